"""A ball."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from morphosim import _validate
from morphosim.geometry.shapes.protocol import Floats


@dataclass(frozen=True, slots=True, kw_only=True)
class Sphere:
    """Ball of radius `radius` about `center`.

    It states ∫ φ, as a target volume does. The tails of φ reach beyond the surface φ = 1/2, which
    therefore lies a little deeper: at 4.84 µm for a radius of 5 µm and c = 2.
    """

    center: ArrayLike
    radius: float

    def __post_init__(self) -> None:
        _validate.vector("shape.center", self.center)
        _validate.number("shape.radius", self.radius, above=0)

    @property
    def exact(self) -> bool:
        """False: a target volume near its own takes its place."""
        return False

    @property
    def volume(self) -> float:
        """Volume in µm³."""
        return 4 / 3 * np.pi * self.radius**3

    def depth(self, x: Floats, y: Floats, z: Floats) -> Floats:
        """Distance to the surface, positive inside."""
        ox, oy, oz = np.asarray(self.center, float)
        return np.asarray(self.radius - np.sqrt((x - ox) ** 2 + (y - oy) ** 2 + (z - oz) ** 2))

    def bounds(self) -> tuple[Floats, Floats]:
        """See `Shape`."""
        center = np.asarray(self.center, float)
        return center - self.radius, center + self.radius
