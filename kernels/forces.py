"""The nonlinear force F of one cell, and the right-hand side of its step.

F = - γ c W'(φ) - φ R - ∇φ·∇ψ + p |∇φ| + ∇φ·d + f      (Eq. S2, S3 of the paper)

R is the repulsion felt by the cell (other cells and walls), ψ its attraction potential,
p its pressure (volume constraint), d its drift (motility: -κ √δt u), and f what a term of the
user's own computes at each point of φ, ∇φ and Δφ (`point_force`).
"""

import numpy as np

from morphosim.kernels._jit import entry, inline_kernel, kernel
from morphosim.kernels.frames import strides
from morphosim.kernels.points import (
    begin_of_block,
    feels,
    force_at_point,
    place_in_block,
    wanted_second,
)
from morphosim.kernels.rows import BLOCK, FRAME, STRETCH
from morphosim.kernels.stencils import derivative, weighted_neighbours


@inline_kernel()
def gradient(phi, p, sx, sy, stencil):
    """∇φ at point p."""
    c1, c2, c3 = stencil.c1, stencil.c2, stencil.c3
    return (
        derivative(phi, p, sx, c1, c2, c3),
        derivative(phi, p, sy, c1, c2, c3),
        derivative(phi, p, np.uint64(1), c1, c2, c3),
    )


@inline_kernel()
def force(
    phi, gx, gy, gz, slope, psi, repulsion, p, q, sx, sy, stencil, well, half, pressure, dx, dy, dz,
    points, i, begin, j, use_repulsion,
):  # fmt: skip
    """F of ∇φ and |∇φ| at point p of the frames, q of the stretches, j of a block.

    `well` is 4 γ c, `half` is 1/2 in phi's type, and the block begins at `begin`; see `points`.

    W'(φ) = 4φ³ - 6φ² + 2φ = 4 (φ - φ²) (1/2 - φ).
    """
    sz = np.uint64(1)
    c1, c2, c3 = stencil.c1, stencil.c2, stencil.c3
    value = phi[p]
    total = pressure * slope
    if psi is not None:
        total -= gx * derivative(psi, p, sx, c1, c2, c3)
        total -= gy * derivative(psi, p, sy, c1, c2, c3)
        total -= gz * derivative(psi, p, sz, c1, c2, c3)
    if dx is not None:
        total += gx * dx + gy * dy + gz * dz
    total -= well * (value - value * value) * (half - value)
    if use_repulsion is not None:
        total -= value * repulsion[q]
    if points is not None:
        around = weighted_neighbours(phi, p, sx, sy, sz, stencil.l1, stencil.l2, stencil.l3)
        laplacian = around + (stencil.l0 + stencil.l0 + stencil.l0) * value
        second = wanted_second(points, phi, p, sx, sy, stencil)
        place = place_in_block(points, begin, j)
        total += force_at_point(points, i, value, gx, gy, gz, laplacian, second, place)
    return total


@kernel()
def blocks_right_hand_side(
    blocks, n, first, phi, psi, repulsion, history, rhs, memory, start, sx, sy, stencil, scheme,
    well, half, pressure, dx, dy, dz, i, origin, use_repulsion, mobility, points,
):  # fmt: skip
    """`right_hand_side` of the blocks given; the cell's history begins at `first`."""
    a0, a1, b0, b1, e0, e1 = scheme.a0, scheme.a1, scheme.b0, scheme.b1, scheme.e0, scheme.e1
    for k in range(n):
        at, place = np.uint64(blocks[FRAME, k]), np.uint64(blocks[STRETCH, k])
        kept = np.uint64(first + blocks[STRETCH, k])
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
            if mobility is not None:
                total *= mobility
            if history is not None:
                before = history[kept + j]
                memory[q] = b0 * value + b1 * total
                rhs[q] = a0 * value + a1 * total + before
                if start is not None:
                    start[p] = e0 * value + e1 * (before + total)
            else:
                rhs[q] = a0 * value + a1 * total
                if start is not None:
                    start[p] = value


@kernel()
def right_hand_side(
    i, boxes, blocks, n, terms, drift, phi, psi, repulsion, history, rhs, memory, start,
    stencil, scheme, half, use_repulsion,
):  # fmt: skip
    """Right-hand side, next history and start of the iterations of cell i.

    Parameters
    ----------
    i : int
    boxes, terms, stencil, scheme : Boxes, CellTerms, Stencil, Scheme
    blocks, n : where to work
    drift : (N, 3), the same as terms.drift, or None
    phi : frame of the field
    psi : frame of the attraction potential, or None
    repulsion : stretch, the repulsion R
    history : pool of H; None for a scheme without memory
    rhs : stretch, overwritten with the right-hand side
    memory : stretch, overwritten with the next H
    start : frame, overwritten with the start of the iterations; None without any
    half : 1/2 in the type of the fields
    use_repulsion : True, or None where nothing repels; R is then not read
    """
    sx, sy = strides(i, boxes)
    dx, dy, dz = entry(drift, i, 0), entry(drift, i, 1), entry(drift, i, 2)
    given = (
        blocks, n, boxes.start[i], phi, psi, repulsion, history, rhs, memory, start,
        np.uint64(sx), np.uint64(sy), stencil, scheme, terms.well[i], half, terms.pressure[i], dx,
        dy, dz, i, boxes.origin, use_repulsion, entry(terms.mobility, i, 0),
    )  # fmt: skip
    if feels(terms.points, i):
        blocks_right_hand_side(*given, terms.points)
    else:
        blocks_right_hand_side(*given, None)
