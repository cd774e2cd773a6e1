"""Where each field is: its moments, the part of its box that it fills, and which parts overlap."""

from typing import NamedTuple

import numpy as np
from numba import prange

from morphosim.kernels._jit import inline_kernel, kernel, parallel_kernel
from morphosim.kernels.boxes import box_span, include, row_peak
from morphosim.kernels.rows import row_place, row_span
from morphosim.kernels.sharing import offer, turns

N_MOMENTS = 14
"""Of positions in a box: Σ φ, Σ φ (x, y, z); and of the inside, whose weight w goes from 0 to 1 as
φ goes from 3/8 to 5/8: Σ w, Σ w (x, y, z), Σ w (xx, yy, zz), Σ w (xy, xz, yz)."""


class Fields(NamedTuple):
    """The fields of all cells, laid out as `layout.Boxes` says, and what of its box each fills."""

    phi: np.ndarray
    """1-D pool."""
    origin: np.ndarray
    """(N, 3) int64, lattice position of each box's first point."""
    shape: np.ndarray
    """(N, 3) int64, points per axis; z runs fastest."""
    start: np.ndarray
    """(N,) int64, first index in the pool."""
    row_start: np.ndarray
    """(N,) int64, number of its first row."""
    low: np.ndarray
    """(rows,) int16, first point of each row that is held; beyond these φ is 0."""
    high: np.ndarray
    """(rows,) int16, and the last but one."""
    place: np.ndarray
    """(rows,) int32, where point z = 0 of the row is, or would be, from `start` on."""
    extent: np.ndarray
    """(N, 3, 2) int64, points [low, high) of the box beyond which φ is below a level; low > high
    where it is so everywhere."""


@inline_kernel()
def row_moments(values, first, low, count):
    """Σ φ and Σ φ z of so many points from z = low on, and Σ w, Σ w z and Σ w zz of the inside."""
    total = along = inside = inside_along = inside_square = 0.0
    for k in range(np.uint64(count)):
        # Integers of 64 bits become floats one by one on most processors.
        value, place = np.float64(values[first + k]), np.float64(np.int32(k) + np.int32(low))
        weight = min(max(4.0 * value - 1.5, 0.0), 1.0)
        total += value
        along += value * place
        inside += weight
        inside_along += weight * place
        inside_square += weight * place * place
    return total, along, inside, inside_along, inside_square


@kernel()
def box_moments(i, fields, out):
    """Moments of cell i, out (N_MOMENTS,)."""
    out[:] = 0
    for x in range(fields.shape[i, 0]):
        for y in range(fields.shape[i, 1]):
            low, high = row_span(x, y, i, fields)
            first = np.uint64(row_place(x, y, i, fields) + low)
            total, along, inside, inside_along, inside_square = row_moments(
                fields.phi, first, low, max(high - low, 0)
            )
            out[0] += total
            out[1] += total * x
            out[2] += total * y
            out[3] += along
            out[4] += inside
            out[5] += inside * x
            out[6] += inside * y
            out[7] += inside_along
            out[8] += inside * x * x
            out[9] += inside * y * y
            out[10] += inside_square
            out[11] += inside * x * y
            out[12] += inside_along * x
            out[13] += inside_along * y


@parallel_kernel()
def moments(shares, fields, out):
    """Moments of all cells, in lattice steps from the first point of each box.

    Parameters
    ----------
    shares : Shares of the cells
    fields : Fields
    out : (N, N_MOMENTS) float64, overwritten
    """
    offer(shares)
    for _ in prange(shares.threads):
        for i in turns(shares):
            box_moments(i, fields, out[i])


@kernel()
def find_extent(i, fields, level):
    """Find the extent of cell i."""
    for axis in range(3):
        fields.extent[i, axis, 0] = fields.shape[i, axis]
        fields.extent[i, axis, 1] = -1
    for x in range(fields.shape[i, 0]):
        for y in range(fields.shape[i, 1]):
            low, high = row_span(x, y, i, fields)
            first, count = row_place(x, y, i, fields) + low, max(high - low, 0)
            if row_peak(fields.phi, np.uint64(first), count) > level:
                z0, z1 = box_span(fields.phi, first, count, level)
                include(fields.extent, i, 0, x, x + 1)
                include(fields.extent, i, 1, y, y + 1)
                include(fields.extent, i, 2, low + z0, low + z1)


@parallel_kernel()
def find_extents(shares, fields, level):
    """Fill `fields.extent` with the bounding box of |φ| > level of each cell.

    Parameters
    ----------
    shares : Shares of the cells
    fields : Fields
    level : float
    """
    offer(shares)
    for _ in prange(shares.threads):
        for i in turns(shares):
            find_extent(i, fields, level)


@kernel()
def overlapping_pairs(order, low, high, out):
    """Find the pairs of boxes [low, high) that overlap, going along x.

    Parameters
    ----------
    order : (N,) int64, boxes by rising low x
    low, high : (N, 3) int64
    out : (room, 2) int64, gets the pairs i < j for which there is room

    Returns
    -------
    int : number of pairs that there are
    """
    count = 0
    for a in range(order.shape[0]):
        i = order[a]
        for b in range(a + 1, order.shape[0]):
            j = order[b]
            if low[j, 0] >= high[i, 0]:
                break
            meets = high[j, 0] > low[i, 0]
            for axis in range(1, 3):
                meets &= low[j, axis] < high[i, axis] and high[j, axis] > low[i, axis]
            if meets:
                if count < out.shape[0]:
                    out[count, 0], out[count, 1] = min(i, j), max(i, j)
                count += 1
    return count
