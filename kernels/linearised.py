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
    GUARD,
    N_SURVEYED,
    TOTAL,
    copy_rows,
    row_total,
    survey,
    widen,
)
from morphosim.kernels.columns import gather
from morphosim.kernels.forces import force, gradient
from morphosim.kernels.frames import (
    band_rows,
    clear,
    clear_row,
    copy_row,
    frame_index,
    load,
    run,
    strides,
)
from morphosim.kernels.sharing import offer, turns
from morphosim.kernels.stencils import weighted_neighbours

PHI, PSI, RHS, LAST, U, DAMPING = 0, 1, 2, 3, 4, 5
"""A thread's frames. When ψ has been read, its frame serves the iterations."""
MISSED, MOVED, SLOPE, N_CHANGES = 0, 1, 2, 3
"""What a tried step tells of each cell: Σ u², Σ (φⁿ⁺¹ - φⁿ)² and Σ |∇φ*|²."""


@kernel()
def plane_residual(
    low, high, phi, psi, rhs, last, slopes, damping, sx, sy, stencil, rate, well, half,
    pressure, dx, dy, dz, points, i, use_repulsion, mobility,
):  # fmt: skip
    """F - τ/δt (φ* - φⁿ), |∇φ*| and D along one run of the frames, and sums of them."""
    zero = half - half
    three = half + half + half + half + half + half
    sum_residual, sum_slope, sum_damped, sum_square = zero, zero, zero, zero
    for p in range(low, high):
        value = phi[p]
        gx, gy, gz = gradient(phi, p, sx, sy, stencil)
        square = gx * gx + gy * gy + gz * gz
        slope = np.sqrt(square)
        total = force(
            phi, gx, gy, gz, slope, psi, rhs, p, sx, sy, stencil, well, half, pressure, dx, dy, dz,
            points, i, use_repulsion,
        )  # fmt: skip
        local = well * (half - three * (value - value * value))
        if use_repulsion is not None:
            local += rhs[p]
        if mobility is not None:
            total *= mobility
            local *= mobility
        total -= rate * (value - last[p])
        sum_residual += total
        sum_slope += slope
        sum_square += square
        sum_damped += local * slope
        damping[p] = local
        slopes[p] = slope
        rhs[p] = total
    return sum_residual, sum_slope, sum_damped, sum_square


@kernel()
def add_diffusion(low, high, phi, rhs, sx, sy, l0, l1, l2, l3):
    """Add γΔφ along one run of the frames; γ is in the weights, and 3 in `l0`."""
    sz = np.uint64(1)
    for p in range(low, high):
        rhs[p] += l0 * phi[p] + weighted_neighbours(phi, p, sx, sy, sz, l1, l2, l3)


@kernel()
def residual(i, boxes, terms, frames, psi, stencil, rate, half, sums, use_repulsion):
    """Right-hand side but for q, |∇φ*| and D of cell i, into frames RHS, U and DAMPING.

    The frame RHS has R. The first four of `sums` are overwritten with Σ (F - τ/δt (φ* - φⁿ)),
    Σ |∇φ*|, Σ D |∇φ*| and Σ |∇φ*|².
    """
    sx, sy = strides(i, boxes)
    drift, gamma = terms.drift, terms.gamma[i]
    dx, dy, dz = entry(drift, i, 0), entry(drift, i, 1), entry(drift, i, 2)
    l0, l1 = (gamma + gamma + gamma) * stencil.l0, gamma * stencil.l1
    l2, l3 = times(gamma, stencil.l2), times(gamma, stencil.l3)
    sums[:4] = 0.0
    for x in range(boxes.shape[i, 0]):
        low, high = run(x, i, boxes, False, sx, sy)
        a, b, c, d = plane_residual(
            low, high, frames[PHI], psi, frames[RHS], frames[LAST], frames[U], frames[DAMPING],
            np.uint64(sx), np.uint64(sy), stencil, rate, terms.well[i], half,
            terms.pressure[i], dx, dy, dz, terms.points, i, use_repulsion,
            entry(terms.mobility, i, 0),
        )  # fmt: skip
        sums[0] += a
        sums[1] += b
        sums[2] += c
        sums[3] += d
        add_diffusion(
            low, high, frames[PHI], frames[RHS], np.uint64(sx), np.uint64(sy), l0, l1, l2, l3
        )


@kernel()
def begin_plane(low, high, rhs, u, q, weight):
    """Take off q |∇φ*|, and make the first iteration, along one run of the frames."""
    for p in range(low, high):
        rhs[p] -= q * u[p]
        u[p] = weight * rhs[p]


@kernel()
def iterate_plane(low, high, u, target, rhs, damping, sx, sy, own, diffusion, weight, stencil):
    """One iteration along one run; `own` is 1 - ω (lhs - 3 (γ + s) l0), `diffusion` ω (γ + s)."""
    sz = np.uint64(1)
    for p in range(low, high):
        around = weighted_neighbours(u, p, sx, sy, sz, stencil.l1, stencil.l2, stencil.l3)
        target[p] = weight * rhs[p] + (own - weight * damping[p]) * u[p] + diffusion * around


@kernel()
def solve(i, boxes, terms, frames, stencil, lhs, spread, q, one):
    """U of cell i by Chebyshev iterations; return the frame that holds it."""
    sx, sy = strides(i, boxes)
    for x in range(boxes.shape[i, 0]):
        low, high = run(x, i, boxes, False, sx, sy)
        begin_plane(low, high, frames[RHS], frames[U], q, terms.weights[i, 0])
    clear(i, boxes, False, frames[PSI])
    source = U
    for s in range(1, terms.n_iterations[i]):
        weight = terms.weights[i, s]
        diffusion = weight * (terms.gamma[i] + spread)
        own = one - weight * lhs + (diffusion + diffusion + diffusion) * stencil.l0
        for x in range(boxes.shape[i, 0]):
            low, high = run(x, i, boxes, False, sx, sy)
            iterate_plane(
                low, high, frames[source], frames[U + PSI - source], frames[RHS], frames[DAMPING],
                np.uint64(sx), np.uint64(sy), own, diffusion, weight, stencil,
            )  # fmt: skip
        source = U + PSI - source
    return source


@kernel()
def add_prediction(i, boxes, frame, phi, last):
    """Add φ* to u, given in `frame`, on the band of cell i; return Σ u² and Σ (φⁿ⁺¹ - φⁿ)²."""
    sx, sy = strides(i, boxes)
    missed = moved = 0.0
    zero = frame.dtype.type(0)
    for x in range(boxes.shape[i, 0]):
        low, high = run(x, i, boxes, False, sx, sy)
        sum_missed, sum_moved = zero, zero
        for p in range(low, high):
            u = frame[p]
            value = phi[p] + u
            change = value - last[p]
            frame[p] = value
            sum_missed += u * u
            sum_moved += change * change
        missed += sum_missed
        moved += sum_moved
    return missed, moved


@kernel()
def keep(i, frame, boxes, limits, found, new, rows, survey_of):
    """Survey the new field of cell i, given on its band, and keep field, survey and band."""
    nx, ny, nz = boxes.shape[i, 0], boxes.shape[i, 1], boxes.shape[i, 2]
    sx, sy = strides(i, boxes)
    plane = boxes.plane_start[i]
    survey(
        frame, frame_index(0, 0, 0, sx, sy), sx, sy, nx, ny, nz,
        boxes.band[plane : plane + nx], False, limits, found, survey_of,
    )  # fmt: skip
    widen(found, GUARD, nx, ny)
    copy_rows(found, rows, plane, nx)
    for x in range(nx):
        y0, y1 = band_rows(x, i, boxes, False)
        for y in range(y0, y1):
            goal = np.uint64(boxes.start[i] + (x * ny + y) * nz)
            copy_row(frame, np.uint64(frame_index(x, y, 0, sx, sy)), new, goal, nz)


@kernel(overlapping=True)
def try_step(
    i, phi, ahead, boxes, terms, interaction, columns, pairs_start, pair_potential, frames, sums,
    stencil, inner, linear, half, changes, use_repulsion, use_psi,
):  # fmt: skip
    """Solve for the new field of cell i; return the frame that holds it on the band."""
    clear(i, boxes, False, frames[PHI])
    load(i, ahead, boxes, False, frames[PHI])
    load(i, phi, boxes, False, frames[LAST])
    clear(i, boxes, False, frames[U])
    felt = False
    if use_repulsion is not None:
        felt = columns.felt[i]
        if felt:
            psi = choose(frames[PSI], use_psi)
            gather(
                i, boxes, False, interaction, columns, pairs_start, pair_potential, frames[PHI],
                frames[RHS], psi,
            )  # fmt: skip
            residual(i, boxes, terms, frames, psi, stencil, linear.rate, half, sums, True)
    if not felt:
        residual(i, boxes, terms, frames, None, stencil, linear.rate, half, sums, None)
    stiff, slope = linear.stiffness[i], sums[1]
    implicit = linear.lhs[i] * slope + sums[2] + stiff * slope * slope
    q = frames.dtype.type(stiff * sums[0] * slope / implicit if implicit > 0 else 0.0)
    result = solve(i, boxes, terms, frames, inner, linear.lhs[i], linear.spread, q, half + half)
    changes[i, SLOPE] = sums[3]
    changes[i, MISSED], changes[i, MOVED] = add_prediction(
        i, boxes, frames[result], frames[PHI], frames[LAST]
    )
    return result


@parallel_kernel(overlapping=True)
def try_steps(
    shares, order, phi, ahead, boxes, terms, interaction, columns, pairs_start, pair_potential,
    work, found, measured, stencil, inner, linear, limits, new, rows, surveys, changes,
    use_repulsion, use_psi,
):  # fmt: skip
    """Solve for the new field of every cell of `order`.

    Parameters as for `step_band`, but

    phi, ahead : 1-D pools of φⁿ and φ*; the latter is what cells feel of each other in `columns`
    inner : Stencil, of the iterations
    linear : Linearisation
    new : 1-D pool, overwritten with φⁿ⁺¹ on the bands; it may be `ahead`
    rows : (planes, 2) int32, overwritten with the new bands
    surveys : (N, N_SURVEYED), overwritten
    changes : (N, N_CHANGES) float64, overwritten
    """
    offer(shares)
    for worker in prange(shares.threads):
        frames = work[worker]
        for k in turns(shares):
            i = order[k]
            result = try_step(
                i, phi, ahead, boxes, terms, interaction, columns, pairs_start, pair_potential,
                frames, measured[worker], stencil, inner, linear, limits.half, changes,
                use_repulsion, use_psi,
            )  # fmt: skip
            keep(i, frames[result], boxes, limits, found[worker], new, rows, surveys[i])


@inline_kernel(overlapping=True)
def advance_row(new, phi, ahead, first, count, growth):
    """φⁿ⁺¹ into `phi`, and its extrapolation into `ahead`, along one row; return its sum."""
    total = 0.0
    for k in range(first, first + np.uint64(count)):
        value = new[k]
        extrapolated = value + growth * (value - phi[k])
        phi[k] = value
        ahead[k] = extrapolated
        total += extrapolated
    return total


@kernel(overlapping=True)
def take_step(i, new, phi, ahead, growth, boxes, rows, found, surveys, lost, totals):
    """Take the step that was tried for cell i."""
    if found[BAD] > 0:
        surveys[i, BAD] = found[BAD]
        return
    nx, ny, nz = boxes.shape[i, 0], boxes.shape[i, 1], boxes.shape[i, 2]
    total = dropped = 0.0
    for x in range(nx):
        plane = boxes.plane_start[i] + x
        y0, y1 = boxes.band[plane, 0], boxes.band[plane, 1]
        for y in range(y0, y1):
            first = np.uint64(boxes.start[i] + (x * ny + y) * nz)
            if rows[plane, 0] <= y < rows[plane, 1]:
                total += advance_row(new, phi, ahead, first, nz, growth)
            else:
                dropped += row_total(new, first, nz)
                clear_row(phi, first, nz)
                clear_row(ahead, first, nz)
        boxes.band[plane, 0], boxes.band[plane, 1] = rows[plane, 0], rows[plane, 1]
    for k in range(N_SURVEYED):
        surveys[i, k] = found[k]
    surveys[i, TOTAL] -= dropped
    lost[i] += dropped
    totals[i] = total


@parallel_kernel(overlapping=True)
def take_steps(
    shares, order, new, phi, ahead, growth, boxes, rows, found, surveys, lost, totals
):  # fmt: skip
    """Take the steps that were tried, and extrapolate to the next.

    Rows that leave the band are set to 0; what was there is counted in `lost`. A cell whose new
    field is not finite, or runs away, keeps its old field.

    Parameters
    ----------
    shares, order, boxes : as for `try_steps`
    new, rows, found : what that has written: fields, bands and surveys
    phi, ahead : 1-D pools of φⁿ and φ*, updated
    growth : r of the next step
    surveys, lost : (N, N_SURVEYED) and (N,) float64, updated
    totals : (N,) float64, overwritten with Σ φ*
    """
    offer(shares)
    for _ in prange(shares.threads):
        for k in turns(shares):
            i = order[k]
            take_step(i, new, phi, ahead, growth, boxes, rows, found[i], surveys, lost, totals)


@parallel_kernel()
def stretch(shares, order, phi, ahead, share, boxes, totals):
    """Lay φ* to φⁿ + share (φ* - φⁿ), for a step of another length.

    Parameters as for `take_steps`; `share` is the new δt in those of the old.
    """
    offer(shares)
    for _ in prange(shares.threads):
        for k in turns(shares):
            i = order[k]
            ny, nz = boxes.shape[i, 1], boxes.shape[i, 2]
            total = 0.0
            for x in range(boxes.shape[i, 0]):
                y0, y1 = band_rows(x, i, boxes, False)
                for y in range(y0, y1):
                    first = np.uint64(boxes.start[i] + (x * ny + y) * nz)
                    for p in range(first, first + np.uint64(nz)):
                        value = phi[p] + share * (ahead[p] - phi[p])
                        ahead[p] = value
                        total += value
            totals[i] = total
