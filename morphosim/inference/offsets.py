"""How far simulated surfaces lie from those that are seen, point by point and patch by patch."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from morphosim.cell_field import CellField
from morphosim.inference.observation import Surfaces
from morphosim.kernels.offsets import surface_offsets
from morphosim.measure.contacts import pack

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
FARTHEST = 3.0
"""A surface is looked for so far from where it is seen, µm."""
PATCH = 2.0
"""Edge of the cubes in which points of an interface are one patch, µm."""
LEAST = 0.2
"""Patches of less area than this, in squared edges, are left out."""


def offsets(surfaces: Surfaces, fields: Sequence[CellField], spacing: float) -> Floats:
    """(P,) µm by which surfaces of fields lie farther out than points of seen ones, at most 3 µm.

    Between cells i and j the surface is where φ_i = φ_j, elsewhere where Σ φ = 1/2: as in images of
    which gaps between cells have been closed.
    """
    known = {field.name: field for field in fields}
    pool, boxes = pack([known[name] for name in surfaces.names])
    around, first = _neighbours(surfaces)
    out = np.empty(len(surfaces.points))
    surface_offsets(
        pool, boxes.origin, boxes.shape, boxes.start, surfaces.cell, surfaces.neighbour, around,
        first, surfaces.points / spacing, surfaces.normals, FARTHEST / spacing, out,
    )  # fmt: skip
    return out * spacing


def _neighbours(surfaces: Surfaces) -> tuple[Integers, Integers]:
    """Cells in contact with each cell, one cell after the other, and where each begins."""
    count = len(surfaces.names)
    touch = surfaces.neighbour >= 0
    pairs = np.unique(
        np.stack([surfaces.cell[touch], surfaces.neighbour[touch]], axis=1), axis=0
    ).reshape(-1, 2)
    both = np.unique(np.concatenate([pairs, pairs[:, ::-1]]), axis=0)
    return np.ascontiguousarray(both[:, 1]), np.searchsorted(both[:, 0], np.arange(count + 1))


@dataclass(frozen=True, slots=True, eq=False)
class Patches:
    """Pieces of interfaces, some 2 µm wide, over which offsets are averaged.

    Attributes
    ----------
    keys : (K, 5) int64
        Cell, neighbour, and cube of space of each patch, sorted.
    area : (K,) µm²
    centre, normal : (K, 3)
        Means over the patch, µm.
    """

    keys: Integers
    area: Floats
    centre: Floats
    normal: Floats

    @classmethod
    def of(cls, surfaces: Surfaces) -> "Patches":
        """Patches of the points that are to be compared."""
        once = surfaces.once
        area = surfaces.area[once]
        found, inverse = np.unique(_keys(surfaces)[once], axis=0, return_inverse=True)
        keys, at = np.asarray(found, np.int64), inverse.reshape(-1)
        total = np.asarray(np.bincount(at, area, len(keys)), np.float64)
        large = total > LEAST * PATCH**2

        def mean(values: Floats) -> Floats:
            sums = [np.bincount(at, area * column, len(keys)) for column in values[once].T]
            return np.asarray(np.stack(sums, axis=1)[large] / total[large, None])

        return cls(keys[large], total[large], mean(surfaces.points), mean(surfaces.normals))

    @classmethod
    def joined(cls, parts: Sequence["Patches"]) -> "Patches":
        """Patches of several frames, one after the other."""
        return cls(
            np.concatenate([part.keys for part in parts]),
            np.concatenate([part.area for part in parts]),
            np.concatenate([part.centre for part in parts]),
            np.concatenate([part.normal for part in parts]),
        )

    @property
    def cell(self) -> Integers:
        """(K,) cell of each patch."""
        return self.keys[:, 0]

    @property
    def neighbour(self) -> Integers:
        """(K,) cell behind it; below 0 where there is none."""
        return self.keys[:, 1]

    @property
    def weight(self) -> Floats:
        """(K,) root of its area, of a whole patch 1: what its offset counts by."""
        return np.asarray(np.sqrt(self.area) / PATCH)

    def mean(self, surfaces: Surfaces, offset: Floats) -> Floats:
        """(K,) mean offset of points within each patch; 0 where there is none.

        The points may be those of another image than that of the patches.
        """
        once = surfaces.once
        keys = np.concatenate([self.keys, _keys(surfaces)[once]])
        _, at = np.unique(keys, axis=0, return_inverse=True)
        at = at.reshape(-1)
        mine, theirs = at[: len(self.keys)], at[len(self.keys) :]
        area, count = surfaces.area[once], int(at.max(initial=0)) + 1
        total = np.bincount(theirs, area, count)
        mean = np.bincount(theirs, area * offset[once], count) / np.where(total > 0, total, 1.0)
        return np.asarray(mean[mine])


def _keys(surfaces: Surfaces) -> Integers:
    """Cell, neighbour and cube of space of each point, (P, 5)."""
    cubes = np.floor(surfaces.points / PATCH).astype(np.int64)
    return np.column_stack([surfaces.cell, surfaces.neighbour, cubes])


def rigid_motions(patches: Patches) -> Floats:
    """(K, 6) offsets of patches where all cells are moved along x, y, z, or turned about them."""
    around = np.cross(patches.centre - patches.centre.mean(axis=0), patches.normal)
    return np.concatenate([patches.normal, around], axis=1)
