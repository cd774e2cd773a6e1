"""The engine of a simulation whose cells are shared out over ranks."""

import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from morphosim.cell_field import CellField
from morphosim.geometry.confinement import Confinement
from morphosim.kernels.boxes import BAD, CORE
from morphosim.mpi import state_transfer as states
from morphosim.mpi.box_directory import Places
from morphosim.mpi.communicator import threads_per_rank
from morphosim.mpi.decompose import owners, work
from morphosim.mpi.gathered_view import Gatherer
from morphosim.mpi.ghost_exchange import Exchange, Traffic
from morphosim.mpi.ghost_regions import Reach, portions
from morphosim.mpi.local_engine import RankEngine, Roll
from morphosim.numerics.parameters import Numerics
from morphosim.physics.parameters import Physics

if TYPE_CHECKING:
    from mpi4py.MPI import Comm

Integers = NDArray[np.int64]
REBALANCE = 256
"""Steps between two looks at which rank should own which cell."""
MOVED, DIVERGED, VANISHED = 0, 1, 2


class DistributedEngine(Gatherer):
    """As `Engine`, of all N cells, of which each rank steps its own.

    All ranks make the same calls in the same order; see `Gatherer` for what is asked of all cells.

    Parameters
    ----------
    comm : communicator of all ranks
    physics, numerics, confinement, names, types, gamma, frozen, parents
        See `Engine`; of all N cells.
    rows : (n,) numbers of the cells that this rank brings
    fields : of these, lattice origin and field

    Attributes
    ----------
    local : RankEngine
        This rank's cells, and copies of those near them.
    traffic : Traffic
        What this rank has sent.
    whole : bool
        See `Engine`.
    rebalance : int
        Steps between two looks at which rank should own which cell.
    """

    def __init__(
        self,
        comm: "Comm",
        physics: Physics,
        numerics: Numerics,
        confinement: Confinement | None,
        names: Sequence[str],
        types: Sequence[str],
        gamma: NDArray[np.float64],
        frozen: NDArray[np.bool_],
        parents: Sequence[str],
        rows: Integers,
        fields: Iterable[tuple[Integers, NDArray[np.floating]]],
    ) -> None:
        roll = Roll(
            list(names), list(types), list(parents), np.asarray(gamma, float),
            np.asarray(frozen, bool), np.arange(len(names), dtype=np.uint64),
        )  # fmt: skip
        own = replace(numerics, threads=numerics.threads or threads_per_rank(comm))
        super().__init__(comm, RankEngine(physics, own, confinement, roll, rows, fields), roll)
        self.numerics, self.confinement = numerics, confinement
        self.whole, self.traffic, self.rebalance = True, Traffic(), REBALANCE
        self._found = np.zeros(3, np.int64)
        self._places = Places(comm, self.traffic)
        self._exchange = Exchange(comm)
        self._places.share(self.local, len(names))
        self._stale = self._due = True
        self._changed = False

    def __len__(self) -> int:
        return len(self._roll.names)

    @property
    def names(self) -> list[str]:
        """Names of all cells."""
        return self._roll.names

    @names.setter
    def names(self, names: Sequence[str]) -> None:
        self._roll.names = list(names)

    @property
    def parents(self) -> list[str]:
        """Names of the mothers of all cells."""
        return self._roll.parents

    @parents.setter
    def parents(self, parents: Sequence[str]) -> None:
        self._roll.parents = list(parents)

    @property
    def types(self) -> list[str]:
        """Types of all cells."""
        return self._roll.types

    @property
    def physics(self) -> Physics:
        """The physics that hold now."""
        return self.local.physics

    @property
    def steps(self) -> int:
        """Steps taken."""
        return self.local.steps

    @property
    def fresh(self) -> bool:
        """Whether the next step is of first order."""
        return self.local.fresh

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
        return self._places.owner

    @contextmanager
    def limited_threads(self) -> Iterator[None]:
        """See `Engine`."""
        with self.local.limited_threads():
            yield

    def step(self, targets: NDArray[np.float64]) -> None:
        """See `Engine`; `targets` are those of all cells."""
        self.whole = False
        self._kept.clear()
        if self.steps % self.rebalance == 0:
            self._stale = self._due = True
        if self._stale:
            self._settle()
        self.local.pool.moved = np.zeros(0, np.int64)
        self.local.step(targets[self.local.rows])
        self._announce()
        self._exchange.run(self.traffic)
        self.traffic.steps += 1
        self.whole = True

    def diverged(self) -> Integers:
        """See `Engine`."""
        return self._cells_with(DIVERGED)

    def vanished(self) -> Integers:
        """See `Engine`."""
        return self._cells_with(VANISHED)

    def remove(self, i: int) -> None:
        """See `Engine`."""
        self._change()
        self._roll.remove(i)
        self.local.drop(i)
        self._places.owner = np.delete(self._places.owner, i)

    def divide(
        self, i: int, names: tuple[str, str], types: tuple[str, str], halves: Sequence[CellField]
    ) -> None:
        """See `Engine`; the daughters belong to the mother's rank."""
        self._change()
        before = self._places.owner
        owner = before[i]
        ids = np.arange(2, dtype=np.uint64) + np.uint64(self._next_id)
        self._roll.divide(i, names, types, ids)
        self._next_id += 2
        self.local.drop(i)
        self._places.owner = np.append(np.delete(before, i), [owner, owner])
        if owner == self.comm.rank:
            self.local.add(len(self) - 2, halves)
        self.local.forget()

    def describe(
        self, physics: Physics, types: Sequence[str], gamma: NDArray[np.float64],
        frozen: NDArray[np.bool_],
    ) -> None:  # fmt: skip
        """See `Engine`."""
        self.local.physics = physics
        self._roll.types = list(types)
        self._roll.gamma, self._roll.frozen = np.asarray(gamma, float), np.asarray(frozen, bool)

    def refresh(self) -> None:
        """See `Engine`."""
        self._change()

    def restart(self) -> None:
        """See `Engine`."""
        self._change()
        self.local.forget()

    def restore(self, state: Mapping[str, NDArray], steps: int, fresh: bool) -> None:
        """See `Engine`; every rank takes its share of the state."""
        self._change()
        self._roll.ids, self._next_id = np.array(state["ids"]), int(state["next_id"])
        self._places.owner = self._best_owners(state["origin"], state["shape"])
        rows = np.flatnonzero(self._places.owner == self.comm.rank)
        own = np.ones(len(rows), bool)
        self.local.own[:] = False  # nothing that is held stays
        self.local.hold(rows, own, state["origin"][rows], state["shape"][rows])
        self.local.take(states.select(state, rows) | {"rows": rows})
        self.local.steps, self.local.fresh = steps, fresh

    def _change(self) -> None:
        """Note that cells or parameters change; the next step begins with `_settle`."""
        self._kept.clear()
        self._stale = self._changed = True
        self._found[:] = 0

    def _best_owners(self, origin: Integers, shape: Integers) -> Integers:
        return owners(origin + shape / 2, work(shape, self._roll.frozen), self.comm.size)

    def _settle(self) -> None:
        """Bring cells to the ranks that should own them, and copies to where they are felt."""
        places = self._places
        places.share(self.local, len(self))
        if self._due or len(np.unique(places.owner)) < self.comm.size:
            self._migrate(self._best_owners(places.origin, places.shape))
        self._lay(anew=self._changed)
        self._exchange.run(self.traffic)
        self._stale = self._due = self._changed = False

    def _migrate(self, owner: Integers) -> None:
        """Give all cells to these ranks (N,)."""
        comm, local, places = self.comm, self.local, self._places
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

    def _lay(self, anew: bool) -> None:
        """Hold copies of the cells that are near now; the next exchange fills the new ones."""
        places, rank = self._places, self.comm.rank
        sends, gets = portions(places.origin, places.shape, places.owner, rank)
        mine = np.flatnonzero(places.owner == rank)
        parts = list(gets.values())
        rows = np.concatenate([mine, *(part.cells for part in parts)])
        origin = np.concatenate([places.origin[mine], *(part.low for part in parts)])
        shape = np.concatenate([places.shape[mine], *(part.shape for part in parts)])
        order = np.argsort(rows)
        local = self.local
        local.hold(rows[order], order < len(mine), origin[order], shape[order])
        if anew or not local.enrolled:
            local.enrol(anew)
        local.lay()
        self._exchange.plan(local.pool, local.rows, sends, gets)

    def _announce(self) -> None:
        """Tell all ranks which boxes have moved, and whether cells have diverged or vanished."""
        local, begin = self.local, time.perf_counter()
        surveys, moved = local.pool.surveys[local.own], local.pool.moved
        mine = np.array([len(moved), (surveys[:, BAD] > 0).sum(), (surveys[:, CORE] == 0).sum()])
        counts = np.zeros((self.comm.size, len(mine)), np.int64)
        self.comm.Allgather(mine, counts)
        self._found = counts.sum(axis=0)
        self.traffic.notices += mine.nbytes
        self.traffic.seconds += time.perf_counter() - begin
        if self._found[MOVED]:
            told = self._places.update(local, moved, counts[:, MOVED].copy())
            if self._concerned(told):
                self._lay(anew=False)

    def _concerned(self, moved: Integers) -> bool:
        """Whether any of these boxes is held here, or has come near."""
        if np.isin(moved, self.local.rows).any():
            return True
        places, mine = self._places, self.local.rows[self.local.own]
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
