"""Boxes: what a step leaves behind in them, and moving them by whole lattice steps."""

import numpy as np

from morphosim.kernels._jit import inline_kernel, kernel


@inline_kernel()
def row_span(values, first, nz, tolerance):
    """[z0, z1) that holds all |φ| > tolerance of one row; (nz, 0) if there is none."""
    z0 = 0
    while z0 < nz and abs(values[first + z0]) <= tolerance:
        z0 += 1
    z1 = nz
    while z1 > z0 and abs(values[first + z1 - 1]) <= tolerance:
        z1 -= 1
    if z0 == nz:
        z1 = 0
    return z0, z1


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


@kernel()
def survey(values, first, nx, ny, nz, tolerance, limit, half, spans, span_start, out):
    """Measure one box: row spans, and in `out` (5,) float64 its sums.

    out = Σ φ, points with |φ| > tolerance, points with φ > 1/2, points beyond `limit` or not
    finite, largest |φ| on the faces.
    """
    total = 0.0
    band_points = 0.0
    core_points = 0.0
    bad_points = 0.0
    for line in range(nx * ny):
        row = np.uint64(first + line * nz)
        part, band, core, bad = row_sums(
            values, row, nz, tolerance * tolerance, limit * limit, half
        )
        total += part
        core_points += core
        bad_points += bad
        band_points += band
        if band == 0:
            spans[span_start + line, 0] = nz
            spans[span_start + line, 1] = 0
        else:
            z0, z1 = row_span(values, first + line * nz, nz, tolerance)
            spans[span_start + line, 0] = z0
            spans[span_start + line, 1] = z1
    out[0] = total
    out[1] = band_points
    out[2] = core_points
    out[3] = bad_points
    out[4] = face_peak(values, first, nx, ny, nz)


@kernel()
def face_peak(values, first, nx, ny, nz):
    """Largest |φ| on the six faces of a box."""
    peak = abs(values[first])
    for x in range(nx):
        edge_x = x == 0 or x == nx - 1
        for y in range(ny):
            row = first + (x * ny + y) * nz
            if edge_x or y == 0 or y == ny - 1:
                for z in range(nz):
                    peak = max(peak, abs(values[row + z]))
            else:
                peak = max(peak, abs(values[row]), abs(values[row + nz - 1]))
    return peak


@kernel()
def extents(cells, boxes, out):
    """Bounding box of the band of each cell, out (len(cells), 3, 2): [low, high) in its box."""
    for k in range(cells.shape[0]):
        i = cells[k]
        for axis in range(3):
            out[k, axis, 0] = boxes.shape[i, axis]
            out[k, axis, 1] = 0
        for x in range(boxes.shape[i, 0]):
            for y in range(boxes.shape[i, 1]):
                line = boxes.row_start[i] + x * boxes.shape[i, 1] + y
                z0, z1 = boxes.spans[line, 0], boxes.spans[line, 1]
                if z0 < z1:
                    include(out, k, 0, x, x + 1)
                    include(out, k, 1, y, y + 1)
                    include(out, k, 2, z0, z1)


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
    lost = 0.0
    for x in range(old_shape[0]):
        for y in range(old_shape[1]):
            row = source_start + (x * old_shape[1] + y) * old_shape[2]
            u, v = x - shift[0], y - shift[1]
            inside = 0 <= u < nx and 0 <= v < ny
            goal = target_start + (u * ny + v) * nz - shift[2]
            for z in range(old_shape[2]):
                if inside and 0 <= z - shift[2] < nz:
                    target[goal + z] = source[row + z]
                else:
                    lost += source[row + z]
    return lost
