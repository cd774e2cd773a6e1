"""What cells can feel of where they are: their places, whom they touch, how far walls are."""

from collections.abc import Callable
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from morphosim.kernels.layout import Boxes
from morphosim.kernels.moments import N_MOMENTS, moments
from morphosim.kernels.surfaces import surfaces
from morphosim.measure.contacts import SURFACE_LEVEL, Prepared, prepare, side_areas
from morphosim.measure.measurement import MATRIX
from morphosim.period import Period

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
DEPTH_STEP = 0.1
"""Half the distance over which the direction of walls is found, µm."""
SMALLEST = 1e-9
"""Depth of a centre that lies in a wall, µm."""


class Surroundings:
    """Surroundings of N cells. Each is measured when it is first asked for, while fields stay.

    Parameters
    ----------
    phi : 1-D array
        Pool of all fields.
    boxes : Boxes
        Where they lie; see `measure.measure`.
    spacing : float
        Lattice step, µm.
    depth : function of x, y, z, optional
        Depth below the walls in µm; None in open space.
    period : Period, optional
        After which space repeats.
    path : (N, 3) int64, optional
        Origins by which centroids are told, if not those of the boxes.

    Attributes
    ----------
    centroid : (N, 3) float64
        ∫ r φ / ∫ φ, µm; NaN of a cell without volume.
    """

    def __init__(
        self, phi: NDArray[np.floating], boxes: Boxes, spacing: float,
        depth: Callable[[Floats, Floats, Floats], Floats] | None,
        period: Period | None = None, path: Integers | None = None,
    ) -> None:  # fmt: skip
        self._phi, self._boxes, self._spacing, self._depth = phi, boxes, spacing, depth
        self._period, origin = period, boxes.origin if path is None else path
        self.centroid: Floats = (origin + self._centre(0)) * spacing

    def between(self, cell: Integers, other: Integers) -> Floats:
        """(Q, 3) vectors from the centroids of cells to those of others, µm.

        In periodic space they are the shortest ones.
        """
        vectors = self.centroid[other] - self.centroid[cell]
        return vectors if self._period is None else self._period.shortest(vectors, self._spacing)

    @cached_property
    def _prepared(self) -> Prepared:
        return prepare(self._phi, self._boxes, self._period)

    @cached_property
    def _moments(self) -> Floats:
        found = np.zeros((len(self._boxes.start), N_MOMENTS))
        moments(self._prepared.shares, self._prepared.fields, found)
        return found

    def _centre(self, first: int) -> Floats:
        """(N, 3) mean positions in boxes; of φ (first moment 0), or of the inside (4)."""
        weight = self._moments[:, first]
        sums = self._moments[:, first + 1 : first + 4]
        return np.asarray(sums / np.where(weight > 0, weight, np.nan)[:, None])

    @cached_property
    def _sides(self) -> tuple[Integers, Floats, Floats]:
        return side_areas(self._prepared)

    @cached_property
    def contacts(self) -> tuple[Integers, Integers, Floats]:
        """Cells (Q,), neighbours that they touch (Q,), and how much of the cell these cover, µm².

        Each pair of cells is there from either side. Levels are those of `measure.contacts`.
        """
        pairs, areas, _ = self._sides
        meet = areas > 0
        cell, neighbour = pairs.T.ravel()[meet], pairs.T[::-1].ravel()[meet]
        return cell, neighbour, areas[meet] * self._spacing**2

    @cached_property
    def surface(self) -> Floats:
        """(N,) area of the surface on which contacts are measured, µm²."""
        prepared, found = self._prepared, np.zeros((len(self.centroid), 2))
        surfaces(prepared.shares, prepared.fields, SURFACE_LEVEL, prepared.work, found)
        return np.asarray(found[:, 0] * self._spacing**2)

    @cached_property
    def exposed(self) -> Floats:
        """(N,) share of that surface which touches no other cell; 0 of a cell that has none."""
        touched = self._sides[2] * self._spacing**2
        known = self.surface > 0
        covered = np.where(known, touched, 1) / np.where(known, self.surface, 1)
        return np.asarray(np.maximum(1 - covered, 0))

    @cached_property
    def nearness(self) -> Floats:
        """(N,) how far each cell reaches to the nearest wall, in the way there: 1 if it touches.

        By the ellipsoid with the same second moments, seen from its centre: h / d with d the depth
        of the centre and h = √(n·C n) the ellipsoid's extent along the normal n of the wall. 0 in
        open space.
        """
        if self._depth is None:
            return np.zeros(len(self.centroid))
        weight = np.where(self._moments[:, 4] > 0, self._moments[:, 4], np.nan)
        centre = self._centre(4)
        second = self._moments[:, MATRIX] / weight[:, None, None]
        tensor = 5 * (second - centre[:, :, None] * centre[:, None, :]) * self._spacing**2
        depth, normal = self._walls((self._boxes.origin + centre) * self._spacing)
        extent = np.sqrt(np.einsum("na,nab,nb->n", normal, tensor, normal))
        return np.asarray(np.nan_to_num(extent / np.maximum(depth, SMALLEST)))

    def _walls(self, points: Floats) -> tuple[Floats, Floats]:
        """Depth (N,) of points, and the direction (N, 3) in which it grows."""
        assert self._depth is not None
        depth = np.asarray(self._depth(*points.T), float)
        slope = np.zeros_like(points)
        for axis in range(3):
            step = np.zeros(3)
            step[axis] = DEPTH_STEP
            ahead, behind = self._depth(*(points + step).T), self._depth(*(points - step).T)
            slope[:, axis] = ahead - behind
        size = np.linalg.norm(slope, axis=1, keepdims=True)
        return depth, np.asarray(slope / np.where(size > 0, size, 1))
