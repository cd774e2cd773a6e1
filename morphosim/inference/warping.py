"""Fields moved together, so that their surfaces come to lie where they are seen.

All cells are moved by one smooth displacement of space. So contacts keep the profiles, gaps and
pressures that they have found, which fields made of an image alone do not have.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from morphosim.cell_field import CellField
from morphosim.inference.observation import Surfaces

Floats = NDArray[np.float64]
WIDTH = 1.0
"""Standard deviation over which offsets of the surface are averaged, and grid of the displacement,
µm."""
MARGIN = 8.0
"""Beyond the surfaces the displacement reaches so far, µm."""
LIGHT = 1e-3
"""Area, µm² per grid point, far below which nothing is moved."""
NEGLIGIBLE = 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class Displacement:
    """A smooth displacement of space.

    Attributes
    ----------
    first : (3,) µm, position of the first grid point
    values : (3, nx, ny, nz) µm, on a grid of `WIDTH`
    """

    first: Floats
    values: Floats

    @classmethod
    def along(cls, surfaces: Surfaces, offset: Floats) -> "Displacement":
        """What takes points of surfaces by so much along their normals, smoothed."""
        from scipy.ndimage import gaussian_filter

        first = surfaces.points.min(axis=0) - MARGIN
        shape = np.ceil((surfaces.points.max(axis=0) + MARGIN - first) / WIDTH).astype(int) + 1
        clear = surfaces.clear
        weight = surfaces.area[clear]
        vectors = (offset[clear, None] * surfaces.normals[clear]).T
        places = (surfaces.points[clear] - first) / WIDTH
        sums = [
            gaussian_filter(_spread(places, w, shape), 1.0) for w in (weight, *weight * vectors)
        ]
        return cls(first, np.stack(sums[1:]) / (sums[0] + LIGHT))

    def at(self, points: Sequence[Floats]) -> Floats:
        """(3, ...) displacement at points x, y, z, µm."""
        from scipy.ndimage import map_coordinates

        places = [(x - o) / WIDTH for x, o in zip(points, self.first, strict=True)]
        return np.stack([map_coordinates(v, places, order=1, mode="nearest") for v in self.values])


def _spread(places: Floats, weight: Floats, shape: NDArray[np.int64]) -> Floats:
    """Weights at places, in grid steps, shared out linearly among the grid points around."""
    base = np.floor(places).astype(np.int64)
    rest = places - base
    out = np.zeros(int(shape.prod()))
    for corner in np.ndindex(2, 2, 2):
        share = np.prod(np.where(corner, rest, 1 - rest), axis=1)
        at = np.ravel_multi_index(tuple((base + corner).T), tuple(shape))
        out += np.bincount(at, share * weight, out.size)
    return out.reshape(shape)


def moved(
    fields: Sequence[CellField], spacing: float, back: Sequence[Displacement]
) -> list[CellField]:
    """Fields whose value at x is that at x + the sum of displacements, by cubic splines."""
    from scipy.ndimage import map_coordinates

    out = []
    for field in fields:
        origin = field.origin - 2
        phi = np.pad(np.asarray(field.phi, np.float64), 2)
        grid = np.meshgrid(*map(np.arange, phi.shape), indexing="ij")
        points = [(g + o) * spacing for g, o in zip(grid, origin, strict=True)]
        shift = sum(part.at(points) for part in back) / spacing
        values = map_coordinates(phi, np.stack(grid) + shift, order=3)
        values[np.abs(values) < NEGLIGIBLE] = 0.0
        out.append(CellField(field.name, origin, values.astype(np.float32)))
    return out
