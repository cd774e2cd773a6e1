"""A cell of a segmented image."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from morphosim import _validate
from morphosim._shown import short_repr
from morphosim.geometry.shapes.protocol import Floats
from morphosim.geometry.shapes.voxels import placed_image, voxel_steps
from morphosim.geometry.signed_distance import depth_image


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

    __repr__ = short_repr

    def __post_init__(self) -> None:
        mask = _validate.image("shape.mask", self.mask)
        if not mask.any():
            message = "shape.mask is empty: no voxel is set"
            raise ValueError(message)
        object.__setattr__(self, "mask", mask)
        placed_image(mask, self.origin, self.spacing)
        _validate.number("shape.smoothing", self.smoothing, least=0)

    @property
    def exact(self) -> bool:
        """True: its volume was measured, or shared out."""
        return True

    @property
    def volume(self) -> float:
        """Voxel count times voxel volume, µm³."""
        return float(self.mask.sum() * np.prod(voxel_steps(self.spacing)))

    def depth(self, x: Floats, y: Floats, z: Floats) -> Floats:
        """Depth below the smoothed surface, positive inside."""
        origin, steps = np.asarray(self.origin, float), voxel_steps(self.spacing)
        reach = _reach(x, y, z, *self.bounds())
        return depth_image(self.mask, origin, steps, reach, self.smoothing).at(x, y, z)

    def bounds(self) -> tuple[Floats, Floats]:
        """See `Shape`."""
        return placed_image(self.mask, self.origin, self.spacing).bounds(self.mask)


def _reach(x: Floats, y: Floats, z: Floats, low: Floats, high: Floats) -> float:
    """How far points lie beyond a box, at most."""
    over = [
        max(float(lo - np.min(p)), float(np.max(p) - hi), 0.0)
        for p, lo, hi in zip((x, y, z), low, high, strict=True)
    ]
    return max(over)
