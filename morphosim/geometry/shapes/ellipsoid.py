"""An ellipsoid."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from morphosim import _validate
from morphosim.geometry.shapes.protocol import Floats


@dataclass(frozen=True, slots=True, kw_only=True)
class Ellipsoid:
    """Ellipsoid along the axes; as with a `Sphere`, its volume is ∫ φ."""

    center: ArrayLike
    semi_axes: ArrayLike

    def __post_init__(self) -> None:
        _validate.vector("shape.center", self.center)
        for axis, value in zip("xyz", _validate.vector("semi_axes", self.semi_axes), strict=True):
            _validate.number(f"shape.semi_axes ({axis})", value, above=0)

    @property
    def exact(self) -> bool:
        """False: a target volume near its own takes its place."""
        return False

    @property
    def volume(self) -> float:
        """Volume in µm³."""
        return float(4 / 3 * np.pi * np.prod(np.asarray(self.semi_axes)))

    def depth(self, x: Floats, y: Floats, z: Floats) -> Floats:
        """Distance to first order: (1 - q) q / |∇q²/2| with q² = Σ (x_k - o_k)² / a_k²."""
        axes = np.asarray(self.semi_axes, float)
        d = [p - o for p, o in zip((x, y, z), np.asarray(self.center), strict=True)]
        q = np.sqrt(sum((u / a) ** 2 for u, a in zip(d, axes, strict=True)))
        slope = np.sqrt(sum((u / a**2) ** 2 for u, a in zip(d, axes, strict=True)))
        with np.errstate(invalid="ignore", divide="ignore"):
            depth = (1 - q) * q / slope
        return np.asarray(np.where(q < 1e-9, axes.min(), depth))

    def bounds(self) -> tuple[Floats, Floats]:
        """See `Shape`."""
        center, axes = np.asarray(self.center, float), np.asarray(self.semi_axes, float)
        return center - axes, center + axes
