"""Moving boxes: where each cell's subgrid lies, and the pools that hold the fields."""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from morphosim.cell_table import CellTable, Column
from morphosim.kernels.boxes import (
    BAD,
    FACE,
    N_SURVEYED,
    TOTAL,
    clear_outside,
    extents,
    move_box,
    survey,
    widen,
)
from morphosim.kernels.layout import Boxes, Limits
from morphosim.kernels.step import GUARD

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
Integers = NDArray[np.int64]
Real = NDArray[np.floating]


class Slots:
    """Stretches of a pool: size classes with free lists, at most 1/8 larger than asked for."""

    def __init__(self) -> None:
        self.end = 0
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
            return self._free[capacity].pop()
        start = self.end
        self.end += capacity
        return start

    def give(self, start: int, size: int) -> None:
        """Return the stretch taken for `size`."""
        self._free.setdefault(self.capacity(size), []).append(start)


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
        """Bytes of the pools."""
        history = 0 if self.history is None else self.history.nbytes
        return self.phi.nbytes + history + self.band.nbytes

    def sizes(self) -> Integers:
        """Points per box."""
        return np.asarray(self.shape.prod(axis=1))

    def box(self, i: int, pool: Real | None = None) -> Real:
        """Field of cell i as a 3-D view (of `phi`, or of another pool of the same layout)."""
        values = self.phi if pool is None else pool
        size = int(self.shape[i].prod())
        return values[self.start[i] : self.start[i] + size].reshape(self.shape[i])

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
            self.survey(i)
        self.forget(rows.tolist())
        self.lost[rows] = given - self.surveys[rows, TOTAL]

    def release(self, rows: Iterable[int]) -> None:
        """Give back the boxes of cells that are about to be dropped from the table."""
        for i in rows:
            self._release(i)

    def forget(self, rows: Iterable[int]) -> None:
        """Begin the histories of cells anew."""
        if self.history is not None:
            for i in rows:
                self.box(i, self.history)[:] = self.box(i) if self._extrapolates else 0
                self.cells["ahead"][i] = self.surveys[i, TOTAL]

    def contents(self, cells: Integers | None = None) -> dict[str, NDArray]:
        """Fields, histories and bands, box after box, of all cells or of those given."""
        held = {"phi": self.phi} if self.history is None else {
            "phi": self.phi, "history": self.history,
        }  # fmt: skip
        chosen = np.arange(len(self)) if cells is None else cells
        bands = [
            self.band[first : first + n]
            for first, n in zip(self.plane_start[chosen], self.shape[chosen, 0], strict=True)
        ]
        return {
            name: np.concatenate([self.box(i, pool).ravel() for i in chosen.tolist()])
            for name, pool in held.items()
        } | {"band": np.concatenate(bands)}

    def restore(self, contents: Mapping[str, NDArray]) -> None:
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
        self.release(np.setdiff1d(np.arange(len(self)), kept).tolist())
        self.cells.arrange(kept, places, len(origin))
        self.origin[:], self.shape[:] = origin, shape
        new = np.setdiff1d(np.arange(len(origin)), places)
        self._take(new)
        for i in new.tolist():
            self.box(i)[:] = 0
            self.band[self.plane_start[i] : self.plane_start[i] + shape[i, 0]] = 0
        self.forget(new.tolist())

    def fill(self, cells: Integers, contents: Mapping[str, NDArray]) -> None:
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

    def survey(self, i: int) -> float:
        """Measure cell i's stored field and find its band anew; return Σ φ that this cuts off."""
        nx, ny, nz = (int(n) for n in self.shape[i])
        band = self.band[self.plane_start[i] : self.plane_start[i] + nx]
        where = self.phi, self.start[i], ny * nz, nz, nx, ny, nz
        survey(*where, band, True, self.limits, band, self.surveys[i])
        widen(band, GUARD, nx, ny)
        if not self.band_only:
            return 0.0
        if self.history is not None:
            clear_outside(self.history, self.start[i], band, nx, ny, nz)
        cut = clear_outside(self.phi, self.start[i], band, nx, ny, nz)
        survey(*where, band, False, self.limits, band.copy(), self.surveys[i])
        return float(cut)

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
        for k in np.flatnonzero(moved):
            self._move(int(cells[k]), low[k], shape[k])
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

    def _move(self, i: int, shift: Integers, shape: Integers) -> None:
        """Give cell i a box whose origin moves by `shift`; history moves with the field."""
        old_shape, old_start = self.shape[i].copy(), int(self.start[i])
        old_size, size = int(old_shape.prod()), int(shape.prod())
        saved = [
            pool[old_start : old_start + old_size].copy()
            for pool in (self.phi, self.history) if pool is not None
        ]  # fmt: skip
        self._release(i)
        self.start[i] = self._slots.take(size)
        self.plane_start[i] = self._planes.take(int(shape[0]))
        self.origin[i] += shift
        self.shape[i] = shape
        self._reserve()
        pools = [pool for pool in (self.phi, self.history) if pool is not None]
        lost = [
            move_box(values, 0, old_shape, pool, self.start[i], shape, shift)
            for values, pool in zip(saved, pools, strict=True)
        ]
        self.lost[i] += lost[0] + self.survey(i)
        if self._extrapolates:
            self.cells["ahead"][i] = self.box(i, self.history).sum(dtype=float)

    def _take(self, rows: Integers) -> None:
        """Give boxes of the shapes in the table their stretches of the pools."""
        for i in rows.tolist():
            self.start[i] = self._slots.take(int(self.shape[i].prod()))
            self.plane_start[i] = self._planes.take(int(self.shape[i, 0]))
        self._reserve()

    def _release(self, i: int) -> None:
        self._slots.give(int(self.start[i]), int(self.shape[i].prod()))
        self._planes.give(int(self.plane_start[i]), int(self.shape[i, 0]))

    def _reserve(self) -> None:
        """Grow the pools to what the slots need, with room for a few boxes more."""
        if self._planes.end > len(self.band):
            self.band = _grown(self.band, self._planes.end)
        if self._slots.end > len(self.phi):
            self.phi = _grown(self.phi, self._slots.end)
            if self.history is not None:
                self.history = _grown(self.history, self._slots.end)


def _grown(pool: NDArray, size: int) -> NDArray:
    """Copy of a pool with room for `size`, and a tenth more if it was in use before."""
    room = size if len(pool) == 0 else size + size // 10
    result = np.zeros((room, *pool.shape[1:]), pool.dtype)
    result[: len(pool)] = pool
    return result
