"""Adhesion of cells to the confinement: walls attract as a neighbour would that fills them.

- ∇φ·∇ψ with ψ = σ_wall φ_w leaves a cell at rest where E = ∫ w (γ/2 |∇φ|² + γ c φ² (1 - φ)² +
R φ²/2), w = exp(-ψ/γ), is least at its volume, as γ ∇·(w ∇φ) / w = γΔφ - ∇φ·∇ψ. Of a cell that is
large against its interface this makes Young's law: with the tension T of the face on the wall, E
per area of the profile across it, and T_0 = γ √(c/2) / 3 of the free surface, the contact angle is
that of cos θ = - T/T_0. From 180° it falls towards 90° as σ_wall rises: T > 0.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from morphosim._shown import short_repr
from morphosim.geometry.confinement.protocol import wall_profile
from morphosim.physics.attraction import STRONGEST
from morphosim.physics.by_type import ByType
from morphosim.physics.confinement_repulsion import distance
from morphosim.physics.term import Concern, Conditions, Environment
from morphosim.physics.term_by_type import TermByType

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class WallAdhesion(TermByType):
    """- ∇φ·∇ψ with ψ = σ_wall φ_w, φ_w = (1 - tanh(√(c/2) d)) / 2, d the depth below the wall.

    φ_w is the field of a cell that fills all outside of the confinement, so that walls pull on a
    cell as another cell does by σ (Eq. 4).

    Attributes
    ----------
    sigma : float
        σ_wall, [F] µm².
    sigma_by_type : mapping from cell type to float
        σ_wall of cells of these types, instead of `sigma`.
    """

    sigma: float = 0.0
    sigma_by_type: Mapping[str, float] = field(default_factory=dict)

    drifts = False
    label = "wall adhesion"

    __repr__ = short_repr

    def __post_init__(self) -> None:
        self.strengths.validate(least=0)

    @property
    def strengths(self) -> ByType:
        """σ_wall, by type."""
        return ByType("wall_adhesion.sigma", self.sigma, self.sigma_by_type)

    def surround(self, environment: Environment) -> None:
        """Add ψ; ValueError in open space."""
        walls, scale = environment.confinement, environment.interface_scale
        if walls is None:
            message = (
                "wall_adhesion: there are no walls to adhere to; give the scene a confinement, or "
                "leave the term out"
            )
            raise ValueError(message)
        step = 0.5 * environment.numerics.spacing

        def field_of_walls(x: Floats, y: Floats, z: Floats) -> Floats:
            return wall_profile(distance(walls, x, y, z, step), 1 / scale)

        environment.add_potential(
            self, field_of_walls, walls, scale, step, strength=self.strengths, local=True
        )

    def explicit_rate(self, conditions: Conditions) -> float:
        """σ k |∇φ_w| at k = √(2c): of account when linearised, where no more is."""
        if not conditions.linearised:
            return 0.0
        return self.strengths.largest(conditions.types) * conditions.interface_scale**2

    def concern(self, conditions: Conditions) -> Concern | None:
        """Cells that walls tear apart."""
        strongest = self.strengths.largest(conditions.types)
        softest = float(conditions.tensions.min())
        limit = STRONGEST["long" if conditions.numerics.dt > 1 else "short"]
        if strongest <= limit * softest:
            return None
        return Concern(
            strongest / (limit * softest),
            f"wall_adhesion.sigma = {strongest:g} is more than {limit:g} times the surface tension "
            f"{softest:g}: walls may tear cells apart. Take a weaker sigma or a larger gamma",
        )
