"""Laguerre (power) partition of a confinement into cells of given volumes.

Cell i is the part of its power cell that lies in the ball of radius √w_i and in the confinement.
The weights that give all cells their volumes maximise a concave function (Aurenhammer, Hoffmann &
Aronov 1998, doi:10.1007/PL00009187); the balls let cells fill less than the confinement (partial
optimal transport, Lévy 2022, doi:10.1016/j.jcp.2021.110838).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from morphosim import _validate
from morphosim._shown import short_repr
from morphosim.geometry.confinement import Confinement

Floats = NDArray[np.float64]
SAMPLES_PER_RADIUS = 8
"""Sampling points along the radius of the ball of a cell's volume."""
TOLERANCE = 1e-3
"""Relative error at which a cell's sampled volume is accepted."""
MAX_STEPS = 100


@dataclass(frozen=True, slots=True, kw_only=True)
class PowerPartition:
    """Cells as power cells cut by balls.

    Attributes
    ----------
    points : (N, 3) µm
    weights : (N,) µm², squared radii of the balls
    """

    points: Floats
    weights: Floats

    __repr__ = short_repr

    def signed_distance(self, cell: int, x: Floats, y: Floats, z: Floats) -> Floats:
        """Depth below the nearest face of a cell, µm, positive inside; walls are not faces."""
        return self.nearest_face(cell, x, y, z)[0]

    def nearest_face(
        self, cell: int, x: Floats, y: Floats, z: Floats
    ) -> tuple[Floats, NDArray[np.int64]]:
        """Depth, and the cell behind the nearest face; the cell itself where that is its ball.

        A radical plane that does not cut the ball is never nearest and is left out.
        """
        p, w = self.points, self.weights
        radius = np.sqrt(max(w[cell], 0.0))
        u, v, s = x - p[cell, 0], y - p[cell, 1], z - p[cell, 2]
        depth = np.asarray(radius - np.sqrt(u * u + v * v + s * s))
        behind = np.full(depth.shape, cell)
        apart = p - p[cell]
        distance = np.linalg.norm(apart, axis=1)
        distance[cell] = np.inf
        offset = 0.5 * (distance + (w[cell] - w) / distance)
        for j in np.flatnonzero(offset < radius):
            n = apart[j] / distance[j]
            face = offset[j] - n[0] * u - n[1] * v - n[2] * s
            closer = face < depth
            depth = np.where(closer, face, depth)
            behind[closer] = j
        return depth, behind


def power_partition(
    points: ArrayLike, volumes: ArrayLike, confinement: Confinement | None
) -> PowerPartition:
    """Power partition of a confinement (None: open space) with given volumes.

    Parameters
    ----------
    points : (N, 3) µm
    volumes : (N,) µm³
    confinement : Confinement or None

    Raises
    ------
    ValueError
        Points or volumes are malformed, a point lies outside of the confinement, two points
        coincide, or the volumes do not fit.
    """
    p = _validate.array("positions", points, (None, 3))
    wanted = _validate.array("volumes", volumes, (len(p),))
    for i, volume in enumerate(wanted):
        _validate.number(f"volumes[{i}]", volume, above=0)
    _check_apart(p)
    if confinement is not None:
        _check_fit(p, wanted, confinement)
    weights = np.cbrt(3 * wanted / (4 * np.pi)) ** 2
    return PowerPartition(points=p, weights=_solve(p, wanted, weights, confinement))


def _check_apart(points: Floats) -> None:
    from scipy.spatial import cKDTree

    for i, j in sorted(cKDTree(points).query_pairs(1e-6)):
        message = f"positions {i} and {j} coincide at {points[i].tolist()}; move one of them"
        raise ValueError(message)


def _check_fit(points: Floats, volumes: Floats, confinement: Confinement) -> None:
    for i in np.flatnonzero(confinement.depth(*points.T) <= 0):
        message = f"positions[{i}] = {points[i].tolist()} µm lies outside of the confinement"
        raise ValueError(message)
    low, high = confinement.bounds()
    axes = [a + (np.arange(64) + 0.5) * (b - a) / 64 for a, b in zip(low, high, strict=True)]
    inside = confinement.depth(*np.meshgrid(*axes, indexing="ij", sparse=True)) > 0
    capacity = float(inside.mean() * np.prod(high - low))
    if volumes.sum() >= 0.99 * capacity:
        message = (
            f"the volumes sum to {volumes.sum():.6g} µm³ and the confinement holds "
            f"{capacity:.6g} µm³; scale the volumes down or enlarge the confinement"
        )
        raise ValueError(message)


def _solve(
    points: Floats, wanted: Floats, weights: Floats, confinement: Confinement | None
) -> Floats:
    """Weights at which all volumes are reached: Newton's method on the concave dual."""
    reached, stiffness = _volumes(points, weights, wanted, confinement)
    for _ in range(MAX_STEPS):
        error = float(np.max(np.abs(wanted - reached) / wanted))
        if error <= TOLERANCE:
            return weights
        # A ball's derivative 2πR of volume by weight lets cells without faces grow.
        damping = 0.1 * min(1.0, error) * 2 * np.pi * np.cbrt(3 * wanted / (4 * np.pi))
        step = np.linalg.solve(stiffness + np.diag(damping), wanted - reached)
        for _ in range(20):
            trial = weights + step
            reached, stiffness = _volumes(points, trial, wanted, confinement)
            # The dual is concave: half way back if the step goes far beyond its maximum.
            if (wanted - reached) @ step >= -0.5 * np.abs(wanted - reached) @ np.abs(step):
                break
            step = step / 2
        weights = trial
    worst = int(np.argmax(np.abs(wanted - reached) / wanted))
    message = (
        f"no power partition found: cell {worst} has {reached[worst]:.6g} of {wanted[worst]:.6g} "
        "µm³; move points apart or from the wall, or make the volumes smaller"
    )
    raise ValueError(message)


def _volumes(
    points: Floats, weights: Floats, wanted: Floats, confinement: Confinement | None
) -> tuple[Floats, Floats]:
    """Volumes reached, and the (N, N) matrix of their derivatives by the weights."""
    partition = PowerPartition(points=points, weights=weights)
    n = len(points)
    reached, area = np.zeros(n), np.zeros((n, n))
    for i in range(n):
        spacing = np.cbrt(3 * wanted[i] / (4 * np.pi)) / SAMPLES_PER_RADIUS
        reached[i], area[i] = _measure(partition, i, spacing, confinement)
    distance = np.linalg.norm(points[:, None] - points[None], axis=2)
    np.fill_diagonal(distance, np.inf)
    coupling = (area + area.T) / (4 * distance)
    ball = area.diagonal() / (2 * np.sqrt(np.maximum(weights, 1e-12)))
    return reached, np.diag(coupling.sum(axis=1) + ball) - coupling


def _measure(
    partition: PowerPartition, i: int, spacing: float, confinement: Confinement | None
) -> tuple[float, Floats]:
    """Volume of a cell (µm³) and areas (µm²) of its faces towards each cell, its ball its own.

    Occupancy rises with depth over four spacings by a fourth-order smooth step, so that curved
    faces do not bias the volume.
    """
    n = len(partition.points)
    if partition.weights[i] <= 0:
        return 0.0, np.zeros(n)
    half = int(np.ceil(np.sqrt(partition.weights[i]) / spacing)) + 2
    offsets = np.arange(-half, half + 1) * spacing
    axes = [p + offsets for p in partition.points[i]]
    grid = np.meshgrid(*axes, indexing="ij", sparse=True)
    depth, behind = partition.nearest_face(i, *grid)
    wall = np.inf if confinement is None else confinement.depth(*grid)
    shallow = np.minimum(depth, wall)
    u = np.clip(shallow / (2 * spacing), -1, 1)
    volume = (0.5 + u * (45 - 50 * u**2 + 21 * u**4) / 32).sum() * spacing**3
    face = (np.abs(depth) < spacing) & (depth < wall)
    counts = np.bincount(behind[face], minlength=n)
    return float(volume), counts * spacing**2 / 2
