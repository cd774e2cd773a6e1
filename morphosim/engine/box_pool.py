"""Moving boxes: where each cell's subgrid lies, and the pools that hold the fields."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import islice
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
    WANTED,
    close_ranks,
    extents,
    find_bands,
    get_boxes,
    put_boxes,
    stretch_totals,
    survey_bands,
)
from morphosim.kernels.layout import Boxes, Limits
from morphosim.kernels.rows import BLOCK, whole_rows
from morphosim.period import Period

SLACK = 4
"""A box is laid anew when it could be smaller by this many points along an axis."""
COLUMNS = (
    Column("origin", np.int64, (3,), inherits=False),
    Column("shape", np.int64, (3,), inherits=False),
    Column("start", np.int64, inherits=False, saved=False),
    Column("row_start", np.int64, inherits=False, saved=False),
    Column("room", np.int64, inherits=False),
    Column("lost", inherits=False),
    Column("surveys", shape=(N_SURVEYED,), inherits=False),
    Column("ahead", inherits=False, optional=True),
)
"""Where each cell's box lies on the lattice and in the pools, and what surveys have found."""
TURNS = Column("turns", np.int64, (3,))
"""In periodic space: periods by which each cell's box has been carried back."""
AT_ONCE = 64
"""Boxes that are laid together: until all are, they are held whole beside the pools."""
SPARE = 32
"""A cell gets room for one more point per so many, as its band changes from step to step."""
FEW, RESERVE = 64, 1.1
"""Of fewer cells it is not known what more need; and how many times that is reserved."""
MOST_FREE = 0.1
"""Share of the pools that may lie idle between boxes, before all boxes close ranks."""
Integers = NDArray[np.int64]
Real = NDArray[np.floating]


class Slots:
    """Stretches of a pool: size classes with free lists, at most 1/16 larger than asked for.

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
        quantum = max(64, 1 << max(size.bit_length() - 5, 0))
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
    return np.asarray(np.maximum(shape + shape % 2, [8, 8, BLOCK]))


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
        Whether the solver works on the narrow band alone, outside of which φ is 0: then that is all
        that is held of a box.
    period : Period or None
        After which space repeats; the table then has `TURNS`.

    Attributes
    ----------
    phi : 1-D pool of φⁿ
    history : 1-D pool of the scheme's history Hⁿ, or of the extrapolation φ*, or None
    low, high : (rows,) int16
        Points of each row along z of each box where the field is not 0: `RIM` more than where it
        exceeds the tolerance.
    place : (rows,) int32
        Where the row lies in the pools; see `Boxes`.
    expected : int
        How many cells there will be, if that is known: pools then grow to what these need at once,
        since memory counts as it is written to, and a copy counts twice.
    """

    def __init__(
        self, cells: CellTable, dtype: DTypeLike, limits: Limits, memory: str,
        band_only: bool, period: Period | None = None,
    ) -> None:  # fmt: skip
        self.cells, self.period = cells, period
        self.dtype: np.dtype[Any] = np.dtype(dtype)
        self.limits, self.band_only = limits, band_only
        self.phi: Real = np.zeros(0, dtype)
        self.history: Real | None = None if memory == "none" else np.zeros(0, dtype)
        self.memory = memory
        self.low = self.high = np.zeros(0, np.int16)
        self.place = np.zeros(0, np.int32)
        self._slots, self._rows, self.expected = Slots(), Slots(), 0

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
    def path(self) -> Integers:
        """(N, 3) where it would be had it not been carried back in periodic space."""
        if self.period is None:
            return self.origin
        return np.asarray(self.origin + self.cells["turns"] * self.period.lengths)

    def wrap(self, rows: Integers) -> None:
        """Carry boxes whose middles have left the period back into it."""
        if self.period is not None and len(rows):
            shifts = self.period.shifts(self.origin[rows], self.shape[rows])
            self.origin[rows] += shifts
            self.cells["turns"][rows] -= shifts // np.maximum(self.period.lengths, 1)

    @property
    def shape(self) -> Integers:
        """(N, 3) points of each box per axis."""
        return self.cells["shape"]

    @property
    def start(self) -> Integers:
        """(N,) first index of each cell in the pools of fields."""
        return self.cells["start"]

    @property
    def row_start(self) -> Integers:
        """(N,) number of each cell's first row."""
        return self.cells["row_start"]

    @property
    def room(self) -> Integers:
        """(N,) points that each cell has in the pools of fields."""
        return self.cells["room"]

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
        return Boxes(
            self.origin, self.shape, self.start, self.row_start, self.low, self.high, self.place
        )

    @property
    def path_boxes(self) -> Boxes:
        """Layout by `path`: where the cells' places are followed."""
        return self.boxes._replace(origin=self.path)

    @property
    def stored(self) -> Boxes:
        """Layout of all that is held, be it in the band or not; valid until a step or a move."""
        if self.band_only:
            return self.boxes
        return Boxes(self.origin, self.shape, self.start, *whole_rows(self.shape))

    def stored_of(self, cells: Integers) -> Boxes:
        """What `stored` says of some cells."""
        held = self.stored
        return held._replace(
            origin=held.origin[cells], shape=held.shape[cells], start=held.start[cells],
            row_start=held.row_start[cells],
        )  # fmt: skip

    @property
    def nbytes(self) -> int:
        """Bytes of the pools, as far as they have been in use."""
        fields = self.phi.itemsize * (1 if self.history is None else 2)
        row = self.low.itemsize + self.high.itemsize + self.place.itemsize
        return fields * self._slots.end + row * self._rows.end

    def sizes(self) -> Integers:
        """Points per box."""
        return np.asarray(self.shape.prod(axis=1))

    def rows_of(self, i: int) -> slice:
        """Rows of cell i in `low`, `high` and `place`."""
        first = int(self.row_start[i])
        return slice(first, first + int(self.shape[i, 0] * self.shape[i, 1]))

    def stretch(self, i: int) -> slice:
        """Values of cell i in the pools."""
        start = int(self.start[i])
        if not self.band_only:
            return slice(start, start + int(self.shape[i].prod()))
        rows = self.rows_of(i)
        return slice(start, start + int((self.high[rows] - self.low[rows]).sum(dtype=np.int64)))

    def box(self, i: int, pool: Real | None = None) -> Real:
        """Field of cell i (of `phi`, or of another pool of the same layout), as a 3-D array.

        A copy where only the band is held, else a view.
        """
        values, shape = self.phi if pool is None else pool, self.shape[[i]]
        if not self.band_only:
            return values[self.stretch(i)].reshape(shape[0])
        whole = np.empty(shape[0], self.dtype)
        none = np.zeros((1, 3), np.int64)
        get_boxes(
            np.array([i]), self.boxes, True, values, none, shape, none[0, :1], whole.reshape(-1),
            np.zeros(len(self)),
        )  # fmt: skip
        return whole

    def lay(self, rows: Integers, fields: Iterable[tuple[Integers, Real]]) -> None:
        """Lay boxes for new rows of the table, around the band of the fields given.

        Parameters
        ----------
        rows : (n,) rows of `cells` that have no box yet
        fields : of these, lattice origin and field; they are taken a few at a time
        """
        self.room[rows] = 0
        given = np.zeros(len(rows))
        for first, some in _batches(rows, fields):
            laid = [self._trim(origin, phi) for origin, phi in some]
            part = rows[first : first + len(some)]
            given[first : first + len(some)] = [float(phi.sum(dtype=float)) for _, phi in some]
            self.origin[part] = [origin for origin, _ in laid]
            self.shape[part] = [phi.shape for _, phi in laid]
            self._take_rows(part)
            self._fill(part, [np.concatenate([phi.reshape(-1) for _, phi in laid])])
        self.forget(rows.tolist())
        self.lost[rows] = given - self.surveys[rows, TOTAL]

    def release(self, rows: Integers) -> None:
        """Give back the boxes of cells that are about to be dropped from the table."""
        self._vacate(rows)
        self._give(self.row_start[rows], self._n_rows(rows), self._rows)

    def forget(self, rows: Iterable[int]) -> None:
        """Begin the histories of cells anew."""
        if self.history is not None:
            for i in rows:
                where = self.stretch(i)
                self.history[where] = self.phi[where] if self._extrapolates else 0
                self.cells["ahead"][i] = self.surveys[i, TOTAL]

    def contents(self, cells: Integers | None = None) -> dict[str, NDArray]:
        """Fields, histories and bands, cell after cell, of all or of those given: copies.

        "points" (n,) says how many values of each field there are, "low" and "high" what `Boxes`
        has for its rows.
        """
        return {name: np.asarray(parts) for name, parts in self.parts(cells).items()}

    def parts(self, cells: Integers | None = None) -> dict[str, Joined]:
        """What `contents` gives, not copied: valid until a field changes or boxes move."""
        held = {"phi": self.phi} if self.history is None else {
            "phi": self.phi, "history": self.history,
        }  # fmt: skip
        chosen = (np.arange(len(self)) if cells is None else cells).tolist()
        stretches, rows = [self.stretch(i) for i in chosen], [self.rows_of(i) for i in chosen]
        points = np.array([s.stop - s.start for s in stretches], np.int64)
        bands = {"low": self.low, "high": self.high}
        return (
            {name: Joined([pool[part] for part in stretches]) for name, pool in held.items()}
            | {name: Joined([values[part] for part in rows]) for name, values in bands.items()}
            | {"points": Joined([points])}
        )

    def restore(self, contents: Mapping[str, InParts]) -> None:
        """Hold exactly the boxes that the table says, with the fields of `contents`."""
        self._slots, self._rows = Slots(), Slots()
        rows = np.arange(len(self))
        self._take_rows(rows)
        self._occupy(rows, self.room)
        self._copy_in(rows, contents)

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
        self.room[new] = 0
        self._take_rows(new)
        self._take(new, self.sizes()[new])
        for i in new.tolist():
            rows = self.rows_of(i)
            self.low[rows] = self.high[rows] = 0
            self._place(i, whole=True)
            self.phi[self.stretch(i)] = 0
        self.forget(new.tolist())

    def fill(self, cells: Integers, contents: Mapping[str, InParts]) -> None:
        """Put what `contents` gave, and their "room", into boxes of the same shapes."""
        self._vacate(cells)
        self._occupy(cells, np.asarray(contents["room"]))
        self._copy_in(cells, contents)

    def _copy_in(self, cells: Integers, contents: Mapping[str, InParts]) -> None:
        """Copy fields, histories and bands."""
        rows, last = np.cumsum(self._n_rows(cells)), 0
        for i, end in zip(cells.tolist(), rows.tolist(), strict=True):
            here = self.rows_of(i)
            self.low[here], self.high[here] = contents["low"][last:end], contents["high"][last:end]
            self._place(i, whole=not self.band_only)
            last = end
        points, last = np.cumsum(contents["points"][: len(cells)]), 0
        for i, end in zip(cells.tolist(), points.tolist(), strict=True):
            where = self.stretch(i)
            self.phi[where] = contents["phi"][last:end]
            if self.history is not None:
                self.history[where] = contents["history"][last:end]
            last = end

    def cramped(self) -> NDArray[np.bool_]:
        """(N,) whether the field has come to a face of its box, or wants more room in the pools."""
        touching = self.surveys[:, FACE] > self.limits.tolerance
        return np.asarray(touching | (self.surveys[:, WANTED] > self.room))

    def refit(self, cells: Integers) -> Integers:
        """Lay the boxes of these cells anew where the band needs it; return those that moved."""
        found = np.zeros((len(cells), 3, 2), np.int64)
        extents(cells, self.boxes, self.band_only, self.phi, self.limits.tolerance, found)
        low, high = found[:, :, 0] - GUARD, found[:, :, 1] + GUARD
        alive = (found[:, 0, 0] < found[:, 0, 1]) & (self.surveys[cells, BAD] == 0)
        shape = even(high - low)
        loose = (shape <= self.shape[cells] - SLACK).any(axis=1)
        moved = alive & (self.cramped()[cells] | loose)
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

    def _move(self, cells: Integers, shifts: Integers, shapes: Integers) -> None:
        """Give cells boxes whose origins move by `shifts`; history moves with the field."""
        starts, size = _one_after_the_other(shapes.prod(axis=1))
        pools = [self.phi] if self.history is None else [self.phi, self.history]
        wholes = []
        for pool in pools:
            wholes.append(np.empty(size, self.dtype))
            get_boxes(
                cells, self.boxes, self.band_only, pool, shifts, shapes, starts, wholes[-1],
                self.lost if pool is self.phi else np.zeros(len(self)),
            )  # fmt: skip
        self._give(self.row_start[cells], self._n_rows(cells), self._rows)
        self.origin[cells] += shifts
        self.shape[cells] = shapes
        self._take_rows(cells)
        self._fill(cells, wholes)
        if self._extrapolates:
            stretch_totals(cells, self.boxes, self.band_only, self.history, self.cells["ahead"])

    def _fill(self, cells: Integers, wholes: Sequence[Real]) -> None:
        """Take in fields, and histories, of whole boxes, one after the other; survey the fields."""
        starts, _ = _one_after_the_other(self.sizes()[cells])
        find_bands(cells, self.boxes, self.band_only, starts, wholes[0], self.limits, self.surveys)
        self._take(cells, self.surveys[cells, WANTED].astype(np.int64))
        put_boxes(cells, self.boxes, self.band_only, starts, wholes[0], self.phi, self.lost)
        for whole in wholes[1:]:
            put_boxes(
                cells, self.boxes, self.band_only, starts, whole, self.history, np.zeros(len(self))
            )
        if self.band_only:
            survey_bands(cells, self.boxes, self.phi, self.limits, self.surveys)

    def _close_ranks(self) -> None:
        """Leave no room between cells in the pools."""
        order = np.argsort(self.start)
        starts, sizes = self.start[order], self.room[order]
        self._slots = Slots()
        goals = np.array([self._slots.take(size) for size in sizes.tolist()], np.int64)
        for pool in (self.phi, self.history):
            if pool is not None:
                close_ranks(starts, goals, sizes, pool)
        self.start[order] = goals

    def _n_rows(self, cells: Integers) -> Integers:
        return np.asarray(self.shape[cells, :2].prod(axis=1))

    def _take_rows(self, cells: Integers) -> None:
        """Give boxes of the shapes in the table their rows."""
        self.row_start[cells] = [self._rows.take(n) for n in self._n_rows(cells).tolist()]
        if self._rows.end > len(self.place):
            self.low, self.high, self.place = (
                _grown(values, self._rows.end, self._more)
                for values in (self.low, self.high, self.place)
            )

    def _take(self, cells: Integers, sizes: Integers) -> None:
        """Give cells other room, for so many points, and for bands to change."""
        self._vacate(cells)
        if self.band_only:
            sizes = sizes + sizes // SPARE
        self._occupy(cells, np.array([Slots.capacity(size) for size in sizes.tolist()], np.int64))

    def _vacate(self, cells: Integers) -> None:
        """Give back the room of cells in the pools of fields."""
        self._give(self.start[cells], self.room[cells], self._slots)
        self.room[cells] = 0

    def _occupy(self, cells: Integers, rooms: Integers) -> None:
        """Give cells so much room in the pools of fields."""
        self.room[cells] = rooms
        self.start[cells] = [self._slots.take(room) for room in rooms.tolist()]
        if self._slots.end > len(self.phi):
            self.phi = _grown(self.phi, self._slots.end, self._more)
            if self.history is not None:
                self.history = _grown(self.history, self._slots.end, self._more)

    @property
    def _more(self) -> float:
        """How many times as many cells as now are expected."""
        return self.expected / max(len(self), FEW)

    def _place(self, i: int, whole: bool) -> None:
        """Set where the rows of cell i lie: those of its whole box, or the spans of its band."""
        rows = self.rows_of(i)
        if whole:
            self.place[rows] = np.arange(rows.stop - rows.start) * self.shape[i, 2]
        else:
            low, length = self.low[rows], self.high[rows] - self.low[rows]
            self.place[rows] = np.cumsum(length, dtype=np.int64) - length - low

    @staticmethod
    def _give(starts: Integers, sizes: Integers, slots: Slots) -> None:
        """Give back stretches of these lengths; those of none have never been taken."""
        for start, size in zip(starts.tolist(), sizes.tolist(), strict=True):
            if size:
                slots.give(start, size)


def _batches(
    rows: Integers, fields: Iterable[tuple[Integers, Real]]
) -> Iterator[tuple[int, list[tuple[Integers, Real]]]]:
    """A few fields at a time, and how many came before."""
    each = iter(fields)
    for first in range(0, len(rows), AT_ONCE):
        yield first, list(islice(each, AT_ONCE))


def _one_after_the_other(sizes: Integers) -> tuple[Integers, int]:
    """Where stretches of these lengths begin, and the length of all."""
    ends = np.cumsum(sizes)
    return np.asarray(ends - sizes), int(ends[-1]) if len(ends) else 0


def _grown(pool: NDArray, size: int, more: float) -> NDArray:
    """Copy of a pool with room for `size`, or more if it was in use before: half, or that expected.

    What is never written to takes no memory.
    """
    room = size if len(pool) == 0 else int(size * max(1.5, RESERVE * more))
    try:
        result = np.zeros((room, *pool.shape[1:]), pool.dtype)
    except MemoryError:  # where what is not written to counts
        result = np.zeros((size + size // 8, *pool.shape[1:]), pool.dtype)
    result[: len(pool)] = pool
    return result
