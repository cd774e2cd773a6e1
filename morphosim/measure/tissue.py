"""Statistics of tissues: the region that cells fill, and how their centres lie in it."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from morphosim._shown import short_repr

Real = NDArray[np.float64]

FLAT = 0.25
"""Cells are one layer if their centres scatter about a plane by less than this share of a cell."""
RAYS = 1 << 13
"""Rays by which it is found how much of a shell around a cell lies within the region, at least."""
MOST_AT_ONCE = 1 << 18
"""Numbers in arrays of sides by cells."""
ROUNDS, CLOSE = 20, 1e-3
"""Newton iterations by which a region's sides are moved, at most, and the last one's share."""


@dataclass(frozen=True, slots=True, eq=False)
class Region:
    """Convex region of a tissue: the hull of the cells' centres, moved outwards.

    Centres of cells at the surface lie some half a cell inside of it. So all sides of the hull are
    moved outwards by one distance, such that the region has the volume of the cells. A tissue
    that fills less than the hull of its centres, as a hollow or bent one, has that hull as region.
    Sides of one layer of cells, whose areas are not known, are moved by half the spacing of cells.

    Attributes
    ----------
    points : (N, d) float64
        Centres of the cells, µm; for one layer of cells d = 2, in its plane.
    sides : (F, d + 1) float64
        A point x is inside where `sides[:, :d] @ x + sides[:, d]` is negative: minus the distance.
    volume : float
        µm³, or for one layer µm².
    """

    points: Real
    sides: Real
    volume: float

    __repr__ = short_repr

    @property
    def spacing(self) -> float:
        """Edge of a cube (of a square) of a cell's share of the region, µm."""
        return float((self.volume / len(self.points)) ** (1 / self.points.shape[1]))

    @property
    def depth(self) -> Real:
        """(N,) distance of each centre from the surface of the region, µm."""
        return np.concatenate(
            [-self._heights(some).max(axis=0) for some in self._parts(self.points)]
        )

    def reach(self, points: Real, directions: Real) -> Real:
        """(R,) distance from inner points (R, d) to the surface along unit vectors (R, d), µm."""
        found = []
        for some, ways in zip(self._parts(points), self._parts(directions), strict=True):
            inwards, towards = np.maximum(-self._heights(some), 0), self.sides[:, :-1] @ ways.T
            lengths = np.full_like(inwards, np.inf)
            np.divide(inwards, towards, out=lengths, where=towards > 0)
            found.append(lengths.min(axis=0))
        return np.concatenate(found)

    def _parts(self, rows: Real) -> list[Real]:
        """Rows in parts for which all sides can be looked at with little memory."""
        return np.array_split(rows, 1 + len(rows) * len(self.sides) // MOST_AT_ONCE)

    def _heights(self, points: Real) -> Real:
        """(F, R) distance of points outwards of each side."""
        return np.asarray(self.sides[:, :-1] @ points.T + self.sides[:, -1:])


def tissue_region(centroids: Real, volumes: Real) -> Region | None:
    """Region of cells in space, or of one layer of cells in its plane; None for very few cells.

    Parameters
    ----------
    centroids : (N, 3) float64, µm
    volumes : (N,) float64, µm³
    """
    if len(centroids) <= centroids.shape[1]:
        return None
    spread, axes = np.linalg.eigh(np.cov(centroids.T))
    if np.sqrt(np.maximum(spread[0], 0)) < FLAT * np.cbrt(volumes.mean()):
        return region_of(centroids @ axes[:, 1:])
    return region_of(centroids, float(volumes.sum()))


def region_of(points: Real, volume: float | None = None) -> Region | None:
    """Region of these centres; None where they span none.

    Parameters
    ----------
    points : (N, d) float64, µm
    volume : float, optional
        Of the region, µm³, or for d = 2 µm²; without one its sides are half a spacing beyond those
        of the hull.
    """
    from scipy.spatial import QhullError

    try:
        return _moved_hull(points, volume)
    except QhullError:
        return None


def _moved_hull(points: Real, volume: float | None) -> Region:
    """Region of these centres; QhullError where they span none."""
    from scipy.spatial import ConvexHull, HalfspaceIntersection

    hull, (count, space) = ConvexHull(points), points.shape
    sides, outwards, moved = np.unique(hull.equations, axis=0), np.eye(space + 1)[-1], 0.0
    for _ in range(ROUNDS if volume is None or hull.volume < volume else 0):
        if volume is None:
            further = (hull.volume / count) ** (1 / space) / 2 - moved
        else:
            further = (volume - hull.volume) / hull.area
        moved, sides = moved + further, sides - further * outwards
        hull = ConvexHull(HalfspaceIntersection(sides, points.mean(axis=0)).intersections)
        if abs(further) < CLOSE * moved:
            break
    return Region(points, sides, float(hull.volume))


def pair_correlation(region: Region, edges: Real) -> tuple[Real, NDArray[np.int64]]:
    """Pair correlation g(r) of the centres of cells in a finite region.

    The number of pairs of a distance, over what it would be if the others were anywhere in the
    region with the same chance: of each shell around a centre only that part counts which lies
    within the region (Ripley's correction of edges). It is found along rays from the centres,
    always the same ones.

    Parameters
    ----------
    region : Region
    edges : (B + 1,) float64
        Of the bins of distance, µm, ascending.

    Returns
    -------
    g : (B,) float64
    pairs : (B,) int64
        Number of pairs that it is of; the relative error by chance is about 1/√pairs.
    """
    from scipy.spatial import cKDTree

    points, (count, space) = region.points, region.points.shape
    tree = cKDTree(points)
    pairs = np.diff(tree.count_neighbors(tree, edges)) // 2
    rng = np.random.default_rng(0)
    starts = np.resize(rng.permutation(count), max(count, RAYS))
    directions = rng.normal(size=(len(starts), space))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    reach = region.reach(points[starts], directions)
    unit_ball = np.pi * (1 if space == 2 else 4 / 3)
    within = [unit_ball * (np.minimum(edge, reach) ** space).mean() for edge in edges]
    expected = np.diff(within) * count * (count - 1) / 2 / region.volume
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(pairs / np.where(expected > 0, expected, np.nan)), pairs


def periodic_pair_correlation(
    points: Real, lengths: Sequence[float], edges: Real
) -> tuple[Real, NDArray[np.int64]]:
    """Pair correlation of centres (N, 3) in space that repeats after these lengths, µm.

    Of each pair the nearest images count; beyond half the shortest length it is NaN. Otherwise as
    `pair_correlation`.
    """
    from scipy.spatial import cKDTree

    count, sides = len(points), np.asarray(lengths, float)
    tree = cKDTree(points % sides, boxsize=sides)
    known = edges <= sides.min() / 2
    within = np.where(known, tree.count_neighbors(tree, np.where(known, edges, 0.0)), 0)
    inside = known[1:]
    pairs = np.where(inside, np.diff(within) // 2, 0)
    shells = np.diff(4 / 3 * np.pi * edges**3)
    expected = shells * count * (count - 1) / 2 / sides.prod()
    return np.where(inside & (expected > 0), pairs / np.maximum(expected, 1e-300), np.nan), pairs


def binned(values: Real, places: Real, edges: Real) -> tuple[Real, Real, NDArray[np.int64]]:
    """Mean and standard deviation of values by bins of their places, and how many there are.

    NaN where there are none; values and places that are not known are left out. The last bin has
    its upper edge.
    """
    known = np.isfinite(values) & (places >= edges[0]) & (places <= edges[-1])
    values, places = values[known], places[known]
    bins = len(edges) - 1
    bin_of = np.minimum(np.searchsorted(edges, places, side="right") - 1, bins - 1)
    count = np.bincount(bin_of, minlength=bins)
    with np.errstate(invalid="ignore"):
        mean = np.bincount(bin_of, values, minlength=bins) / count
        square = np.bincount(bin_of, (values - mean[bin_of]) ** 2, minlength=bins) / count
    return np.asarray(mean), np.sqrt(square), count


def pieces(count: int, pairs: NDArray[Any], clone: NDArray[Any], clones: int) -> NDArray[np.int64]:
    """Number of connected pieces of each clone.

    Parameters
    ----------
    count : int
        Number of cells.
    pairs : (P, 2) int
        Cells in contact.
    clone : (N,) int
        Which clone each cell is of; negative of none.
    clones : int
        How many there are.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    joined = pairs[clone[pairs[:, 0]] == clone[pairs[:, 1]]]
    graph = coo_array((np.ones(len(joined)), joined.T), shape=(count, count))
    _, piece = connected_components(graph, directed=False)
    _, first = np.unique(piece, return_index=True)
    return np.bincount(clone[first][clone[first] >= 0], minlength=clones)
