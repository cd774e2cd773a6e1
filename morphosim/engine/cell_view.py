"""What may be asked of the cells of an engine; see `mpi.gathered_view` for that of all ranks."""

from collections.abc import Sequence
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray

from morphosim import _validate
from morphosim.cell_field import CellField
from morphosim.cell_table import CellTable
from morphosim.engine.box_pool import BoxPool
from morphosim.kernels.boxes import CORE, TOTAL
from morphosim.measure.measurement import centroids
from morphosim.numerics.parameters import Numerics


class PoolFields(Sequence[CellField]):
    """Fields of a pool's cells, each made when it is asked for.

    Parameters
    ----------
    pool : BoxPool
    names : of its cells
    """

    def __init__(self, pool: BoxPool, names: Sequence[str]) -> None:
        self._pool, self._names = pool, names

    def __len__(self) -> int:
        return len(self._names)

    @overload
    def __getitem__(self, i: int) -> CellField: ...
    @overload
    def __getitem__(self, i: slice) -> Sequence[CellField]: ...
    def __getitem__(self, i: int | slice) -> CellField | Sequence[CellField]:
        rows = range(len(self))[i]
        if isinstance(rows, range):
            return [self[k] for k in rows]
        return CellField(self._names[rows], self._pool.origin[rows], self._pool.box(rows))


class CellView:
    """Figures and fields of N cells.

    Attributes
    ----------
    cells : CellTable
    pool : BoxPool
    numerics : Numerics
    """

    cells: CellTable
    pool: BoxPool
    numerics: Numerics

    @property
    def volumes(self) -> NDArray[np.float64]:
        """∫ φ of each cell, µm³."""
        return np.asarray(self.pool.surveys[:, TOTAL] * self.numerics.spacing**3)

    @property
    def core_volumes(self) -> NDArray[np.float64]:
        """Volume where φ exceeds 1/2, of each cell, µm³."""
        return np.asarray(self.pool.surveys[:, CORE] * self.numerics.spacing**3)

    @property
    def face_peak(self) -> NDArray[np.float64]:
        """Certificate: largest |φ| seen on the faces of each cell's box, or edge of its band."""
        return self.cells["face_peak"]

    @property
    def lost_volume(self) -> NDArray[np.float64]:
        """Certificate: ∫ φ that boxes and bands have cut off each cell since the start, µm³."""
        return np.asarray(self.pool.lost * self.numerics.spacing**3)

    @property
    def centroids(self) -> NDArray[np.float64]:
        """(N, 3) centroids ∫ r φ / ∫ φ, µm; in periodic space they go on beyond its faces."""
        pool = self.pool
        return centroids(pool.phi, pool.stored, self.numerics.spacing, pool.path)

    @property
    def fields(self) -> Sequence[CellField]:
        """The cells' fields, each made when it is asked for; valid until the next step."""
        return PoolFields(self.pool, self.cells.names)

    def field(self, row: int) -> CellField:
        """Field of one cell, valid until the next step."""
        return CellField(self.cells["name"][row], self.pool.origin[row], self.pool.box(row))

    def column(self, name: str) -> NDArray[Any]:
        """(N, …) values of a column of the cell table."""
        _validate.choice("column", name, self.cells.columns)
        return self.cells[name]
