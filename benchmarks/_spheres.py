"""Surfaces of cells, and the spheres that parts of them lie on."""

import numpy as np
from numpy.typing import NDArray
from skimage.measure import marching_cubes

from morphosim.cell_field import CellField

Floats = NDArray[np.float64]


def surface_points(field: CellField, spacing: float) -> Floats:
    """(P, 3) points of the surface φ = 1/2, µm."""
    return np.asarray((marching_cubes(field.phi, 0.5)[0] + np.array(field.origin)) * spacing)


def fitted_sphere(points: Floats) -> tuple[Floats, float]:
    """Centre (3,) and radius of the sphere nearest to points (P, 3), by least squares."""
    system = np.column_stack([2 * points, np.ones(len(points))])
    *center, rest = np.linalg.lstsq(system, (points**2).sum(axis=1), rcond=None)[0]
    return np.array(center), float(np.sqrt(rest + np.dot(center, center)))
