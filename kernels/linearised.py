"""The linearly implicit step on the narrow band (scheme "linearised").

Forces are taken at the extrapolation φ* = φⁿ + r (φⁿ - φⁿ⁻¹), r = δt / δtⁿ, and linearised about it
where their derivative is local. With u = φⁿ⁺¹ - φ* and backward differences of second order

    (lhs + D - (γ + s) Δ) u = F(φ*) + γ Δφ* - τ/δt (φ* - φⁿ) - q |∇φ*|
    lhs = τ/δt (1 + 2r) / (1 + r),    D = γ c W''(φ*) + R

R is the repulsion by other cells and walls, and s the stabilisation of what stays explicit. The
pressure follows the new volume, p(∫ φ* + ∫ u): q = - p' ∫ u, where ∫ u is the solution of the
equation's integral for u along |∇φ*|, as that of a moving interface is.

The iterations are those of `chebyshev`, whose diagonal varies here. They begin with u = 0.

A step is tried (`try_steps`), which changes no field, and then taken (`take_steps`), or tried again
with another δt, for which φ* is laid elsewhere on the same line (`stretch`).
"""

import numpy as np
from numba import prange

from morphosim.kernels._jit import choose, entry, inline_kernel, kernel, parallel_kernel, times
from morphosim.kernels.boxes import (
    BAD,
    PART,
    TOTAL,
    keep_survey,
    relay,
    row_total,
    stretch_length,
)
from morphosim.kernels.columns import gather
from morphosim.kernels.forces import force, gradient
from morphosim.kernels.frames import copy_row, strides
from morphosim.kernels.points import begin_of_block, feels
from morphosim.kernels.rows import (
    BLOCK,
    FRAME,
    NEW_HIGH,
    NEW_LOW,
    STRETCH,
    copy_block,
    list_blocks,
    listed,
    load,
    row_number,
    settle_rows,
    wipe,
    write_block,
)
from morphosim.kernels.sharing import offer, turns
from morphosim.kernels.stencils import weighted_neighbours
from morphosim.kernels.step import find_new_band

PHI, PSI, U, V = 0, 1, 2, 3
"""A thread's frames; the iterations go from one of the last two to the other."""
R, RHS, SLOPE, DAMPING, RESULT = 0, 1, 2, 3, 4
"""A thread's stretches; R serves for the right-hand side when it has been read."""
MISSED, MOVED, SQUARE, N_CHANGES = 0, 1, 2, 3
"""What a tried step tells of each cell: Σ u², Σ (φⁿ⁺¹ - φⁿ)² and Σ |∇φ*|²."""


@kernel()
def blocks_residual(
    blocks, n, first, phi, psi, repulsion, last, rhs, slopes, damping, sx, sy, stencil, rate, well,
    half, pressure, dx, dy, dz, i, origin, use_repulsion, mobility, points,
):  # fmt: skip
    """F - τ/δt (φ* - φⁿ), |∇φ*| and D of the blocks given; the cell begins at `first` in `last`."""
    three = half + half + half + half + half + half
    for k in range(n):
        at, place = np.uint64(blocks[FRAME, k]), np.uint64(blocks[STRETCH, k])
        before = np.uint64(first + blocks[STRETCH, k])
        begin = begin_of_block(points, i, origin, at, sx, sy)
        for j in range(np.uint64(BLOCK)):
            p, q = at + j, place + j
            value = phi[p]
            gx, gy, gz = gradient(phi, p, sx, sy, stencil)
            slope = np.sqrt(gx * gx + gy * gy + gz * gz)
            total = force(
                phi, gx, gy, gz, slope, psi, repulsion, p, q, sx, sy, stencil, well, half, pressure,
                dx, dy, dz, points, i, begin, j, use_repulsion,
            )  # fmt: skip
            local = well * (half - three * (value - value * value))
            if use_repulsion is not None:
                local += repulsion[q]
            if mobility is not None:
                total *= mobility
                local *= mobility
            rhs[q] = total - rate * (value - last[before + j])
            slopes[q] = slope
            damping[q] = local


@kernel()
def sums_of(count, rhs, slopes, damping, sums):
    """Σ of the right-hand side, of |∇φ*|, of D |∇φ*| and of |∇φ*|²: the first four of `sums`."""
    sums[:4] = 0.0
    zero = rhs.dtype.type(0)
    for at in range(0, count, PART):
        a, b, c, d = zero, zero, zero, zero
        for q in range(np.uint64(at), np.uint64(min(at + PART, count))):
            slope = slopes[q]
            a += rhs[q]
            b += slope
            c += damping[q] * slope
            d += slope * slope
        sums[0] += a
        sums[1] += b
        sums[2] += c
        sums[3] += d


@kernel()
def residual(
    i, boxes, terms, blocks, n, frames, psi, stretches, phi, stencil, rate, half, sums,
    use_repulsion,
):  # fmt: skip
    """Right-hand side but for γΔφ* and q, |∇φ*| and D of cell i, and their `sums_of`."""
    sx, sy = strides(i, boxes)
    dx, dy, dz = entry(terms.drift, i, 0), entry(terms.drift, i, 1), entry(terms.drift, i, 2)
    given = (
        blocks, n, boxes.start[i], frames[PHI], psi, stretches[R], phi, stretches[RHS],
        stretches[SLOPE], stretches[DAMPING], np.uint64(sx), np.uint64(sy), stencil, rate,
        terms.well[i], half, terms.pressure[i], dx, dy, dz, i, boxes.origin, use_repulsion,
        entry(terms.mobility, i, 0),
    )  # fmt: skip
    if feels(terms.points, i):
        blocks_residual(*given, terms.points)
    else:
        blocks_residual(*given, None)
    sums_of(
        stretch_length(i, boxes, False), stretches[RHS], stretches[SLOPE], stretches[DAMPING], sums
    )


@kernel()
def begin_blocks(blocks, n, phi, rhs, slopes, whole, u, sx, sy, l0, l1, l2, l3, q, weight):
    """Add γΔφ* and take off q |∇φ*|, into `whole`, and make the first iteration.

    γ is in the weights, and 3 in `l0`.
    """
    sz = np.uint64(1)
    for k in range(n):
        at, place = np.uint64(blocks[FRAME, k]), np.uint64(blocks[STRETCH, k])
        for j in range(np.uint64(BLOCK)):
            around = weighted_neighbours(phi, at + j, sx, sy, sz, l1, l2, l3)
            total = rhs[place + j] + l0 * phi[at + j] + around - q * slopes[place + j]
            whole[place + j] = total
            u[at + j] = weight * total


@inline_kernel()
def iterate_blocks(blocks, n, u, target, rhs, damping, sx, sy, own, weight, d1, d2, d3):
    """One iteration; `own` is 1 - ω (lhs - 3 (γ + s) l0), and ω (γ + s) is in `d1` to `d3`."""
    sz = np.uint64(1)
    for k in range(n):
        at, place = np.uint64(blocks[FRAME, k]), np.uint64(blocks[STRETCH, k])
        for j in range(np.uint64(BLOCK)):
            p, r = at + j, place + j
            around = weighted_neighbours(u, p, sx, sy, sz, d1, d2, d3)
            target[p] = around + own * u[p] + weight * (rhs[r] - damping[r] * u[p])


@inline_kernel()
def solve(i, boxes, terms, blocks, n, frames, stretches, stencil, inner, lhs, spread, q, one):
    """U of cell i by Chebyshev iterations; return the frame that holds it."""
    sx, sy = strides(i, boxes)
    ux, uy, gamma = np.uint64(sx), np.uint64(sy), terms.gamma[i]
    begin_blocks(
        blocks, n, frames[PHI], stretches[RHS], stretches[SLOPE], stretches[R], frames[U], ux, uy,
        (gamma + gamma + gamma) * stencil.l0, gamma * stencil.l1, times(gamma, stencil.l2),
        times(gamma, stencil.l3), q, terms.weights[i, 0],
    )  # fmt: skip
    source = U
    for s in range(1, terms.n_iterations[i]):
        weight = terms.weights[i, s]
        diffusion = weight * (gamma + spread)
        own = one - weight * lhs + (diffusion + diffusion + diffusion) * inner.l0
        iterate_blocks(
            blocks, n, frames[source], frames[U + V - source], stretches[R], stretches[DAMPING], ux,
            uy, own, weight, diffusion * inner.l1, times(diffusion, inner.l2),
            times(diffusion, inner.l3),
        )  # fmt: skip
        source = U + V - source
    return source


@kernel()
def add_prediction(blocks, n, frame, phi, result, u):
    """Add φ* to u, given in `frame`, and copy u: both into stretches."""
    one = phi.dtype.type(1)
    for k in range(n):
        at, place = blocks[FRAME, k], blocks[STRETCH, k]
        write_block(result, place, one, phi, at, one, frame, at, 1)
        copy_block(frame, at, u, place)


@kernel()
def changes_of(count, first, result, u, last):
    """Σ u² and Σ (φⁿ⁺¹ - φⁿ)² of a cell whose field begins at `first` in `last`."""
    missed = moved = 0.0
    zero = result.dtype.type(0)
    for at in range(0, count, PART):
        sum_missed, sum_moved = zero, zero
        for r in range(np.uint64(at), np.uint64(min(at + PART, count))):
            change = result[r] - last[np.uint64(first) + r]
            sum_missed += u[r] * u[r]
            sum_moved += change * change
        missed += sum_missed
        moved += sum_moved
    return missed, moved


@kernel()
def keep(i, values, boxes, room, limits, new, low, high, spans, found):
    """Survey the new field of cell i, given as its stretch, and keep field, survey and band.

    The band goes into lists `low` and `high` as those of `Boxes`.
    """
    find_new_band(i, values, boxes, room, limits, spans, found)
    count, ny = stretch_length(i, boxes, False), boxes.shape[i, 1]
    copy_row(values, np.uint64(0), new, np.uint64(boxes.start[i]), count)
    if found[BAD] > 0:
        return
    for x in range(boxes.shape[i, 0]):
        row, source = row_number(x, 0, i, boxes), listed(x, 0, ny)
        for y in range(ny):
            low[row + y], high[row + y] = spans[NEW_LOW, source + y], spans[NEW_HIGH, source + y]


@inline_kernel(overlapping=True)
def try_step(
    i, phi, ahead, boxes, terms, interaction, columns, pairs_start, pair_potential, frames,
    stretches, blocks, spans, sums, stencil, inner, linear, half, changes, use_repulsion, use_psi,
):  # fmt: skip
    """Solve for the new field of cell i, into the stretch `RESULT`."""
    n = list_blocks(i, boxes, False, blocks)
    load(ahead, boxes.start[i], blocks, n, frames[PHI])
    felt = False
    if use_repulsion is not None:
        felt = columns.felt[i]
        if felt:
            psi = choose(frames[PSI], use_psi)
            gather(
                i, boxes, False, interaction, columns, pairs_start, pair_potential, frames[PHI],
                stretches[R], psi, spans,
            )  # fmt: skip
            residual(
                i, boxes, terms, blocks, n, frames, psi, stretches, phi, stencil, linear.rate, half,
                sums, True,
            )  # fmt: skip
    if not felt:
        residual(
            i, boxes, terms, blocks, n, frames, None, stretches, phi, stencil, linear.rate, half,
            sums, None,
        )  # fmt: skip
    stiff, slope = linear.stiffness[i], sums[1]
    implicit = linear.lhs[i] * slope + sums[2] + stiff * slope * slope
    q = frames.dtype.type(stiff * sums[0] * slope / implicit if implicit > 0 else 0.0)
    source = solve(
        i, boxes, terms, blocks, n, frames, stretches, stencil, inner, linear.lhs[i], linear.spread,
        q, half + half,
    )  # fmt: skip
    changes[i, SQUARE] = sums[3]
    add_prediction(blocks, n, frames[source], frames[PHI], stretches[RESULT], stretches[SLOPE])
    changes[i, MISSED], changes[i, MOVED] = changes_of(
        stretch_length(i, boxes, False), boxes.start[i], stretches[RESULT], stretches[SLOPE], phi
    )
    wipe(blocks, n, frames[PHI])
    wipe(blocks, n, frames[U])
    wipe(blocks, n, frames[V])


@parallel_kernel(overlapping=True)
def try_steps(
    shares, order, phi, ahead, boxes, terms, interaction, columns, pairs_start, pair_potential,
    work, room, stencil, inner, linear, limits, new, low, high, surveys, changes, use_repulsion,
    use_psi,
):  # fmt: skip
    """Solve for the new field of every cell of `order`.

    Parameters as for `step_band`, but

    phi, ahead : 1-D pools of φⁿ and φ*; the latter is what cells feel of each other in `columns`
    inner : Stencil, of the iterations
    linear : Linearisation
    new : 1-D pool, overwritten with φⁿ⁺¹ on the bands; it may be `ahead`
    low, high : (rows,) int16, overwritten with the new bands
    surveys : (N, N_SURVEYED), overwritten
    changes : (N, N_CHANGES) float64, overwritten
    """
    offer(shares)
    for worker in prange(shares.threads):
        frames, stretches = work.frames[worker], work.stretches[worker]
        blocks, spans = work.blocks[worker], work.spans[worker]
        for k in turns(shares):
            i = order[k]
            try_step(
                i, phi, ahead, boxes, terms, interaction, columns, pairs_start, pair_potential,
                frames, stretches, blocks, spans, work.measured[worker], stencil, inner, linear,
                limits.half, changes, use_repulsion, use_psi,
            )  # fmt: skip
            keep(i, stretches[RESULT], boxes, room[i], limits, new, low, high, spans, surveys[i])


@kernel(overlapping=True)
def advance(new, phi, first, count, growth, values, extrapolated):
    """φⁿ⁺¹ and its extrapolation as stretches, of pools in which the cell begins at `first`."""
    for k in range(np.uint64(count)):
        value = new[np.uint64(first) + k]
        values[k] = value
        extrapolated[k] = value + growth * (value - phi[np.uint64(first) + k])


@kernel()
def list_new_spans(i, boxes, low, high, spans):
    """Write a band from lists `low` and `high` as those of `Boxes` into NEW_LOW and NEW_HIGH."""
    ny = boxes.shape[i, 1]
    for x in range(boxes.shape[i, 0]):
        row, goal = row_number(x, 0, i, boxes), listed(x, 0, ny)
        for y in range(ny):
            spans[NEW_LOW, goal + y], spans[NEW_HIGH, goal + y] = low[row + y], high[row + y]


@kernel(overlapping=True)
def take_step(
    i, new, phi, ahead, growth, boxes, low, high, found, surveys, lost, totals, stretches, spans
):  # fmt: skip
    """Take the step that was tried for cell i."""
    if found[BAD] > 0:
        surveys[i, BAD] = found[BAD]
        return
    count, first = stretch_length(i, boxes, False), boxes.start[i]
    advance(new, phi, first, count, growth, stretches[R], stretches[RHS])
    list_new_spans(i, boxes, low, high, spans)
    dropped = relay(i, boxes, spans, stretches[R], phi)
    relay(i, boxes, spans, stretches[RHS], ahead)
    settle_rows(i, boxes, spans)
    keep_survey(i, found, surveys)
    surveys[i, TOTAL] -= dropped
    lost[i] += dropped
    totals[i] = stretch_total(i, boxes, ahead)


@kernel()
def stretch_total(i, boxes, values):
    """Σ over cell i's stretch in a pool."""
    count, total = stretch_length(i, boxes, False), 0.0
    for at in range(0, count, PART):
        total += row_total(values, np.uint64(boxes.start[i] + at), min(PART, count - at))
    return total


@parallel_kernel(overlapping=True)
def take_steps(
    shares, order, new, phi, ahead, growth, boxes, low, high, found, surveys, lost, totals, work
):  # fmt: skip
    """Take the steps that were tried, and extrapolate to the next.

    What leaves the band is counted in `lost`. A cell whose new field is not finite, or runs away,
    keeps its old field.

    Parameters
    ----------
    shares, order, boxes, work : as for `try_steps`
    new, low, high, found : what that has written: fields, bands and surveys
    phi, ahead : 1-D pools of φⁿ and φ*, updated
    growth : r of the next step
    surveys, lost : (N, N_SURVEYED) and (N,) float64, updated
    totals : (N,) float64, overwritten with Σ φ*
    """
    offer(shares)
    for worker in prange(shares.threads):
        for k in turns(shares):
            i = order[k]
            take_step(
                i, new, phi, ahead, growth, boxes, low, high, found[i], surveys, lost, totals,
                work.stretches[worker], work.spans[worker],
            )  # fmt: skip


@parallel_kernel()
def stretch(shares, order, phi, ahead, share, boxes, totals):
    """Lay φ* to φⁿ + share (φ* - φⁿ), for a step of another length.

    Parameters as for `take_steps`; `share` is the new δt in those of the old.
    """
    offer(shares)
    for _ in prange(shares.threads):
        for k in turns(shares):
            i = order[k]
            first = np.uint64(boxes.start[i])
            for p in range(first, first + np.uint64(stretch_length(i, boxes, False))):
                ahead[p] = phi[p] + share * (ahead[p] - phi[p])
            totals[i] = stretch_total(i, boxes, ahead)
