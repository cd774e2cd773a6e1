"""Where all cells are and whose they are, as every rank knows it."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from morphosim.mpi.ghost_exchange import Traffic
from morphosim.mpi.local_engine import LocalEngine

if TYPE_CHECKING:
    from mpi4py.MPI import Comm

Integers = NDArray[np.int64]
COLUMNS = 7
"""Of what ranks tell of a cell: its number, and origin and shape of its box."""


class BoxDirectory:
    """Boxes and owners of all N cells.

    Attributes
    ----------
    owner : (N,) rank of each cell
    origin, shape : (N, 3) boxes
    """

    def __init__(self, comm: "Comm", traffic: Traffic) -> None:
        self._comm, self._traffic = comm, traffic
        self.owner = np.zeros(0, np.int64)
        self.origin = self.shape = np.zeros((0, 3), np.int64)

    def share(self, local: LocalEngine, count: int) -> None:
        """Tell all ranks of all cells of each."""
        mine = local.owned
        counts = np.zeros(self._comm.size, np.int64)
        self._comm.Allgather(np.array([len(mine)], np.int64), counts)
        self.owner = np.zeros(count, np.int64)
        self.origin = np.zeros((count, 3), np.int64)
        self.shape = np.zeros((count, 3), np.int64)
        cells = self.update(local, mine, counts)
        self.owner[cells] = np.repeat(np.arange(self._comm.size), counts)

    def update(self, local: LocalEngine, mine: Integers, counts: Integers) -> Integers:
        """Tell all ranks of some cells of each, at these places; return their numbers.

        `counts` (ranks,) says of how many each rank tells.
        """
        pool = local.pool
        told = np.column_stack([local.rows[mine], pool.origin[mine], pool.shape[mine]])
        rows = np.zeros((int(counts.sum()), COLUMNS), np.int64)
        self._comm.Allgatherv(np.ascontiguousarray(told), (rows, counts * COLUMNS))
        self._traffic.notices += told.nbytes
        cells = rows[:, 0]
        self.origin[cells], self.shape[cells] = rows[:, 1:4], rows[:, 4:]
        return cells
