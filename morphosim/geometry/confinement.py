"""Confinements: what φ_e is (Eq. 3). φ_e is 0 inside and 1 outside; None means open space.

Every confinement offers `field(x, y, z)`, the value of φ_e at points in µm (arrays that broadcast),
`depth(x, y, z)`, a length that is positive inside, and `bounds()`, the corners of a box around the
inside.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from morphosim import _validate
from morphosim.geometry.signed_distance import Image, depth_image

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


def _is_width(value: Any) -> bool:
    """Whether a value is a positive number; inf is one."""
    return isinstance(value, int | float | np.number) and bool(value > 0)


def _check_corners(lower: ArrayLike, upper: ArrayLike) -> None:
    """Raise ValueError unless two corners span a box."""
    low = _validate.vector("confinement.lower", lower)
    high = _validate.vector("confinement.upper", upper)
    if not (high > low).all():
        message = f"confinement.upper = {upper!r} must exceed lower = {lower!r}"
        raise ValueError(message)


def _profile(depth: Floats, width: float) -> Floats:
    """(1 - tanh(depth / width)) / 2; a hard wall, 1 where depth <= 0, at zero width."""
    if width == 0:
        return np.asarray(depth <= 0, dtype=np.float64)
    return np.asarray(0.5 * (1 - np.tanh(depth / width)))


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
        half_widths = np.ravel(np.asarray(self.cut, dtype=object))
        if len(half_widths) != 3 or not all(_is_width(w) for w in half_widths):
            message = f"confinement.cut = {self.cut!r}: expected three half-widths > 0 (inf: none)"
            raise ValueError(message)
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
        return _profile(self.depth(x, y, z), self.width)

    def bounds(self) -> tuple[Floats, Floats]:
        """See `Confinement`."""
        center = np.asarray(self.center, dtype=np.float64)
        half = np.minimum(np.asarray(self.semi_axes, float), np.asarray(self.cut, float))
        return center - half, center + half


@dataclass(frozen=True, slots=True, kw_only=True)
class BoxWalls:
    """Six plane walls, the faces of the box from `lower` to `upper` (µm)."""

    lower: ArrayLike
    upper: ArrayLike
    width: float = 0.0

    def __post_init__(self) -> None:
        _check_corners(self.lower, self.upper)
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
        return _profile(self.depth(x, y, z), self.width)

    def bounds(self) -> tuple[Floats, Floats]:
        """See `Confinement`."""
        return np.asarray(self.lower, float), np.asarray(self.upper, float)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MaskWalls:
    """Confinement given as an image: non-zero voxels are inside.

    Attributes
    ----------
    inside : (nx, ny, nz) bool
        Beyond the image everything is outside.
    origin : (3,) µm, position of the voxel [0, 0, 0]
    spacing : float or (3,) µm
    """

    inside: NDArray[np.bool_]
    origin: ArrayLike = (0.0, 0.0, 0.0)
    spacing: ArrayLike = 0.5

    def __post_init__(self) -> None:
        inside = np.asarray(self.inside)
        if inside.ndim == 3 and inside.any():
            inside = _validate.image("confinement.inside", inside)
        else:
            count = np.count_nonzero(inside)
            message = f"confinement.inside has shape {inside.shape} and {count} voxels"
            raise ValueError(message + " set; expected a 3-D image with an inside")
        object.__setattr__(self, "inside", inside)
        _validate.vector("confinement.origin", self.origin)
        _validate.spacing("confinement.spacing", self.spacing)

    def field(self, x: Floats, y: Floats, z: Floats) -> Floats:
        """φ_e of the nearest voxel."""
        spacing = np.broadcast_to(np.asarray(self.spacing, float), 3)
        points = np.broadcast_arrays(x, y, z)
        index = [
            np.rint((p - o) / h).astype(np.int64)
            for p, o, h in zip(points, np.asarray(self.origin), spacing, strict=True)
        ]
        result = np.ones(points[0].shape)
        known = np.ones(points[0].shape, dtype=bool)
        for k, n in zip(index, self.inside.shape, strict=True):
            known &= (k >= 0) & (k < n)
        result[known] = ~self.inside[tuple(k[known] for k in index)]
        return result

    def depth(self, x: Floats, y: Floats, z: Floats) -> Floats:
        """Distance to the surface of the image, to about a voxel; constant beyond the image."""
        return _mask_depth(self).at(x, y, z)

    def bounds(self) -> tuple[Floats, Floats]:
        """See `Confinement`."""
        spacing = np.broadcast_to(np.asarray(self.spacing, float), 3)
        voxels = np.argwhere(self.inside)
        origin = np.asarray(self.origin, float)
        return origin + (voxels.min(0) - 0.5) * spacing, origin + (voxels.max(0) + 0.5) * spacing


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FunctionWalls:
    """Confinement given by a function φ_e(x, y, z) of positions in µm, with its bounds (µm)."""

    function: Callable[[Any, Any, Any], Any]
    lower: ArrayLike
    upper: ArrayLike

    def __post_init__(self) -> None:
        if not callable(self.function):
            message = f"confinement.function = {self.function!r} cannot be called"
            raise TypeError(message)
        _check_corners(self.lower, self.upper)

    def field(self, x: Floats, y: Floats, z: Floats) -> Floats:
        """φ_e, checked to be finite and between 0 and 1."""
        shape = np.broadcast_shapes(np.shape(x), np.shape(y), np.shape(z))
        values = np.asarray(self.function(x, y, z), dtype=np.float64)
        try:
            values = np.broadcast_to(values, shape)
        except ValueError as error:
            message = f"confinement.function gives shape {values.shape} for points of {shape}"
            raise ValueError(message) from error
        if not ((values >= 0) & (values <= 1)).all():
            message = (
                f"confinement.function gives values from {values.min():g} to {values.max():g}; "
                "φ_e must lie between 0 (inside) and 1 (outside)"
            )
            raise ValueError(message)
        return values

    def depth(self, x: Floats, y: Floats, z: Floats) -> Floats:
        """Distance to the surface φ_e = 1/2, to about 1/100 of the bounds."""
        return _sampled_depth(self).at(x, y, z)

    def bounds(self) -> tuple[Floats, Floats]:
        """See `Confinement`."""
        return np.asarray(self.lower, float), np.asarray(self.upper, float)


@lru_cache(maxsize=4)
def _mask_depth(walls: MaskWalls) -> Image:
    steps = np.array(np.broadcast_to(np.asarray(walls.spacing, float), 3))
    return depth_image(walls.inside, np.asarray(walls.origin, float), steps, reach=5.0)


@lru_cache(maxsize=4)
def _sampled_depth(walls: FunctionWalls) -> Image:
    low, high = walls.bounds()
    step = float((high - low).max()) / 100
    axes = [np.arange(a, b + step, step) for a, b in zip(low, high, strict=True)]
    inside = walls.field(*np.meshgrid(*axes, indexing="ij", sparse=True)) < 0.5
    if not inside.any():
        message = "confinement.function is above 1/2 everywhere within its bounds: no inside"
        raise ValueError(message)
    return depth_image(inside, low, np.full(3, step), reach=5.0)
