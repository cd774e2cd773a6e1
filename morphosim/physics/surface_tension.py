"""Surface tension γ and double well c (Eq. 1): what keeps the interface and rounds cells up."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from morphosim import _validate
from morphosim.cell_table import CellTable, Column
from morphosim.numerics.parameters import Numerics
from morphosim.physics.term import Conditions, Term


@dataclass(frozen=True, slots=True, kw_only=True)
class SurfaceTension(Term):
    """γ Δφ - γ c W'(φ), W' = 4φ³ - 6φ² + 2φ (Eq. 1).

    γ Δφ is what the solvers take implicitly; γ c W' is part of every cell's force.

    Attributes
    ----------
    gamma : float
        Surface tension γ; a cell may have its own, in the column "own_tension". The column
        "tension" has that of each cell.
    c : float
        Strength of the double well, 1/µm². The interface is φ = (1 + tanh(√(c/2) d)) / 2 with d
        the depth in µm.
    """

    gamma: float
    c: float

    columns = (
        Column("own_tension", default=np.nan, shared=True),
        Column("tension", saved=False),
    )
    drifts = False
    label = "double well"

    def __post_init__(self) -> None:
        _validate.number("physics.gamma", self.gamma, above=0)
        _validate.number("physics.c", self.c, above=0)

    def tensions(self, cells: CellTable) -> NDArray[np.float64]:
        """(N,) γ of each cell: its own, or that of the physics."""
        own = cells["own_tension"]
        return np.where(np.isnan(own), self.gamma, own)

    def prepare(self, cells: CellTable, numerics: Numerics) -> None:
        """Set the tension of each cell."""
        cells["tension"][:] = self.tensions(cells)

    def explicit_rate(self, conditions: Conditions) -> float:
        """2 γ c: the double well at φ = 0 and 1."""
        if conditions.linearised:
            return 0.0
        return float(2 * conditions.tensions.max() * self.c)
