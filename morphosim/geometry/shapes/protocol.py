"""What a scene needs to know of a shape that a cell starts from."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

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
