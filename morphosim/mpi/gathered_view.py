"""What is asked of all cells, gathered from the ranks that have it."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, cast, overload

import numpy as np
from numpy.typing import NDArray

from morphosim import _validate
from morphosim.cell_field import CellField
from morphosim.cell_table import CellTable
from morphosim.engine import box_pool
from morphosim.engine.box_pool import BoxPool
from morphosim.engine.cell_view import PoolFields
from morphosim.kernels.boxes import CORE, TOTAL
from morphosim.measure.measurement import Measurement, centroids, measure
from morphosim.mpi import state_transfer
from morphosim.mpi.local_engine import LocalEngine

if TYPE_CHECKING:
    from mpi4py.MPI import Comm


class GatheredView:
    """Figures and fields of all cells, gathered when they are asked for.

    By default all ranks ask, and all get them. Within `alone` rank 0 asks and gets, while the
    others are in `serve`.

    Parameters
    ----------
    comm : communicator of all ranks
    local : LocalEngine
    everyone : CellTable
        What every rank knows of all cells.
    """

    def __init__(self, comm: "Comm", local: LocalEngine, everyone: CellTable) -> None:
        self.comm, self.local, self.everyone = comm, local, everyone
        self._alone = False
        self._kept: dict[str, Any] = {}

    @property
    def _volume(self) -> float:
        return float(self.local.numerics.spacing**3)

    @property
    def volumes(self) -> NDArray[np.float64]:
        """∫ φ of each cell, µm³."""
        return np.asarray(self._table["surveys"][:, TOTAL] * self._volume)

    @property
    def core_volumes(self) -> NDArray[np.float64]:
        """Volume where φ exceeds 1/2, of each cell, µm³."""
        return np.asarray(self._table["surveys"][:, CORE] * self._volume)

    @property
    def lost_volume(self) -> NDArray[np.float64]:
        """See `Engine`."""
        return np.asarray(self._table["lost"] * self._volume)

    @property
    def face_peak(self) -> NDArray[np.float64]:
        """See `Engine`."""
        return np.asarray(self._table["face_peak"])

    @property
    def centroids(self) -> NDArray[np.float64]:
        """(N, 3) centroids of all cells, µm."""
        return np.asarray(self._gathered("gather_centroids"))

    @property
    def pool(self) -> BoxPool:
        """Copy of all fields."""
        return cast(BoxPool, self._gathered("gather_state")[1])

    @property
    def _table(self) -> dict[str, NDArray]:
        return cast(dict[str, NDArray], self._gathered("gather_table"))

    def contents(self, lasting: bool = True) -> dict[str, Any]:
        """See `Engine`: of all cells, and copies in any case."""
        state: dict[str, NDArray] = self._gathered("gather_state")[0]
        return self.everyone.saved() | state | self.local.solver.contents()

    @property
    def fields(self) -> Sequence[CellField]:
        """Copies of the cells' fields, fetched from their ranks when they are looked at."""
        return _Fields(self)

    def column(self, name: str) -> NDArray[Any]:
        """See `Engine`: of all cells."""
        _validate.choice("column", name, self.local.cells.columns)
        values = self.everyone[name] if name in self.everyone else self._table[name]
        return np.asarray(values)

    def measured(self) -> Measurement:
        """See `Engine`: of all cells, on this rank's threads."""
        pool = self.pool
        with self.local.limited_threads():
            return measure(pool.phi, pool.stored, self.local.numerics.spacing)

    @property
    def owner(self) -> NDArray[np.int64]:
        """(N,) rank of each cell."""
        raise NotImplementedError

    def field(self, i: int) -> CellField:
        """Copy of one cell's field, on all ranks."""
        name = self.everyone["name"][i]
        if self._alone:
            return CellField(name, self.pool.origin[i], self.pool.box(i))
        owner = int(self.owner[i])
        sent = None
        if owner == self.comm.rank:
            place = int(np.searchsorted(self.local.rows, i))
            sent = self.local.pool.origin[place], self.local.pool.box(place).copy()
        origin, phi = self.comm.bcast(sent, owner)
        return CellField(name, origin, phi)

    @contextmanager
    def alone(self) -> Iterator[None]:
        """On rank 0: go on alone; what is asked for then, the others give from `serve`."""
        self._alone = True
        before = dict(self._kept)
        try:
            yield
        finally:
            self._alone = False
            self._kept = before
            self.comm.bcast(None)

    def serve(self) -> None:
        """On the other ranks: give rank 0 what it asks for, until it leaves `alone`."""
        while (what := self.comm.bcast(None)) is not None:
            getattr(self, what)(everyone=False)

    def gather_table(self, everyone: bool) -> dict[str, NDArray] | None:
        """What ranks know of their cells alone."""
        local, own = self.local, self.local.owned
        columns = [c for c in local.cells.columns.values() if not c.shared]
        values = local.cells.select(own, [column.name for column in columns])
        part = {"rows": local.rows[own]} | state_transfer.sendable(values)
        parts = state_transfer.gather(self.comm, part, everyone)
        if parts is None:
            return None
        table = _in_order(parts)
        return {c.name: table[c.name].astype(c.dtype, copy=False) for c in columns}

    def gather_centroids(self, everyone: bool) -> NDArray[np.float64] | None:
        """Centroids of all cells."""
        pool, own = self.local.pool, self.local.owned
        found = np.zeros((0, 3))
        if len(own):
            found = centroids(pool.phi, pool.stored_of(own), self.local.numerics.spacing)
        part = {"rows": self.local.rows[own], "centroids": found}
        parts = state_transfer.gather(self.comm, part, everyone)
        return None if parts is None else _in_order(parts)["centroids"]

    def gather_state(self, everyone: bool) -> tuple[dict[str, NDArray], BoxPool] | None:
        """State of all cells, and a pool that holds it."""
        rows = self.local.rows[self.local.own]
        part = self.local.part(rows) if len(rows) else {"rows": rows}
        parts = state_transfer.gather(self.comm, part, everyone)
        if parts is None:
            return None
        state, like = state_transfer.merge(parts), self.local.pool
        del parts, part
        cells, none = CellTable(box_pool.COLUMNS), np.zeros(0, np.int64)
        cells.arrange(none, none, len(state["origin"]))
        cells.fill({c.name: state[c.name] for c in box_pool.COLUMNS if c.saved})
        pool = BoxPool(cells, like.dtype, like.limits, like.memory, like.band_only)
        pool.restore(state)
        return state, pool

    def _gathered(self, what: str) -> Any:
        """What one of the functions above gives, kept until the state changes."""
        if what not in self._kept:
            if self._alone:
                self.comm.bcast(what)
            self._kept[what] = getattr(self, what)(everyone=not self._alone)
        return self._kept[what]


class _Fields(Sequence[CellField]):
    """Fields of all cells: one is fetched alone, to look at all gathers all."""

    def __init__(self, view: GatheredView) -> None:
        self._view = view

    def __len__(self) -> int:
        return len(self._view.everyone)

    @overload
    def __getitem__(self, i: int) -> CellField: ...
    @overload
    def __getitem__(self, i: slice) -> Sequence[CellField]: ...
    def __getitem__(self, i: int | slice) -> CellField | Sequence[CellField]:
        if isinstance(i, slice):
            return list(self)[i]
        return self._view.field(range(len(self))[i])

    def __iter__(self) -> Iterator[CellField]:
        return iter(PoolFields(self._view.pool, self._view.everyone.names))


def _in_order(parts: Sequence[state_transfer.State]) -> dict[str, NDArray]:
    """Arrays with a row per cell, put together in the order of the cells."""
    order = np.argsort(np.concatenate([part["rows"] for part in parts]))
    return {name: np.concatenate([part[name] for part in parts])[order] for name in parts[0]}
