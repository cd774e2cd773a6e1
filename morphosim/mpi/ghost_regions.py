"""Which cells feel cells of other ranks, and which part of them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from morphosim.engine.column_sums import SHIFTS, TILE_SHAPE
from morphosim.kernels.frames import HALO, frame_shapes

Integers = NDArray[np.int64]
FARTHEST = 2 * (HALO + max(TILE_SHAPE))
"""Boxes with more lattice points in between have no tile in common."""


@dataclass(frozen=True, slots=True)
class Portion:
    """Parts of some cells that one rank sends to another, in the order of the cells' numbers.

    Attributes
    ----------
    cells : (K,) numbers of the cells
    low, shape : (K, 3)
        Box of the ghost cell: the part of the cell's box over the accumulation columns that cells
        of the receiving rank reach, so that the same columns exist there as on one rank.
    first, end : (K, 3)
        Lattice points [first, end) that the receiving rank's cells read; nothing else is sent.
        There are none where a cell is near and yet out of reach.
    """

    cells: Integers
    low: Integers
    shape: Integers
    first: Integers
    end: Integers

    @property
    def rows(self) -> int:
        """Number of rows along z of all parts."""
        return int((self.end - self.first)[:, :2].prod(axis=1).sum())

    @property
    def points(self) -> int:
        """Number of points of all parts."""
        return int((self.end - self.first).prod(axis=1).sum())


@dataclass(frozen=True, slots=True)
class Reach:
    """How far boxes reach: lattice points of their frames, and tiles under these."""

    origin: Integers
    shape: Integers
    low: Integers
    high: Integers
    first: Integers
    end: Integers

    @classmethod
    def of(cls, origin: Integers, shape: Integers) -> "Reach":
        """Reach of boxes with these origins and shapes, (N, 3)."""
        low = origin - HALO
        high = low + frame_shapes(shape)
        return cls(origin, shape, low, high, low >> SHIFTS, (high - 1 >> SHIFTS) + 1)

    def pairs(self, mine: Integers, others: Integers) -> tuple[Integers, Integers]:
        """All pairs of a cell of `mine` and one of `others` with a tile in common."""
        from scipy.spatial import KDTree

        extent = (self.end - self.first).max(axis=0)  # so far apart, centres meet at most
        centre = (self.first + self.end) / (2 * extent)
        trees = KDTree(centre[mine]), KDTree(centre[others])
        near = trees[0].sparse_distance_matrix(trees[1], 1.0, p=np.inf, output_type="ndarray")
        a, b = mine[near["i"]], others[near["j"]]
        meet = (self.first[a] < self.end[b]) & (self.first[b] < self.end[a])
        meeting = meet.all(axis=1)
        return a[meeting], b[meeting]

    def portion(self, sent: Integers, reader: Integers, numbers: Integers) -> Portion:
        """What one rank sends another; cell `sent[k]` meets the other's cell `reader[k]`.

        `numbers` are those of the cells in the whole simulation.
        """
        order = np.argsort(sent, kind="stable")
        cells, starts = np.unique(sent[order], return_index=True)
        readers = reader[order]

        def hull(low: Integers, high: Integers) -> tuple[Integers, Integers]:
            return (
                np.minimum.reduceat(low[readers], starts, axis=0),
                np.maximum.reduceat(high[readers], starts, axis=0),
            )

        origin, stop = self.origin[cells], self.origin[cells] + self.shape[cells]
        tiles = hull(self.first, self.end)
        low = np.clip(tiles[0] << SHIFTS, origin, stop - 1)
        high = np.clip(tiles[1] << SHIFTS, low + 1, stop)
        frames = hull(self.low, self.high)
        first, end = np.maximum(frames[0], low), np.minimum(frames[1], high)
        out = (first >= end).any(axis=1)
        first[out], end[out] = low[out], low[out]
        return Portion(numbers[cells], low, high - low, first, end)


def portions(
    origin: Integers, shape: Integers, owner: Integers, rank: int
) -> tuple[dict[int, Portion], dict[int, Portion]]:
    """What a rank sends to others, and what it gets from others, by their rank.

    Parameters
    ----------
    origin, shape : (N, 3) boxes of all cells
    owner : (N,) their ranks
    rank : int
    """
    mine = owner == rank
    low, high = origin[mine].min(axis=0), (origin + shape)[mine].max(axis=0)
    near = (origin < high + FARTHEST) & (origin + shape > low - FARTHEST)
    cells = np.flatnonzero(near.all(axis=1))
    reach, owner = Reach.of(origin[cells], shape[cells]), owner[cells]
    own, other = reach.pairs(np.flatnonzero(owner == rank), np.flatnonzero(owner != rank))
    sends, gets = {}, {}
    for partner in np.unique(owner[other]).tolist():
        theirs = owner[other] == partner
        sends[partner] = reach.portion(own[theirs], other[theirs], cells)
        gets[partner] = reach.portion(other[theirs], own[theirs], cells)
    return sends, gets
