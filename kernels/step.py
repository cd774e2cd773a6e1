"""One time step of all cells: gather, force, implicit solve, survey.

Threads take the cells piece by piece (`sharing`). What a cell does depends on its own box and on
the column sums of the last state only, so the result is the same for any number of threads.
A thread works in padded work arrays (`frames`), which stay in its cache.

A cell whose new field is not finite, or runs away, keeps its old field; its survey tells.
"""

import numpy as np
from numba import prange

from morphosim.kernels._jit import choose, kernel, parallel_kernel
from morphosim.kernels.boxes import (
    BAD,
    GUARD,
    N_SURVEYED,
    TOTAL,
    copy_rows,
    row_total,
    survey,
    widen,
)
from morphosim.kernels.chebyshev import iterate
from morphosim.kernels.columns import gather
from morphosim.kernels.forces import right_hand_side
from morphosim.kernels.frames import (
    band_rows,
    clear,
    clear_row,
    copy_row,
    frame_index,
    load,
    mirror,
    strides,
    unload,
)
from morphosim.kernels.helmholtz import helmholtz_solve
from morphosim.kernels.sharing import offer, turns

PHI, PSI, RHS, HISTORY, START, N_FRAMES = 0, 1, 2, 3, 4, 6
"""A thread's frames; each holds that of the largest box."""


@kernel()
def prepare(
    i, phi, history, boxes, whole, terms, interaction, columns, pairs_start, pair_potential,
    frames, stencil, scheme, half, use_repulsion, use_psi, use_start,
):  # fmt: skip
    """Fill cell i's frames: field, what acts on it, right-hand side, next history and start."""
    clear(i, boxes, whole, frames[PHI])
    load(i, phi, boxes, whole, frames[PHI])
    memory = choose(frames[HISTORY], history)
    if history is not None:
        load(i, history, boxes, whole, memory)
    start = choose(frames[START], use_start)
    if use_start is not None:
        clear(i, boxes, whole, start)
    felt = False
    if use_repulsion is not None:
        felt = columns.felt[i]
        if felt:
            psi = choose(frames[PSI], use_psi)
            gather(
                i, boxes, whole, interaction, columns, pairs_start, pair_potential, frames[PHI],
                frames[RHS], psi,
            )  # fmt: skip
            if whole:
                mirror(i, boxes, frames[PHI])
            right_hand_side(
                i, boxes, whole, terms, terms.drift, frames[PHI], psi, frames[RHS], memory, start,
                stencil, scheme, half, True,
            )  # fmt: skip
    if not felt:
        if whole:
            mirror(i, boxes, frames[PHI])
        right_hand_side(
            i, boxes, whole, terms, terms.drift, frames[PHI], None, frames[RHS], memory, start,
            stencil, scheme, half, None,
        )  # fmt: skip


@kernel()
def settle(i, boxes, found, out, surveys):
    """Take over a survey that found no divergence; return whether it did not."""
    if out[BAD] > 0:
        surveys[i, BAD] = out[BAD]
        return False
    for k in range(N_SURVEYED):
        surveys[i, k] = out[k]
    copy_rows(found, boxes.band, boxes.plane_start[i], boxes.shape[i, 0])
    return True


@kernel()
def accept_box(i, phi, values, boxes, limits, found, out, surveys):
    """Survey the new field of cell i, given as its whole box, and store it; tell if it is sound."""
    nx, ny, nz = boxes.shape[i, 0], boxes.shape[i, 1], boxes.shape[i, 2]
    survey(values, 0, ny * nz, nz, nx, ny, nz, found, True, limits, found, out)
    widen(found, GUARD, nx, ny)
    sound = settle(i, boxes, found, out, surveys)
    if sound:
        copy_row(values, np.uint64(0), phi, np.uint64(boxes.start[i]), nx * ny * nz)
    return sound


@kernel()
def accept_band(i, phi, history, frame, memory, boxes, limits, found, out, surveys, lost):
    """Survey the new field of cell i, given on its band, and store it with its history.

    Rows that leave the band are set to 0; what was there is counted in `lost`.
    """
    nx, ny, nz = boxes.shape[i, 0], boxes.shape[i, 1], boxes.shape[i, 2]
    sx, sy = strides(i, boxes)
    plane = boxes.plane_start[i]
    survey(
        frame, frame_index(0, 0, 0, sx, sy), sx, sy, nx, ny, nz,
        boxes.band[plane : plane + nx], False, limits, found, out,
    )  # fmt: skip
    if out[BAD] == 0:
        widen(found, GUARD, nx, ny)
        for x in range(nx):
            y0, y1 = band_rows(x, i, boxes, False)
            for y in range(y0, y1):
                source = np.uint64(frame_index(x, y, 0, sx, sy))
                goal = np.uint64(boxes.start[i] + (x * ny + y) * nz)
                if found[x, 0] <= y < found[x, 1]:
                    copy_row(frame, source, phi, goal, nz)
                    if history is not None:
                        copy_row(memory, source, history, goal, nz)
                else:
                    dropped = row_total(frame, source, nz)
                    lost[i] += dropped
                    out[TOTAL] -= dropped
                    clear_row(phi, goal, nz)
                    if history is not None:
                        clear_row(history, goal, nz)
    settle(i, boxes, found, out, surveys)


@parallel_kernel()
def step_transform(
    shares, order, phi, history, boxes, terms, interaction, columns, pairs_start, pair_potential,
    work, found, measured, stencil, scheme, first, cosines, limits, surveys, use_repulsion, use_psi,
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
    work : (threads, N_FRAMES, largest frame); found : (threads, longest x axis, 2) int32;
        measured : (threads, N_SURVEYED) float64; all overwritten
    surveys : (N, N_SURVEYED) float64, updated; see `survey`
    use_repulsion, use_psi : True, or None where the scene has no such physics
    """
    offer(shares)
    for worker in prange(shares.threads):
        frames = work[worker]
        for k in turns(shares):
            i = order[k]
            own = first if terms.fresh[i] else scheme
            prepare(
                i, phi, history, boxes, True, terms, interaction, columns, pairs_start,
                pair_potential, frames, stencil, own, limits.half, use_repulsion, use_psi, None,
            )  # fmt: skip
            unload(i, frames[RHS], boxes, frames[START])
            helmholtz_solve(
                frames[START], frames[PSI], frames[PHI],
                boxes.shape[i, 0], boxes.shape[i, 1], boxes.shape[i, 2],
                cosines, own.lhs, terms.gamma[i],
            )  # fmt: skip
            sound = accept_box(
                i, phi, frames[START], boxes, limits, found[worker], measured[worker], surveys
            )
            if sound:
                keep_history(i, history, boxes, frames[HISTORY])


@kernel()
def keep_history(i, history, boxes, frame):
    """Store the next history of cell i."""
    if history is not None:
        unload(i, frame, boxes, history[boxes.start[i] :])


@parallel_kernel()
def step_band(
    shares, order, phi, history, boxes, terms, interaction, columns, pairs_start, pair_potential,
    work, found, measured, stencil, scheme, first, limits, surveys, lost, use_repulsion, use_psi,
):  # fmt: skip
    """Advance every cell of `order` by Chebyshev iterations on the band, or by explicit Euler.

    Parameters as for `step_transform`; `lost` (N,) float64 counts Σ φ of rows that leave the band.
    """
    offer(shares)
    for worker in prange(shares.threads):
        frames = work[worker]
        one = limits.half + limits.half
        for k in turns(shares):
            i = order[k]
            own = first if terms.fresh[i] else scheme
            prepare(
                i, phi, history, boxes, False, terms, interaction, columns, pairs_start,
                pair_potential, frames, stencil, own, limits.half, use_repulsion, use_psi, True,
            )  # fmt: skip
            for s in range(terms.n_iterations[i]):
                source = START if s % 2 == 0 else PHI
                iterate(
                    i, boxes, frames[source], frames[START + PHI - source], frames[RHS], stencil,
                    own.lhs, terms.gamma[i], terms.weights[i, s], one,
                )  # fmt: skip
            result = PHI if terms.n_iterations[i] % 2 else START
            accept_band(
                i, phi, history, frames[result], frames[HISTORY], boxes, limits, found[worker],
                measured[worker], surveys, lost,
            )  # fmt: skip


@parallel_kernel()
def prepare_all(
    shares, order, phi, history, boxes, terms, interaction, columns, pairs_start, pair_potential,
    work, stencil, scheme, first, half, rhs, use_repulsion, use_psi,
):  # fmt: skip
    """Right-hand sides of all cells into the pool `rhs`, for a transform outside of Numba."""
    offer(shares)
    for worker in prange(shares.threads):
        frames = work[worker]
        for k in turns(shares):
            i = order[k]
            own = first if terms.fresh[i] else scheme
            prepare(
                i, phi, history, boxes, True, terms, interaction, columns, pairs_start,
                pair_potential, frames, stencil, own, half, use_repulsion, use_psi, None,
            )  # fmt: skip
            keep_history(i, history, boxes, frames[HISTORY])
            unload(i, frames[RHS], boxes, rhs[boxes.start[i] :])


@parallel_kernel()
def accept_all(shares, order, phi, values, boxes, limits, found, measured, surveys):
    """Survey and store the new fields of all cells, given in the pool `values`."""
    offer(shares)
    for worker in prange(shares.threads):
        for k in turns(shares):
            i = order[k]
            accept_box(
                i, phi, values[boxes.start[i] :], boxes, limits, found[worker], measured[worker],
                surveys,
            )  # fmt: skip
