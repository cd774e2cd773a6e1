"""Frames: a thread's working copy of one cell's box, with a halo of zeros.

A frame has HALO more points at each end of each axis, so that stencils need no care at the faces
and one plane of the band is one long run: rows y0 … y1 with the halos between them. What a run
computes in those halos is dropped. Frames are flat; point (x, y, z) of the box lies at
`frame_index`, its neighbours `stride_x`, `stride_y` and 1 further on.
"""

import numpy as np

from morphosim.kernels._jit import inline_kernel, kernel

HALO = 3
"""Reach of the widest stencil."""


@inline_kernel()
def strides(i, boxes):
    """Steps between neighbours along x and y in cell i's frame."""
    row = boxes.shape[i, 2] + 2 * HALO
    return (boxes.shape[i, 1] + 2 * HALO) * row, row


@inline_kernel()
def frame_index(x, y, z, sx, sy):
    """Index in the frame of point (x, y, z) of the box."""
    return (x + HALO) * sx + (y + HALO) * sy + z + HALO


@kernel()
def frame_size(i, boxes):
    """Number of points of cell i's frame."""
    return (boxes.shape[i, 0] + 2 * HALO) * strides(i, boxes)[0]


@inline_kernel()
def band_rows(x, i, boxes, whole):
    """Rows [y0, y1) of plane x to work on: those of the band, or all if `whole`."""
    if whole:
        return 0, boxes.shape[i, 1]
    plane = boxes.plane_start[i] + x
    return np.int64(boxes.band[plane, 0]), np.int64(boxes.band[plane, 1])


@inline_kernel()
def run(x, i, boxes, whole, sx, sy):
    """Frame indices [low, high) of the rows to work on in plane x; low >= high if there are none."""
    y0, y1 = band_rows(x, i, boxes, whole)
    if y0 >= y1:
        return np.uint64(1), np.uint64(0)
    low = frame_index(x, y0, 0, sx, sy)
    return np.uint64(low), np.uint64(low + (y1 - y0) * sy - 2 * HALO)


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
def load(i, pool, boxes, whole, frame):
    """Fill cell i's frame from its box in a pool; 0 in the halo and outside of the band."""
    sx, sy = strides(i, boxes)
    ny, nz = boxes.shape[i, 1], boxes.shape[i, 2]
    frame[: frame_size(i, boxes)] = 0
    for x in range(boxes.shape[i, 0]):
        y0, y1 = band_rows(x, i, boxes, whole)
        for y in range(y0, y1):
            copy_row(
                pool, np.uint64(boxes.start[i] + (x * ny + y) * nz),
                frame, np.uint64(frame_index(x, y, 0, sx, sy)), nz,
            )  # fmt: skip


@kernel()
def unload(i, frame, boxes, values):
    """Copy the box out of a frame into `values`, box of the cell."""
    sx, sy = strides(i, boxes)
    ny, nz = boxes.shape[i, 1], boxes.shape[i, 2]
    for x in range(boxes.shape[i, 0]):
        for y in range(ny):
            copy_row(
                frame, np.uint64(frame_index(x, y, 0, sx, sy)),
                values, np.uint64((x * ny + y) * nz), nz,
            )  # fmt: skip
