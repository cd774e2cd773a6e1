"""What a scene needs to know of a shape that a cell starts from."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


class Shape(Protocol):
    """A region of space that `phase_field.lattice_field` turns into a phase field.

    The surface moves along its normal until ∫ φ is the volume that the cell starts with.
    """

    @property
    def exact(self) -> bool:
        """Whether a cell starts with this volume whatever its target is; else see `Cell`."""

    @property
    def volume(self) -> float:
        """Volume in µm³."""

    def depth(self, x: Floats, y: Floats, z: Floats) -> Floats:
        """Depth below the surface, positive inside."""

    def bounds(self) -> tuple[Floats, Floats]:
        """Lower and upper corner of a box around the shape."""
