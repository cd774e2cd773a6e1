"""Walls given as an image."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from morphosim import _validate
from morphosim._shown import short_repr
from morphosim.geometry.confinement.protocol import Floats
from morphosim.geometry.signed_distance import Image, depth_image


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

    __repr__ = short_repr

    def __post_init__(self) -> None:
        inside = _validate.image("confinement.inside", self.inside)
        if not inside.any():
            message = f"confinement.inside has shape {inside.shape} and 0 voxels set; expected an "
            raise ValueError(message + "image with an inside")
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


@lru_cache(maxsize=4)
def _mask_depth(walls: MaskWalls) -> Image:
    steps = np.array(np.broadcast_to(np.asarray(walls.spacing, float), 3))
    return depth_image(walls.inside, np.asarray(walls.origin, float), steps, reach=5.0)
