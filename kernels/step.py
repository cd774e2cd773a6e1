"""One time step of all cells: gather, force, implicit solve, survey.

Work is shared out as lists of cells, one list per thread. What a cell does depends on its own box
and on the tile sums of the last state only, so the result is the same for any number of threads.

A cell whose new field is not finite, or runs away, keeps its old field; its survey tells.
"""

from numba import prange

from morphosim.kernels._jit import kernel, parallel_kernel
from morphosim.kernels.boxes import survey
from morphosim.kernels.forces import right_hand_side
from morphosim.kernels.helmholtz import helmholtz_solve, laplacian
from morphosim.kernels.tiles import gather

REPULSION, PSI, WORK, OTHER, N_WORK = 0, 1, 2, 3, 4
"""Rows of a thread's work space; each holds the largest box."""


@kernel()
def box_size(i, boxes):
    """Number of lattice points in cell i's box."""
    return boxes.shape[i, 0] * boxes.shape[i, 1] * boxes.shape[i, 2]


@kernel()
def prepare(
    i, phi, history, boxes, terms, interaction, tiles, pair_potential, repulsion, psi,
    force, rhs, stencil, scheme, half,
):  # fmt: skip
    """Gather what acts on cell i, then fill its right-hand side."""
    if repulsion is not None:
        gather(i, phi, boxes, interaction, tiles, pair_potential, repulsion, psi)
    right_hand_side(
        i, phi, history, boxes, terms, terms.drift, repulsion, psi, force, rhs,
        stencil, scheme, half,
    )  # fmt: skip


@kernel()
def accept(i, phi, values, boxes, limits, surveys):
    """Survey the new field of cell i and store it; a field that diverges is only counted."""
    first = boxes.start[i]
    nx, ny, nz = boxes.shape[i, 0], boxes.shape[i, 1], boxes.shape[i, 2]
    survey(
        values, 0, nx, ny, nz, limits.tolerance, limits.runaway, limits.half,
        boxes.spans, boxes.row_start[i], surveys[i],
    )  # fmt: skip
    bad = surveys[i, 3]
    if bad == 0:
        size = nx * ny * nz
        phi[first : first + size] = values[:size]
    else:
        survey(
            phi, first, nx, ny, nz, limits.tolerance, limits.runaway, limits.half,
            boxes.spans, boxes.row_start[i], surveys[i],
        )  # fmt: skip
        surveys[i, 3] = bad


@parallel_kernel()
def step_implicit(
    bounds, order, phi, history, boxes, terms, interaction, tiles, pair_potential,
    work, force, stencil, scheme, cosines, limits, surveys, use_repulsion, use_psi,
):  # fmt: skip
    """Advance every cell of `order` by Eq. 6, 8 or 9, as `scheme` says.

    Parameters
    ----------
    bounds : (threads + 1,) ranges of `order`, one per thread
    order : cells, grouped by thread
    phi, history : 1-D pools, updated; history is None for a scheme without memory
    boxes, terms, interaction, tiles, stencil, scheme, cosines, limits : see `layout`
    pair_potential : 1-D pool, or None
    work : (threads, N_WORK, largest box); force : (threads, longest row)
    surveys : (N, 5) float64, overwritten; see `survey`
    use_repulsion, use_psi : True, or None where the scene has no such physics
    """
    for worker in prange(bounds.shape[0] - 1):
        rhs = work[worker, WORK]
        repulsion = choose(work[worker, REPULSION], use_repulsion)
        psi = choose(work[worker, PSI], use_psi)
        for k in range(bounds[worker], bounds[worker + 1]):
            i = order[k]
            prepare(
                i, phi, history, boxes, terms, interaction, tiles, pair_potential,
                repulsion, psi, force[worker], rhs, stencil, scheme, limits.half,
            )  # fmt: skip
            helmholtz_solve(
                rhs, work[worker, OTHER], work[worker, REPULSION],
                boxes.shape[i, 0], boxes.shape[i, 1], boxes.shape[i, 2],
                cosines, scheme.lhs, terms.gamma[i],
            )  # fmt: skip
            accept(i, phi, rhs, boxes, limits, surveys)


@parallel_kernel()
def step_explicit(
    bounds, order, phi, boxes, terms, interaction, tiles, pair_potential,
    work, force, stencil, scheme, cosines, limits, surveys, use_repulsion, use_psi,
):  # fmt: skip
    """Advance every cell of `order` by explicit Euler: φ + (δt/τ) (F + γΔφ).

    Parameters as for `step_implicit`; the scheme has a0 = 1 and a1 = δt/τ.
    """
    for worker in prange(bounds.shape[0] - 1):
        rhs = work[worker, WORK]
        diffusion = work[worker, PSI]
        other = work[worker, OTHER]
        repulsion = choose(work[worker, REPULSION], use_repulsion)
        psi = choose(work[worker, PSI], use_psi)
        for k in range(bounds[worker], bounds[worker + 1]):
            i = order[k]
            prepare(
                i, phi, None, boxes, terms, interaction, tiles, pair_potential,
                repulsion, psi, force[worker], rhs, stencil, scheme, limits.half,
            )  # fmt: skip
            size = box_size(i, boxes)
            diffusion[:size] = phi[boxes.start[i] : boxes.start[i] + size]
            laplacian(
                diffusion, other, work[worker, REPULSION],
                boxes.shape[i, 0], boxes.shape[i, 1], boxes.shape[i, 2], cosines, terms.gamma[i],
            )  # fmt: skip
            for p in range(size):
                rhs[p] += scheme.a1 * diffusion[p]
            accept(i, phi, rhs, boxes, limits, surveys)


@parallel_kernel()
def prepare_all(
    bounds, order, phi, history, boxes, terms, interaction, tiles, pair_potential,
    work, force, stencil, scheme, half, rhs, use_repulsion, use_psi,
):  # fmt: skip
    """Right-hand sides of all cells into the pool `rhs`, for a transform outside of Numba."""
    for worker in prange(bounds.shape[0] - 1):
        repulsion = choose(work[worker, REPULSION], use_repulsion)
        psi = choose(work[worker, PSI], use_psi)
        for k in range(bounds[worker], bounds[worker + 1]):
            i = order[k]
            first = boxes.start[i]
            prepare(
                i, phi, history, boxes, terms, interaction, tiles, pair_potential, repulsion,
                psi, force[worker], rhs[first : first + box_size(i, boxes)],
                stencil, scheme, half,
            )  # fmt: skip


@parallel_kernel()
def accept_all(bounds, order, phi, values, boxes, limits, surveys):
    """Survey and store the new fields of all cells, given in the pool `values`."""
    for worker in prange(bounds.shape[0] - 1):
        for k in range(bounds[worker], bounds[worker + 1]):
            i = order[k]
            first = boxes.start[i]
            accept(i, phi, values[first : first + box_size(i, boxes)], boxes, limits, surveys)


@kernel()
def choose(array, use):
    """`array`, or None where `use` is None: decided when the kernel is compiled."""
    if use is None:
        return None
    return array
