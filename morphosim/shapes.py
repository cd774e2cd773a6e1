"""Shapes a cell can start from. All lengths in µm."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from morphosim import _validate

if TYPE_CHECKING:
    from morphosim.confinement import Confinement
    from morphosim.partition import PowerPartition

Floats = NDArray[np.float64]


class Shape(Protocol):
    """A region of space that `initial.discretise` turns into a phase field."""

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


class _Image:
    """Values on a regular grid of their own: voxel [0, 0, 0] at `origin`."""

    __slots__ = ()
    origin: ArrayLike
    spacing: ArrayLike

    def _steps(self) -> Floats:
        return np.broadcast_to(np.asarray(self.spacing, float), 3)

    def _interpolate(self, image: Floats, x: Floats, y: Floats, z: Floats) -> Floats:
        from scipy.ndimage import map_coordinates

        coordinates = [
            (p - o) / h
            for p, o, h in zip((x, y, z), np.asarray(self.origin), self._steps(), strict=True)
        ]
        points = np.stack(np.broadcast_arrays(*coordinates))
        return np.asarray(map_coordinates(image, points, order=1, mode="nearest"))

    def _voxel_bounds(self, inside: NDArray[np.bool_]) -> tuple[Floats, Floats]:
        voxels = np.argwhere(inside)
        origin, steps = np.asarray(self.origin, float), self._steps()
        return origin + voxels.min(0) * steps, origin + voxels.max(0) * steps


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Mask(_Image):
    """Voxels of an image: the non-zero ones are the cell.

    The field starts from the distance to the mask's surface, smoothed over one voxel, moved so
    that its integral is the mask's volume.

    Attributes
    ----------
    mask : (nx, ny, nz) bool
    origin : (3,) µm, position of the voxel [0, 0, 0]
    spacing : float or (3,) µm
    """

    mask: NDArray[np.bool_]
    origin: ArrayLike = (0.0, 0.0, 0.0)
    spacing: ArrayLike = 0.5

    def __post_init__(self) -> None:
        mask = np.asarray(self.mask) != 0
        if mask.ndim != 3:
            message = f"shape.mask has shape {mask.shape}; expected three axes (x, y, z)"
            raise ValueError(message)
        if not mask.any():
            message = "shape.mask is empty: no voxel is set"
            raise ValueError(message)
        object.__setattr__(self, "mask", mask)
        _validate.vector("shape.origin", self.origin)
        for value in self._steps():
            _validate.number("shape.spacing", value, above=0)

    @property
    def exact(self) -> bool:
        """False: the surface fits the volume."""
        return False

    @property
    def volume(self) -> float:
        """Voxel count times voxel volume, µm³."""
        return float(self.mask.sum() * np.prod(self._steps()))

    def depth(self, x: Floats, y: Floats, z: Floats) -> Floats:
        """Smoothed distance to the mask's surface, positive inside."""
        from scipy.ndimage import distance_transform_edt, gaussian_filter

        steps, (low, high) = self._steps(), self.bounds()
        pad = int(np.ceil(_reach(x, y, z, low, high) / steps.min())) + 2
        voxels = np.argwhere(self.mask)
        first, last = voxels.min(0), voxels.max(0) + 1
        mask = np.pad(self.mask[tuple(map(slice, first, last))], pad)
        half = 0.5 * steps.min()
        inside = distance_transform_edt(mask, sampling=steps)
        outside = distance_transform_edt(~mask, sampling=steps)
        distance = np.where(mask, inside - half, half - outside)
        smooth = gaussian_filter(distance, 1.0)
        corner = np.asarray(self.origin, float) + (first - pad) * steps
        return Mask(mask=mask, origin=corner, spacing=steps)._interpolate(smooth, x, y, z)

    def bounds(self) -> tuple[Floats, Floats]:
        """See `Shape`."""
        return self._voxel_bounds(self.mask)


def _reach(x: Floats, y: Floats, z: Floats, low: Floats, high: Floats) -> float:
    """How far points lie beyond a box, at most."""
    over = [
        max(float(lo - np.min(p)), float(np.max(p) - hi), 0.0)
        for p, lo, hi in zip((x, y, z), low, high, strict=True)
    ]
    return max(over)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Field(_Image):
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
        _validate.vector("shape.origin", self.origin)
        for value in self._steps():
            _validate.number("shape.spacing", value, above=0)

    @property
    def volume(self) -> float:
        """∫ φ in µm³."""
        return float(np.sum(self.phi, dtype=np.float64) * np.prod(self._steps()))

    def values(self, x: Floats, y: Floats, z: Floats) -> Floats:
        """φ at points in µm, linear between its own points, 0 beyond them."""
        padded = np.pad(np.asarray(self.phi, float), 1)
        corner = np.asarray(self.origin, float) - self._steps()
        wide = Field(phi=padded, origin=corner, spacing=self.spacing)
        return wide._interpolate(padded, x, y, z)

    def bounds(self) -> tuple[Floats, Floats]:
        """Box around all values that are not negligible."""
        return self._voxel_bounds(np.abs(self.phi) > 1e-6)


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
