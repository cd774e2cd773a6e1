"""Periodic space: what goes out of one face of the box [0, L) comes in at the opposite one.

A box whose middle leaves the period is carried to the other side, which the cell's `turns` count.
Beyond the faces cells act as *images*: boxes at other places with the same values in the pools. So
kernels know nothing of periods, and sums and contacts count images as they count cells.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import ArrayLike, NDArray

from morphosim.kernels.layout import Boxes

Integers = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Period:
    """Lengths after which space repeats.

    Attributes
    ----------
    lengths : (3,) int64
        In lattice steps; 0 along an axis where it does not.
    """

    lengths: Integers

    @classmethod
    def of(cls, lengths: ArrayLike, spacing: float) -> "Period | None":
        """That of lengths in µm, multiples of the spacing; None if all are 0."""
        steps = np.rint(np.asarray(lengths, float) / spacing).astype(np.int64)
        return cls(steps) if steps.any() else None

    def shifts(self, origin: Integers, shape: Integers) -> Integers:
        """(n, 3) how far to carry boxes, multiples of the lengths, so that their middles are in."""
        repeats = np.maximum(self.lengths, 1)
        middle = origin + shape // 2
        return np.where(self.lengths > 0, -(middle // repeats) * self.lengths, 0)

    def images(self, boxes: Boxes, margin: int) -> tuple[Integers, Integers]:
        """Images of which any comes near any of these boxes, each with a margin around it.

        Returns
        -------
        owner : (M,) int64, rows of the boxes that they repeat
        origin : (M, 3) int64
        """
        low, high = boxes.origin - margin, boxes.origin + boxes.shape + margin
        first, end = low.min(axis=0), high.max(axis=0)
        found = []
        for offset in product(*(self._offsets(axis, first, end) for axis in range(3))):
            if any(offset):
                shift = np.array(offset) * self.lengths
                near = ((low + shift < end) & (high + shift > first)).all(axis=1)
                rows = np.flatnonzero(near)
                found.append((rows, boxes.origin[rows] + shift))
        owners, origins = zip(*found, strict=True) if found else ((), ())
        return (
            np.concatenate([np.zeros(0, np.int64), *owners]),
            np.concatenate([np.zeros((0, 3), np.int64), *origins]),
        )

    def _offsets(self, axis: int, first: Integers, end: Integers) -> range:
        length = int(self.lengths[axis])
        most = int(end[axis] - first[axis]) // length if length else 0
        return range(-most, most + 1)

    def block(self, low: Integers, shape: Integers) -> tuple[Integers, Integers]:
        """First point and shape of a block, or along axes that repeat those of one period."""
        repeats = self.lengths > 0
        return np.where(repeats, 0, low), np.where(repeats, self.lengths, shape)

    def cuts(self, axis: int, first: int, count: int) -> Iterator[tuple[slice, slice]]:
        """Parts of points [first, first + count) along an axis: in the period, and of them."""
        length, at = int(self.lengths[axis]), 0
        while at < count:
            place = (first + at) % length if length else first + at
            part = min(count - at, length - place) if length else count
            yield slice(place, place + part), slice(at, at + part)
            at += part

    def shortest(self, vectors: NDArray[np.float64], spacing: float) -> NDArray[np.float64]:
        """(n, 3) vectors in µm, each to or from the nearest image."""
        lengths = self.lengths * spacing
        turns = np.rint(vectors / np.where(lengths > 0, lengths, np.inf))
        return np.asarray(vectors - turns * lengths)


def with_images(boxes: Boxes, owner: Integers, origin: Integers) -> Boxes:
    """Boxes of cells, and after them those of their images."""
    every = np.concatenate([np.arange(len(boxes.start)), owner])
    return boxes._replace(
        origin=np.concatenate([boxes.origin, origin]), shape=boxes.shape[every],
        start=boxes.start[every], row_start=boxes.row_start[every],
    )  # fmt: skip
