"""A rank's part of the cells: its own, and ghost cells, which are others that come near."""

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from morphosim.cell_field import CellField
from morphosim.cell_table import CellTable, Column
from morphosim.engine.engine import Engine, Fields
from morphosim.engine.solvers.solver import StepState
from morphosim.geometry.confinement import Confinement
from morphosim.measure.surroundings import Surroundings
from morphosim.mpi import state_transfer
from morphosim.mpi.communicator import agreed
from morphosim.numerics.parameters import Numerics
from morphosim.physics.parameters import Physics

if TYPE_CHECKING:
    from mpi4py.MPI import Comm

Integers = NDArray[np.int64]


class LocalEngine(Engine):
    """Engine of a rank's own cells and of ghost cells, which act and are not stepped.

    Cells are in the order of their numbers in the whole simulation, so that sums over cells run
    as they do on one rank.

    Parameters
    ----------
    physics, numerics, confinement
        See `Scene`.
    columns : see `Engine`
    everyone : CellTable
        All cells of the simulation; its columns are those that every rank knows.
    comm : communicator of all ranks
    share_fields : function
        Sends the fields in which forces are taken to the ranks where they are felt.

    Attributes
    ----------
    rows : (n,) numbers of the rank's cells and ghost cells in the whole simulation, ascending
    own : (n,) bool, which of them are not ghost cells
    """

    def __init__(
        self, physics: Physics, numerics: Numerics, confinement: Confinement | None,
        columns: Sequence[Column], everyone: CellTable, comm: "Comm",
        share_fields: Callable[[], None],
    ) -> None:  # fmt: skip
        super().__init__(physics, numerics, confinement, columns)
        self._comm, self._share = comm, share_fields
        self._everyone = everyone
        self.rows, self.own = np.zeros(0, np.int64), np.zeros(0, bool)

    @property
    def everyone(self) -> CellTable:
        """All cells of the simulation."""
        return self._everyone

    @property
    def owned(self) -> Integers:
        """Places of the rank's own cells among all that it holds."""
        return np.flatnonzero(self.own)

    @property
    def own_columns(self) -> list[str]:
        """Columns that this rank alone knows of its cells, and must hand over with them."""
        return [c.name for c in self.cells.columns.values() if c.saved and not c.shared]

    def begin(self, rows: Integers, fields: Fields) -> None:
        """Begin with own cells of these numbers, and their start fields."""
        empty = np.zeros(0, np.int64)
        self.cells.arrange(empty, empty, len(rows))
        self.rows, self.own = rows, np.ones(len(rows), bool)
        self.enrol()
        self._lay_start(fields)

    def aim(self, time: float) -> None:
        """Set the columns that are `aimed` of all cells, and take over those of the cells held."""
        super().aim(time)
        for column in self.cells.columns.values():
            if column.aimed:
                self.cells[column.name][:] = self._everyone[column.name][self.rows]

    def _made_ready(self, ticks: int) -> StepState:
        """See `Engine`; under error control ranks agree on what follows, so all must come to it."""
        if self.numerics.tolerance is None:
            return super()._made_ready(ticks)
        return agreed(self._comm, lambda: super(LocalEngine, self)._made_ready(ticks))

    def _share_fields(self) -> None:
        """Send the fields in which forces are taken to the ranks where they are felt."""
        self._share()

    def _surroundings(self) -> Surroundings:
        """What cells can feel; ghost cells' centroids and columns of terms from their ranks."""
        found, own = super()._surroundings(), self.owned
        columns = [c.name for c in self.physics.columns if c.saved]
        part = self.cells.select(own, columns) | {"centroid": found.centroid[own]}
        parts = self._comm.allgather(part | {"rows": self.rows[own]})
        known, ghosts = state_transfer.merge(parts), ~self.own
        found.centroid[ghosts] = known["centroid"][self.rows[ghosts]]
        for name in columns:
            self.cells[name][ghosts] = known[name][self.rows[ghosts]]
        return found

    def _most_of_all(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Largest values on any rank, one by one."""
        from mpi4py import MPI

        most = np.empty_like(values)
        self._comm.Allreduce(values, most, op=MPI.MAX)
        return most

    def adopt(self, physics: Physics, steps: int, ticks: int) -> None:
        """Go on from a saved state of these physics; `hold` and `take` bring its cells."""
        self.physics, self.steps, self.ticks = physics, steps, ticks
        self.cells.require(self.columns_with(physics))
        self.own[:] = False  # nothing that is held stays
        self.change()

    def hold(
        self, rows: Integers, own: NDArray[np.bool_], origin: Integers, shape: Integers
    ) -> None:
        """Hold other cells; those that are here with the same boxes stay as they are.

        Parameters
        ----------
        rows : (n,) numbers of the cells, ascending
        own : (n,) bool, which are not ghost cells
        origin, shape : (n, 3) boxes
        """
        found = np.minimum(np.searchsorted(rows, self.rows), len(rows) - 1)
        same_box = (origin[found] == self.pool.origin) & (shape[found] == self.pool.shape)
        same = (rows[found] == self.rows) & (own[found] == self.own) & same_box.all(axis=1)
        kept = np.flatnonzero(same)
        if not (np.array_equal(rows, self.rows) and np.array_equal(own, self.own)):
            self.change()
        self.pool.arrange(kept, found[kept], origin, shape)
        self.rows, self.own = rows, own
        self.enrol()
        self._displaced = True

    def enrol(self) -> None:
        """Take over what all ranks know of the cells held."""
        shared = [c.name for c in self.cells.columns.values() if c.shared]
        self.cells.kinds = self._everyone.kinds
        self.cells.fill(self._everyone.select(self.rows, shared))
        self.cells["frozen"][:] |= ~self.own
        self.cells.index()

    def drop(self, numbers: Integers) -> None:
        """Forget cells, by their numbers in the whole simulation; those behind them move up."""
        places = np.flatnonzero(np.isin(self.rows, numbers))
        self.pool.release(places)
        self.cells.remove(places)
        self._close_up(places, numbers)

    def split(
        self, numbers: Integers, own: NDArray[np.bool_], born: Mapping[str, Any],
        halves: Sequence[CellField],
    ) -> None:  # fmt: skip
        """Replace own cells by two each, and forget others that divide elsewhere.

        Daughters come last, here and in the whole simulation.

        Parameters
        ----------
        numbers : (n,) of the mothers, in the whole simulation before
        own : (n,) bool, which of them are this rank's
        born : the daughters' rows of the columns that all ranks know, (2 n, …)
        halves : (2 n,) their fields
        """
        if not own.any():
            self.drop(numbers)
            return
        here, gone = np.repeat(own, 2), np.flatnonzero(np.isin(self.rows, numbers))
        mothers = np.searchsorted(self.rows, numbers[own])
        inherited = self.cells.born(mothers, {"name": born["name"][here]})
        self.pool.release(gone)
        rows = self.cells.replace(gone, inherited)
        for name, values in born.items():
            self.cells[name][rows] = values[here]
        self.cells.index()
        self._close_up(gone, numbers)
        first = len(self.everyone) - len(here)
        self.rows = np.concatenate([self.rows, first + np.flatnonzero(here)])
        self.own = np.concatenate([self.own, np.ones(here.sum(), bool)])
        self._lay_halves(rows, [half for half, mine in zip(halves, here, strict=True) if mine])

    def _close_up(self, places: Integers, numbers: Integers) -> None:
        """Take the cells of these places and numbers out of the lists of who is held."""
        kept = np.delete(self.rows, places)
        self.rows = kept - np.searchsorted(np.sort(numbers), kept)
        self.own = np.delete(self.own, places)

    def part(self, rows: Integers) -> dict[str, NDArray]:
        """What `Engine.contents` has of some own cells and other ranks do not know."""
        places = np.searchsorted(self.rows, rows)
        columns = state_transfer.sendable(self.cells.select(places, self.own_columns))
        return columns | self.pool.contents(places) | {"rows": rows}

    def take(self, part: Mapping[str, NDArray]) -> None:
        """Fill the boxes of own cells with what `part` gave on another rank."""
        places = np.searchsorted(self.rows, part["rows"])
        self.pool.fill(places, part)
        for name in self.own_columns:
            if name in part:
                self.cells[name][places] = part[name]
