"""Boxes: what a step leaves behind in them, and laying them anew around their fields."""

import numpy as np
from numba import prange

from morphosim.kernels._jit import inline_kernel, kernel, parallel_kernel
from morphosim.kernels.frames import clear_row, copy_row
from morphosim.kernels.rows import (
    BLOCK,
    HIGH,
    LOW,
    N_SPANS,
    NEW_HIGH,
    NEW_LOW,
    beyond,
    block,
    copy_span,
    covered,
    list_spans,
    listed,
    n_blocks,
    n_listed,
    row_number,
    row_place,
    row_span,
    settle_rows,
    widen,
)

TOTAL, BAND, CORE, BAD, FACE, EDGE, WANTED, N_SURVEYED = 0, 1, 2, 3, 4, 5, 6, 7
"""What a survey finds: Σ φ, points with |φ| > tolerance, points with φ > 1/2, points beyond the
limit or not finite, the largest |φ| on the faces of the box and on the edge of its band, and how
many points the cell needs in the pools."""
GUARD = 1
"""Points of a box beyond those where |φ| exceeds the tolerance, and rows of its planes."""
PART = 1024
"""Points that are summed in the type of the fields."""


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
def survey(values, nx, ny, nz, limits, found, out):
    """Measure one field that is kept whole.

    Parameters
    ----------
    values : 1-D, begins with the box
    nx, ny, nz : shape of the box
    limits : Limits
    found : (nx, 2), overwritten with the rows of each plane where |φ| exceeds the tolerance
    out : (N_SURVEYED,) float64, overwritten
    """
    tolerance2 = limits.tolerance * limits.tolerance
    runaway2 = limits.runaway * limits.runaway
    sum_total = sum_band = sum_core = sum_bad = 0.0
    face = values.dtype.type(0)
    last = np.uint64(nz - 1)
    for x in range(nx):
        found[x, 0], found[x, 1] = ny, 0
        for y in range(ny):
            row = np.uint64((x * ny + y) * nz)
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
    out[TOTAL], out[BAND], out[CORE], out[BAD] = sum_total, sum_band, sum_core, sum_bad
    out[FACE] = out[EDGE] = face
    out[WANTED] = nx * ny * nz


@kernel()
def widen_planes(found, guard, nx, ny):
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
def keep_survey(i, out, surveys):
    """Keep what a survey of cell i has found; to assign slices takes seconds to compile."""
    for k in range(N_SURVEYED):
        surveys[i, k] = out[k]


@kernel()
def settle_planes(i, boxes, found):
    """Make these rows [y0, y1) of each plane the band of cell i, whose box is kept whole."""
    ny, nz = boxes.shape[i, 1], boxes.shape[i, 2]
    for x in range(boxes.shape[i, 0]):
        first = row_number(x, 0, i, boxes)
        for y in range(ny):
            boxes.low[first + y] = 0
            boxes.high[first + y] = nz if found[x, 0] <= y < found[x, 1] else 0
            boxes.place[first + y] = (x * ny + y) * nz


@inline_kernel()
def stretch_length(i, boxes, whole):
    """Points of cell i in the pools."""
    rows = boxes.shape[i, 0] * boxes.shape[i, 1]
    if whole:
        return rows * boxes.shape[i, 2]
    for row in range(boxes.row_start[i] + rows - 1, boxes.row_start[i] - 1, -1):
        if boxes.low[row] < boxes.high[row]:
            return np.int64(boxes.place[row]) + np.int64(boxes.high[row])
    return np.int64(0)


@kernel()
def survey_stretch(values, first, count, limits, out):
    """Measure so many values of a field, but for what depends on where they are."""
    tolerance2 = limits.tolerance * limits.tolerance
    runaway2 = limits.runaway * limits.runaway
    sum_total = sum_band = sum_core = sum_bad = 0.0
    for at in range(0, count, PART):
        total, band, core, bad = row_sums(
            values, np.uint64(first + at), min(PART, count - at), tolerance2, runaway2, limits.half
        )
        sum_total += total
        sum_band += band
        sum_core += core
        sum_bad += bad
    out[TOTAL], out[BAND], out[CORE], out[BAD] = sum_total, sum_band, sum_core, sum_bad


@inline_kernel()
def span_beyond(values, first, low, high, level):
    """[z0, z1) that holds all |φ| > level of a span of a row, whose z = 0 is at `first`."""
    last = high - BLOCK
    begin, found = beyond(values, np.uint64(first + low), level)
    _, end = beyond(values, np.uint64(first + last), level)
    if found > 0 and end > 0:
        return low + begin, last + end
    z0, z1 = high, low
    for k in range(n_blocks(low, high)):
        z = block(k, low, high)
        begin, end = beyond(values, np.uint64(first + z), level)
        if end > 0:
            z0, z1 = min(z0, z + begin), z + end
    return z0, z1


@kernel()
def survey_rows(i, boxes, values, first, limits, spans, out):
    """Find what of cell i's band is beyond the tolerance, row by row; it is kept row by row.

    Parameters
    ----------
    values, first : 1-D, where its stretch begins in them
    limits : Limits
    spans : (N_SPANS, rows); LOW and HIGH are overwritten with what was found, others as well
    out : (N_SURVEYED,) float64; FACE and EDGE are overwritten
    """
    nx, ny, nz = boxes.shape[i, 0], boxes.shape[i, 1], boxes.shape[i, 2]
    face = edge = values.dtype.type(0)
    list_spans(i, boxes, False, spans)
    covered(i, boxes, spans)
    for k in range(np.uint64(n_listed(nx, ny))):
        spans[LOW, k], spans[HIGH, k] = nz, 0
    for x in range(nx):
        for y in range(ny):
            low, high = row_span(x, y, i, boxes)
            if low >= high:
                continue
            k, row = listed(x, y, ny), first + boxes.place[row_number(x, y, i, boxes)]
            z0, z1 = span_beyond(values, row, low, high, limits.tolerance)
            if z0 < z1:
                spans[LOW, k], spans[HIGH, k] = z0, z1
            if x == 0 or x == nx - 1 or y == 0 or y == ny - 1:
                face = max(face, row_peak(values, np.uint64(row + low), high - low))
            else:
                if low == 0:
                    face = max(face, abs(values[np.uint64(row)]))
                if high == nz:
                    face = max(face, abs(values[np.uint64(row + nz - 1)]))
                z0, z1 = (
                    min(np.int64(spans[NEW_LOW, k]), high),
                    max(np.int64(spans[NEW_HIGH, k]), low),
                )
                edge = max(edge, row_peak(values, np.uint64(row + low), z0 - low))
                edge = max(edge, row_peak(values, np.uint64(row + z1), high - z1))
    out[FACE], out[EDGE] = face, max(edge, face)


@kernel()
def relay(i, boxes, spans, values, target):
    """Lay cell i's stretch for the band in `spans` NEW_LOW and NEW_HIGH; return Σ that is cut off.

    `values` begins with the stretch as it was, `target` is a pool. What is new is 0.
    """
    ny = boxes.shape[i, 1]
    goal, lost = boxes.start[i], 0.0
    for x in range(boxes.shape[i, 0]):
        for y in range(ny):
            k = listed(x, y, ny)
            low, high = row_span(x, y, i, boxes)
            new_low, new_high = np.int64(spans[NEW_LOW, k]), np.int64(spans[NEW_HIGH, k])
            row = np.int64(boxes.place[row_number(x, y, i, boxes)])
            if low == new_low and high == new_high:
                if low < high:
                    copy_span(values, row + low, target, goal, high - low)
            else:
                lost += relay_row(row, low, high, new_low, new_high, values, goal, target)
            goal += new_high - new_low
    return lost


@kernel()
def relay_row(row, low, high, new_low, new_high, values, goal, target):
    """`relay` of a row whose span is another: from z = 0 at `row` to its begin at `goal`."""
    clear_row(target, np.uint64(goal), new_high - new_low)
    first, last = min(max(low, new_low), high), max(min(high, new_high), low)
    if first >= last:
        return row_total(values, np.uint64(row + low), high - low)
    copy_row(
        values, np.uint64(row + first), target, np.uint64(goal + first - new_low), last - first
    )
    lost = row_total(values, np.uint64(row + low), first - low)
    return lost + row_total(values, np.uint64(row + last), high - last)


@inline_kernel()
def box_span(values, first, nz, tolerance):
    """[z0, z1) that holds all |φ| > tolerance of one row; empty if there is none."""
    z0 = np.int64(0)
    while z0 < nz and abs(values[first + z0]) <= tolerance:
        z0 += 1
    z1 = np.int64(nz)
    while z1 > z0 and abs(values[first + z1 - 1]) <= tolerance:
        z1 -= 1
    return z0, z1


@kernel()
def find_band(i, boxes, on_band, values, limits, out):
    """Find the band of cell i, of which `values` begins with the whole box, and what it needs.

    `out` (N_SURVEYED,) is overwritten; of a field on the band, but for WANTED, it is of no use.
    """
    nx, ny, nz = boxes.shape[i, 0], boxes.shape[i, 1], boxes.shape[i, 2]
    if not on_band:
        found = np.empty((nx, 2), np.int32)
        survey(values, nx, ny, nz, limits, found, out)
        widen_planes(found, GUARD, nx, ny)
        settle_planes(i, boxes, found)
        return
    spans = np.empty((N_SPANS, n_listed(nx, ny)), np.int16)
    spans[LOW], spans[HIGH] = nz, 0
    for x in range(nx):
        for y in range(ny):
            z0, z1 = box_span(values, (x * ny + y) * nz, nz, limits.tolerance)
            if z0 < z1:
                spans[LOW, listed(x, y, ny)], spans[HIGH, listed(x, y, ny)] = z0, z1
    out[WANTED] = widen(i, boxes, spans)
    settle_rows(i, boxes, spans)


@parallel_kernel()
def find_bands(cells, boxes, on_band, starts, values, limits, surveys):
    """`find_band` of several cells.

    Parameters
    ----------
    cells : (n,) cells whose rows have their places, and whose bands are written
    boxes : Boxes
    on_band : bool, whether only the band is kept
    starts, values : (n,) first indices, and a 1-D array in which these whole boxes begin there
    limits : Limits
    surveys : (N, N_SURVEYED), updated
    """
    for k in prange(cells.shape[0]):
        find_band(cells[k], boxes, on_band, values[starts[k] :], limits, surveys[cells[k]])


@parallel_kernel()
def put_boxes(cells, boxes, on_band, starts, values, pool, lost):
    """Put whole boxes into a pool; `lost` (N,) is updated with Σ of what the bands leave out.

    Parameters as for `find_bands`.
    """
    for k in prange(cells.shape[0]):
        i = cells[k]
        nx, ny, nz = boxes.shape[i, 0], boxes.shape[i, 1], boxes.shape[i, 2]
        cut = 0.0
        for x in range(nx):
            for y in range(ny):
                source, goal = starts[k] + (x * ny + y) * nz, row_place(x, y, i, boxes)
                low, high = np.int64(0), nz
                if on_band:
                    low, high = row_span(x, y, i, boxes)
                    high = max(high, low)
                copy_row(values, np.uint64(source + low), pool, np.uint64(goal + low), high - low)
                cut += row_total(values, np.uint64(source), low)
                cut += row_total(values, np.uint64(source + high), nz - high)
        lost[i] += cut


@parallel_kernel()
def get_boxes(cells, boxes, on_band, pool, shifts, shapes, starts, values, lost):
    """Copy fields out of a pool into whole boxes of other shapes; the rest of these is 0.

    Parameters
    ----------
    cells : (n,) cells
    boxes : Boxes, as they are
    on_band : bool, whether only the band is kept
    pool : 1-D
    shifts, shapes : (n, 3) origins of the new boxes minus those of the old, and their shapes
    starts, values : (n,) first indices of the new boxes in a 1-D array, overwritten there
    lost : (N,), updated with Σ of what is left outside
    """
    for k in prange(cells.shape[0]):
        i = cells[k]
        nx, ny, nz = shapes[k, 0], shapes[k, 1], shapes[k, 2]
        clear_row(values, np.uint64(starts[k]), nx * ny * nz)
        outside = 0.0
        for x in range(boxes.shape[i, 0]):
            for y in range(boxes.shape[i, 1]):
                low, high = np.int64(0), boxes.shape[i, 2]
                if on_band:
                    low, high = row_span(x, y, i, boxes)
                source = row_place(x, y, i, boxes)
                u, v = x - shifts[k, 0], y - shifts[k, 1]
                z0, z1 = min(max(low, shifts[k, 2]), high), min(high, shifts[k, 2] + nz)
                if not (0 <= u < nx and 0 <= v < ny and z0 < z1):
                    z0, z1 = low, low
                goal = starts[k] + (u * ny + v) * nz + z0 - shifts[k, 2]
                copy_row(pool, np.uint64(source + z0), values, np.uint64(goal), z1 - z0)
                outside += row_total(pool, np.uint64(source + low), z0 - low)
                outside += row_total(pool, np.uint64(source + z1), max(high - z1, 0))
        lost[i] += outside


@parallel_kernel()
def survey_bands(cells, boxes, phi, limits, surveys):
    """Survey fields whose bands alone are kept."""
    for k in prange(cells.shape[0]):
        i = cells[k]
        count = stretch_length(i, boxes, False)
        spans = np.empty((N_SPANS, n_listed(boxes.shape[i, 0], boxes.shape[i, 1])), np.int16)
        survey_stretch(phi, boxes.start[i], count, limits, surveys[i])
        survey_rows(i, boxes, phi, boxes.start[i], limits, spans, surveys[i])
        surveys[i, WANTED] = count


@parallel_kernel()
def stretch_totals(cells, boxes, on_band, values, totals):
    """Σ over the stretches of cells in a pool, into `totals` (N,)."""
    for k in prange(cells.shape[0]):
        i = cells[k]
        count, total = stretch_length(i, boxes, not on_band), 0.0
        for at in range(0, count, PART):
            total += row_total(values, np.uint64(boxes.start[i] + at), min(PART, count - at))
        totals[i] = total


@parallel_kernel()
def extents(cells, boxes, on_band, phi, tolerance, out):
    """Bounding box of |φ| > tolerance of each cell, out (len(cells), 3, 2): [low, high)."""
    for k in prange(cells.shape[0]):
        i = cells[k]
        nz = boxes.shape[i, 2]
        for axis in range(3):
            out[k, axis, 0] = boxes.shape[i, axis]
            out[k, axis, 1] = 0
        for x in range(boxes.shape[i, 0]):
            for y in range(boxes.shape[i, 1]):
                low, high = np.int64(0), nz
                if on_band:
                    low, high = row_span(x, y, i, boxes)
                first = row_place(x, y, i, boxes) + low
                z0, z1 = box_span(phi, first, max(high - low, 0), tolerance)
                if z0 < z1:
                    include(out, k, 0, x, x + 1)
                    include(out, k, 1, y, y + 1)
                    include(out, k, 2, low + z0, low + z1)


@inline_kernel()
def include(out, k, axis, low, high):
    """Widen out[k, axis] to hold [low, high)."""
    out[k, axis, 0] = min(out[k, axis, 0], low)
    out[k, axis, 1] = max(out[k, axis, 1], high)


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
