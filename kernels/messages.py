"""Fields of ghost cells put into messages and taken out: the narrow band alone."""

import numpy as np

from morphosim.kernels._jit import kernel
from morphosim.kernels.frames import copy_row
from morphosim.kernels.rows import row_number, row_place, row_span


@kernel()
def pack(cells, low, high, phi, boxes, rows, values):
    """Write parts of some cells.

    Parameters
    ----------
    cells : (K,) int64
    low, high : (K, 3) int64, the part [low, high) of each cell's box
    phi : 1-D pool
    boxes : Boxes
    rows : (rows of the parts, 2) int16, overwritten with the band's span of each, counted from
        `low`
    values : 1-D, overwritten with these spans

    Returns
    -------
    int
        Number of values.
    """
    row = place = 0
    for k in range(cells.shape[0]):
        i = cells[k]
        for x in range(low[k, 0], high[k, 0]):
            for y in range(low[k, 1], high[k, 1]):
                z0, z1 = row_span(x, y, i, boxes)
                z0, z1 = max(z0, low[k, 2]), min(z1, high[k, 2])
                count = max(z1 - z0, 0)
                source = row_place(x, y, i, boxes) + z0
                copy_row(phi, np.uint64(source), values, np.uint64(place), count)
                first = z0 - low[k, 2] if count else 0
                rows[row, 0], rows[row, 1] = first, first + count
                place += count
                row += 1
    return place


@kernel()
def unpack(cells, low, high, phi, boxes, rows, values):
    """Read what `pack` has written into the parts [low, high) of boxes; sets their band."""
    row = place = 0
    for k in range(cells.shape[0]):
        i = cells[k]
        for x in range(low[k, 0], high[k, 0]):
            for y in range(low[k, 1], high[k, 1]):
                z0, count = low[k, 2] + rows[row, 0], np.int64(rows[row, 1] - rows[row, 0])
                number = row_number(x, y, i, boxes)
                boxes.low[number], boxes.high[number] = z0, z0 + count
                goal = row_place(x, y, i, boxes) + z0
                copy_row(values, np.uint64(place), phi, np.uint64(goal), count)
                place += count
                row += 1
