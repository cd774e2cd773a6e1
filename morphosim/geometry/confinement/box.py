"""A box of six plane walls."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from morphosim import _validate
from morphosim.geometry.confinement.protocol import Floats, check_corners, wall_profile


@dataclass(frozen=True, slots=True, kw_only=True)
class BoxWalls:
    """Six plane walls, the faces of the box from `lower` to `upper` (µm)."""

    lower: ArrayLike
    upper: ArrayLike
    width: float = 0.0

    def __post_init__(self) -> None:
        check_corners(self.lower, self.upper)
        _validate.number("confinement.width", self.width, least=0)

    def depth(self, x: Floats, y: Floats, z: Floats) -> Floats:
        """Distance to the nearest wall, positive inside."""
        depth = np.asarray(np.inf)
        for p, low, high in zip(
            (x, y, z), np.asarray(self.lower), np.asarray(self.upper), strict=True
        ):
            depth = np.minimum(depth, np.minimum(p - low, high - p))
        return np.asarray(depth)

    def field(self, x: Floats, y: Floats, z: Floats) -> Floats:
        """φ_e, see `Confinement`."""
        return wall_profile(self.depth(x, y, z), self.width)

    def bounds(self) -> tuple[Floats, Floats]:
        """See `Confinement`."""
        return np.asarray(self.lower, float), np.asarray(self.upper, float)
