"""Which cells touch, and over what area.

Definitions of the published program: two cells touch where {φ > 0.44}, dilated by one lattice
step, overlap; the contact area of i with j is that part of the φ_i = 0.34 surface on which
φ_j >= 0.2, and the area of a pair is the mean of both sides.
"""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from morphosim.fields import CellField

TOUCH_LEVEL = 0.44
SURFACE_LEVEL = 0.34
NEIGHBOUR_LEVEL = 0.2


def touching(fields: Sequence[CellField]) -> dict[tuple[str, str], int]:
    """Pairs of names that touch, with the number of lattice points that both cells cover."""
    from scipy.ndimage import binary_dilation, generate_binary_structure

    cross = generate_binary_structure(3, 1)
    masks = [
        CellField(f.name, f.origin - 1, binary_dilation(np.pad(f.phi > TOUCH_LEVEL, 1), cross))
        for f in fields
    ]
    counts = {}
    for i, j in overlapping(masks):
        a, b = common(masks[i], masks[j])
        shared = int(np.count_nonzero(a & b))
        if shared:
            counts[masks[i].name, masks[j].name] = shared
    return counts


def contact_areas(fields: Sequence[CellField], spacing: float) -> dict[tuple[str, str], float]:
    """Contact area in µm² of every pair whose surfaces meet."""
    surfaces: dict[int, tuple[NDArray[np.float64], NDArray[np.float64]]] = {}
    areas = {}
    for i, j in overlapping(fields):
        sides = []
        for me, other in ((i, j), (j, i)):
            if me not in surfaces:
                surfaces[me] = surface_faces(fields[me], spacing)
            centres, face_areas = surfaces[me]
            sides.append(float(face_areas[sample(fields[other], centres) >= NEIGHBOUR_LEVEL].sum()))
        if any(sides):
            areas[fields[i].name, fields[j].name] = 0.5 * sum(sides)
    return areas


def surface_faces(
    cell: CellField, spacing: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Triangles of the φ = 0.34 surface: centres in lattice units (F, 3), and areas in µm²."""
    from skimage.measure import marching_cubes

    phi = np.pad(np.asarray(cell.phi, np.float32), 1)
    if phi.max() <= SURFACE_LEVEL:
        return np.zeros((0, 3)), np.zeros(0)
    vertices, faces, _, _ = marching_cubes(phi, SURFACE_LEVEL)
    corners = vertices[faces] + (cell.origin - 1)
    edges = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return corners.mean(axis=1), 0.5 * np.linalg.norm(edges, axis=1) * spacing**2


def sample(cell: CellField, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """φ at points in lattice units, linear between lattice points, 0 outside of the box."""
    from scipy.ndimage import map_coordinates

    local = (points - cell.origin).T
    return np.asarray(map_coordinates(np.asarray(cell.phi, np.float64), local, order=1, cval=0.0))


def overlapping(fields: Sequence[CellField]) -> Iterator[tuple[int, int]]:
    """Pairs of indices whose boxes overlap; sweeps along x."""
    low = np.array([f.origin for f in fields])
    high = low + np.array([f.phi.shape for f in fields])
    order = np.argsort(low[:, 0], kind="stable")
    for position, i in enumerate(order):
        later = order[position + 1 :]
        later = later[: np.searchsorted(low[later, 0], high[i, 0])]
        meets = (low[later] < high[i]) & (high[later] > low[i])
        for j in later[meets.all(axis=1)]:
            yield (int(i), int(j)) if i < j else (int(j), int(i))


def common(a: CellField, b: CellField) -> tuple[NDArray, NDArray]:
    """Views of both arrays on the part of the lattice that they share."""
    low = np.maximum(a.origin, b.origin)
    high = np.minimum(a.origin + a.phi.shape, b.origin + b.phi.shape)
    views = [
        f.phi[tuple(slice(p, q) for p, q in zip(low - f.origin, high - f.origin, strict=True))]
        for f in (a, b)
    ]
    return views[0], views[1]
