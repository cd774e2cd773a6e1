"""The linearly implicit step on the narrow band (scheme "linearised").

Forces are taken at the extrapolation φ* = φⁿ + δt v, v = (φⁿ - φⁿ⁻¹) / δt, and linearised about it
where their derivative is local. With u = φⁿ⁺¹ - φ* and backward differences of second order

    (lhs + D - (γ + s) Δ) u = F(φ*) + γ Δφ* - τ v - q |∇φ*|,      lhs = 3 τ / 2 δt
    D = γ c W''(φ*) + R

R is the repulsion by other cells and walls, and s the stabilisation of what stays explicit. The
pressure follows the new volume, p(∫ φ* + ∫ u): q = - p' ∫ u, where ∫ u is the solution of the
equation's integral for u along |∇φ*|, as that of a moving interface is.

The iterations are those of `chebyshev`, whose diagonal varies here. They begin with u = 0.
"""

import numpy as np
from numba import prange

from morphosim.kernels._jit import choose, entry, kernel, parallel_kernel
from morphosim.kernels.boxes import BAD, TOTAL, row_total, survey, widen
from morphosim.kernels.columns import gather
from morphosim.kernels.forces import force
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
from morphosim.kernels.stencils import derivative, weighted_neighbours
from morphosim.kernels.step import GUARD, settle

PHI, PSI, RHS, LAST, U, DAMPING = 0, 1, 2, 3, 4, 5
"""A thread's frames. When ψ has been read, its frame serves the iterations."""


@kernel()
def plane_residual(
    low, high, phi, psi, rhs, last, slopes, damping, sx, sy, stencil, rate, gamma, well, half,
    pressure, dx, dy, dz, points, i, use_repulsion,
):  # fmt: skip
    """`residual` along one run of the frames."""
    sz = np.uint64(1)
    c1, c2, c3 = stencil.c1, stencil.c2, stencil.c3
    zero = half - half
    three = half + half + half + half + half + half
    sum_residual, sum_slope, sum_damped = zero, zero, zero
    for p in range(low, high):
        value = phi[p]
        total = force(
            phi, psi, rhs, p, sx, sy, stencil, well, half, pressure, dx, dy, dz, points, i,
            use_repulsion,
        )  # fmt: skip
        gx = derivative(phi, p, sx, c1, c2, c3)
        gy = derivative(phi, p, sy, c1, c2, c3)
        gz = derivative(phi, p, sz, c1, c2, c3)
        slope = np.sqrt(gx * gx + gy * gy + gz * gz)
        local = well * (half - three * (value - value * value))
        if use_repulsion is not None:
            local += rhs[p]
        around = weighted_neighbours(phi, p, sx, sy, sz, stencil.l1, stencil.l2, stencil.l3)
        total -= rate * (value - last[p])
        sum_residual += total
        sum_slope += slope
        sum_damped += local * slope
        damping[p] = local
        slopes[p] = slope
        rhs[p] = total + gamma * (around + (stencil.l0 + stencil.l0 + stencil.l0) * value)
    return sum_residual, sum_slope, sum_damped


@kernel()
def residual(i, boxes, terms, frames, psi, stencil, rate, half, sums, use_repulsion):
    """Right-hand side but for q, |∇φ*| and D of cell i, into frames RHS, U and DAMPING.

    The first three of `sums` are overwritten with Σ (F - τ v), Σ |∇φ*| and Σ D |∇φ*|. The frame RHS has R.
    """
    sx, sy = strides(i, boxes)
    drift = terms.drift
    dx, dy, dz = entry(drift, i, 0), entry(drift, i, 1), entry(drift, i, 2)
    sums[0] = sums[1] = sums[2] = 0.0
    for x in range(boxes.shape[i, 0]):
        low, high = run(x, i, boxes, False, sx, sy)
        a, b, c = plane_residual(
            low, high, frames[PHI], psi, frames[RHS], frames[LAST], frames[U], frames[DAMPING],
            np.uint64(sx), np.uint64(sy), stencil, rate, terms.gamma[i], terms.well[i], half,
            terms.pressure[i], dx, dy, dz, terms.points, i, use_repulsion,
        )  # fmt: skip
        sums[0] += a
        sums[1] += b
        sums[2] += c


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
    """u of cell i by Chebyshev iterations; return the frame that holds it."""
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
def add_band(i, boxes, frame, target):
    """Add a frame to another on the band of cell i."""
    sx, sy = strides(i, boxes)
    for x in range(boxes.shape[i, 0]):
        low, high = run(x, i, boxes, False, sx, sy)
        for p in range(low, high):
            target[p] += frame[p]


@kernel()
def extrapolate_row(frame, last, source, target, goal, count, growth):
    """φ* of the next step along one row; return its sum."""
    for k in range(np.uint64(count)):
        value = frame[source + k]
        target[goal + k] = value + growth * (value - last[source + k])
    return row_total(target, goal, count)


@kernel()
def accept(
    i, phi, ahead, frame, last, growth, boxes, limits, found, out, surveys, lost, sums_ahead
):  # fmt: skip
    """Survey the new field of cell i, given on its band, and store it with its extrapolation.

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
        total = 0.0
        for x in range(nx):
            y0, y1 = band_rows(x, i, boxes, False)
            for y in range(y0, y1):
                source = np.uint64(frame_index(x, y, 0, sx, sy))
                goal = np.uint64(boxes.start[i] + (x * ny + y) * nz)
                if found[x, 0] <= y < found[x, 1]:
                    copy_row(frame, source, phi, goal, nz)
                    total += extrapolate_row(frame, last, source, ahead, goal, nz, growth)
                else:
                    dropped = row_total(frame, source, nz)
                    lost[i] += dropped
                    out[TOTAL] -= dropped
                    clear_row(phi, goal, nz)
                    clear_row(ahead, goal, nz)
        sums_ahead[i] = total
    settle(i, boxes, found, out, surveys)


@parallel_kernel()
def step_linearised(
    bounds, order, phi, ahead, boxes, terms, interaction, columns, pairs_start, pair_potential,
    work, found, measured, stencil, linear, limits, surveys, lost, sums_ahead, use_repulsion,
    use_psi,
):  # fmt: skip
    """Advance every cell of `order`.

    Parameters as for `step_band`, but

    ahead : 1-D pool of φ*, updated; it is what cells feel of each other in `columns`
    linear : Linearisation
    sums_ahead : (N,) float64, overwritten with Σ φ*
    """
    for worker in prange(bounds.shape[0] - 1):
        frames = work[worker]
        one = limits.half + limits.half
        sums = measured[worker]
        for k in range(bounds[worker], bounds[worker + 1]):
            i = order[k]
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
                        i, boxes, False, interaction, columns, pairs_start, pair_potential,
                        frames[PHI], frames[RHS], psi,
                    )  # fmt: skip
                    residual(
                        i, boxes, terms, frames, psi, stencil, linear.rate, limits.half, sums, True
                    )  # fmt: skip
            if not felt:
                residual(
                    i, boxes, terms, frames, None, stencil, linear.rate, limits.half, sums, None
                )  # fmt: skip
            lhs = linear.lhs[i]
            stiff = linear.stiffness[i]
            damping = sums[2] / max(sums[1], 1e-9)
            q = stiff * sums[0] / (lhs + damping + stiff * sums[1])
            result = solve(
                i, boxes, terms, frames, stencil, lhs, linear.spread, frames.dtype.type(q), one
            )  # fmt: skip
            add_band(i, boxes, frames[PHI], frames[result])
            accept(
                i, phi, ahead, frames[result], frames[LAST], linear.growth, boxes, limits,
                found[worker], measured[worker], surveys, lost, sums_ahead,
            )  # fmt: skip
