"""A phase field as it is."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from morphosim import _validate
from morphosim._shown import short_repr
from morphosim.geometry.shapes.protocol import Floats
from morphosim.geometry.shapes.voxels import placed_image, voxel_steps
from morphosim.geometry.signed_distance import Image

LARGEST_PHI = 4.0
"""φ beyond this is none that a run could go on with (`engine.RUNAWAY`)."""


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

    __repr__ = short_repr

    def __post_init__(self) -> None:
        phi = _validate.array("shape.phi", self.phi, (None, None, None))
        if np.abs(phi).max(initial=0) > LARGEST_PHI:
            where = np.unravel_index(np.abs(phi).argmax(), phi.shape)
            message = (
                f"shape.phi{[int(k) for k in where]} = {phi[where]:g} is no phase field, which "
            )
            raise ValueError(f"{message}lies between 0 and 1 (up to ±{LARGEST_PHI:g} is taken)")
        if not (phi > 0.5).any():
            message = f"shape.phi has no value above 0.5 (largest {phi.max(initial=0):g})"
            raise ValueError(message + ": no cell is there")
        placed_image(phi, self.origin, self.spacing)

    @property
    def volume(self) -> float:
        """∫ φ in µm³."""
        return float(np.sum(self.phi, dtype=np.float64) * np.prod(voxel_steps(self.spacing)))

    def values(self, x: Floats, y: Floats, z: Floats) -> Floats:
        """φ at points in µm, linear between its own points, 0 beyond them."""
        steps = voxel_steps(self.spacing)
        padded = np.pad(np.asarray(self.phi, float), 1)
        return Image(padded, np.asarray(self.origin, float) - steps, steps).at(x, y, z)

    def bounds(self) -> tuple[Floats, Floats]:
        """Box around all values that are not negligible."""
        return placed_image(self.phi, self.origin, self.spacing).bounds(np.abs(self.phi) > 1e-6)
