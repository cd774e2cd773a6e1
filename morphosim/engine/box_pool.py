"""Moving boxes: where each cell's subgrid lies, and the pools that hold the fields."""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from morphosim._parts import InParts, Joined
from morphosim.cell_table import CellTable, Column
from morphosim.kernels.boxes import (
    BAD,
    FACE,
    GUARD,
    N_SURVEYED,
    TOTAL,
    close_ranks,
    extents,
    find_bands,
    move_boxes,
)
from morphosim.kernels.layout import Boxes, Limits

SLACK = 4
"""A box is laid anew when it could be smaller by this many points along an axis."""
COLUMNS = (
    Column("origin", np.int64, (3,), inherits=False),
    Column("shape", np.int64, (3,), inherits=False),
    Column("start", np.int64, inherits=False, saved=False),
    Column("plane_start", np.int64, inherits=False, saved=False),
    Column("lost", inherits=False),
    Column("surveys", shape=(N_SURVEYED,), inherits=False),
    Column("ahead", inherits=False, optional=True),
)
"""Where each cell's box lies on the lattice and in the pools, and what surveys have found."""
AT_ONCE = 1024
"""Boxes that move together: until all have, the pools hold the old and the new ones."""
MOST_FREE = 0.1
"""Share of the pools that may lie idle between boxes, before all boxes close ranks."""
Integers = NDArray[np.int64]
Real = NDArray[np.floating]


class Slots:
    """Stretches of a pool: size classes with free lists, at most 1/8 larger than asked for.

    Attributes
    ----------
    end : int
        Where the last stretch ends.
    free : int
        Length of all that have been given back.
    """

    def __init__(self) -> None:
        self.end = self.free = 0
        self._free: dict[int, list[int]] = {}

    @staticmethod
    def capacity(size: int) -> int:
        """Length of the stretch that `take` gives for `size`."""
        quantum = max(64, 1 << max(size.bit_length() - 4, 0))
        return -(-size // quantum) * quantum

    def take(self, size: int) -> int:
        """Start of a stretch that holds `size`."""
        capacity = self.capacity(size)
        if self._free.get(capacity):
            self.free -= capacity
            return self._free[capacity].pop()
        start = self.end
        self.end += capacity
        return start

    def give(self, start: int, size: int) -> None:
        """Return the stretch taken for `size`."""
        capacity = self.capacity(size)
        self.free += capacity
        self._free.setdefault(capacity, []).append(start)


def even(shape: Integers) -> Integers:
    """Box shape rounded up to even numbers, which keeps the number of sizes small."""
    return np.asarray(np.maximum(shape + shape % 2, 8))


def morton_order(origin: Integers) -> Integers:
    """Order of boxes along a curve that keeps near ones together (Z-order, cells of 8 points)."""
    place = (origin - origin.min(axis=0)) >> 3
    key = np.zeros(len(origin), np.int64)
    for bit in range(20):
        for axis in range(3):
            key |= ((place[:, axis] >> bit) & 1) << (3 * bit + 2 - axis)
    return np.argsort(key, kind="stable")


class BoxPool:
    """The fields of all cells, each in its own box.

    Parameters
    ----------
    cells : CellTable
        With `COLUMNS`, which this keeps.
    dtype : of the fields
    limits : Limits
    memory : {"history", "extrapolation", "none"}
        What the scheme remembers: Hⁿ, 0 at first, or φ*, φ at first, in which forces are taken.
    band_only : bool
        Whether the solver works on the narrow band alone, outside of which φ is 0.

    Attributes
    ----------
    phi : 1-D pool of φⁿ
    history : 1-D pool of the scheme's history Hⁿ, or of the extrapolation φ*, or None
    band : (planes, 2) int32
        Rows of each plane of each box where the field is not 0, `GUARD` more than where it
        exceeds the tolerance.
    """

    def __init__(
        self, cells: CellTable, dtype: DTypeLike, limits: Limits, memory: str,
        band_only: bool,
    ) -> None:  # fmt: skip
        self.cells = cells
        self.dtype: np.dtype[Any] = np.dtype(dtype)
        self.limits, self.band_only = limits, band_only
        self.phi: Real = np.zeros(0, dtype)
        self.history: Real | None = None if memory == "none" else np.zeros(0, dtype)
        self.memory = memory
        self.band = np.zeros((0, 2), np.int32)
        self._slots, self._planes = Slots(), Slots()

    def __len__(self) -> int:
        return len(self.cells)

    @property
    def _extrapolates(self) -> bool:
        return self.memory == "extrapolation"

    @property
    def origin(self) -> Integers:
        """(N, 3) lattice position of each box's first point."""
        return self.cells["origin"]

    @property
    def shape(self) -> Integers:
        """(N, 3) points of each box per axis."""
        return self.cells["shape"]

    @property
    def start(self) -> Integers:
        """(N,) first index of each box in the pools of fields."""
        return self.cells["start"]

    @property
    def plane_start(self) -> Integers:
        """(N,) first index of each box in `band`."""
        return self.cells["plane_start"]

    @property
    def lost(self) -> NDArray[np.float64]:
        """(N,) Σ φ that moving boxes has cut off each cell so far (signed, lattice units)."""
        return self.cells["lost"]

    @property
    def surveys(self) -> NDArray[np.float64]:
        """(N, N_SURVEYED) what `kernels.boxes.survey` has found."""
        return self.cells["surveys"]

    @property
    def acting(self) -> Real:
        """1-D pool of the fields in which forces are taken: φⁿ, or the extrapolation φ*."""
        return self.history if self._extrapolates and self.history is not None else self.phi

    @property
    def totals(self) -> NDArray[np.float64]:
        """(N,) Σ over each cell's field in `acting`."""
        return self.cells["ahead"] if self._extrapolates else self.surveys[:, TOTAL]

    @property
    def boxes(self) -> Boxes:
        """Layout for the kernels; valid until boxes move."""
        return Boxes(self.origin, self.shape, self.start, self.plane_start, self.band)

    @property
    def nbytes(self) -> int:
        """Bytes of the pools, as far as they have been in use."""
        fields = self.phi.itemsize * (1 if self.history is None else 2)
        return fields * self._slots.end + 2 * self.band.itemsize * self._planes.end

    def sizes(self) -> Integers:
        """Points per box."""
        return np.asarray(self.shape.prod(axis=1))

    def box(self, i: int, pool: Real | None = None) -> Real:
        """Field of cell i as a 3-D view (of `phi`, or of another pool of the same layout)."""
        values = self.phi if pool is None else pool
        start, (nx, ny, nz) = int(self.start[i]), self.shape[i].tolist()
        return values[start : start + nx * ny * nz].reshape(nx, ny, nz)

    def lay(self, rows: Integers, fields: Iterable[tuple[Integers, Real]]) -> None:
        """Lay boxes for new rows of the table, around the band of the fields given.

        Parameters
        ----------
        rows : (n,) rows of `cells` that have no box yet
        fields : of these, lattice origin and field
        """
        given, laid = [], []
        for origin, phi in fields:
            given.append(float(phi.sum(dtype=float)))
            laid.append(self._trim(origin, phi))
        self.origin[rows] = [origin for origin, _ in laid]
        self.shape[rows] = [phi.shape for _, phi in laid]
        self._take(rows)
        for i, (_, phi) in zip(rows.tolist(), laid, strict=True):
            self.box(i)[:] = phi
        self.survey(rows)
        self.forget(rows.tolist())
        self.lost[rows] = given - self.surveys[rows, TOTAL]

    def release(self, rows: Integers) -> None:
        """Give back the boxes of cells that are about to be dropped from the table."""
        self._give(self.start[rows], self.plane_start[rows], self.shape[rows])

    def forget(self, rows: Iterable[int]) -> None:
        """Begin the histories of cells anew."""
        if self.history is not None:
            for i in rows:
                self.box(i, self.history)[:] = self.box(i) if self._extrapolates else 0
                self.cells["ahead"][i] = self.surveys[i, TOTAL]

    def contents(self, cells: Integers | None = None) -> dict[str, NDArray]:
        """Fields, histories and bands, box after box, of all cells or of those given: copies."""
        return {name: np.asarray(parts) for name, parts in self.parts(cells).items()}

    def parts(self, cells: Integers | None = None) -> dict[str, Joined]:
        """What `contents` gives, not copied: valid until a field changes or boxes move."""
        held = {"phi": self.phi} if self.history is None else {
            "phi": self.phi, "history": self.history,
        }  # fmt: skip
        chosen = np.arange(len(self)) if cells is None else cells
        bands = [
            self.band[first : first + n]
            for first, n in zip(self.plane_start[chosen], self.shape[chosen, 0], strict=True)
        ]
        return {
            name: Joined([self.box(i, pool).reshape(-1) for i in chosen.tolist()])
            for name, pool in held.items()
        } | {"band": Joined(bands)}

    def restore(self, contents: Mapping[str, InParts]) -> None:
        """Hold exactly the boxes that the table says, with the fields of `contents`."""
        self._slots, self._planes = Slots(), Slots()
        rows = np.arange(len(self))
        self._take(rows)
        self.fill(rows, contents)

    def arrange(self, kept: Integers, places: Integers, origin: Integers, shape: Integers) -> None:
        """Hold other cells: some of the present ones, at new rows of the table, and empty boxes.

        Parameters
        ----------
        kept : (K,) present rows of the cells that stay
        places : (K,) their new rows
        origin, shape : (N, 3) boxes of all cells then
        """
        self.release(np.setdiff1d(np.arange(len(self)), kept))
        self.cells.arrange(kept, places, len(origin))
        self.origin[:], self.shape[:] = origin, shape
        new = np.setdiff1d(np.arange(len(origin)), places)
        self._take(new)
        for i in new.tolist():
            self.box(i)[:] = 0
            self.band[self.plane_start[i] : self.plane_start[i] + shape[i, 0]] = 0
        self.forget(new.tolist())

    def fill(self, cells: Integers, contents: Mapping[str, InParts]) -> None:
        """Put the fields, histories and bands of `contents` into boxes of the same shapes."""
        sizes, planes = self.sizes()[cells], self.shape[cells, 0]
        ends, last = np.cumsum(sizes), np.cumsum(planes)
        for k, i in enumerate(cells.tolist()):
            box = slice(ends[k] - sizes[k], ends[k])
            self.box(i)[:] = contents["phi"][box].reshape(self.shape[i])
            if self.history is not None:
                self.box(i, self.history)[:] = contents["history"][box].reshape(self.shape[i])
            first = int(self.plane_start[i])
            self.band[first : first + planes[k]] = contents["band"][last[k] - planes[k] : last[k]]

    def survey(self, rows: Integers) -> None:
        """Measure the stored fields of cells and find their bands anew; `lost` counts the cut."""
        find_bands(
            rows, self.phi, self.history, self.boxes, self.band_only, self.limits, self.surveys,
            self.lost,
        )  # fmt: skip

    def refit(self, cells: Integers) -> Integers:
        """Lay the boxes of these cells anew where the band needs it; return those that moved."""
        found = np.zeros((len(cells), 3, 2), np.int64)
        extents(cells, self.phi, self.boxes, self.limits.tolerance, found)
        low, high = found[:, :, 0] - GUARD, found[:, :, 1] + GUARD
        alive = (found[:, 0, 0] < found[:, 0, 1]) & (self.surveys[cells, BAD] == 0)
        shape = even(high - low)
        touching = self.surveys[cells, FACE] > self.limits.tolerance
        loose = (shape <= self.shape[cells] - SLACK).any(axis=1)
        moved = alive & (touching | loose)
        for start in range(0, moved.sum(), AT_ONCE):
            some = np.flatnonzero(moved)[start : start + AT_ONCE]
            self._move(cells[some], low[some], shape[some])
        if self._slots.free > MOST_FREE * self._slots.end:
            self._close_ranks()
        return np.asarray(cells[moved])

    def _trim(self, origin: Integers, phi: Real) -> tuple[Integers, Real]:
        """Cut a start field down to its band, or pad it, and make its shape even."""
        band = np.argwhere(np.abs(phi) > self.limits.tolerance)
        if not len(band):  # a cell that has vanished
            band = np.array([np.array(phi.shape) // 2])
        low = band.min(axis=0) - GUARD
        shape = even(band.max(axis=0) + 1 + GUARD - low)
        target = np.zeros(shape, self.dtype)
        source = tuple(
            slice(max(a, 0), min(a + n, have))
            for a, n, have in zip(low, shape, phi.shape, strict=True)
        )
        goal = tuple(slice(s.start - a, s.stop - a) for s, a in zip(source, low, strict=True))
        target[goal] = phi[source]
        return np.asarray(origin + low, np.int64), target

    def _move(self, rows: Integers, shifts: Integers, shapes: Integers) -> None:
        """Give cells boxes whose origins move by `shifts`; history moves with the field."""
        starts, old, planes = self.start[rows], self.shape[rows], self.plane_start[rows]
        self.origin[rows] += shifts
        self.shape[rows] = shapes
        self._take(rows)
        move_boxes(
            rows, starts, old, shifts, self.phi, self.history, self.boxes, self.band_only,
            self.limits, self.surveys, self.lost,
            self.cells["ahead"] if self._extrapolates else None,
        )  # fmt: skip
        self._give(starts, planes, old)

    def _close_ranks(self) -> None:
        """Leave no room between boxes in the pools."""
        order = np.argsort(self.start)
        starts, sizes = self.start[order], self.sizes()[order]
        self._slots = Slots()
        goals = np.array([self._slots.take(size) for size in sizes.tolist()], np.int64)
        for pool in (self.phi, self.history):
            if pool is not None:
                close_ranks(starts, goals, sizes, pool)
        self.start[order] = goals

    def _take(self, rows: Integers) -> None:
        """Give boxes of the shapes in the table their stretches of the pools."""
        sizes = self.shape[rows].prod(axis=1)
        self.start[rows] = [self._slots.take(size) for size in sizes.tolist()]
        self.plane_start[rows] = [self._planes.take(n) for n in self.shape[rows, 0].tolist()]
        self._reserve()

    def _give(self, starts: Integers, planes: Integers, shapes: Integers) -> None:
        """Give back the stretches of boxes of these shapes."""
        for start, size in zip(starts.tolist(), shapes.prod(axis=1).tolist(), strict=True):
            self._slots.give(start, size)
        for start, size in zip(planes.tolist(), shapes[:, 0].tolist(), strict=True):
            self._planes.give(start, size)

    def _reserve(self) -> None:
        """Grow the pools to what the slots need, with room for a few boxes more."""
        if self._planes.end > len(self.band):
            self.band = _grown(self.band, self._planes.end)
        if self._slots.end > len(self.phi):
            self.phi = _grown(self.phi, self._slots.end)
            if self.history is not None:
                self.history = _grown(self.history, self._slots.end)


def _grown(pool: NDArray, size: int) -> NDArray:
    """Copy of a pool with room for `size`, and half as much again if it was in use before.

    What is never written to takes no memory.
    """
    room = size if len(pool) == 0 else size + size // 2
    result = np.zeros((room, *pool.shape[1:]), pool.dtype)
    result[: len(pool)] = pool
    return result
