"""Repulsion between cells (Eq. 3)."""

from dataclasses import dataclass

from morphosim import _validate
from morphosim.physics.term import Conditions, Environment, Term


@dataclass(frozen=True, slots=True, kw_only=True)
class Repulsion(Term):
    """- g φ_i Σ_j φ_j², j other cells (Eq. 3).

    Attributes
    ----------
    g : float
        Strength.
    """

    g: float

    drifts = False
    label = "cells"

    def __post_init__(self) -> None:
        _validate.number("physics.g", self.g, least=0)

    @property
    def present(self) -> bool:
        """Whether cells repel."""
        return self.g > 0

    def surround(self, environment: Environment) -> None:
        """Add Σ g φ² to R."""
        environment.g += self.g

    def explicit_rate(self, conditions: Conditions) -> float:
        """g, where another cell is 1; of what linearising leaves, no more than the double well."""
        if not conditions.several:
            return 0.0
        well = 4 * float(conditions.tensions.max()) * conditions.interface_scale**2
        return min(self.g, well) if conditions.linearised else self.g
