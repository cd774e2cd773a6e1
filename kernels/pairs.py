"""Attraction of single pairs of cells, where σ is not given by their types."""

import numpy as np
from numba import prange

from morphosim.kernels._jit import inline_kernel, kernel, parallel_kernel
from morphosim.kernels.frames import HALO, frame_index, frame_size, strides
from morphosim.kernels.rows import row_place, row_span
from morphosim.kernels.sharing import offer, turns


@inline_kernel()
def overlap(i, j, axis, boxes):
    """Range [low, high) of cell i's frame, in its box's count, in cell j's box; may be empty."""
    shift = boxes.origin[j, axis] - boxes.origin[i, axis]
    low = max(-HALO, shift)
    high = min(boxes.shape[i, axis] + HALO, shift + boxes.shape[j, axis])
    return low, high, shift


@kernel()
def add_overlap(i, j, weight, phi, boxes, target, first):
    """target_i += weight φ_j where the frame of cell i meets the band of cell j."""
    x0, x1, shift_x = overlap(i, j, 0, boxes)
    y0, y1, shift_y = overlap(i, j, 1, boxes)
    z0, z1, shift_z = overlap(i, j, 2, boxes)
    sx, sy = strides(i, boxes)
    for x in range(x0, x1):
        for y in range(y0, y1):
            low, high = row_span(x - shift_x, y - shift_y, j, boxes)
            low, high = max(low + shift_z, z0), min(high + shift_z, z1)
            place = row_place(x - shift_x, y - shift_y, j, boxes) - shift_z
            source, goal = np.uint64(place + low), np.uint64(first + frame_index(x, y, low, sx, sy))
            for k in range(np.uint64(max(high - low, 0))):
                target[goal + k] += weight * phi[source + k]


@parallel_kernel()
def accumulate_pairs(shares, order, pairs, phi, boxes, target):
    """target_i = Σ_j weight_ij φ_j over the listed pairs, for every pulled cell of `order`.

    Parameters
    ----------
    shares : Shares of `order`
    order : cells that are stepped
    pairs : Pairs
    phi : 1-D pool
    boxes : Boxes
    target : 1-D pool of the frames of pulled cells, overwritten
    """
    offer(shares)
    for _ in prange(shares.threads):
        for k in turns(shares):
            i = order[k]
            first = pairs.frame_start[i]
            if first >= 0:
                target[first : first + frame_size(i, boxes)] = 0
                for pair in range(pairs.start[i], pairs.start[i + 1]):
                    add_overlap(i, pairs.cell[pair], pairs.weight[pair], phi, boxes, target, first)
