"""What a scene needs to know of a confinement, and what confinements share."""

from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from morphosim import _validate

Floats = NDArray[np.float64]


class Confinement(Protocol):
    """What a scene needs to know of a confinement.

    One that also has an attribute `width` equal to 0 is a hard wall at depth 0: the lattice may
    place it better than point by point (`Numerics.walls`). Others are taken as `field` gives them.
    """

    def field(self, x: Floats, y: Floats, z: Floats) -> Floats:
        """φ_e at points in µm: 0 inside, 1 outside."""

    def depth(self, x: Floats, y: Floats, z: Floats) -> Floats:
        """Depth below the wall in µm, positive inside (near the wall a distance)."""

    def bounds(self) -> tuple[Floats, Floats]:
        """Lower and upper corner, in µm, of a box that holds the inside."""


def check_corners(lower: ArrayLike, upper: ArrayLike) -> None:
    """Raise ValueError unless two corners span a box."""
    low = _validate.vector("confinement.lower", lower)
    high = _validate.vector("confinement.upper", upper)
    if not (high > low).all():
        message = (
            f"confinement.upper = {_validate.brief(upper)} must exceed lower = "
            f"{_validate.brief(lower)}"
        )
        raise ValueError(message)


def wall_profile(depth: Floats, width: float) -> Floats:
    """(1 - tanh(depth / width)) / 2; a hard wall, 1 where depth <= 0, at zero width."""
    if width == 0:
        return np.asarray(depth <= 0, dtype=np.float64)
    return np.asarray(0.5 * (1 - np.tanh(depth / width)))
