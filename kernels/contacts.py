"""Contact areas: how much of a cell's surface lies in its neighbours.

The surface is cut into one piece per cube of the lattice; see `surfaces`. φ of a neighbour is
looked up once on each, at its centre.
"""

from typing import NamedTuple

import numpy as np
from numba import prange

from morphosim.kernels._jit import inline_kernel, kernel, parallel_kernel
from morphosim.kernels.rows import row_place, row_span
from morphosim.kernels.sharing import offer, turns
from morphosim.kernels.surfaces import corners, crossings, cubes_of, cut_cube, load_extent

COVERED = 7
"""Place in a piece of the largest area that one neighbour covers."""
REACH = 2
"""Pieces of surface count in cubes of whose points one is in the neighbour's extent, and in those
next to them: a piece can lie half in the contact with its centre outside."""


class Neighbours(NamedTuple):
    """Cells that each cell may touch."""

    start: np.ndarray
    """(N + 1,) int64, compressed rows of `cell`."""
    cell: np.ndarray
    """int64."""


@inline_kernel()
def normal(v):
    """Direction of ∇φ, averaged over a cube."""
    x = v[4] + v[5] + v[6] + v[7] - v[0] - v[1] - v[2] - v[3]
    y = v[2] + v[3] + v[6] + v[7] - v[0] - v[1] - v[4] - v[5]
    z = v[1] + v[3] + v[5] + v[7] - v[0] - v[2] - v[4] - v[6]
    length = np.sqrt(x * x + y * y + z * z)
    scale = 1 / length if length > 0 else 0.0
    return x * scale, y * scale, z * scale


@inline_kernel()
def value_at(phi, place, low, high, w):
    """φ at point w of a row; 0 beyond its span [low, high), in which there are points."""
    value = np.float64(phi[np.uint64(place + min(max(w, low), high - 1))])
    return value if low <= w < high else 0.0


@inline_kernel()
def along(j, fields, u, v, w, z):
    """φ between two points of row (u, v) of cell j's box, and its slope; 0 beyond the field."""
    if not (0 <= u < fields.shape[j, 0] and 0 <= v < fields.shape[j, 1]):
        return 0.0, 0.0
    low, high = row_span(u, v, j, fields)
    if low >= high:
        return 0.0, 0.0
    place = row_place(u, v, j, fields)
    first = value_at(fields.phi, place, low, high, w)
    second = value_at(fields.phi, place, low, high, w + 1)
    return first + z * (second - first), second - first


@inline_kernel()
def sample(j, fields, u, v, w, x, y, z):
    """φ_j and ∇φ_j, trilinear, (x, y, z) from the first corner of the cube (u, v, w) of its box."""
    f00, g00 = along(j, fields, u, v, w, z)
    f01, g01 = along(j, fields, u, v + 1, w, z)
    f10, g10 = along(j, fields, u + 1, v, w, z)
    f11, g11 = along(j, fields, u + 1, v + 1, w, z)
    f0, f1 = f00 + y * (f01 - f00), f10 + y * (f11 - f10)
    g0, g1 = g00 + y * (g01 - g00), g10 + y * (g11 - g10)
    slope_y = f01 - f00 + x * (f11 - f10 - f01 + f00)
    return f0 + x * (f1 - f0), f1 - f0, slope_y, g0 + x * (g1 - g0)


@inline_kernel()
def cut_row(values, first, found, sx, sy, level, cubes, pieces):
    """Area, centre (from the cube's first corner) and normal of the surface in the cubes found."""
    for k in range(found):
        v = corners(values, first + cubes[k], sx, sy)
        area, _, x, y, z = cut_cube(v, level)
        scale = 1 / area if area > 0 else 0.0
        pieces[k, 0] = area
        pieces[k, 1], pieces[k, 2], pieces[k, 3] = x * scale, y * scale, z * scale
        pieces[k, 4], pieces[k, 5], pieces[k, 6] = normal(v)
        pieces[k, COVERED] = 0.0


@inline_kernel()
def covered(j, fields, u, v, w, piece, level):
    """Area of a piece of surface where φ_j >= level.

    It is taken as a square with two sides along the edge of the contact, and φ_j as linear on it:
    so the area changes smoothly as cells move, and not by whole pieces.
    """
    value, x, y, z = sample(j, fields, u, v, w, piece[1], piece[2], piece[3])
    across = x * piece[4] + y * piece[5] + z * piece[6]
    rise = np.sqrt(max(x * x + y * y + z * z - across * across, 0.0) * piece[0])
    if rise > 0:
        return piece[0] * min(max((value - level) / rise + 0.5, 0.0), 1.0)
    return piece[0] if value >= level else 0.0


@inline_kernel()
def covered_in_row(j, fields, u, v, w, found, cubes, pieces, level):
    """Area of those pieces of a row of cubes, the first at (u, v, w) of cell j's box."""
    z0, z1 = fields.extent[j, 2, 0] - REACH - w, fields.extent[j, 2, 1] + REACH - 1 - w
    area = 0.0
    for k in range(found):
        if z0 <= cubes[k] < z1:
            part = covered(j, fields, u, v, w + cubes[k], pieces[k], level)
            area += part
            pieces[k, COVERED] = max(pieces[k, COVERED], part)
    return area


@inline_kernel()
def reaches(j, fields, u, v):
    """Whether the row of cubes (u, v) of cell j's box is within reach of its extent."""
    return (
        fields.extent[j, 0, 0] - REACH <= u < fields.extent[j, 0, 1] + REACH - 1
        and fields.extent[j, 1, 0] - REACH <= v < fields.extent[j, 1, 1] + REACH - 1
    )


@kernel()
def meet_row(
    i, fields, level, neighbour_level, neighbours, x, y, z, values, row, found, sx, sy, cubes,
    pieces, out,
):  # fmt: skip
    """Add the contacts in one row of cubes; its first is at lattice position (x, y, z).

    Returns the area that is in contact with any neighbour.
    """
    is_cut = False
    for n in range(neighbours.start[i], neighbours.start[i + 1]):
        j = neighbours.cell[n]
        u, v, w = x - fields.origin[j, 0], y - fields.origin[j, 1], z - fields.origin[j, 2]
        if reaches(j, fields, u, v):
            if not is_cut:
                cut_row(values, row, found, sx, sy, level, cubes, pieces)
                is_cut = True
            out[n] += covered_in_row(j, fields, u, v, w, found, cubes, pieces, neighbour_level)
    touched = 0.0
    if is_cut:
        for k in range(found):
            touched += pieces[k, COVERED]
    return touched


@kernel()
def meet(i, fields, level, neighbour_level, neighbours, values, cubes, pieces, out):
    """Contact areas of cell i, `out` at the places of its neighbours; returns their union's."""
    out[neighbours.start[i] : neighbours.start[i + 1]] = 0
    touched = 0.0
    if neighbours.start[i] == neighbours.start[i + 1]:
        return touched
    load_extent(i, fields, values)
    nx, ny, nz = cubes_of(i, fields)
    sx, sy = (ny + 1) * (nz + 1), nz + 1
    x0 = fields.origin[i, 0] + fields.extent[i, 0, 0] - 1
    y0 = fields.origin[i, 1] + fields.extent[i, 1, 0] - 1
    z0 = fields.origin[i, 2] + fields.extent[i, 2, 0] - 1
    for x in range(nx):
        for y in range(ny):
            row = x * sx + y * sy
            found, _ = crossings(values, row, nz, sx, sy, level, cubes)
            if found > 0:
                touched += meet_row(
                    i, fields, level, neighbour_level, neighbours, x0 + x, y0 + y, z0, values, row,
                    found, sx, sy, cubes, pieces, out,
                )  # fmt: skip
    return touched


@parallel_kernel()
def contacts(shares, fields, level, neighbour_level, neighbours, work, out, touched):
    """Area of that part of each cell's surface φ = level on which a neighbour's φ is as large.

    Parameters
    ----------
    shares : Shares of the cells
    fields : Fields, with extents below both levels
    level : float, > 0
    neighbour_level : float, > 0; what φ of the neighbour must be at least
    neighbours : Neighbours
    work : Work
    out : (len(neighbours.cell),) float64, overwritten; in squared lattice steps
    touched : (N,) float64, overwritten with the area on which any neighbour's φ is as large
    """
    offer(shares)
    for worker in prange(shares.threads):
        for i in turns(shares):
            touched[i] = meet(
                i, fields, level, neighbour_level, neighbours, work.values[worker],
                work.cubes[worker], work.pieces[worker], out,
            )  # fmt: skip
