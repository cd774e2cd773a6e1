"""Scratch space of the threads, for the largest box."""

import numpy as np
from numpy.typing import NDArray

from morphosim.kernels.boxes import N_SURVEYED
from morphosim.kernels.frames import frame_sizes
from morphosim.kernels.helmholtz import COLUMNS
from morphosim.kernels.step import N_FRAMES


class Workspace:
    """Padded work arrays (frames) and surveys of each thread.

    Parameters
    ----------
    threads : int
    dtype : of the fields

    Attributes
    ----------
    frames : (threads, N_FRAMES, largest frame)
    found : (threads, longest x axis, 2) int32
    measured : (threads, N_SURVEYED) float64
    """

    def __init__(self, threads: int, dtype: np.dtype) -> None:
        self.frames = np.zeros((threads, N_FRAMES, 0), dtype)
        self.found = np.zeros((threads, 0, 2), np.int32)
        self.measured = np.zeros((threads, N_SURVEYED))

    def reserve(self, shape: NDArray[np.int64]) -> None:
        """Have room for boxes of these shapes (N, 3)."""
        threads, frames, room = self.frames.shape
        size, planes = max(frame_sizes(shape).max(), COLUMNS * shape.max()), shape[:, 0].max()
        if room < size:
            self.frames = _aligned_zeros((threads, frames, int(size)), self.frames.dtype)
        if self.found.shape[1] < planes:
            self.found = np.zeros((threads, planes, 2), np.int32)


def _aligned_zeros(shape: tuple[int, ...], dtype: np.dtype) -> NDArray[np.floating]:
    """Zeros that begin on a cache line."""
    line = 64 // dtype.itemsize
    values = np.zeros(int(np.prod(shape)) + line, dtype)
    skip = -values.ctypes.data % 64 // dtype.itemsize
    return values[skip : skip + int(np.prod(shape))].reshape(shape)
