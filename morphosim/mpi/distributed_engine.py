"""The engine of a simulation whose cells are shared out over ranks."""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from morphosim.cell_field import CellField
from morphosim.cell_table import CellTable, Column
from morphosim.engine.engine import Fields
from morphosim.geometry.confinement import Confinement
from morphosim.kernels.boxes import BAD, CORE
from morphosim.mpi import state_transfer
from morphosim.mpi.box_directory import BoxDirectory
from morphosim.mpi.communicator import agreed, is_agreed, raise_agreed, threads_per_rank
from morphosim.mpi.decompose import owners, work
from morphosim.mpi.gathered_view import GatheredView
from morphosim.mpi.ghost_exchange import GhostExchange, Traffic
from morphosim.mpi.ghost_regions import Reach, portions
from morphosim.mpi.local_engine import LocalEngine
from morphosim.numerics.parameters import MOST_TICKS, Numerics
from morphosim.physics.parameters import Physics

if TYPE_CHECKING:
    from mpi4py.MPI import Comm

Integers = NDArray[np.int64]
REBALANCE = 256
"""Steps between two looks at which rank should own which cell."""
MOVED, DIVERGED, VANISHED, FAILED, TOUCHED = range(5)


class DistributedEngine(GatheredView):
    """As `Engine`, of all N cells, of which each rank steps its own.

    All ranks make the same calls in the same order; see `GatheredView` for what is asked of all
    cells.

    Parameters
    ----------
    comm : communicator of all ranks
    physics, numerics, confinement
        See `Scene`.
    columns : see `Engine`

    Attributes
    ----------
    everyone : CellTable
        What every rank knows of all N cells.
    local : LocalEngine
        This rank's cells, and ghost cells near them.
    traffic : Traffic
        What this rank has sent.
    whole : bool
        See `Engine`.
    rebalance : int
        Steps between two looks at which rank should own which cell.
    """

    def __init__(
        self, comm: "Comm", physics: Physics, numerics: Numerics,
        confinement: Confinement | None, columns: Sequence[Column] = (),
    ) -> None:  # fmt: skip
        everyone = CellTable()
        own = replace(numerics, threads=numerics.threads or threads_per_rank(comm))
        local = LocalEngine(physics, own, confinement, columns, everyone, comm, self._share_fields)
        everyone.require(_shared(local, physics))
        super().__init__(comm, local, everyone)
        self.numerics, self.confinement = numerics, confinement
        self.whole, self.traffic, self.rebalance = True, Traffic(), REBALANCE
        self._found = np.zeros(5, np.int64)
        self._boxes = BoxDirectory(comm, self.traffic)
        self._exchange = GhostExchange(comm)
        self._stale = self._due = True

    def start(
        self, values: Mapping[str, Any], types: Sequence[str], rows: Integers, fields: Fields
    ) -> None:
        """Begin with these cells.

        Parameters
        ----------
        values : by column of the cell table, of all N cells
        types : of all N cells
        rows : (n,) numbers of the cells whose fields this rank brings
        fields : of these, lattice origin and start field
        """
        self.everyone.add(values, types)
        agreed(self.comm, lambda: self.local.begin(rows, fields))
        self._boxes.share(self.local, len(self))

    def __len__(self) -> int:
        return len(self.everyone)

    @property
    def physics(self) -> Physics:
        """The physics that hold now."""
        return self.local.physics

    @property
    def explicit_rate(self) -> float:
        """See `Engine`."""
        return self.local.explicit_rate

    @explicit_rate.setter
    def explicit_rate(self, rate: float) -> None:
        self.local.explicit_rate = rate

    @property
    def S(self) -> float:
        """See `Engine`."""
        return self.local.S

    @property
    def steps(self) -> int:
        """Steps taken."""
        return self.local.steps

    @property
    def ticks(self) -> int:
        """Ticks passed."""
        return self.local.ticks

    @property
    def time(self) -> float:
        """*In silico* time."""
        return self.local.time

    @property
    def targets(self) -> Callable[[float], None]:
        """See `Engine`."""
        return self.local.targets

    @targets.setter
    def targets(self, function: Callable[[float], None]) -> None:
        self.local.targets = function

    @property
    def dtype(self) -> np.dtype:
        """Type of the fields."""
        return self.local.dtype

    @property
    def workers(self) -> int:
        """Threads of this rank."""
        return self.local.workers

    @property
    def nbytes(self) -> int:
        """Bytes of this rank's arrays that grow with its cells."""
        return self.local.nbytes

    @property
    def owner(self) -> Integers:
        """(N,) rank of each cell."""
        return self._boxes.owner

    @contextmanager
    def limited_threads(self) -> Iterator[None]:
        """See `Engine`."""
        with self.local.limited_threads():
            yield

    def expect(self, cells: int) -> None:
        """See `Engine`; each rank has about the same share."""
        self.local.expect(-(-cells // self.comm.size))

    def settle(self) -> None:
        """See `Engine`; here the next step does it, when all ranks hold their ghost cells."""

    def step(self, most: int = MOST_TICKS) -> None:
        """See `Engine`.

        Raises
        ------
        StoppedError
            The step has failed on other ranks only, by an error of a force term for example.
        Exception
            What it has raised here.
        """
        self.whole = False
        self._kept.clear()
        if self.steps % self.rebalance == 0:
            self._stale = self._due = True
        if self._stale:
            self._settle()
        local, everyone, before = self.local, self.everyone, (self.steps, self.ticks)
        error: Exception | None = None
        try:
            local.step(most)
        except Exception as raised:
            if is_agreed(raised):  # no rank has taken the step
                self.whole = True
                raise
            error = raised
        everyone["fresh"][:] = False
        try:
            self._announce(error)
        except Exception:
            local.steps, local.ticks = before  # some ranks have taken the step, others have not
            self.change()
            raise
        self._share_fields()
        self.traffic.steps += 1
        self.whole = True

    def _share_fields(self) -> None:
        """Send the fields at the border to the ranks where they are felt."""
        self._exchange.run(self.traffic)

    @property
    def overdue(self) -> bool:
        """See `Engine`."""
        return self.local.overdue

    def diverged(self) -> Integers:
        """See `Engine`."""
        return self._cells_with(DIVERGED)

    def vanished(self) -> Integers:
        """See `Engine`."""
        return self._cells_with(VANISHED)

    def remove(self, rows: ArrayLike) -> None:
        """See `Engine`."""
        gone = np.atleast_1d(np.asarray(rows, np.int64))
        self.change()
        self.everyone.remove(gone)
        self.local.drop(gone)
        self._boxes.owner = np.delete(self._boxes.owner, gone)

    def divide(
        self, rows: ArrayLike, values: Mapping[str, Any], types: Sequence[str],
        halves: Sequence[CellField],
    ) -> None:  # fmt: skip
        """See `Engine`; daughters belong to their mother's rank."""
        self.change()
        mothers = np.atleast_1d(np.asarray(rows, np.int64))
        owner = self._boxes.owner[mothers]
        born = self.everyone.select(self.everyone.divide(mothers, values, types))
        kept = np.delete(self._boxes.owner, mothers)
        self._boxes.owner = np.concatenate([kept, np.repeat(owner, 2)])
        self.local.split(mothers, owner == self.comm.rank, born, halves)

    def set_physics(self, physics: Physics) -> None:
        """See `Engine`."""
        self.everyone.require(_shared(self.local, physics))
        agreed(self.comm, lambda: self.local.set_physics(physics))
        self.restart()

    def stabilise(self, rate: float) -> None:
        """See `Engine`."""
        self.local.stabilise(rate)
        self.change()

    def restart(self, rows: ArrayLike | None = None) -> None:
        """See `Engine`."""
        self.change()
        chosen = np.arange(len(self)) if rows is None else np.asarray(rows, np.int64)
        self.everyone["fresh"][chosen] = True
        self.local.pool.forget(np.flatnonzero(np.isin(self.local.rows, chosen)).tolist())

    def restore(
        self, contents: Mapping[str, NDArray], physics: Physics, steps: int, ticks: int
    ) -> None:
        """See `Engine`; every rank takes its share of the state."""
        self.change()
        self.everyone.require(_shared(self.local, physics))
        self.everyone.restore(contents)
        self.local.adopt(physics, steps, ticks)
        self.local.solver.restore(contents)
        self._boxes.owner = self._best_owners(contents["origin"], contents["shape"])
        rows = np.flatnonzero(self._boxes.owner == self.comm.rank)
        own = np.ones(len(rows), bool)
        self.local.hold(rows, own, contents["origin"][rows], contents["shape"][rows])
        self.local.take(state_transfer.select(contents, rows))

    def change(self) -> None:
        """See `Engine`; the next step begins with `_settle`."""
        self._kept.clear()
        self.local.change()
        self._stale = True
        self._found[:] = 0

    def _best_owners(self, origin: Integers, shape: Integers) -> Integers:
        return owners(origin + shape / 2, work(shape, self.everyone["frozen"]), self.comm.size)

    def _settle(self) -> None:
        """Bring cells to the ranks that should own them, ghost cells to where they are felt."""
        places = self._boxes
        places.share(self.local, len(self))
        if self._due or len(np.unique(places.owner)) < self.comm.size:
            self._migrate(self._best_owners(places.origin, places.shape))
        self._lay()
        self._exchange.run(self.traffic)
        self._stale = self._due = False

    def _migrate(self, owner: Integers) -> None:
        """Give all cells to these ranks (N,)."""
        comm, local, places = self.comm, self.local, self._boxes
        mine = local.rows[local.own]
        leaving = {to: mine[owner[mine] == to] for to in np.unique(owner[mine]).tolist()}
        arrived = []
        for shift in range(1, comm.size):
            cells = leaving.get((comm.rank + shift) % comm.size, ())
            part = local.part(cells) if len(cells) else None
            source = (comm.rank - shift) % comm.size
            arrived.append(comm.sendrecv(part, (comm.rank + shift) % comm.size, source=source))
            self.traffic.notices += sum(value.nbytes for value in (part or {}).values())
        rows = np.flatnonzero(owner == comm.rank)
        local.hold(rows, np.ones(len(rows), bool), places.origin[rows], places.shape[rows])
        for part in arrived:
            if part is not None:
                local.take(part)
        places.owner = owner

    def _lay(self) -> None:
        """Hold ghost cells that are near now; the next exchange fills the new ones."""
        places, rank = self._boxes, self.comm.rank
        sends, gets = portions(places.origin, places.shape, places.owner, rank)
        mine = np.flatnonzero(places.owner == rank)
        parts = list(gets.values())
        rows = np.concatenate([mine, *(part.cells for part in parts)])
        origin = np.concatenate([places.origin[mine], *(part.low for part in parts)])
        shape = np.concatenate([places.shape[mine], *(part.shape for part in parts)])
        order = np.argsort(rows)
        local = self.local
        local.hold(rows[order], order < len(mine), origin[order], shape[order])
        self._exchange.plan(local.pool, local.rows, sends, gets)

    def _announce(self, error: Exception | None) -> None:
        """Tell all ranks which boxes have moved, and whether cells have diverged or vanished.

        If the step has failed on any rank, all raise an error.
        """
        local, begin = self.local, time.perf_counter()
        surveys, moved = local.pool.surveys[local.own], local.moved
        mine = np.array([
            len(moved), (surveys[:, BAD] > 0).sum(), (surveys[:, CORE] == 0).sum(),
            error is not None, error is None or not local.whole,
        ])  # fmt: skip
        counts = np.zeros((self.comm.size, len(mine)), np.int64)
        self.comm.Allgather(mine, counts)
        self._found = counts.sum(axis=0)
        self.traffic.notices += mine.nbytes
        self.traffic.seconds += time.perf_counter() - begin
        if self._found[FAILED]:
            self.whole = not self._found[TOUCHED]
            raise_agreed(self.comm, error)
        if self._found[MOVED]:
            told = self._boxes.update(local, moved, counts[:, MOVED].copy())
            if self._concerned(told):
                self._lay()

    def _concerned(self, moved: Integers) -> bool:
        """Whether any of these boxes is held here, or has come near."""
        if np.isin(moved, self.local.rows).any():
            return True
        places, mine = self._boxes, self.local.rows[self.local.own]
        both = np.concatenate([mine, moved])
        reach = Reach.of(places.origin[both], places.shape[both])
        met, _ = reach.pairs(np.arange(len(mine)), np.arange(len(mine), len(both)))
        return len(met) > 0

    def _cells_with(self, what: int) -> Integers:
        """Numbers of the cells that have diverged or vanished in the last step."""
        if not self._found[what]:
            return np.zeros(0, np.int64)
        local = self.local
        surveys = local.pool.surveys[local.own]
        here = surveys[:, BAD] > 0 if what == DIVERGED else surveys[:, CORE] == 0
        lists = self.comm.allgather(local.rows[local.own][here])
        return np.sort(np.concatenate(lists))


def _shared(local: LocalEngine, physics: Physics) -> list[Column]:
    """Columns that every rank knows of all cells."""
    return [column for column in local.columns_with(physics) if column.shared]
