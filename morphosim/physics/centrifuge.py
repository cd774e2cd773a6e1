"""A centrifuge: a force away from an axis, which grows with the distance."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from morphosim import _validate
from morphosim._shown import short_repr
from morphosim.physics.by_type import ByType
from morphosim.physics.steady_drift import too_fast
from morphosim.physics.term import Concern, Conditions, Environment
from morphosim.physics.term_by_type import TermByType

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Centrifuge(TermByType):
    """ψ = k r²/2, r the distance to an axis: a small cell moves outwards with the velocity k r/τ.

    Attributes
    ----------
    strength : float
        k, the centrifugal weight per distance (ω² times density less that of the medium), [F];
        negative for cells that gather at the axis.
    strength_by_type : mapping from cell type to float
        k of cells of these types, instead of `strength`.
    axis : (3,)
        Along the axis; its length is of no account.
    center : (3,) µm
        A point of the axis.
    """

    strength: float = 0.0
    strength_by_type: Mapping[str, float] = field(default_factory=dict)
    axis: ArrayLike = (0.0, 0.0, 1.0)
    center: ArrayLike = (0.0, 0.0, 0.0)

    drifts = False
    label = "centrifuge"

    __repr__ = short_repr

    def __post_init__(self) -> None:
        self.strengths.validate()
        _validate.direction("centrifuge.axis", self.axis)
        _validate.vector("centrifuge.center", self.center)

    @property
    def strengths(self) -> ByType:
        """k, by type."""
        return ByType("centrifuge.strength", self.strength, self.strength_by_type)

    def surround(self, environment: Environment) -> None:
        """Add ψ."""
        environment.add_potential(self, self._half_square, strength=self.strengths)

    def _half_square(self, x: Floats, y: Floats, z: Floats) -> Floats:
        """Half the square of the distance to the axis, µm²."""
        axis = _validate.direction("centrifuge.axis", self.axis)
        offsets = [p - o for p, o in zip((x, y, z), np.asarray(self.center, float), strict=True)]
        along = sum(d * a for d, a in zip(offsets, axis, strict=True))
        return np.asarray((sum(d * d for d in offsets) - along**2) / 2)

    def concern(self, conditions: Conditions) -> Concern | None:
        """Cells far from the axis, where walls say how far they come."""
        if conditions.confinement is None:
            return None
        corners = np.array(conditions.confinement.bounds())
        x, y, z = np.meshgrid(*corners.T, indexing="ij")
        farthest = float(np.sqrt(2 * self._half_square(x, y, z).max()))
        strength = self.strengths.largest(conditions.types)
        what = f"centrifuge.strength = {strength:g} at {farthest:.3g} µm from the axis"
        return too_fast(what, strength * farthest, conditions)
