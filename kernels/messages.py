"""Fields of ghost cells put into messages and taken out: the rows of the narrow band alone."""

import numpy as np

from morphosim.kernels._jit import kernel
from morphosim.kernels.frames import band_rows, copy_row


@kernel()
def pack(cells, low, high, phi, boxes, rows, values):
    """Write parts of some cells.

    Parameters
    ----------
    cells : (K,) int64
    low, high : (K, 3) int64, the part [low, high) of each cell's box
    phi : 1-D pool
    boxes : Boxes
    rows : (planes, 2) int32, overwritten with the band's rows of each plane, counted from `low`
    values : 1-D, overwritten with these rows

    Returns
    -------
    int
        Number of values.
    """
    plane = place = 0
    for k in range(cells.shape[0]):
        i, count = cells[k], high[k, 2] - low[k, 2]
        ny, nz = boxes.shape[i, 1], boxes.shape[i, 2]
        for x in range(low[k, 0], high[k, 0]):
            y0, y1 = band_rows(x, i, boxes, False)
            y0, y1 = max(y0, low[k, 1]), min(y1, high[k, 1])
            rows[plane, 0], rows[plane, 1] = y0 - low[k, 1], max(y1, y0) - low[k, 1]
            for y in range(y0, y1):
                source = boxes.start[i] + (x * ny + y) * nz + low[k, 2]
                copy_row(phi, np.uint64(source), values, np.uint64(place), count)
                place += count
            plane += 1
    return place


@kernel()
def unpack(cells, low, high, phi, boxes, rows, values):
    """Read what `pack` has written into the parts [low, high) of boxes; sets their band."""
    plane = place = 0
    for k in range(cells.shape[0]):
        i, count = cells[k], high[k, 2] - low[k, 2]
        ny, nz = boxes.shape[i, 1], boxes.shape[i, 2]
        for x in range(low[k, 0], high[k, 0]):
            y0, y1 = rows[plane, 0] + low[k, 1], rows[plane, 1] + low[k, 1]
            band = boxes.plane_start[i] + x
            boxes.band[band, 0], boxes.band[band, 1] = y0, y1
            for y in range(y0, y1):
                goal = boxes.start[i] + (x * ny + y) * nz + low[k, 2]
                copy_row(values, np.uint64(place), phi, np.uint64(goal), count)
                place += count
            plane += 1
