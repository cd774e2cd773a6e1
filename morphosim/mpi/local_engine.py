"""A rank's part of the cells: its own, and copies of those of other ranks that come near."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from morphosim.cell_field import CellField
from morphosim.engine.box_pool import BoxPool
from morphosim.engine.engine import Engine, Society
from morphosim.geometry.confinement import Confinement
from morphosim.kernels.boxes import EDGE
from morphosim.numerics.parameters import Numerics
from morphosim.physics.parameters import Physics

Integers = NDArray[np.int64]


@dataclass
class Roll:
    """What every rank knows of all N cells of the simulation."""

    names: list[str]
    types: list[str]
    parents: list[str]
    gamma: NDArray[np.float64]
    frozen: NDArray[np.bool_]
    ids: NDArray[np.uint64]

    def remove(self, i: int) -> None:
        """Drop cell i."""
        del self.names[i], self.types[i], self.parents[i]
        for name in ("gamma", "frozen", "ids"):
            setattr(self, name, np.delete(getattr(self, name), i))

    def divide(
        self, i: int, names: Sequence[str], types: Sequence[str], ids: NDArray[np.uint64]
    ) -> None:
        """Replace cell i by two, which come last."""
        mother, gamma, frozen = self.names[i], self.gamma[i], self.frozen[i]
        self.remove(i)
        self.names += names
        self.types += types
        self.parents += [mother, mother]
        self.gamma = np.append(self.gamma, [gamma, gamma])
        self.frozen = np.append(self.frozen, [frozen, frozen])
        self.ids = np.append(self.ids, ids)


class RankPool(BoxPool):
    """Fields of a rank's own cells and of its copies.

    Attributes
    ----------
    moved : cells whose boxes the last `refit` has moved
    """

    moved: Integers = np.zeros(0, np.int64)

    def refit(self, cells: Integers) -> Integers:
        """See `BoxPool`."""
        self.moved = super().refit(cells)
        return self.moved

    def arrange(self, kept: Integers, places: Integers, origin: Integers, shape: Integers) -> None:
        """Hold other cells: some of the present ones, at new places, and empty boxes.

        Parameters
        ----------
        kept : (K,) present numbers of the cells that stay
        places : (K,) their new numbers
        origin, shape : (N, 3) boxes of all cells then
        """
        for i in np.setdiff1d(np.arange(len(self)), kept).tolist():
            self._release(i)
        for name in ("start", "plane_start", "lost", "surveys"):
            before = getattr(self, name)
            after = np.zeros((len(origin), *before.shape[1:]), before.dtype)
            after[places] = before[kept]
            setattr(self, name, after)
        self.origin, self.shape = origin.copy(), shape.copy()
        new = np.setdiff1d(np.arange(len(origin)), places)
        for i in new.tolist():
            self.start[i] = self._slots.take(int(shape[i].prod()))
            self.plane_start[i] = self._planes.take(int(shape[i, 0]))
        self._reserve()
        for i in new.tolist():
            self.box(i)[:] = 0
            self.band[self.plane_start[i] : self.plane_start[i] + shape[i, 0]] = 0


class RankEngine(Engine):
    """Engine of a rank's own cells and of copies, which act and are not stepped.

    Cells are in the order of their numbers in the whole simulation, so that sums over cells run
    as they do on one rank.

    Parameters
    ----------
    physics, numerics, confinement
        See `Scene`.
    roll : Roll
        All cells of the simulation.
    rows : (n,) numbers of the cells that the rank starts with
    fields : of these, lattice origin and start field

    Attributes
    ----------
    rows : (n,) numbers of the rank's cells and copies in the whole simulation, ascending
    own : (n,) bool, which of them are not copies
    """

    pool: RankPool

    def __init__(
        self,
        physics: Physics,
        numerics: Numerics,
        confinement: Confinement | None,
        roll: Roll,
        rows: Integers,
        fields: Iterable[tuple[Integers, NDArray[np.floating]]],
    ) -> None:
        self.roll, self.rows, self.own = roll, rows, np.ones(len(rows), bool)
        self._enrolled = rows.copy(), self.own.copy()
        super().__init__(
            physics, numerics, confinement, [roll.names[i] for i in rows],
            [roll.types[i] for i in rows], roll.gamma[rows], roll.frozen[rows], fields,
        )  # fmt: skip

    @property
    def society(self) -> Society:
        """See `Engine`."""
        return Society(self.roll.gamma, self.roll.types)

    @property
    def owned(self) -> Integers:
        """Places of the rank's own cells among all that it holds."""
        return np.flatnonzero(self.own)

    @property
    def enrolled(self) -> bool:
        """Whether the cells held are those of the last `enrol`."""
        return all(map(np.array_equal, self._enrolled, (self.rows, self.own)))

    def hold(
        self, rows: Integers, own: NDArray[np.bool_], origin: Integers, shape: Integers
    ) -> None:
        """Hold other cells; those that are here with the same boxes stay as they are.

        Parameters
        ----------
        rows : (n,) numbers of the cells, ascending
        own : (n,) bool, which are not copies
        origin, shape : (n, 3) boxes
        """
        found = np.minimum(np.searchsorted(rows, self.rows), len(rows) - 1)
        same_box = (origin[found] == self.pool.origin) & (shape[found] == self.pool.shape)
        same = (rows[found] == self.rows) & (own[found] == self.own) & same_box.all(axis=1)
        kept = np.flatnonzero(same)
        self.pool.arrange(kept, found[kept], origin, shape)
        peak = np.zeros(len(rows))
        peak[found[kept]] = self.face_peak[kept]
        self.rows, self.own, self.face_peak = rows, own, peak

    def enrol(self, anew: bool) -> None:
        """Take over from the roll what is said of the cells held; `anew`, all else too."""
        roll, rows = self.roll, self.rows.tolist()
        self.names, self.types, self.parents = (
            [texts[i] for i in rows] for texts in (roll.names, roll.types, roll.parents)
        )
        self.gamma, self.ids = roll.gamma[rows], roll.ids[rows]
        self.frozen = roll.frozen[rows] | ~self.own
        if anew:
            self._relist()
        else:
            self._set_terms()
        self._enrolled = self.rows.copy(), self.own.copy()

    def lay(self) -> None:
        """Set up all that depends on where the boxes are, of the copies also."""
        super()._relayout()

    def drop(self, number: int) -> None:
        """Forget a cell, by its number in the whole simulation; those behind it move up."""
        for i in np.flatnonzero(self.rows == number).tolist():
            self.pool.remove(i)
            for name in ("rows", "own", "face_peak"):
                setattr(self, name, np.delete(getattr(self, name), i))
        self.rows[self.rows > number] -= 1

    def add(self, number: int, fields: Sequence[CellField]) -> None:
        """Take in own cells, which come last and have these numbers and those that follow."""
        n = len(fields)
        self.pool.add((field.origin, field.phi) for field in fields)
        self.rows = np.append(self.rows, np.arange(number, number + n))
        self.own = np.append(self.own, np.ones(n, bool))
        self.face_peak = np.append(self.face_peak, self.pool.surveys[-n:, EDGE])

    def part(self, rows: Integers) -> dict[str, NDArray]:
        """What `Engine.contents` has of some own cells, and their numbers."""
        places = np.searchsorted(self.rows, rows)
        contents = self.pool.contents(places)
        return contents | {"rows": rows, "face_peak": self.face_peak[places]}

    def take(self, part: Mapping[str, NDArray]) -> None:
        """Fill the boxes of own cells with what `part` gave on another rank."""
        places = np.searchsorted(self.rows, part["rows"])
        self.pool.fill(places, part)
        self.pool.lost[places], self.pool.surveys[places] = part["lost"], part["surveys"]
        self.face_peak[places] = part["face_peak"]

    def forget(self) -> None:
        """The next step is of first order; see `Engine.restart`."""
        self.fresh = True
        if self.pool.history is not None:
            self.pool.history[:] = 0

    def _make_pool(self) -> BoxPool:
        bdf2 = self.numerics.scheme == "bdf2"
        return RankPool(self.dtype, self._limits, bdf2, self._band_only)

    def _relayout(self) -> None:
        """Not within a step: the boxes of the copies are not known yet, and `lay` follows."""
