"""Shapes that a cell can start from. All lengths in µm.

Another one is a file here and a row of `SHAPES`; scene files, errors and fingerprints know it by
that.
"""

from morphosim.geometry.shapes.ellipsoid import Ellipsoid
from morphosim.geometry.shapes.field import Field
from morphosim.geometry.shapes.mask import Mask
from morphosim.geometry.shapes.point import Point, PowerCell
from morphosim.geometry.shapes.polyhedron import Polyhedron
from morphosim.geometry.shapes.protocol import Shape
from morphosim.geometry.shapes.sphere import Sphere

SHAPES: dict[str, type] = {
    "sphere": Sphere,
    "ellipsoid": Ellipsoid,
    "polyhedron": Polyhedron,
    "mask": Mask,
    "field": Field,
    "point": Point,
}
"""Classes by the `kind` that a scene file names them by."""

__all__ = [
    "SHAPES", "Ellipsoid", "Field", "Mask", "Point", "Polyhedron", "PowerCell", "Shape", "Sphere",
]  # fmt: skip
