"""Moving boxes: where each cell's subgrid lies, and the pools that hold the fields."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from morphosim.kernels.boxes import extents, move_box, survey
from morphosim.kernels.layout import Boxes

GUARD = 1
"""Lattice points between the band and the faces of a freshly laid box."""
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


class BoxPool:
    """The fields of all cells, each in its own box.

    Attributes
    ----------
    phi : 1-D pool of φⁿ
    history : 1-D pool of the scheme's history Hⁿ, or None
    lost : (N,) float64
        Σ φ that moving boxes has cut off since the start, per cell (signed, lattice units).
    """

    def __init__(self, dtype: DTypeLike, tolerance: float, with_history: bool) -> None:
        self.dtype: np.dtype[Any] = np.dtype(dtype)
        self._real: Any = self.dtype.type
        self.tolerance = np.asarray(tolerance, dtype)[()]
        self.phi: Real = np.zeros(0, dtype)
        self.history: Real | None = np.zeros(0, dtype) if with_history else None
        self.spans = np.zeros((0, 2), np.int32)
        self.origin = np.zeros((0, 3), np.int64)
        self.shape = np.zeros((0, 3), np.int64)
        self.start = np.zeros(0, np.int64)
        self.row_start = np.zeros(0, np.int64)
        self.lost = np.zeros(0)
        self.surveys = np.zeros((0, 5))
        self._slots, self._rows = Slots(), Slots()

    def __len__(self) -> int:
        return len(self.start)

    @property
    def boxes(self) -> Boxes:
        """Layout for the kernels; valid until boxes move."""
        return Boxes(self.origin, self.shape, self.start, self.row_start, self.spans)

    @property
    def nbytes(self) -> int:
        """Bytes of the pools."""
        history = 0 if self.history is None else self.history.nbytes
        return self.phi.nbytes + history + self.spans.nbytes

    def sizes(self) -> Integers:
        """Points per box."""
        return np.asarray(self.shape.prod(axis=1))

    def box(self, i: int, pool: Real | None = None) -> Real:
        """Field of cell i as a 3-D view (of `phi`, or of another pool of the same layout)."""
        values = self.phi if pool is None else pool
        size = int(self.shape[i].prod())
        return values[self.start[i] : self.start[i] + size].reshape(self.shape[i])

    def add(self, fields: Sequence[tuple[Integers, Real]]) -> None:
        """Append cells given by lattice origin and field; their boxes are laid around the band."""
        laid = [self._trim(origin, phi) for origin, phi in fields]
        first = len(self)
        shapes = np.array([phi.shape for _, phi in laid], np.int64).reshape(-1, 3)
        self.origin = np.concatenate([self.origin, np.array([o for o, _ in laid]).reshape(-1, 3)])
        self.shape = np.concatenate([self.shape, shapes])
        starts = [self._slots.take(int(n)) for n in shapes.prod(axis=1)]
        rows = [self._rows.take(int(n)) for n in shapes[:, :2].prod(axis=1)]
        self.start = np.concatenate([self.start, np.array(starts, np.int64)])
        self.row_start = np.concatenate([self.row_start, np.array(rows, np.int64)])
        self.lost = np.concatenate([self.lost, np.zeros(len(laid))])
        self.surveys = np.concatenate([self.surveys, np.zeros((len(laid), 5))])
        self._reserve()
        for i, (_, phi) in enumerate(laid, first):
            self.box(i)[:] = phi
            if self.history is not None:
                self.box(i, self.history)[:] = 0
            self.survey(i)

    def remove(self, i: int) -> None:
        """Drop cell i; cells behind it move up by one."""
        self._release(i)
        for name in ("origin", "shape", "start", "row_start", "lost", "surveys"):
            setattr(self, name, np.delete(getattr(self, name), i, axis=0))

    def survey(self, i: int) -> None:
        """Measure cell i's stored field: its row spans and sums (`kernels.boxes.survey`)."""
        survey(
            self.phi, self.start[i], *self.shape[i], self.tolerance, self._real(np.inf),
            self._real(0.5), self.spans, self.row_start[i], self.surveys[i],
        )  # fmt: skip

    def refit(self, cells: Integers) -> Integers:
        """Lay the boxes of these cells anew where the band needs it; return those that moved."""
        found = np.zeros((len(cells), 3, 2), np.int64)
        extents(cells, self.boxes, found)
        low, high = found[:, :, 0] - GUARD, found[:, :, 1] + GUARD
        alive = (found[:, 0, 0] < found[:, 0, 1]) & (self.surveys[cells, 3] == 0)
        shape = even(high - low)
        touching = self.surveys[cells, 4] > self.tolerance
        loose = (shape <= self.shape[cells] - SLACK).any(axis=1)
        moved = alive & (touching | loose)
        for k in np.flatnonzero(moved):
            self._move(int(cells[k]), low[k], shape[k])
        return np.asarray(cells[moved])

    def _trim(self, origin: Integers, phi: Real) -> tuple[Integers, Real]:
        """Cut a start field down to its band, or pad it, and make its shape even."""
        band = np.argwhere(np.abs(phi) > self.tolerance)
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
        self.row_start[i] = self._rows.take(int(shape[0] * shape[1]))
        self.origin[i] += shift
        self.shape[i] = shape
        self._reserve()
        pools = [pool for pool in (self.phi, self.history) if pool is not None]
        lost = [
            move_box(values, 0, old_shape, pool, self.start[i], shape, shift)
            for values, pool in zip(saved, pools, strict=True)
        ]
        self.lost[i] += lost[0]
        self.survey(i)

    def _release(self, i: int) -> None:
        self._slots.give(int(self.start[i]), int(self.shape[i].prod()))
        self._rows.give(int(self.row_start[i]), int(self.shape[i, :2].prod()))

    def _reserve(self) -> None:
        """Grow the pools to what the slots need, with room for a few boxes more."""
        if self._rows.end > len(self.spans):
            self.spans = _grown(self.spans, self._rows.end)
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
