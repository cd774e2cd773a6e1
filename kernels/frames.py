"""Frames: padded work arrays, each a thread's copy of one cell's box with a halo around it.

A frame has HALO more points at each end of each axis, so that stencils need no care at the faces.
It is 0 wherever no cell is at work; where the whole box is worked on, the halo mirrors it. Frames
are flat: point (x, y, z) of the box lies at `frame_index`, its neighbours along x, y, z at
`strides` and 1. What no stencil reads is kept without a frame, as the pools are; see `rows`.
"""

import numpy as np

from morphosim.kernels._jit import inline_kernel, kernel

HALO = 3
"""Reach of the widest stencil."""
LEAD = 8
"""Points before the first row, of whose halo they are a part."""


@inline_kernel()
def row_length(nz):
    """Points of a frame's row: a multiple of 8, so that whole vectors fill it."""
    return (nz + 2 * HALO + 7) & ~7


def frame_shapes(shape):
    """(N, 3) shapes of the frames of boxes of these shapes (N, 3); not a kernel."""
    result = shape + 2 * HALO
    result[:, 2] = row_length.py_func(shape[:, 2])
    return result


@inline_kernel()
def frame_length(points):
    """Length of a frame of so many points: with what leads and ends it, in whole cache lines."""
    return (points + 2 * LEAD + 15) & ~15


def frame_sizes(shape):
    """(N,) lengths of the frames of boxes of these shapes (N, 3); not a kernel."""
    return frame_length.py_func(frame_shapes(shape).prod(axis=1))


@inline_kernel()
def strides(i, boxes):
    """Steps between neighbours along x and y in cell i's frame."""
    row = row_length(boxes.shape[i, 2])
    return (boxes.shape[i, 1] + 2 * HALO) * row, row


@inline_kernel()
def frame_index(x, y, z, sx, sy):
    """Index in the frame of point (x, y, z) of the box."""
    return LEAD + (x + HALO) * sx + (y + HALO) * sy + z


@inline_kernel()
def box_point(p, sx, sy):
    """Point (x, y, z) of the box that has the index p in the frame."""
    rest = np.int64(p) - LEAD
    x = rest // np.int64(sx)
    rest -= x * np.int64(sx)
    y = rest // np.int64(sy)
    return x - HALO, y - HALO, rest - y * np.int64(sy)


@kernel()
def frame_size(i, boxes):
    """Length of cell i's frame."""
    return frame_length((boxes.shape[i, 0] + 2 * HALO) * strides(i, boxes)[0])


@inline_kernel()
def copy_row(source, first, target, goal, count):
    """Copy a stretch."""
    for k in range(np.uint64(count)):
        target[goal + k] = source[first + k]


@inline_kernel()
def clear_row(target, goal, count):
    """Set a stretch to 0."""
    for k in range(np.uint64(count)):
        target[goal + k] = 0


@kernel()
def clear(i, boxes, frame):
    """Set the whole of cell i's frame to 0."""
    clear_row(frame, np.uint64(0), frame_size(i, boxes))


@inline_kernel()
def mirrored(k, n):
    """Index in 0 … n - 1 of which k is the mirror image beyond the faces at -1/2 and n - 1/2."""
    if k < 0:
        return -1 - k
    return k if k < n else 2 * n - 1 - k


@kernel()
def mirror(i, boxes, frame):
    """Fill the halo of a frame that holds cell i's whole box as cosine series continue it."""
    sx, sy = strides(i, boxes)
    nx, ny, nz = boxes.shape[i, 0], boxes.shape[i, 1], boxes.shape[i, 2]
    for x in range(nx):
        for y in range(ny):
            row = frame_index(x, y, 0, sx, sy)
            for k in range(1, HALO + 1):
                frame[row - k] = frame[row + k - 1]
                frame[row + nz + k - 1] = frame[row + nz - k]
    for x in range(-HALO, nx + HALO):
        for y in range(-HALO, ny + HALO):
            if not (0 <= x < nx and 0 <= y < ny):
                source = frame_index(mirrored(x, nx), mirrored(y, ny), -HALO, sx, sy)
                goal = frame_index(x, y, -HALO, sx, sy)
                copy_row(frame, np.uint64(source), frame, np.uint64(goal), nz + 2 * HALO)
