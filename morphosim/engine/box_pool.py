"""Moving boxes: where each cell's subgrid lies, and the pools that hold the fields."""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

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

    Attributes
    ----------
    phi : 1-D pool of φⁿ
    history : 1-D pool of the scheme's history Hⁿ, or None
    band : (planes, 2) int32
        Rows of each plane of each box where the field is not 0, `GUARD` more than where it
        exceeds the tolerance.
    surveys : (N, N_SURVEYED) float64
        What `kernels.boxes.survey` found.
    lost : (N,) float64
        Σ φ that moving boxes has cut off since the start, per cell (signed, lattice units).
    """

    def __init__(
        self, dtype: DTypeLike, limits: Limits, with_history: bool, band_only: bool
    ) -> None:
        self.dtype: np.dtype[Any] = np.dtype(dtype)
        self.limits, self.band_only = limits, band_only
        self.phi: Real = np.zeros(0, dtype)
        self.history: Real | None = np.zeros(0, dtype) if with_history else None
        self.band = np.zeros((0, 2), np.int32)
        self.origin = np.zeros((0, 3), np.int64)
        self.shape = np.zeros((0, 3), np.int64)
        self.start = np.zeros(0, np.int64)
        self.plane_start = np.zeros(0, np.int64)
        self.lost = np.zeros(0)
        self.surveys = np.zeros((0, N_SURVEYED))
        self._slots, self._planes = Slots(), Slots()

    def __len__(self) -> int:
        return len(self.start)

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

    def add(self, fields: Iterable[tuple[Integers, Real]]) -> None:
        """Append cells given by lattice origin and field; their boxes are laid around the band."""
        given, laid = [], []
        for origin, phi in fields:
            given.append(float(phi.sum(dtype=float)))
            laid.append(self._trim(origin, phi))
        first = len(self)
        shapes = np.array([phi.shape for _, phi in laid], np.int64).reshape(-1, 3)
        self.origin = np.concatenate([self.origin, np.array([o for o, _ in laid]).reshape(-1, 3)])
        self.shape = np.concatenate([self.shape, shapes])
        starts = [self._slots.take(int(n)) for n in shapes.prod(axis=1)]
        planes = [self._planes.take(int(n)) for n in shapes[:, 0]]
        self.start = np.concatenate([self.start, np.array(starts, np.int64)])
        self.plane_start = np.concatenate([self.plane_start, np.array(planes, np.int64)])
        self.lost = np.concatenate([self.lost, np.zeros(len(laid))])
        self.surveys = np.concatenate([self.surveys, np.zeros((len(laid), N_SURVEYED))])
        self._reserve()
        for i, (_, phi) in enumerate(laid, first):
            self.box(i)[:] = phi
            if self.history is not None:
                self.box(i, self.history)[:] = 0
            self.survey(i)
        self.lost[first:] = given - self.surveys[first:, TOTAL]

    def contents(self, cells: Integers | None = None) -> dict[str, NDArray]:
        """All that `restore` needs, box after box in the order of the cells, or of those given."""
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
        } | {
            "band": np.concatenate(bands), "origin": self.origin[chosen],
            "shape": self.shape[chosen], "lost": self.lost[chosen], "surveys": self.surveys[chosen],
        }  # fmt: skip

    def restore(self, contents: Mapping[str, NDArray]) -> None:
        """Hold exactly the boxes of `contents`, instead of the present ones."""
        for name in ("origin", "shape", "lost", "surveys"):
            setattr(self, name, np.array(contents[name]))
        self._slots, self._planes = Slots(), Slots()
        self.start = np.array([self._slots.take(int(n)) for n in self.sizes()], np.int64)
        self.plane_start = np.array([self._planes.take(int(n)) for n in self.shape[:, 0]], np.int64)
        self._reserve()
        self.fill(np.arange(len(self)), contents)

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

    def remove(self, i: int) -> None:
        """Drop cell i; cells behind it move up by one."""
        self._release(i)
        for name in ("origin", "shape", "start", "plane_start", "lost", "surveys"):
            setattr(self, name, np.delete(getattr(self, name), i, axis=0))

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
