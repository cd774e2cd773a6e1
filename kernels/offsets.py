"""Fields between their lattice points: their values, and where surfaces are along a direction."""

import math

import numpy as np

from morphosim.kernels._jit import inline_kernel, kernel

STRIDE = 0.5
"""Distance between two places at which a crossing is looked for, in lattice steps."""
SECANTS = 4
"""Improvements of a crossing once it is between two such places."""


@inline_kernel()
def cubic_weights(t):
    """Weights of four points in a row for a place t in [0, 1) after the second (Catmull-Rom)."""
    return (
        -0.5 * t * (1.0 - t) ** 2,
        1.0 + t * t * (1.5 * t - 2.5),
        0.5 * t * (1.0 + t * (4.0 - 3.0 * t)),
        0.5 * t * t * (t - 1.0),
    )


@kernel()
def value_at(pool, origin, shape, start, cell, x, y, z):
    """Field of a cell at a place in lattice steps; 0 outside of its box."""
    a, b, c = x - origin[cell, 0], y - origin[cell, 1], z - origin[cell, 2]
    i, j, k = math.floor(a), math.floor(b), math.floor(c)
    _, ny, nz = shape[cell, 0], shape[cell, 1], shape[cell, 2]
    if min(i, j, k) < 1 or i + 2 >= shape[cell, 0] or j + 2 >= ny or k + 2 >= nz:
        return 0.0
    along_x, along_y, along_z = cubic_weights(a - i), cubic_weights(b - j), cubic_weights(c - k)
    total = 0.0
    for p in range(4):
        for q in range(4):
            first = start[cell] + ((i - 1 + p) * ny + j - 1 + q) * nz + k - 1
            row = 0.0
            for r in range(4):
                row += along_z[r] * pool[first + r]
            total += along_x[p] * along_y[q] * row
    return total


@kernel()
def within(pool, origin, shape, start, cell, other, around, first, x, y, z):
    """Above 0 within a cell: φ_i - φ_j at a contact, and Σ φ - 1/2 where it is free (other < 0).

    Σ is over the cell and those that `around` lists from first[cell] to first[cell + 1].
    """
    mine = value_at(pool, origin, shape, start, cell, x, y, z)
    if other >= 0:
        return mine - value_at(pool, origin, shape, start, other, x, y, z)
    total = mine - 0.5
    for k in range(first[cell], first[cell + 1]):
        total += value_at(pool, origin, shape, start, around[k], x, y, z)
    return total


@kernel()
def surface_offsets(
    pool, origin, shape, start, cell, other, around, first, points, normals, most, out
):
    """Distance from points, along their normals, to where `within` is 0, at most `most`.

    Parameters
    ----------
    pool, origin, shape, start : fields of all cells, as `layout.Boxes` says
    cell, other : (P,) int64
    around, first : (A,) and (N + 1,) int64, neighbours of each cell
    points, normals : (P, 3), lattice steps, and of unit length
    most : float, lattice steps
    out : (P,)
        Positive where the surface lies farther out; `most` where there is none so near.
    """
    for p in range(len(cell)):
        i, j = cell[p], other[p]
        x, y, z = points[p, 0], points[p, 1], points[p, 2]
        u, v, w = normals[p, 0], normals[p, 1], normals[p, 2]
        here = within(pool, origin, shape, start, i, j, around, first, x, y, z)
        way = 1.0 if here > 0.0 else -1.0
        near, far, beyond = 0.0, 0.0, here
        while beyond * way > 0.0 and far < most:
            near, here = far, beyond
            far += STRIDE
            s = way * far
            beyond = within(
                pool, origin, shape, start, i, j, around, first, x + s * u, y + s * v, z + s * w
            )
        if beyond * way > 0.0:
            out[p] = way * most
            continue
        for _ in range(SECANTS):
            step = (far - near) * here / (here - beyond) if here != beyond else 0.0
            s = near + step
            found = within(
                pool, origin, shape, start, i, j, around, first,
                x + way * s * u, y + way * s * v, z + way * s * w,
            )  # fmt: skip
            if found * way > 0.0:
                near, here = s, found
            else:
                far, beyond = s, found
        out[p] = way * (near + ((far - near) * here / (here - beyond) if here != beyond else 0.0))
    return np.int64(len(cell))


@kernel()
def grid_values(pool, origin, shape, start, cell, first, step, out):
    """Field of a cell on a grid of points.

    Parameters
    ----------
    pool, origin, shape, start : fields of all cells, as `layout.Boxes` says
    cell : int
    first, step : (3,) place of the grid's first point, and its steps, in lattice steps
    out : (nx, ny, nz)
    """
    for i in range(out.shape[0]):
        x = first[0] + i * step[0]
        for j in range(out.shape[1]):
            y = first[1] + j * step[1]
            for k in range(out.shape[2]):
                out[i, j, k] = value_at(
                    pool, origin, shape, start, cell, x, y, first[2] + k * step[2]
                )
