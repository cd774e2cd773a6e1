"""Surfaces of cells as triangle meshes."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from morphosim import _validate
from morphosim._shown import short_repr
from morphosim.cell_field import CellField

SURFACE = 0.5
"""φ on the surface of a cell."""


@dataclass(frozen=True, slots=True)
class Surface:
    """Triangle mesh of one cell's surface, seen from outside counterclockwise.

    Attributes
    ----------
    name : str
    vertices : (V, 3) float64, µm
    faces : (F, 3) int, indices of vertices
    """

    name: str
    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]

    __repr__ = short_repr

    @property
    def area(self) -> float:
        """Area in µm²."""
        a, b, c = np.moveaxis(self.vertices[self.faces], 1, 0)
        return float(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())

    @property
    def volume(self) -> float:
        """Enclosed volume in µm³."""
        a, b, c = np.moveaxis(self.vertices[self.faces] - self.vertices.mean(axis=0), 1, 0)
        return float((a * np.cross(b, c)).sum() / 6)


def cell_surface(field: CellField, spacing: float, level: float = SURFACE) -> Surface:
    """Surface φ = `level` of one cell; without triangles where φ is nowhere above it.

    Points where φ is not finite count as outside.
    """
    from skimage.measure import marching_cubes

    _validate.number("level", level, above=0)
    phi = np.pad(np.asarray(field.phi, np.float32), 1)
    phi[~np.isfinite(phi)] = 0
    if phi.max() <= level:
        return Surface(field.name, np.zeros((0, 3)), np.zeros((0, 3), np.int64))
    vertices, faces, _, _ = marching_cubes(phi, level)
    return Surface(
        field.name,
        (vertices + (field.origin - 1)) * spacing,
        np.asarray(faces[:, ::-1], np.int64),
    )
