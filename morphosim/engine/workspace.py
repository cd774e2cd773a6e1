"""Scratch space of the threads, for the largest box."""

import numpy as np
from numpy.typing import NDArray

from morphosim.kernels.boxes import N_SURVEYED
from morphosim.kernels.frames import frame_sizes
from morphosim.kernels.helmholtz import COLUMNS
from morphosim.kernels.layout import Room
from morphosim.kernels.rows import BLOCK, N_SPANS, n_listed
from morphosim.kernels.step import N_FRAMES, N_STRETCHES

Integers = NDArray[np.int64]


class Workspace:
    """Work arrays of each thread.

    Parameters
    ----------
    threads : int
    dtype : of the fields

    Attributes
    ----------
    room : Room
    """

    def __init__(self, threads: int, dtype: np.dtype) -> None:
        self.room = Room(
            frames=np.zeros((threads, N_FRAMES, 0), dtype),
            stretches=np.zeros((threads, N_STRETCHES, 0), dtype),
            blocks=np.zeros((threads, 2, 0), np.int32),
            spans=np.zeros((threads, N_SPANS, 0), np.int16),
            found=np.zeros((threads, 0, 2), np.int32),
            measured=np.zeros((threads, N_SURVEYED)),
        )

    @property
    def nbytes(self) -> int:
        """Bytes of all of them."""
        return sum(values.nbytes for values in self.room)

    def reserve(self, shape: Integers) -> None:
        """Have room for boxes of these shapes (N, 3)."""
        now, rows = self.room, shape[:, 0] * shape[:, 1]
        frame = max(frame_sizes(shape).max(), COLUMNS * shape.max())
        points, planes = (rows * shape[:, 2]).max(), shape[:, 0].max()
        blocks = (rows * -(-shape[:, 2] // BLOCK)).max()
        spans = n_listed.py_func(shape[:, 0], shape[:, 1]).max()
        self.room = now._replace(
            frames=_roomy(now.frames, -1, frame), stretches=_roomy(now.stretches, -1, points),
            blocks=_roomy(now.blocks, -1, blocks), spans=_roomy(now.spans, -1, spans),
            found=_roomy(now.found, 1, planes),
        )  # fmt: skip


def _roomy(values: NDArray, axis: int, length: int) -> NDArray:
    """The array, or zeros that are that long along an axis; each thread's begin on a line."""
    if values.shape[axis] >= length:
        return values
    shape = list(values.shape)
    line = 64 // values.dtype.itemsize
    shape[axis] = -(-int(length) // line) * line
    size = int(np.prod(shape))
    flat = np.zeros(size + line, values.dtype)
    skip = -flat.ctypes.data % 64 // values.dtype.itemsize
    return flat[skip : skip + size].reshape(shape)
