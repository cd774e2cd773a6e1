"""The volume constraint (Eq. 2, 10): a pressure that brings cells to their target volume."""

from dataclasses import dataclass

import numpy as np

from morphosim import _validate
from morphosim.cell_table import CellTable
from morphosim.physics.term import Conditions, Forces, Step, Term

KINDS = ("relative", "absolute", "none")
DEFAULT_M = {"relative": 8.0, "absolute": 0.0016, "none": 0.0}
"""M' of Eq. 10, and M of Eq. 2 in 1/µm³."""


@dataclass(frozen=True, slots=True, kw_only=True)
class VolumeConstraint(Term):
    """p |∇φ| with p = M (1 - v/V) (Eq. 10, M is M' there) or M (V - v) (Eq. 2), v = ∫ φ.

    The target volume V(t) is the column "target" of the cell table, µm³.

    Attributes
    ----------
    kind : {"relative", "absolute", "none"}
    M : float, optional
        By default 8 (relative) or 0.0016 per µm³ (absolute).
    """

    kind: str
    M: float | None

    drifts = False
    label = "volume constraint"

    def __post_init__(self) -> None:
        _validate.choice("physics.volume_constraint", self.kind, KINDS)
        if self.M is not None:
            _validate.number("physics.M", self.M, least=0)

    @property
    def strength(self) -> float:
        """`M` or its default; 0 where the volume is not constrained."""
        default = DEFAULT_M[self.kind]
        return default if self.M is None or self.kind == "none" else self.M

    @property
    def present(self) -> bool:
        """Whether volumes are constrained."""
        return self.strength > 0

    def update(self, cells: CellTable, step: Step, forces: Forces) -> None:
        """Add the pressure."""
        if self.kind == "relative":
            forces.pressure[:] += self.strength * (1 - step.volumes / cells["target"])
            forces.stiffness[:] += self.strength / cells["target"]
        else:
            forces.pressure[:] += self.strength * (cells["target"] - step.volumes)
            forces.stiffness[:] += self.strength

    def whole_cell_rate(self, conditions: Conditions) -> float:
        """M' A / V or M A, A the surface, of the cell that is worst off, taken as a ball.

        A is that of what is there where that is more than V.
        """
        if conditions.linearised:
            return 0.0
        volumes = conditions.volumes
        largest = np.maximum(volumes, conditions.filled)
        rates = self.strength * (36 * np.pi * largest**2) ** (1 / 3)
        return float((rates / volumes if self.kind == "relative" else rates).max())
