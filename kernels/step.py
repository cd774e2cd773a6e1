"""One time step of all cells: gather, force, implicit solve, survey.

Threads take the cells piece by piece (`sharing`). What a cell does depends on its own box and on
the column sums of the last state only, so the result is the same for any number of threads.
A thread works in arrays of its own, which stay in its cache: padded ones (`frames`) for what
stencils read, and others in the order of the pools (`rows`).

A cell whose new field is not finite, or runs away, keeps its old field; its survey tells.
"""

import numpy as np
from numba import prange

from morphosim.kernels._jit import choose, kernel, parallel_kernel
from morphosim.kernels.boxes import (
    BAD,
    GUARD,
    TOTAL,
    WANTED,
    keep_survey,
    relay,
    settle_planes,
    stretch_length,
    survey,
    survey_rows,
    survey_stretch,
    widen_planes,
)
from morphosim.kernels.chebyshev import iterate
from morphosim.kernels.columns import gather
from morphosim.kernels.forces import right_hand_side
from morphosim.kernels.frames import clear, copy_row, mirror
from morphosim.kernels.helmholtz import helmholtz_solve
from morphosim.kernels.rows import (
    FRAME,
    STRETCH,
    list_blocks,
    load,
    settle_rows,
    stay,
    widen,
    wipe,
)
from morphosim.kernels.sharing import offer, turns

PHI, PSI, START, N_FRAMES = 0, 1, 2, 4
"""A thread's frames; each holds that of the largest box."""
R, RHS, MEMORY, RESULT, N_STRETCHES = 0, 1, 2, 3, 5
"""A thread's stretches: what the cell feels, right-hand side, next history, and new field."""


@kernel()
def prepare(
    i, phi, history, boxes, whole, blocks, n, terms, interaction, columns, pairs_start,
    pair_potential, frames, stretches, spans, stencil, scheme, half, use_repulsion, use_psi,
    use_start,
):  # fmt: skip
    """Fill cell i's frames of the field and the start, stretches of right-hand side and history."""
    start = choose(frames[START], use_start)
    if whole:
        clear(i, boxes, frames[PHI])
    load(phi, boxes.start[i], blocks, n, frames[PHI])
    memory = choose(stretches[MEMORY], history)
    felt = False
    if use_repulsion is not None:
        felt = columns.felt[i]
        if felt:
            psi = choose(frames[PSI], use_psi)
            gather(
                i, boxes, whole, interaction, columns, pairs_start, pair_potential, frames[PHI],
                stretches[R], psi, spans,
            )  # fmt: skip
            if whole:
                mirror(i, boxes, frames[PHI])
            right_hand_side(
                i, boxes, blocks, n, terms, terms.drift, frames[PHI], psi, stretches[R],
                history, stretches[RHS], memory, start, stencil, scheme, half, True,
            )  # fmt: skip
    if not felt:
        if whole:
            mirror(i, boxes, frames[PHI])
        right_hand_side(
            i, boxes, blocks, n, terms, terms.drift, frames[PHI], None, stretches[R],
            history, stretches[RHS], memory, start, stencil, scheme, half, None,
        )  # fmt: skip


@kernel()
def accept_box(i, phi, values, boxes, limits, found, out, surveys):
    """Survey the new field of cell i, given as its whole box, and store it; tell if it is sound."""
    nx, ny, nz = boxes.shape[i, 0], boxes.shape[i, 1], boxes.shape[i, 2]
    survey(values, nx, ny, nz, limits, found, out)
    if out[BAD] > 0:
        surveys[i, BAD] = out[BAD]
        return False
    widen_planes(found, GUARD, nx, ny)
    settle_planes(i, boxes, found)
    keep_survey(i, out, surveys)
    copy_row(values, np.uint64(0), phi, np.uint64(boxes.start[i]), nx * ny * nz)
    return True


@kernel()
def find_new_band(i, values, boxes, room, limits, spans, out):
    """Survey the new field of cell i, given as its stretch, and find its new band in `spans`.

    The band stays as it is where the new one does not fit into the `room` of the cell in the pools.
    """
    survey_stretch(values, 0, stretch_length(i, boxes, False), limits, out)
    if out[BAD] > 0:
        return
    survey_rows(i, boxes, values, 0, limits, spans, out)
    out[WANTED] = widen(i, boxes, spans)
    if out[WANTED] > room:
        stay(i, boxes, spans)


@kernel()
def accept_band(
    i, phi, history, values, memory, boxes, room, limits, spans, out, surveys, lost
):  # fmt: skip
    """Survey the new field of cell i, given as its stretch, and store it with its history.

    What leaves the band is counted in `lost`.
    """
    find_new_band(i, values, boxes, room, limits, spans, out)
    if out[BAD] > 0:
        surveys[i, BAD] = out[BAD]
        return
    dropped = relay(i, boxes, spans, values, phi)
    if history is not None:
        relay(i, boxes, spans, memory, history)
    settle_rows(i, boxes, spans)
    lost[i] += dropped
    out[TOTAL] -= dropped
    keep_survey(i, out, surveys)


@parallel_kernel()
def step_transform(
    shares, order, phi, history, boxes, terms, interaction, columns, pairs_start, pair_potential,
    work, stencil, scheme, first, cosines, limits, surveys, use_repulsion, use_psi,
):  # fmt: skip
    """Advance every cell of `order` by Eq. 6, 8 or 9, solved in each box by cosine transforms.

    Parameters
    ----------
    shares : Shares of `order`
    order : cells that are stepped
    phi, history : 1-D pools, updated; history is None for a scheme without memory
    boxes, terms, interaction, columns, stencil, cosines, limits : see `layout`
    scheme, first : Scheme, of cells with history and of those without
    pairs_start, pair_potential : see `gather`, or None
    work : Room
    surveys : (N, N_SURVEYED) float64, updated; see `survey`
    use_repulsion, use_psi : True, or None where the scene has no such physics
    """
    offer(shares)
    for worker in prange(shares.threads):
        frames, stretches, blocks = work.frames[worker], work.stretches[worker], work.blocks[worker]
        for k in turns(shares):
            i = order[k]
            own = first if terms.fresh[i] else scheme
            n = list_blocks(i, boxes, True, blocks)
            prepare(
                i, phi, history, boxes, True, blocks, n, terms, interaction, columns, pairs_start,
                pair_potential, frames, stretches, work.spans[worker], stencil, own,
                limits.half, use_repulsion, use_psi, None,
            )  # fmt: skip
            helmholtz_solve(
                stretches[RHS], frames[PSI], frames[PHI],
                boxes.shape[i, 0], boxes.shape[i, 1], boxes.shape[i, 2],
                cosines, own.lhs, terms.gamma[i],
            )  # fmt: skip
            sound = accept_box(
                i, phi, stretches[RHS], boxes, limits, work.found[worker], work.measured[worker],
                surveys,
            )  # fmt: skip
            if sound and history is not None:
                keep_history(i, history, boxes, stretches[MEMORY])


@kernel()
def keep_history(i, history, boxes, values):
    """Store the next history of cell i, whose box is kept whole."""
    count = stretch_length(i, boxes, True)
    copy_row(values, np.uint64(0), history, np.uint64(boxes.start[i]), count)


@parallel_kernel()
def step_band(
    shares, order, phi, history, boxes, terms, interaction, columns, pairs_start, pair_potential,
    work, room, stencil, scheme, first, limits, surveys, lost, use_repulsion, use_psi,
):  # fmt: skip
    """Advance every cell of `order` by Chebyshev iterations on the band, or by explicit Euler.

    Parameters as for `step_transform`; `room` (N,) is what cells have in the pools, and `lost` (N,)
    float64 counts Σ φ of what leaves the band.
    """
    offer(shares)
    for worker in prange(shares.threads):
        frames, stretches, blocks = work.frames[worker], work.stretches[worker], work.blocks[worker]
        spans, one = work.spans[worker], limits.half + limits.half
        for k in turns(shares):
            i = order[k]
            own = first if terms.fresh[i] else scheme
            n, last = list_blocks(i, boxes, False, blocks), terms.n_iterations[i] - 1
            prepare(
                i, phi, history, boxes, False, blocks, n, terms, interaction, columns, pairs_start,
                pair_potential, frames, stretches, spans, stencil, own, limits.half, use_repulsion,
                use_psi, True,
            )  # fmt: skip
            for s in range(last + 1):
                source = START if s % 2 == 0 else PHI
                target, where = frames[START + PHI - source], FRAME
                if s == last:
                    target, where = stretches[RESULT], STRETCH
                iterate(
                    i, boxes, blocks, n, where, frames[source], target, stretches[RHS], stencil,
                    own.lhs, terms.gamma[i], terms.weights[i, s], one,
                )  # fmt: skip
            wipe(blocks, n, frames[PHI])
            wipe(blocks, n, frames[START])
            accept_band(
                i, phi, history, stretches[RESULT], stretches[MEMORY], boxes, room[i], limits,
                spans, work.measured[worker], surveys, lost,
            )  # fmt: skip


@parallel_kernel()
def prepare_all(
    shares, order, phi, history, boxes, terms, interaction, columns, pairs_start, pair_potential,
    work, stencil, scheme, first, half, rhs, use_repulsion, use_psi,
):  # fmt: skip
    """Right-hand sides of all cells into the pool `rhs`, for a transform outside of Numba."""
    offer(shares)
    for worker in prange(shares.threads):
        stretches, blocks = work.stretches[worker], work.blocks[worker]
        for k in turns(shares):
            i = order[k]
            own = first if terms.fresh[i] else scheme
            n = list_blocks(i, boxes, True, blocks)
            prepare(
                i, phi, history, boxes, True, blocks, n, terms, interaction, columns, pairs_start,
                pair_potential, work.frames[worker], stretches, work.spans[worker],
                stencil, own, half, use_repulsion, use_psi, None,
            )  # fmt: skip
            if history is not None:
                keep_history(i, history, boxes, stretches[MEMORY])
            count = stretch_length(i, boxes, True)
            copy_row(stretches[RHS], np.uint64(0), rhs, np.uint64(boxes.start[i]), count)


@parallel_kernel()
def accept_all(shares, order, phi, values, boxes, limits, work, surveys):
    """Survey and store the new fields of all cells, given in the pool `values`."""
    offer(shares)
    for worker in prange(shares.threads):
        for k in turns(shares):
            i = order[k]
            accept_box(
                i, phi, values[boxes.start[i] :], boxes, limits, work.found[worker],
                work.measured[worker], surveys,
            )  # fmt: skip
