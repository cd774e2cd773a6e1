"""Gravity: a force on all of a cell, by which it settles."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from morphosim import _validate
from morphosim._shown import short_repr
from morphosim.cell_table import CellTable
from morphosim.physics.by_type import ByType
from morphosim.physics.steady_drift import too_fast
from morphosim.physics.term import Concern, Conditions, Forces, Step
from morphosim.physics.term_by_type import TermByType


@dataclass(frozen=True, slots=True, kw_only=True)
class Gravity(TermByType):
    """d·∇φ with d = -w e: a free cell settles with the velocity w/τ along the unit vector e.

    The force is per volume, as the friction τ is, so large and small cells settle alike.

    Attributes
    ----------
    weight : float
        Weight w less buoyancy, [F] µm; negative for cells that rise.
    weight_by_type : mapping from cell type to float
        w of cells of these types, instead of `weight`.
    direction : (3,)
        Downwards; its length is of no account.
    """

    weight: float = 0.0
    weight_by_type: Mapping[str, float] = field(default_factory=dict)
    direction: ArrayLike = (0.0, 0.0, -1.0)

    label = "gravity"

    __repr__ = short_repr

    def __post_init__(self) -> None:
        self.strengths.validate()
        _validate.direction("gravity.direction", self.direction)

    @property
    def strengths(self) -> ByType:
        """w, by type."""
        return ByType("gravity.weight", self.weight, self.weight_by_type)

    def update(self, cells: CellTable, step: Step, forces: Forces) -> None:
        """Add the drift."""
        down = _validate.direction("gravity.direction", self.direction)
        forces.drift[:] -= np.outer(self.strengths.of_each(cells), down)

    def concern(self, conditions: Conditions) -> Concern | None:
        """Cells that settle too far in a step."""
        weight = self.strengths.largest(conditions.types)
        return too_fast(f"gravity.weight = {weight:g}", weight, conditions)
