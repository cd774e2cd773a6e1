"""The nonlinear force F of one cell, and the right-hand side of its implicit step.

F = - γ c W'(φ) - φ R - ∇φ·∇ψ + p |∇φ| + ∇φ·d      (Eq. S2, S3 of the paper)

R is the repulsion felt by the cell (other cells and the confinement), ψ its attraction potential,
p the volume constraint's pressure and d = -κ √δt u the motility drift. Terms without gradients are
evaluated in the whole box, gradient terms on the band: one span of z per row.
"""

import numpy as np

from morphosim.kernels._jit import inline_kernel, kernel
from morphosim.kernels.stencils import derivative


@inline_kernel()
def local_force(phi, start, repulsion, row, force, nz, well, half):
    """Double well and repulsion along one row; `well` is 4 γ c, `half` is 1/2 in phi's type.

    W'(φ) = 4φ³ - 6φ² + 2φ = 4 (φ - φ²) (1/2 - φ).
    """
    for z in range(np.uint64(nz)):
        value = phi[start + z]
        total = -well * (value - value * value) * (half - value)
        if repulsion is not None:
            total -= value * repulsion[row + z]
        force[z] = total


@inline_kernel()
def gradient_force(phi, start, psi, row, force, z0, z1, sx, sy, c1, c2, c3, pressure, dx, dy, dz):
    """Add volume constraint, attraction and motility along [z0, z1) of one row."""
    sz = np.uint64(1)
    for z in range(np.uint64(z0), np.uint64(z1)):
        p = start + z
        gx = derivative(phi, p, sx, c1, c2, c3)
        gy = derivative(phi, p, sy, c1, c2, c3)
        gz = derivative(phi, p, sz, c1, c2, c3)
        total = pressure * np.sqrt(gx * gx + gy * gy + gz * gz)
        if psi is not None:
            q = row + z
            total -= gx * derivative(psi, q, sx, c1, c2, c3)
            total -= gy * derivative(psi, q, sy, c1, c2, c3)
            total -= gz * derivative(psi, q, sz, c1, c2, c3)
        if dx is not None:
            total += gx * dx + gy * dy + gz * dz
        force[z] += total


@kernel()
def edge_force(phi, start, psi, row, force, z0, z1, sx, sy, edge, pressure, dx, dy, dz):
    """`gradient_force` by the second-order stencil, where others would reach out of the box."""
    gradient_force(
        phi, start, psi, row, force, z0, z1, sx, sy, edge, None, None, pressure, dx, dy, dz
    )


@inline_kernel()
def combine(phi, history, start, force, rhs, row, nz, a0, a1, b0, b1):
    """Right-hand side a0 φ + a1 F + H along one row; H becomes b0 φ + b1 F.

    A scheme without memory passes None as `history`.
    """
    for z in range(np.uint64(nz)):
        value = phi[start + z]
        total = a0 * value + a1 * force[z]
        if history is not None:
            total += history[start + z]
            history[start + z] = b0 * value + b1 * force[z]
        rhs[row + z] = total


@kernel()
def right_hand_side(
    i, phi, history, boxes, terms, drift, repulsion, psi, force, rhs, stencil, scheme, half
):
    """Fill `rhs` (box of cell i) and update `history`.

    Parameters
    ----------
    i : int
    phi, history : 1-D pools; history is None for a scheme without memory
    boxes, terms, stencil, scheme : Boxes, CellTerms, Stencil, Scheme
    drift : (N, 3), the same as terms.drift, or None
    repulsion, psi : 1-D, box of the cell, or None where the scene has no such physics
    force : 1-D work row, as long as the longest row
    rhs : 1-D, box of the cell, overwritten
    half : 1/2 in the type of the fields
    """
    nx, ny, nz = boxes.shape[i, 0], boxes.shape[i, 1], boxes.shape[i, 2]
    start, spans, row_start = boxes.start[i], boxes.spans, boxes.row_start[i]
    well, pressure = terms.well[i], terms.pressure[i]
    sx, sy, r = np.uint64(ny * nz), np.uint64(nz), stencil.radius
    if drift is None:
        dx = dy = dz = None
    else:
        dx, dy, dz = drift[i, 0], drift[i, 1], drift[i, 2]
    for x in range(nx):
        for y in range(ny):
            line = x * ny + y
            row = np.uint64(line * nz)
            base = np.uint64(start + line * nz)
            local_force(phi, base, repulsion, row, force, nz, well, half)
            z0 = max(1, spans[row_start + line, 0])
            z1 = min(nz - 1, spans[row_start + line, 1])
            if z0 < z1 and 0 < x < nx - 1 and 0 < y < ny - 1:
                inner = r <= x < nx - r and r <= y < ny - r
                low = min(max(r, z0), z1) if inner else z1
                high = max(min(nz - r, z1), low)
                gradient_force(
                    phi, base, psi, row, force, low, high, sx, sy,
                    stencil.c1, stencil.c2, stencil.c3, pressure, dx, dy, dz,
                )  # fmt: skip
                edge_force(
                    phi, base, psi, row, force, z0, low, sx, sy, stencil.edge, pressure,
                    dx, dy, dz,
                )  # fmt: skip
                edge_force(
                    phi, base, psi, row, force, high, z1, sx, sy, stencil.edge, pressure,
                    dx, dy, dz,
                )  # fmt: skip
            combine(
                phi, history, base, force, rhs, row, nz,
                scheme.a0, scheme.a1, scheme.b0, scheme.b1,
            )  # fmt: skip
