"""Shapes a cell can start from. All lengths in µm."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from morphosim import _validate
from morphosim.geometry.signed_distance import Image, depth_image

if TYPE_CHECKING:
    from morphosim.geometry.confinement import Confinement
    from morphosim.geometry.power_partition import PowerPartition

Floats = NDArray[np.float64]


class Shape(Protocol):
    """A region of space that `phase_field.lattice_field` turns into a phase field."""

    @property
    def exact(self) -> bool:
        """Whether the surface stays where the shape puts it; else it moves to fit the volume."""

    @property
    def volume(self) -> float:
        """Volume in µm³."""

    def depth(self, x: Floats, y: Floats, z: Floats) -> Floats:
        """Depth below the surface, positive inside."""

    def bounds(self) -> tuple[Floats, Floats]:
        """Lower and upper corner of a box around the shape."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Ellipsoid:
    """Ellipsoid along the axes."""

    center: ArrayLike
    semi_axes: ArrayLike

    def __post_init__(self) -> None:
        _validate.vector("shape.center", self.center)
        for axis, value in zip("xyz", _validate.vector("semi_axes", self.semi_axes), strict=True):
            _validate.number(f"shape.semi_axes ({axis})", value, above=0)

    @property
    def exact(self) -> bool:
        """True: the surface is where it was put."""
        return True

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


@dataclass(frozen=True, slots=True, kw_only=True)
class Sphere:
    """Ball of radius `radius` about `center`."""

    center: ArrayLike
    radius: float

    def __post_init__(self) -> None:
        _validate.vector("shape.center", self.center)
        _validate.number("shape.radius", self.radius, above=0)

    @property
    def exact(self) -> bool:
        """True: the surface is where it was put."""
        return True

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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Mask:
    """Voxels of an image: the non-zero ones are the cell.

    The field starts from the depth below the mask's smoothed surface, moved so that its integral
    is the mask's volume.

    Attributes
    ----------
    mask : (nx, ny, nz) bool
    origin : (3,) µm, position of the voxel [0, 0, 0]
    spacing : float or (3,) µm
    smoothing : float, µm
        Width over which the surface is smoothed; by default that of the published program, nine
        voxels of 0.5 µm. 0 keeps the steps of the voxels.
    """

    mask: NDArray[np.bool_]
    origin: ArrayLike = (0.0, 0.0, 0.0)
    spacing: ArrayLike = 0.5
    smoothing: float = 4.5

    def __post_init__(self) -> None:
        mask = _validate.image("shape.mask", self.mask)
        if not mask.any():
            message = "shape.mask is empty: no voxel is set"
            raise ValueError(message)
        object.__setattr__(self, "mask", mask)
        _image(mask, self.origin, self.spacing)
        _validate.number("shape.smoothing", self.smoothing, least=0)

    @property
    def exact(self) -> bool:
        """False: the surface fits the volume."""
        return False

    @property
    def volume(self) -> float:
        """Voxel count times voxel volume, µm³."""
        return float(self.mask.sum() * np.prod(_steps(self.spacing)))

    def depth(self, x: Floats, y: Floats, z: Floats) -> Floats:
        """Depth below the smoothed surface, positive inside."""
        origin, steps = np.asarray(self.origin, float), _steps(self.spacing)
        reach = _reach(x, y, z, *self.bounds())
        return depth_image(self.mask, origin, steps, reach, self.smoothing).at(x, y, z)

    def bounds(self) -> tuple[Floats, Floats]:
        """See `Shape`."""
        return _image(self.mask, self.origin, self.spacing).bounds(self.mask)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Field:
    """A phase field given as an array; taken as it is where it lies on the scene's lattice.

    Attributes
    ----------
    phi : (nx, ny, nz) float, between about 0 and 1
    origin : (3,) µm, position of the value [0, 0, 0]
    spacing : float or (3,) µm
    """

    phi: NDArray[np.floating]
    origin: ArrayLike = (0.0, 0.0, 0.0)
    spacing: ArrayLike = 0.5

    def __post_init__(self) -> None:
        phi = _validate.array("shape.phi", self.phi, (None, None, None))
        if not (phi > 0.5).any():
            message = f"shape.phi has no value above 0.5 (largest {phi.max(initial=0):g})"
            raise ValueError(message + ": no cell is there")
        _image(phi, self.origin, self.spacing)

    @property
    def volume(self) -> float:
        """∫ φ in µm³."""
        return float(np.sum(self.phi, dtype=np.float64) * np.prod(_steps(self.spacing)))

    def values(self, x: Floats, y: Floats, z: Floats) -> Floats:
        """φ at points in µm, linear between its own points, 0 beyond them."""
        steps = _steps(self.spacing)
        padded = np.pad(np.asarray(self.phi, float), 1)
        return Image(padded, np.asarray(self.origin, float) - steps, steps).at(x, y, z)

    def bounds(self) -> tuple[Floats, Floats]:
        """Box around all values that are not negligible."""
        return _image(self.phi, self.origin, self.spacing).bounds(np.abs(self.phi) > 1e-6)


def _steps(spacing: ArrayLike) -> Floats:
    return _validate.spacing("shape.spacing", spacing)


def _image(values: NDArray, origin: ArrayLike, spacing: ArrayLike) -> Image:
    """Image with its place checked."""
    return Image(values, _validate.vector("shape.origin", origin), _steps(spacing))


def _reach(x: Floats, y: Floats, z: Floats, low: Floats, high: Floats) -> float:
    """How far points lie beyond a box, at most."""
    over = [
        max(float(lo - np.min(p)), float(np.max(p) - hi), 0.0)
        for p, lo, hi in zip((x, y, z), low, high, strict=True)
    ]
    return max(over)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PowerCell:
    """One cell of a power partition of a confinement (see `Scene.from_points`)."""

    partition: "PowerPartition"
    cell: int
    volume: float
    confinement: "Confinement | None" = None

    @property
    def exact(self) -> bool:
        """False: the surface fits the volume."""
        return False

    def depth(self, x: Floats, y: Floats, z: Floats) -> Floats:
        """Depth below the nearest of its faces and of the wall."""
        depth = self.partition.signed_distance(self.cell, x, y, z)
        if self.confinement is not None:
            depth = np.minimum(depth, self.confinement.depth(x, y, z))
        return depth

    def bounds(self) -> tuple[Floats, Floats]:
        """Box around the ball that holds the cell."""
        point = self.partition.points[self.cell]
        radius = float(np.sqrt(self.partition.weights[self.cell]))
        return point - radius, point + radius
