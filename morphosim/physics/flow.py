"""A uniform flow of the medium, which carries all cells along."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from morphosim import _validate
from morphosim._shown import short_repr
from morphosim.cell_table import CellTable
from morphosim.physics.steady_drift import too_fast
from morphosim.physics.term import Concern, Conditions, Forces, Step, Term


@dataclass(frozen=True, slots=True, kw_only=True)
class Flow(Term):
    """d·∇φ with d = -τ u: friction is that against a medium which moves, τ (∂φ/∂t + u·∇φ) = F.

    A free cell moves with u. Walls stay where they are.

    Attributes
    ----------
    velocity : (3,)
        u, µm per time.
    """

    velocity: ArrayLike

    label = "flow"

    __repr__ = short_repr

    def __post_init__(self) -> None:
        _validate.vector("flow.velocity", self.velocity)

    @property
    def present(self) -> bool:
        """Whether anything flows."""
        return bool(np.any(self.velocity))

    def update(self, cells: CellTable, step: Step, forces: Forces) -> None:
        """Add the drift."""
        forces.drift[:] -= step.tau * np.asarray(self.velocity, np.float64)

    def concern(self, conditions: Conditions) -> Concern | None:
        """Cells that are carried too far in a step."""
        speed = float(np.linalg.norm(np.asarray(self.velocity, np.float64)))
        what = f"flow.velocity = {_validate.brief(self.velocity)}"
        return too_fast(what, speed * conditions.tau, conditions)
