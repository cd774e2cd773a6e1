"""Surfaces φ = level by marching tetrahedra: their area, and what they enclose.

Between eight neighbouring lattice points lies a cube. It is cut into six tetrahedra, one for each
way along its edges from its first corner to its last. Where φ is linear in a tetrahedron, its
surface is a triangle or a quadrilateral. All cubes are cut alike, so the pieces join without gaps.
Beyond a box φ is 0: a surface that reaches a face of the box is closed there.
"""

from typing import NamedTuple

import numpy as np
from numba import prange

from morphosim.kernels._jit import inline_kernel, kernel, parallel_kernel
from morphosim.kernels.frames import clear_row, copy_row
from morphosim.kernels.rows import row_place, row_span
from morphosim.kernels.sharing import offer, turns


class Work(NamedTuple):
    """Scratch space of each thread, large enough for the largest extent; all overwritten."""

    values: np.ndarray
    """(threads, points) in the type of the fields: an extent with one point more on each side."""
    cubes: np.ndarray
    """(threads, cubes along z) int64: places of the cubes of a row that the surface crosses."""
    pieces: np.ndarray
    """(threads, cubes along z, 8) float64: area, centre and normal of the surface in these, and the
    area that neighbours cover."""


@inline_kernel()
def cut_corner(p, a, b, c, level):
    """Cut that parts corner p of a tetrahedron from a, b and c.

    Returns
    -------
    area : that of the cut times 2 / |∇φ|
    share : of the volume that is on the side of p
    weights : of p, a, b, c; the sum of weights times positions is area times centre
    """
    to_a, to_b, to_c = (p - level) / (p - a), (p - level) / (p - b), (p - level) / (p - c)
    area = abs(to_a * to_b / (p - c))
    at_a, at_b, at_c = area * to_a / 3, area * to_b / 3, area * to_c / 3
    return area, to_a * to_b * to_c, area - at_a - at_b - at_c, at_a, at_b, at_c


@inline_kernel()
def cut_pair(p, q, a, b, level):
    """Cut that parts corners p and q of a tetrahedron from a and b; see `cut_corner`."""
    pa, pb = (p - level) / (p - a), (p - level) / (p - b)
    qa, qb = (q - level) / (q - a), (q - level) / (q - b)
    # Two triangles that share the line from the cut of edge pa to that of qb.
    one, other = abs(pa * (1 - pb) / (q - b)), abs(qa * (1 - pa) / (q - b))
    area = one + other
    share = pa * pb + pa * qb * (1 - pb) + qa * qb * (1 - pa)
    at_a, at_b = (area * pa + other * qa) / 3, (area * qb + one * pb) / 3
    at_p = (area * (1 - pa) + one * (1 - pb)) / 3
    return area, share, at_p, area - at_a - at_b - at_p, at_a, at_b


@kernel()
def cut(v0, v1, v2, v3, level):
    """Surface in one tetrahedron, given φ at the corners along its way through the cube.

    Returns
    -------
    area, volume : of the surface, and of φ > level; in lattice steps
    first, second, third : area times how far the centre is along the axes of the way's three edges
    """
    case = (v0 > level) + 2 * (v1 > level) + 4 * (v2 > level)
    if v3 > level:
        case = 7 - case  # the same cut, seen from the other side
    if case == 0:
        return 0.0, 1 / 6 if v3 > level else 0.0, 0.0, 0.0, 0.0
    if case == 1:
        area, share, _, w1, w2, w3 = cut_corner(v0, v1, v2, v3, level)
    elif case == 2:
        area, share, w1, _, w2, w3 = cut_corner(v1, v0, v2, v3, level)
    elif case == 4:
        area, share, w2, _, w1, w3 = cut_corner(v2, v0, v1, v3, level)
    elif case == 7:
        area, beyond, w3, _, w1, w2 = cut_corner(v3, v0, v1, v2, level)
        share = 1 - beyond
    elif case == 3:
        area, share, _, w1, w2, w3 = cut_pair(v0, v1, v2, v3, level)
    elif case == 5:
        area, share, _, w2, w1, w3 = cut_pair(v0, v2, v1, v3, level)
    else:
        area, share, w1, w2, _, w3 = cut_pair(v1, v2, v0, v3, level)
    if v3 > level:
        share = 1 - share
    slope = 0.5 * np.sqrt((v1 - v0) ** 2 + (v2 - v1) ** 2 + (v3 - v2) ** 2)
    return slope * area, share / 6, slope * (w1 + w2 + w3), slope * (w2 + w3), slope * w3


@inline_kernel()
def corners(values, at, sx, sy):
    """φ at the eight corners of the cube that begins at index `at`; number 4 x + 2 y + z."""
    one, up, far = np.uint64(at + 1), np.uint64(at + sy), np.uint64(at + sy + 1)
    step = np.uint64(sx)
    at = np.uint64(at)
    return (
        np.float64(values[at]), np.float64(values[one]),
        np.float64(values[up]), np.float64(values[far]),
        np.float64(values[at + step]), np.float64(values[one + step]),
        np.float64(values[up + step]), np.float64(values[far + step]),
    )  # fmt: skip


@inline_kernel()
def cut_cube(v, level):
    """Surface in one cube with φ = v at its corners, all in lattice steps.

    Returns
    -------
    area, volume : of the surface, and of φ > level
    x, y, z : area times centre of the surface, from the first corner
    """
    a0, b0, x0, y0, z0 = cut(v[0], v[4], v[6], v[7], level)
    a1, b1, x1, z1, y1 = cut(v[0], v[4], v[5], v[7], level)
    a2, b2, y2, x2, z2 = cut(v[0], v[2], v[6], v[7], level)
    a3, b3, y3, z3, x3 = cut(v[0], v[2], v[3], v[7], level)
    a4, b4, z4, x4, y4 = cut(v[0], v[1], v[5], v[7], level)
    a5, b5, z5, y5, x5 = cut(v[0], v[1], v[3], v[7], level)
    return (
        a0 + a1 + a2 + a3 + a4 + a5, b0 + b1 + b2 + b3 + b4 + b5,
        x0 + x1 + x2 + x3 + x4 + x5, y0 + y1 + y2 + y3 + y4 + y5, z0 + z1 + z2 + z3 + z4 + z5,
    )  # fmt: skip


@inline_kernel()
def above(values, at, sx, sy, level):
    """How many of the four corners of lowest z of a cube have φ > level."""
    here, up = np.uint64(at), np.uint64(at + sy)
    step = np.uint64(sx)
    return (
        np.int64(values[here] > level) + np.int64(values[up] > level)
        + np.int64(values[here + step] > level) + np.int64(values[up + step] > level)
    )  # fmt: skip


@kernel()
def crossings(values, first, count, sx, sy, level, cubes):
    """Find the cubes that the surface crosses, among `count` in a row; `cubes` gets their z.

    Returns
    -------
    found : how many these are
    full : number of cubes with φ > level at all corners
    """
    found = full = 0
    before = above(values, first, sx, sy, level)
    for z in range(count):
        after = above(values, first + z + 1, sx, sy, level)
        if before + after == 8:
            full += 1
        elif before + after > 0:
            cubes[found] = z
            found += 1
        before = after
    return found, full


@inline_kernel()
def cubes_of(i, fields):
    """Cubes per axis that reach into cell i's extent; none, or fewer, if there is no such."""
    x0, x1 = fields.extent[i, 0, 0], fields.extent[i, 0, 1]
    y0, y1 = fields.extent[i, 1, 0], fields.extent[i, 1, 1]
    z0, z1 = fields.extent[i, 2, 0], fields.extent[i, 2, 1]
    return x1 - x0 + 1, y1 - y0 + 1, z1 - z0 + 1


@kernel()
def load_extent(i, fields, values):
    """Copy cell i's extent with one point more on each side into `values`; 0 beyond its field."""
    nx, ny = fields.shape[i, 0], fields.shape[i, 1]
    x0, y0, z0 = fields.extent[i, 0, 0] - 1, fields.extent[i, 1, 0] - 1, fields.extent[i, 2, 0] - 1
    x1, y1, z1 = fields.extent[i, 0, 1] + 1, fields.extent[i, 1, 1] + 1, fields.extent[i, 2, 1] + 1
    for x in range(x0, x1):
        for y in range(y0, y1):
            goal = np.uint64(((x - x0) * (y1 - y0) + y - y0) * (z1 - z0))
            clear_row(values, goal, z1 - z0)
            if 0 <= x < nx and 0 <= y < ny:
                low, high = row_span(x, y, i, fields)
                low, high = max(low, z0), min(high, z1)
                source = np.uint64(row_place(x, y, i, fields) + low)
                copy_row(fields.phi, source, values, goal + np.uint64(low - z0), max(high - low, 0))


@kernel()
def enclose(i, fields, level, values, cubes, out):
    """Area of cell i's surface and the volume in it, out (2,)."""
    load_extent(i, fields, values)
    nx, ny, nz = cubes_of(i, fields)
    sx, sy = (ny + 1) * (nz + 1), nz + 1
    out[:] = 0
    for x in range(nx):
        for y in range(ny):
            first = x * sx + y * sy
            found, full = crossings(values, first, nz, sx, sy, level, cubes)
            out[1] += full
            for k in range(found):
                v = corners(values, first + cubes[k], sx, sy)
                area, volume, _, _, _ = cut_cube(v, level)
                out[0] += area
                out[1] += volume


@parallel_kernel()
def surfaces(shares, fields, level, work, out):
    """Area of the surface φ = level of each cell, and the volume that it encloses.

    Parameters
    ----------
    shares : Shares of the cells
    fields : Fields, with extents at this level or a lower one
    level : float, > 0
    work : Work
    out : (N, 2) float64, overwritten; in squared and cubed lattice steps
    """
    offer(shares)
    for worker in prange(shares.threads):
        for i in turns(shares):
            enclose(i, fields, level, work.values[worker], work.cubes[worker], out[i])
