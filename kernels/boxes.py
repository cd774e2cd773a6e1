"""Boxes: what a step leaves behind in them, and moving them by whole lattice steps."""

import numpy as np
from numba import prange

from morphosim.kernels._jit import inline_kernel, kernel, parallel_kernel
from morphosim.kernels.frames import clear_row, copy_row

TOTAL, BAND, CORE, BAD, FACE, EDGE, N_SURVEYED = 0, 1, 2, 3, 4, 5, 6
"""What a survey finds: Σ φ, points with |φ| > tolerance, points with φ > 1/2, points beyond the
limit or not finite, and the largest |φ| on the faces of the box and on the edge of its band."""
GUARD = 1
"""Rows of the band beyond those where |φ| exceeds the tolerance."""


@inline_kernel()
def row_sums(values, first, nz, tolerance2, limit2, half):
    """Σ φ and the numbers of points in the band, above one half, and beyond the limit.

    The numbers are counted in the type of the fields, twice as fast as in integers and exact.
    """
    zero, one = values.dtype.type(0), values.dtype.type(1)
    total = zero
    band = zero
    core = zero
    bad = zero
    for z in range(np.uint64(nz)):
        value = values[first + z]
        square = value * value
        total += value
        band += one if square > tolerance2 else zero
        core += one if value > half else zero
        bad += zero if square <= limit2 else one
    return total, band, core, bad


@inline_kernel()
def row_total(values, first, count):
    """Σ φ of a row, in double precision."""
    total = 0.0
    for z in range(np.uint64(count)):
        total += values[first + z]
    return total


@inline_kernel()
def row_peak(values, first, nz):
    """Largest |φ| of a row."""
    peak = values.dtype.type(0)
    for z in range(np.uint64(nz)):
        peak = max(peak, abs(values[first + z]))
    return peak


@kernel()
def survey(values, first, sx, sy, nx, ny, nz, rows, whole, limits, found, out):
    """Measure one field.

    Parameters
    ----------
    values : 1-D; point (x, y, z) of the box lies at first + x sx + y sy + z
    nx, ny, nz : shape of the box
    rows : (nx, 2) rows [y0, y1) of each plane to look at; the field is 0 in others
    whole : bool, look at all rows
    limits : Limits
    found : (nx, 2), overwritten with the rows of each plane where |φ| exceeds the tolerance
    out : (N_SURVEYED,) float64, overwritten
    """
    tolerance2 = limits.tolerance * limits.tolerance
    runaway2 = limits.runaway * limits.runaway
    sum_total = sum_band = sum_core = sum_bad = 0.0
    face = edge = values.dtype.type(0)
    last = np.uint64(nz - 1)
    for x in range(nx):
        found[x, 0], found[x, 1] = ny, 0
        y0, y1 = (0, ny) if whole else (rows[x, 0], rows[x, 1])
        inner_0, inner_1 = y0 + 1, y1 - 1
        if not whole and 0 < x < nx - 1:
            inner_0 = max(inner_0, rows[x - 1, 0], rows[x + 1, 0])
            inner_1 = min(inner_1, rows[x - 1, 1], rows[x + 1, 1])
        for y in range(y0, y1):
            row = np.uint64(first + x * sx + y * sy)
            total, band, core, bad = row_sums(values, row, nz, tolerance2, runaway2, limits.half)
            sum_total += total
            sum_band += band
            sum_core += core
            sum_bad += bad
            if band > 0:
                found[x, 0] = min(found[x, 0], y)
                found[x, 1] = y + 1
            if x == 0 or x == nx - 1 or y == 0 or y == ny - 1:
                face = max(face, row_peak(values, row, nz))
            else:
                face = max(face, abs(values[row]), abs(values[row + last]))
                if not inner_0 <= y < inner_1:
                    edge = max(edge, row_peak(values, row, nz))
    out[TOTAL], out[BAND], out[CORE], out[BAD] = sum_total, sum_band, sum_core, sum_bad
    out[FACE] = face
    out[EDGE] = max(edge, face)


@kernel()
def widen(found, guard, nx, ny):
    """Widen the rows of each plane by `guard`, also over the planes beside; planes stay hulls."""
    for _ in range(guard):
        before_0, before_1 = ny, 0
        for x in range(nx):
            y0, y1 = found[x, 0], found[x, 1]
            low, high = min(before_0, ny), max(before_1, 0)
            if y0 < y1:
                low, high = min(low, y0 - 1), max(high, y1 + 1)
            if x + 1 < nx and found[x + 1, 0] < found[x + 1, 1]:
                low, high = min(low, found[x + 1, 0]), max(high, found[x + 1, 1])
            before_0, before_1 = y0, y1
            found[x, 0], found[x, 1] = max(low, 0), min(high, ny)


@inline_kernel()
def copy_rows(rows, target, first, nx):
    """Copy the rows [y0, y1) of nx planes; to assign slices takes seconds to compile."""
    for x in range(nx):
        target[first + x, 0], target[first + x, 1] = rows[x, 0], rows[x, 1]


@kernel()
def clear_outside(values, first, rows, nx, ny, nz):
    """Set a box to 0 outside of these rows of each plane; return Σ of what was there."""
    lost = 0.0
    for x in range(nx):
        for y in range(ny):
            if not rows[x, 0] <= y < rows[x, 1]:
                row = np.uint64(first + (x * ny + y) * nz)
                lost += row_total(values, row, nz)
                clear_row(values, row, nz)
    return lost


@kernel()
def find_band(i, phi, history, boxes, on_band, limits, surveys):
    """Measure cell i's stored field and find its band anew; return Σ φ that this cuts off.

    Parameters
    ----------
    phi, history : 1-D pools of fields; the latter may be None
    on_band : bool, whether fields are 0 outside of the band
    surveys : (N, N_SURVEYED), row i is overwritten
    """
    nx, ny, nz = boxes.shape[i, 0], boxes.shape[i, 1], boxes.shape[i, 2]
    first, planes = boxes.start[i], boxes.plane_start[i]
    band = boxes.band[planes : planes + nx]
    survey(phi, first, ny * nz, nz, nx, ny, nz, band, True, limits, band, surveys[i])
    widen(band, GUARD, nx, ny)
    if not on_band:
        return 0.0
    if history is not None:
        clear_outside(history, first, band, nx, ny, nz)
    cut = clear_outside(phi, first, band, nx, ny, nz)
    survey(phi, first, ny * nz, nz, nx, ny, nz, band, False, limits, band.copy(), surveys[i])
    return cut


@kernel()
def find_bands(cells, phi, history, boxes, on_band, limits, surveys, lost):
    """Do what `find_band` does for several cells; `lost` (N,) is updated with what it returns."""
    for k in range(cells.shape[0]):
        lost[cells[k]] += find_band(cells[k], phi, history, boxes, on_band, limits, surveys)


@parallel_kernel()
def extents(cells, phi, boxes, tolerance, out):
    """Bounding box of |φ| > tolerance of each cell, out (len(cells), 3, 2): [low, high)."""
    for k in prange(cells.shape[0]):
        i = cells[k]
        nx, ny, nz = boxes.shape[i, 0], boxes.shape[i, 1], boxes.shape[i, 2]
        for axis in range(3):
            out[k, axis, 0] = boxes.shape[i, axis]
            out[k, axis, 1] = 0
        for x in range(nx):
            for y in range(ny):
                z0, z1 = row_span(phi, boxes.start[i] + (x * ny + y) * nz, nz, tolerance)
                if z0 < z1:
                    include(out, k, 0, x, x + 1)
                    include(out, k, 1, y, y + 1)
                    include(out, k, 2, z0, z1)


@inline_kernel()
def row_span(values, first, nz, tolerance):
    """[z0, z1) that holds all |φ| > tolerance of one row; empty if there is none."""
    z0 = 0
    while z0 < nz and abs(values[first + z0]) <= tolerance:
        z0 += 1
    z1 = nz
    while z1 > z0 and abs(values[first + z1 - 1]) <= tolerance:
        z1 -= 1
    return z0, z1


@inline_kernel()
def include(out, k, axis, low, high):
    """Widen out[k, axis] to hold [low, high)."""
    out[k, axis, 0] = min(out[k, axis, 0], low)
    out[k, axis, 1] = max(out[k, axis, 1], high)


@kernel()
def move_box(source, source_start, old_shape, target, target_start, new_shape, shift):
    """Copy a box into another of other shape, moved by `shift` lattice steps; the rest is 0.

    `shift` is new origin minus old origin. Returns Σ of the values that are left outside.
    """
    nx, ny, nz = new_shape[0], new_shape[1], new_shape[2]
    target[target_start : target_start + nx * ny * nz] = 0
    z0, z1 = max(0, shift[2]), min(old_shape[2], shift[2] + nz)
    kept = max(z1 - z0, 0)
    lost = 0.0
    for x in range(old_shape[0]):
        for y in range(old_shape[1]):
            row = np.uint64(source_start + (x * old_shape[1] + y) * old_shape[2])
            u, v = x - shift[0], y - shift[1]
            if 0 <= u < nx and 0 <= v < ny and kept > 0:
                goal = np.uint64(target_start + (u * ny + v) * nz + z0 - shift[2])
                copy_row(source, row + np.uint64(z0), target, goal, kept)
                lost += row_total(source, row, z0)
                lost += row_total(source, row + np.uint64(z1), old_shape[2] - z1)
            else:
                lost += row_total(source, row, old_shape[2])
    return lost


@kernel()
def close_ranks(starts, goals, sizes, values):
    """Copy stretches of a pool to where they begin from now on, none of them further up.

    Parameters
    ----------
    starts, goals, sizes : (n,) first indices before and after, both ascending, and lengths
    values : 1-D pool, updated
    """
    for k in range(starts.shape[0]):
        if goals[k] < starts[k]:
            for p in range(sizes[k]):
                values[goals[k] + p] = values[starts[k] + p]


@kernel()
def box_total(i, values, boxes):
    """Σ over the box of cell i."""
    ny, nz = boxes.shape[i, 1], boxes.shape[i, 2]
    total = 0.0
    for row in range(boxes.shape[i, 0] * ny):
        total += row_total(values, np.uint64(boxes.start[i] + row * nz), nz)
    return total


@parallel_kernel()
def move_boxes(
    cells, starts, shapes, shifts, phi, history, boxes, on_band, limits, surveys, lost, totals
):  # fmt: skip
    """Copy fields from where boxes were to where they are now, and find their bands.

    Parameters
    ----------
    cells : (n,) whose boxes have moved
    starts, shapes, shifts : (n,), (n, 3), (n, 3) first index and shape of the old boxes, which no
        new one overlaps in the pools, and new origins minus old ones
    phi, history : 1-D pools of fields; the latter may be None
    boxes : Boxes, of now
    on_band, limits, surveys : see `find_band`
    lost : (N,) updated with Σ φ that this cuts off
    totals : (N,) overwritten with Σ of the histories of these cells, or None
    """
    for k in prange(cells.shape[0]):
        i = cells[k]
        where = boxes.start[i], boxes.shape[i], shifts[k]
        outside = move_box(phi, starts[k], shapes[k], phi, *where)
        if history is not None:
            move_box(history, starts[k], shapes[k], history, *where)
        lost[i] += outside + find_band(i, phi, history, boxes, on_band, limits, surveys)
        if totals is not None:
            totals[i] = box_total(i, history, boxes)
