"""An ellipsoid, flattened or not: the eggshell (Supplementary Note 1.4)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from morphosim import _validate
from morphosim.geometry.confinement.protocol import Floats, wall_profile


@dataclass(frozen=True, slots=True, kw_only=True)
class EllipsoidShell:
    """Ellipsoid along the axes, flattened where `cut` says: the eggshell (Note 1.4).

    Attributes
    ----------
    center, semi_axes : (3,) µm
    cut : (3,) µm
        Half-widths about the centre beyond which the inside is cut off; inf cuts nothing.
    width : float, µm
        Width of the wall's tanh profile; 0 is a hard wall.
    """

    center: ArrayLike
    semi_axes: ArrayLike
    cut: ArrayLike = (np.inf, np.inf, np.inf)
    width: float = 0.0

    def __post_init__(self) -> None:
        _validate.vector("confinement.center", self.center)
        for axis, value in zip("xyz", _validate.vector("semi_axes", self.semi_axes), strict=True):
            _validate.number(f"confinement.semi_axes ({axis})", value, above=0)
        cut = _validate.array("confinement.cut", self.cut, (3,), infinite=True)
        if not (cut > _validate.SMALLEST).all():
            message = (
                f"confinement.cut = {_validate.brief(self.cut)}: expected three half-widths > 0"
            )
            raise ValueError(f"{message} (inf: none)")
        _validate.number("confinement.width", self.width, least=0)

    def depth(self, x: Floats, y: Floats, z: Floats) -> Floats:
        """Depth a (1 - √Σ (x_k - o_k)² / a_k²), a the longest semi-axis, less what is cut off."""
        offsets = [p - o for p, o in zip((x, y, z), np.asarray(self.center), strict=True)]
        axes = np.asarray(self.semi_axes, dtype=np.float64)
        squares = sum((d / a) ** 2 for d, a in zip(offsets, axes, strict=True))
        depth = axes.max() * (1 - np.sqrt(squares))
        for d, half_width in zip(offsets, np.asarray(self.cut), strict=True):
            if np.isfinite(half_width):
                depth = np.minimum(depth, half_width - np.abs(d))
        return np.asarray(depth)

    def field(self, x: Floats, y: Floats, z: Floats) -> Floats:
        """φ_e, see `Confinement`."""
        return wall_profile(self.depth(x, y, z), self.width)

    def bounds(self) -> tuple[Floats, Floats]:
        """See `Confinement`."""
        center = np.asarray(self.center, dtype=np.float64)
        half = np.minimum(np.asarray(self.semi_axes, float), np.asarray(self.cut, float))
        return center - half, center + half
