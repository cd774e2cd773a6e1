"""A convex polyhedron."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from morphosim import _validate
from morphosim._shown import short_repr
from morphosim.geometry.shapes.protocol import Floats

ALIKE = 3
"""Digits of a face's plane (unit normal; µm from the middle) by which two are one."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Polyhedron:
    """Convex polyhedron, such as a cell of a Voronoi diagram; its volume is ∫ φ.

    Attributes
    ----------
    vertices : (V, 3) µm
        Its corners, in any order. Points within their convex hull are no corners.

    Raises
    ------
    ValueError
        There are fewer than four points, or all lie in one plane.
    """

    vertices: ArrayLike
    volume: float = field(init=False, repr=False)
    _planes: Floats = field(init=False, repr=False)

    __repr__ = short_repr

    def __post_init__(self) -> None:
        from scipy.spatial import ConvexHull, QhullError

        points = _validate.array("shape.vertices", self.vertices, (None, 3))
        middle = points.mean(axis=0) if len(points) else np.zeros(3)
        try:
            hull = ConvexHull(points - middle)
        except (QhullError, ValueError) as error:
            message = (
                f"shape.vertices: {len(points)} points span no volume; expected four or more that "
                "do not lie in one plane"
            )
            raise ValueError(message) from error
        planes = hull.equations[
            np.unique(hull.equations.round(ALIKE), axis=0, return_index=True)[1]
        ]
        planes[:, 3] -= planes[:, :3] @ middle
        object.__setattr__(self, "volume", float(hull.volume))
        object.__setattr__(self, "_planes", planes)

    @property
    def exact(self) -> bool:
        """False: a target volume near its own takes its place."""
        return False

    def depth(self, x: Floats, y: Floats, z: Floats) -> Floats:
        """Depth below the nearest face, positive inside; beyond edges less than the distance."""
        depth = np.full(np.broadcast_shapes(np.shape(x), np.shape(y), np.shape(z)), np.inf)
        for u, v, w, offset in self._planes:
            np.minimum(depth, (-u * x - v * y) - (w * z + offset), out=depth)
        return depth

    def bounds(self) -> tuple[Floats, Floats]:
        """See `Shape`."""
        points = np.asarray(self.vertices, float)
        return points.min(axis=0), points.max(axis=0)
