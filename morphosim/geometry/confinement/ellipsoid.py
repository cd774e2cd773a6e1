"""An ellipsoid, flattened or hollow or not: an eggshell (Supplementary Note 1.4)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from morphosim import _validate
from morphosim.geometry.confinement.protocol import Floats, wall_profile


@dataclass(frozen=True, slots=True, kw_only=True)
class EllipsoidShell:
    """Ellipsoid along the axes, flattened where `cut` says: the eggshell (Note 1.4).

    With a `core`, cells live in the layer between the two.

    Attributes
    ----------
    center, semi_axes : (3,) µm
    cut : (3,) µm
        Half-widths about the centre beyond which the inside is cut off; inf cuts nothing.
    width : float, µm
        Width of the wall's tanh profile; 0 is a hard wall.
    core : (3,) µm, optional
        Semi-axes of an ellipsoid about the same centre that no cell enters, such as a yolk.
    """

    center: ArrayLike
    semi_axes: ArrayLike
    cut: ArrayLike = (np.inf, np.inf, np.inf)
    width: float = 0.0
    core: ArrayLike | None = None

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
        if self.core is not None:
            core = _validate.vector("confinement.core", self.core)
            if not ((core > 0) & (core < np.minimum(self.semi_axes, cut))).all():
                message = (
                    f"confinement.core = {_validate.brief(self.core)}: expected semi-axes > 0 that "
                    f"leave a layer within {_validate.brief(self.semi_axes)}"
                )
                raise ValueError(message)

    def depth(self, x: Floats, y: Floats, z: Floats) -> Floats:
        """Depth a (1 - √Σ (x_k - o_k)² / a_k²), a the longest semi-axis, less what is left out."""
        offsets = [p - o for p, o in zip((x, y, z), np.asarray(self.center), strict=True)]
        depth = _below(offsets, self.semi_axes)
        if self.core is not None:
            depth = np.minimum(depth, -_below(offsets, self.core))
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


def _below(offsets: list[Floats], semi_axes: ArrayLike) -> Floats:
    """Depth below the surface of an ellipsoid, at places as seen from its centre."""
    axes = np.asarray(semi_axes, dtype=np.float64)
    squares = sum((d / a) ** 2 for d, a in zip(offsets, axes, strict=True))
    return np.asarray(axes.max() * (1 - np.sqrt(squares)))
