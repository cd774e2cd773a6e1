"""Columns over example boxes: laid out anew here, with NaN between them."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from morphosim.kernels.columns import ROWS, WIDTH
from morphosim.kernels.frames import HALO, strides
from morphosim.kernels.layout import Boxes, ColumnLists, Columns, Interaction, Shares
from morphosim.kernels.sharing import shares_of

from .example_boxes import GAP, seen_from

G = np.float64(1.6)
TYPES = np.array([0, 1, 1, 2, 0])
PULL = np.array([[0.4, 0.0, 0.1], [0.7, 0.3, 0.2], [0.5, 0.6, 0.9]])
"""pull[j, i]; one of them zero."""


SPACE = np.array([[1.0, 1.0, 1.0], [0.5, 0.0, -0.8]])
"""Pulls of two functions of space on the three types."""


def interaction(fields: int = 0) -> Interaction:
    """Of three types, and of space."""
    pull = np.pad(PULL, (0, fields)) if fields else PULL
    pull[3:, :3] = SPACE[:fields]
    return Interaction(g=G, types=TYPES, pull=pull)


@dataclass
class Cover:
    """Columns under the frames of boxes; every `absent`-th does not exist, none if 0."""

    boxes: Boxes
    absent: int = 5
    extents: list = field(init=False)
    """By number: column (x, y), first and last lattice z."""
    start: list = field(init=False)
    """By number: first index in the pools, -1 where absent."""
    under: list = field(init=False)
    """By cell: the column's number for each place under its frame, x slowest."""
    size: int = field(init=False)

    def __post_init__(self) -> None:
        origin, shape = self.boxes.origin, self.boxes.shape
        n = len(origin)
        low, high = origin - HALO, origin + shape + HALO
        self.low = low[:, 2]
        places = [
            [
                (x, y)
                for x in range(low[i, 0] // WIDTH, (high[i, 0] - 1) // WIDTH + 1)
                for y in range(low[i, 1] // WIDTH, (high[i, 1] - 1) // WIDTH + 1)
            ]
            for i in range(n)
        ]
        ends = [int(self.low[i] + strides(i, self.boxes)[1]) for i in range(n)]
        self.extents = []
        for place in sorted({p for found in places for p in found}):
            over = sorted((int(self.low[i]), ends[i]) for i in range(n) if place in places[i])
            hulls = [list(over[0])]
            for z0, z1 in over[1:]:
                if z0 <= hulls[-1][1]:
                    hulls[-1][1] = max(hulls[-1][1], z1)
                else:
                    hulls.append([z0, z1])
            self.extents += [(place, z0, z1) for z0, z1 in hulls]
        self.under = [
            [
                next(
                    a for a, (p, z0, z1) in enumerate(self.extents)
                    if p == place and z0 <= self.low[i] < z1
                )
                for place in places[i]
            ]
            for i in range(n)
        ]  # fmt: skip
        self.start, self.size = [], GAP
        for a, (_, z0, z1) in enumerate(self.extents):
            exists = not self.absent or (a + 1) % self.absent
            self.start.append(self.size if exists else -1)
            self.size += (ROWS * (z1 - z0) + GAP) if exists else 0

    def shares(self, threads: int = 2) -> Shares:
        """Shares of the columns that exist."""
        present = sum(first >= 0 for first in self.start)
        return shares_of(np.linspace(0, present, threads + 1), threads)

    def lists(self) -> ColumnLists:
        """Cells over each column that exists."""
        present = [a for a, first in enumerate(self.start) if first >= 0]
        over = [[i for i, found in enumerate(self.under) if a in found] for a in present]
        sizes = [len(cells) for cells in over]
        return ColumnLists(
            start=np.array([self.start[a] for a in present], np.int64),
            length=np.array([self.extents[a][2] - self.extents[a][1] for a in present], np.int64),
            corner=np.array(
                [(*(WIDTH * np.array(self.extents[a][0])), self.extents[a][1]) for a in present],
                np.int64,
            ).reshape(-1, 3),
            cell_start=np.cumsum([0, *sizes]).astype(np.int64),
            cells=np.array([i for cells in over for i in cells], np.int64),
        )

    def columns(self, background: bool, n_types: int, fields: int = 0) -> Columns:
        """Sums not yet made; background and fields are random."""
        cover = [
            (
                self.start[a],
                self.extents[a][2] - self.extents[a][1],
                self.low[i] - self.extents[a][1],
            )
            for i, found in enumerate(self.under)
            for a in found
        ]
        sizes = [len(found) for found in self.under]
        values = np.random.default_rng(10).random(self.size)
        return Columns(
            cover_start=np.cumsum([0, *sizes[:-1]]),
            cover=np.array(cover),
            felt=np.array([any(self.start[a] >= 0 for a in found) for found in self.under]),
            background=np.where(self.between(), np.nan, values) if background else None,
            field=self.fields(values, fields) if fields else None,
            repulsion=np.full(self.size, np.nan),
            potential=np.full(self.size * n_types, np.nan) if n_types else None,
        )

    def fields(self, values: NDArray, count: int) -> NDArray:
        """(count, points) functions of space."""
        return np.where(self.between(), np.nan, [values ** (2 + k) for k in range(count)])

    def between(self) -> NDArray[np.bool_]:
        """Which indices of the pools belong to no column."""
        result = np.ones(self.size, bool)
        for first, (_, z0, z1) in zip(self.start, self.extents, strict=True):
            if first >= 0:
                result[first : first + ROWS * (z1 - z0)] = False
        return result

    def at(self, values: NDArray, i: int) -> NDArray[np.float64]:
        """Values on the columns at the points of cell i's box and its halo; 0 without column."""
        nx, ny, nz = self.boxes.shape[i] + 2 * HALO
        ox, oy, oz = self.boxes.origin[i] - HALO
        result = np.zeros((nx, ny, nz))
        for x, y in np.ndindex(nx, ny):
            place = (int(ox + x) // WIDTH, int(oy + y) // WIDTH)
            a = next(a for a in self.under[i] if self.extents[a][0] == place)
            if self.start[a] >= 0:
                _, z0, z1 = self.extents[a]
                column = values[self.start[a] : self.start[a] + ROWS * (z1 - z0)]
                row = column.reshape(WIDTH, WIDTH, -1)[(ox + x) % WIDTH, (oy + y) % WIDTH]
                result[x, y] = row[oz - z0 : oz - z0 + nz]
        return result

    def felt_repulsion(self, phi: NDArray, columns: Columns, i: int) -> NDArray[np.float64]:
        """R of cell i at the points of its box and its halo: of all others, and the background."""
        others = [j for j in range(len(self.boxes.start)) if j != i]
        result = G * sum(seen_from(self.boxes, phi, j, i) ** 2 for j in others)
        result = self.at(np.ones(self.size), i) * result
        return result if columns.background is None else result + self.at(columns.background, i)

    def felt_potential(self, phi: NDArray, i: int) -> NDArray[np.float64]:
        """ψ of cell i at the points of its box and its halo, of all others by their types."""
        others = [j for j in range(len(self.boxes.start)) if j != i]
        psi = sum(PULL[TYPES[j], TYPES[i]] * seen_from(self.boxes, phi, j, i) for j in others)
        return self.at(np.ones(self.size), i) * psi
