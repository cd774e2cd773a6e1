"""Attraction of single pairs of cells, where σ is not given by their types."""

import numpy as np
from numba import prange

from morphosim.kernels._jit import inline_kernel, kernel, parallel_kernel


@inline_kernel()
def overlap(i, j, axis, boxes):
    """Common lattice range [low, high) of two boxes along one axis; may be empty."""
    low = max(boxes.origin[i, axis], boxes.origin[j, axis])
    high = min(
        boxes.origin[i, axis] + boxes.shape[i, axis],
        boxes.origin[j, axis] + boxes.shape[j, axis],
    )
    return low, high


@inline_kernel()
def row_index(i, x, y, boxes):
    """Number of the row at lattice position (x, y) within cell i's box."""
    return (x - boxes.origin[i, 0]) * boxes.shape[i, 1] + y - boxes.origin[i, 1]


@kernel()
def add_overlap(i, j, weight, phi, boxes, target):
    """target_i += weight φ_j where the boxes of cells i and j overlap."""
    x0, x1 = overlap(i, j, 0, boxes)
    y0, y1 = overlap(i, j, 1, boxes)
    z0, z1 = overlap(i, j, 2, boxes)
    for x in range(x0, x1):
        for y in range(y0, y1):
            line = row_index(j, x, y, boxes)
            low = max(z0, boxes.origin[j, 2] + boxes.spans[boxes.row_start[j] + line, 0])
            high = min(z1, boxes.origin[j, 2] + boxes.spans[boxes.row_start[j] + line, 1])
            if low >= high:
                continue
            source = np.uint64(boxes.start[j] + line * boxes.shape[j, 2] + low - boxes.origin[j, 2])
            line = row_index(i, x, y, boxes)
            goal = np.uint64(boxes.start[i] + line * boxes.shape[i, 2] + low - boxes.origin[i, 2])
            for k in range(np.uint64(high - low)):
                target[goal + k] += weight * phi[source + k]


@parallel_kernel()
def accumulate_pairs(bounds, order, pairs, phi, boxes, target):
    """target_i = Σ_j weight_ij φ_j over the listed pairs, for every cell of `order`.

    Parameters
    ----------
    bounds : (threads + 1,) ranges of `order`, one per thread
    order : cells, grouped by thread
    pairs : Pairs
    phi, target : 1-D pools of the same layout; `target` is overwritten
    boxes : Boxes
    """
    for worker in prange(bounds.shape[0] - 1):
        for k in range(bounds[worker], bounds[worker + 1]):
            i = order[k]
            first = boxes.start[i]
            size = boxes.shape[i, 0] * boxes.shape[i, 1] * boxes.shape[i, 2]
            target[first : first + size] = 0
            for pair in range(pairs.start[i], pairs.start[i + 1]):
                add_overlap(i, pairs.cell[pair], pairs.weight[pair], phi, boxes, target)
