"""Small random fields and their surfaces by plain geometry, for the tests of measuring."""

from collections.abc import Iterator
from itertools import permutations, product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from morphosim.kernels.moments import Fields, find_extents
from morphosim.kernels.sharing import shares_of
from morphosim.kernels.surfaces import Work

from .example_boxes import box, lay_out, put

LEVEL = 0.4
LOW_LEVEL = 0.15
SHAPES = ((4, 5, 6), (5, 4, 6), (5, 5, 4), (4, 4, 4))
ORIGINS = ((-2, -3, 4), (0, -1, 2), (1, 0, 20), (-1, 0, 3))
"""Two boxes that overlap, one far above them, and one for a faint field amid the two."""
FAINT = 3
CORNERS = np.array(list(product((0, 1), repeat=3)))
"""Corners of a cube, z fastest."""
TETRAHEDRA = [
    np.cumsum([np.zeros(3, int), *np.eye(3, dtype=int)[list(order)]], axis=0)
    for order in permutations(range(3))
]
"""Corners of the six tetrahedra of a cube."""


def random_fields(seed: int, dtype: type = np.float64, whole: bool = False) -> Fields:
    """Fields that also cross the levels at the faces of their boxes, and at the ends of spans.

    Of some rows a part is held, or nothing, if not the `whole` boxes are; elsewhere there is NaN.
    """
    rng = np.random.default_rng(seed)
    spans = [np.broadcast_to([0, nz], (nx, ny, 2)) for nx, ny, nz in SHAPES]
    if not whole:
        spans = [cut_short(rng, *shape) for shape in SHAPES]
    boxes, phi = lay_out(ORIGINS, SHAPES, spans, whole)
    for i, shape in enumerate(SHAPES):
        put(phi, boxes, i, rng.uniform(-0.1, 0.1 if i == FAINT else 1, shape))
    extent = np.full((len(SHAPES), 3, 2), 77)
    return Fields(phi.astype(dtype), *boxes, extent)


def cut_short(rng: np.random.Generator, nx: int, ny: int, nz: int) -> NDArray[np.int64]:
    """Spans of rows: most of all points, some of fewer, a few of none."""
    spans = np.tile([0, nz], (nx, ny, 1))
    for span in spans.reshape(-1, 2):
        if rng.random() < 0.3:
            span[:] = np.sort(rng.integers(0, nz + 1, 2))
    return spans


def with_extents(fields: Fields, level: float = LOW_LEVEL) -> Fields:
    """The same fields, their extents found."""
    find_extents(shares_of([0, len(fields.start)], threads=1), fields, level)
    return fields


def make_work(fields: Fields, threads: int) -> Work:
    """Scratch space with nothing sensible in it."""
    points = (fields.extent[:, :, 1] - fields.extent[:, :, 0] + 2).clip(min=1)
    longest = points[:, 2].max()
    return Work(
        np.full((threads, points.prod(axis=1).max()), np.nan, fields.phi.dtype),
        np.full((threads, longest), -7),
        np.full((threads, longest, 8), np.nan),
    )


class Piece(NamedTuple):
    """Surface in one cube: lattice position of its first corner, and what the tests compare."""

    corner: NDArray[np.int64]
    area: float
    centre: NDArray[np.float64]
    normal: NDArray[np.float64]
    volume: float
    """Share of this cube in the integral over the closed surface that gives the volume in it."""


def polygon(points: NDArray, values: NDArray, level: float) -> NDArray[np.float64]:
    """Corners, in order, of the surface in one tetrahedron; none if it does not cross it."""
    inside, outside = np.flatnonzero(values > level), np.flatnonzero(values <= level)
    edges = [(p, a) for p in inside for a in outside]
    if len(inside) == 2:
        edges = [edges[k] for k in (0, 1, 3, 2)]
    cuts = [
        points[p] + (values[p] - level) / (values[p] - values[a]) * (points[a] - points[p])
        for p, a in edges
    ]
    return np.array(cuts).reshape(-1, 3)


def triangles(values: NDArray, level: float) -> Iterator[NDArray[np.float64]]:
    """Triangles in one cube, seen counterclockwise from where φ is lower."""
    for corners in TETRAHEDRA:
        at = values[tuple(corners.T)]
        cuts = polygon(corners.astype(float), at, level)
        uphill = np.linalg.solve(np.diff(corners, axis=0).astype(float), np.diff(at))
        for k in range(1, len(cuts) - 1):
            a, b, c = cuts[0], cuts[k], cuts[k + 1]
            yield np.array([a, c, b] if np.cross(b - a, c - a) @ uphill > 0 else [a, b, c])


def pieces(fields: Fields, i: int, level: float) -> Iterator[Piece]:
    """Surface of cell i, cube by cube, its box in zeros."""
    phi = np.pad(box(fields.phi, fields, i).astype(float), 1)
    for place in np.ndindex(*(n - 1 for n in phi.shape)):
        values = phi[tuple(slice(p, p + 2) for p in place)]
        found = np.array(list(triangles(values, level)))
        if not len(found):
            continue
        a, b, c = np.moveaxis(found, 1, 0)
        areas = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
        a, b, c = (p + np.array(place) for p in (a, b, c))
        slope = np.array([np.diff(values, axis=axis).mean() for axis in range(3)])
        yield Piece(
            corner=fields.origin[i] + place - 1,
            area=areas.sum(),
            centre=(found.mean(axis=1) * areas[:, None]).sum(axis=0) / areas.sum(),
            normal=slope / np.linalg.norm(slope),
            volume=(a * np.cross(b, c)).sum() / 6,
        )
