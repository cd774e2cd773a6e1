"""A cell of a power partition, and the point that stands for it in a scene file."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from morphosim import _validate
from morphosim._shown import short_repr
from morphosim.geometry.confinement import Confinement
from morphosim.geometry.power_partition import PowerPartition
from morphosim.geometry.shapes.protocol import Floats


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Point:
    """Start of a cell as a scene file may say it: it becomes a `PowerCell`.

    All points of a scene share out its confinement (see `Scene.from_points`).

    Attributes
    ----------
    position : (3,) µm
    volume : float, optional
        µm³; by default the target volume of the cell.
    """

    position: ArrayLike
    volume: float | None = None

    __repr__ = short_repr

    def __post_init__(self) -> None:
        _validate.vector("shape.position", self.position)
        if self.volume is not None:
            _validate.number("shape.volume", self.volume, above=0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PowerCell:
    """One cell of a power partition of a confinement (see `Scene.from_points`)."""

    partition: PowerPartition
    cell: int
    volume: float
    confinement: Confinement | None = None

    __repr__ = short_repr

    def __post_init__(self) -> None:
        _validate.instance("shape.partition", self.partition, PowerPartition)
        last = len(self.partition.points) - 1
        _validate.integer("shape.cell", self.cell, least=0, most=last)
        _validate.number("shape.volume", self.volume, above=0)
        if self.confinement is not None and not hasattr(self.confinement, "depth"):
            message = f"shape.confinement = {_validate.brief(self.confinement)} has no depth"
            raise TypeError(message)

    @property
    def point(self) -> Point:
        """What a scene file says of it."""
        return Point(position=self.partition.points[self.cell], volume=self.volume)

    @property
    def exact(self) -> bool:
        """True: its volume was measured, or shared out."""
        return True

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
