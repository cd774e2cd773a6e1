"""Laguerre (power) partition of a confinement into cells of given volumes.

Cell ``i`` is the part of its power cell that lies in the ball of radius ``sqrt(w_i)`` and in the
confinement. The weights ``w`` that give all cells their volumes maximise a concave function
(Aurenhammer, Hoffmann & Aronov 1998, doi:10.1007/PL00009187). The ball makes the optimal transport
partial: cells may fill less than the confinement (Levy 2022, doi:10.1016/j.jcp.2021.110838).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist

FloatArray: TypeAlias = npt.NDArray[np.float64]
IntArray: TypeAlias = npt.NDArray[np.int64]
Inside: TypeAlias = Callable[[FloatArray, FloatArray, FloatArray], npt.ArrayLike]

_CLOSEST_UM = 1e-6  # two points closer than this coincide
_MAX_SAMPLES = 20_000_000  # of the lattice in the box
_SLAB_SAMPLES = 1_000_000  # given to `inside` in one call
_SAMPLES_PER_RADIUS = 8.0  # at least, of a cell's lattice
_MAX_SAMPLES_PER_RADIUS = 40.0  # in open space
_HALF_WIDTH = 2.0  # of the smoothed cell edge, in lattice spacings
_BLOCK = 4  # samples along each side of the blocks that locate a cell
_SPLIT = 4  # samples along each side of a voxel at the wall
_SHIFTS = (0.7548776662466927, 0.5698402909980532)  # 1/r and 1/r^2 with r^3 = r + 1
_COARSE_TOLERANCE, _COARSE_STEPS, _MAX_STEPS, _MAX_CUTS = 5e-3, 30, 100, 20


@dataclass(frozen=True, slots=True, kw_only=True)
class PowerPartition:
    """Cells as power cells cut by balls.

    Attributes
    ----------
    points
        Position of each cell's nucleus, shape (N, 3), in um.
    weights
        Squared radius of each cell's ball, shape (N,), in um^2.
    """

    points: FloatArray
    weights: FloatArray

    def signed_distance(
        self, cell: int, x: npt.ArrayLike, y: npt.ArrayLike, z: npt.ArrayLike
    ) -> FloatArray:
        """Return the depth below the nearest face of a cell; the confinement is not a face.

        Parameters
        ----------
        cell
            Index of the cell, 0 to N - 1.
        x, y, z
            Coordinates in um; their shapes must broadcast.

        Returns
        -------
        FloatArray
            Depth in um, positive inside the cell, of the broadcast shape.

        Raises
        ------
        IndexError
            If there is no such cell.
        """
        count = len(self.points)
        if not 0 <= cell < count:
            message = f"cell is {cell}; it must be 0 to {count - 1}"
            raise IndexError(message)
        axes = (np.asarray(x, float), np.asarray(y, float), np.asarray(z, float))
        return _depth(self.points, self.weights, cell, axes)[0]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Lattice:
    """Sample points at voxel centres; ``share`` is the confinement's part of each voxel."""

    lower: FloatArray  # (3,) um
    spacing: FloatArray  # (3,) um
    share: FloatArray | None  # (nx, ny, nz); None: open space

    @property
    def capacity(self) -> float:
        """Volume of the confinement, in um^3."""
        if self.share is None:
            return float("inf")
        return float(self.share.sum() * self.spacing.prod())

    def coarsened(self) -> _Lattice:
        """Return the lattice of twice the spacing and of the same capacity."""
        merged = self.share
        if merged is not None:
            merged = np.pad(merged, [(0, size % 2) for size in merged.shape])
            nx, ny, nz = (size // 2 for size in merged.shape)
            merged = _sharpened(merged.reshape(nx, 2, ny, 2, nz, 2).mean(axis=(1, 3, 5)), 1 / 32)
        return _Lattice(lower=self.lower, spacing=2 * self.spacing, share=merged)

    def span(self, centre: FloatArray, reach: float) -> tuple[IntArray, IntArray]:
        """Return the first index, and the one after the last, of the samples around a point."""
        first = np.floor((centre - reach - self.lower) / self.spacing).astype(np.int64)
        last = np.ceil((centre + reach - self.lower) / self.spacing).astype(np.int64)
        if self.share is None:
            return first, last
        return np.clip(first, 0, self.share.shape), np.clip(last, 0, self.share.shape)

    def axes(self, first: IntArray, last: IntArray, stride: int = 1) -> tuple[FloatArray, ...]:
        """Return coordinates (um) of samples, or of centres of blocks, as broadcastable arrays."""
        index = np.ix_(*(np.arange(a, b, stride) for a, b in zip(first, last, strict=True)))
        return tuple(
            low + (i + 0.5 * stride) * step
            for low, step, i in zip(self.lower, self.spacing, index, strict=True)
        )

    def mass(self, first: IntArray, last: IntArray) -> FloatArray:
        """Return the volume (um^3) that each sample stands for, of broadcastable shape."""
        volume = self.spacing.prod()
        if self.share is None:
            return np.full((1, 1, 1), volume)
        window = tuple(slice(a, b) for a, b in zip(first, last, strict=True))
        return np.asarray(self.share[window] * volume)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Problem:
    """Cells, their volumes, and the lattice that measures each."""

    points: FloatArray  # (N, 3) um
    volumes: FloatArray  # (N,) um^3
    lattices: list[_Lattice]


def power_partition(
    points: npt.ArrayLike,
    volumes: npt.ArrayLike,
    inside: Inside | None,
    lower: npt.ArrayLike | None,
    upper: npt.ArrayLike | None,
    *,
    spacing: float = 0.5,
    tolerance: float = 1e-3,
) -> PowerPartition:
    """Divide a confinement into cells of given volumes around given points.

    The region of cell ``i`` is the set of ``x`` in the confinement where
    ``|x - p_i|^2 - w_i`` is negative and no larger than that of any other cell.
    The regions are disjoint, and each is convex if the confinement is convex.

    Parameters
    ----------
    points
        Nuclei, shape (N, 3), in um.
    volumes
        Volume of each cell, shape (N,), in um^3.
    inside
        Function of x, y, z (um, arrays of one shape) that is true, or the fraction 1,
        in the confinement. None: open space.
    lower, upper
        Corners of the box that is sampled, shape (3,), in um. Cells end at a given box.
        None: open space has no box; around a confinement it is chosen from points and volumes.
    spacing
        Distance of volume samples, in um. It is made finer around cells of few samples, and
        coarser for very large cells in open space.
    tolerance
        Largest relative error of a cell's volume. Sampling adds about 2e-4 at 13 spacings per
        cell radius.

    Returns
    -------
    PowerPartition
        The points and their weights.

    Raises
    ------
    ValueError
        If an argument is malformed, a point lies outside the confinement, or the volumes do not
        fit in the confinement.
    RuntimeError
        If the volumes were not reached.
    """
    points, volumes = _checked_cells(points, volumes)
    _check_positive("spacing", spacing)
    _check_positive("tolerance", tolerance)
    base = _make_lattice(points, volumes, inside, lower, upper, spacing)
    _check_capacity(volumes, base.capacity)
    coarse, fine = (
        _Problem(points=points, volumes=volumes, lattices=lattices)
        for lattices in _cell_lattices(volumes, base, spacing)
    )
    weights, _ = _solve(coarse, _radii(volumes) ** 2, _COARSE_TOLERANCE, _COARSE_STEPS)
    weights, reached = _solve(fine, weights, tolerance / 5, _MAX_STEPS)
    _check_reached(volumes, reached, tolerance, spacing)
    return PowerPartition(points=points, weights=weights)


def _radii(volumes: FloatArray) -> FloatArray:
    """Return the radii (um) of balls of the given volumes (um^3)."""
    return np.asarray(np.cbrt(3 * volumes / (4 * np.pi)), dtype=np.float64)


def _depth(
    points: FloatArray, weights: FloatArray, cell: int, axes: tuple[FloatArray, ...]
) -> tuple[FloatArray, IntArray]:
    """Return the depth (um) below a cell's faces and the neighbour behind the nearest face.

    The neighbour is the cell itself where the nearest face is its ball.
    """
    neighbours, normals, offsets = _faces(points, weights, cell)
    x, y, z = (axes[k] - points[cell, k] for k in range(3))
    radius = np.sqrt(max(weights[cell], 0.0))
    depth = np.array(radius - np.sqrt(x * x + y * y + z * z))
    nearest = np.full(depth.shape, cell)
    for neighbour, normal, offset in zip(neighbours, normals, offsets, strict=True):
        face = (offset - normal[0] * x) - normal[1] * y - normal[2] * z
        closer = face < depth
        np.copyto(depth, face, where=closer)
        nearest[closer] = neighbour
    return depth, nearest


def _faces(
    points: FloatArray, weights: FloatArray, cell: int
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return neighbours, unit normals and distances (um) of the radical planes that cut the ball.

    A plane outside the ball is never the nearest face, so leaving it out is exact.
    """
    separation = points - points[cell]
    distance = np.linalg.norm(separation, axis=1)
    distance[cell] = np.inf
    offset = 0.5 * (distance + (weights[cell] - weights) / distance)
    cutting = np.flatnonzero(offset < np.sqrt(max(weights[cell], 0.0)))
    return cutting, separation[cutting] / distance[cutting, None], offset[cutting]


def _measure(
    points: FloatArray, weights: FloatArray, cell: int, lattice: _Lattice
) -> tuple[float, FloatArray]:
    """Return a cell's volume (um^3) and its face area (um^2) towards each cell, shape (N,).

    The area towards itself is that of its ball. Occupancy falls from 1 to 0 across a face as the
    integral of the kernel ``15/32 (7 u^4 - 10 u^2 + 3)``. The kernel's second moment is zero, so
    curved faces, edges and corners do not bias the volume.
    """
    if weights[cell] <= 0:
        return 0.0, np.zeros(len(points))
    width = _HALF_WIDTH * float(lattice.spacing.max())
    first, last = _window(points, weights, cell, lattice, width)
    mass = lattice.mass(first, last)
    depth, nearest = _depth(points, weights, cell, lattice.axes(first, last))
    u = np.clip(depth / width, -1, 1)
    volume = np.sum(mass * (0.5 + u * (45 - 50 * u**2 + 21 * u**4) / 32))
    edge = np.abs(u) < 1
    u, mass = u[edge], np.broadcast_to(mass, edge.shape)[edge]
    density = mass * (15 / 32) * (7 * u**4 - 10 * u**2 + 3) / width
    return float(volume), np.bincount(nearest[edge], weights=density, minlength=len(points))


def _window(
    points: FloatArray, weights: FloatArray, cell: int, lattice: _Lattice, width: float
) -> tuple[IntArray, IntArray]:
    """Return the index range of the samples within ``width`` (um) of a cell.

    Depth changes by at most the distance, so its value at a block's centre bounds it in the block.
    """
    first, last = lattice.span(points[cell], float(np.sqrt(weights[cell])) + width)
    depth, _ = _depth(points, weights, cell, lattice.axes(first, last, _BLOCK))
    near = np.argwhere(depth > -width - 0.5 * _BLOCK * np.linalg.norm(lattice.spacing))
    if not len(near):
        return first, first
    return (
        first + _BLOCK * near.min(axis=0),
        np.minimum(first + _BLOCK * (near.max(axis=0) + 1), last),
    )


def _volumes_and_stiffness(problem: _Problem, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the volumes reached (um^3) and their derivative by the weights, (N, N) in um."""
    points = problem.points
    measured = [_measure(points, weights, i, own) for i, own in enumerate(problem.lattices)]
    reached = np.array([volume for volume, _ in measured])
    area = np.array([row for _, row in measured])
    distance = cdist(points, points)
    np.fill_diagonal(distance, np.inf)
    coupling = np.maximum(area + area.T, 0) / (4 * distance)
    ball = np.maximum(area.diagonal(), 0) / (2 * np.sqrt(np.maximum(weights, 1e-12)))
    return reached, np.diag(coupling.sum(axis=1) + ball) - coupling


def _solve(
    problem: _Problem, weights: FloatArray, tolerance: float, max_steps: int
) -> tuple[FloatArray, FloatArray]:
    """Return the weights (um^2) that give the volumes, and the volumes reached (um^3).

    Newton's method on the concave dual. Far from the solution a diagonal term, scaled by a ball's
    derivative 2 pi R of volume by weight, lets cells without volume grow.
    """
    volumes = problem.volumes
    reached, stiffness = _volumes_and_stiffness(problem, weights)
    for _ in range(max_steps):
        error = np.abs(volumes - reached) / volumes
        if error.max() <= tolerance:
            break
        damping = 0.1 * min(1.0, float(error.max())) * 2 * np.pi * _radii(volumes)
        step = np.linalg.solve(stiffness + np.diag(damping), volumes - reached)
        weights, reached, stiffness = _line_search(problem, weights, volumes - reached, step)
    return weights, reached


def _line_search(
    problem: _Problem, weights: FloatArray, gradient: FloatArray, step: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Shorten a step until it does not go far beyond the dual's maximum along it.

    The gradient is the volume missing. The dual is concave: the slope along the step only falls.
    """
    slope, scale = float(gradient @ step), 1.0
    for _ in range(_MAX_CUTS):
        trial = weights + scale * step
        reached, stiffness = _volumes_and_stiffness(problem, trial)
        trial_slope = float((problem.volumes - reached) @ step)
        if trial_slope >= -0.5 * slope:
            break
        scale *= max(0.1, slope / (slope - trial_slope))
    return trial, reached, stiffness


def _cell_lattices(
    volumes: FloatArray, base: _Lattice, spacing: float
) -> tuple[list[_Lattice], list[_Lattice]]:
    """Return each cell's lattice for a first solution, and its finer one for the final one."""
    wanted = np.minimum(spacing, _radii(volumes) / _SAMPLES_PER_RADIUS)
    ratio = np.maximum(wanted / base.spacing.max(), 1.0)
    level = np.floor(np.log2(ratio)).astype(int)
    lattices = [base]
    for _ in range(int(level.max()) + 1):
        lattices.append(lattices[-1].coarsened())
    return [lattices[k + 1] for k in level], [lattices[k] for k in level]


def _make_lattice(
    points: FloatArray,
    volumes: FloatArray,
    inside: Inside | None,
    lower: npt.ArrayLike | None,
    upper: npt.ArrayLike | None,
    spacing: float,
) -> _Lattice:
    """Return the finest lattice that a cell needs, in the box or in open space."""
    radii = _radii(volumes)
    finest = min(spacing, float(radii.min()) / _SAMPLES_PER_RADIUS)
    if inside is None and lower is None and upper is None:
        finest = max(finest, float(radii.max()) / _MAX_SAMPLES_PER_RADIUS)
        return _Lattice(lower=np.zeros(3), spacing=np.full(3, finest), share=None)
    margin = 2 * _radii(volumes.sum())
    low = _checked_corner("lower", lower, points.min(axis=0) - margin)
    high = _checked_corner("upper", upper, points.max(axis=0) + margin)
    _check_box(points, low, high, spacing)
    finest = max(finest, float(np.cbrt(np.prod(high - low) / _MAX_SAMPLES)))
    shape = np.ceil((high - low) / finest - 1e-9).astype(int)
    step = (high - low) / shape
    if inside is None:
        return _Lattice(lower=low, spacing=step, share=np.ones(shape))
    _check_inside(points, inside)
    share = _sharpened(_fractions(inside, low, step, tuple(shape)), 1 / 24)
    return _Lattice(lower=low, spacing=step, share=share)


def _sharpened(mean: FloatArray, factor: float) -> FloatArray:
    """Return voxel means minus ``factor`` times their second differences; the sum is kept.

    The factor 1/24 makes voxel means into values at voxel centres, to fourth order. The mean of
    eight such values needs another 1/32 of the second differences over twice the spacing.
    """
    sharp = mean.copy()
    for axis in range(3):
        change = factor * np.diff(mean, axis=axis)
        values = np.moveaxis(sharp, axis, 0)
        values[:-1] -= np.moveaxis(change, axis, 0)
        values[1:] += np.moveaxis(change, axis, 0)
    return sharp


def _fractions(
    inside: Inside, lower: FloatArray, step: FloatArray, shape: tuple[int, ...]
) -> FloatArray:
    """Return the confinement's part of each voxel: one sample, or 4 x 4 x 4 samples at the wall."""
    fraction = np.empty(shape)
    slabs = np.array_split(np.arange(shape[0]), fraction.size // _SLAB_SAMPLES + 1)
    for slab in (slab for slab in slabs if slab.size):
        index = np.ix_(slab, np.arange(shape[1]), np.arange(shape[2]))
        fraction[slab] = _evaluate(
            inside, *(lower[k] + (index[k] + 0.5) * step[k] for k in range(3))
        )
    wall = np.nonzero(_wall(fraction))
    fraction[wall] = 0.0
    for part in np.ndindex(_SPLIT, _SPLIT, _SPLIT):
        fine = [_SPLIT * wall[k] + part[k] for k in range(3)]
        # Samples in planes would misplace a flat wall along the lattice: spread them.
        shift = [(fine[k - 2] * _SHIFTS[0] + fine[k - 1] * _SHIFTS[1]) % 1 for k in range(3)]
        axes = [lower[k] + (fine[k] + shift[k]) * step[k] / _SPLIT for k in range(3)]
        fraction[wall] += _evaluate(inside, *axes) / _SPLIT**3
    return fraction


def _wall(fraction: FloatArray) -> npt.NDArray[np.bool_]:
    """Return the voxels that differ from a neighbour along an axis, or are partly inside."""
    wall = (fraction > 0) & (fraction < 1)
    for axis in range(3):
        values, marks = np.moveaxis(fraction, axis, 0), np.moveaxis(wall, axis, 0)
        change = values[1:] != values[:-1]
        marks[1:] |= change
        marks[:-1] |= change
    return wall


def _evaluate(inside: Inside, x: FloatArray, y: FloatArray, z: FloatArray) -> FloatArray:
    """Return ``inside`` as fractions, checked."""
    x, y, z = np.broadcast_arrays(x, y, z)
    value = np.broadcast_to(np.asarray(inside(x, y, z), dtype=float), x.shape)
    low, high = float(value.min()), float(value.max())
    if not (low >= 0 and high <= 1):
        message = (
            f"inside returned values from {low:g} to {high:g}; "
            "it must return booleans or fractions 0 to 1"
        )
        raise ValueError(message)
    return value


def _checked_cells(points: npt.ArrayLike, volumes: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Return points and volumes as arrays of matching shapes, checked."""
    point_array = np.array(points, dtype=float)
    volume_array = np.array(volumes, dtype=float)
    if point_array.ndim != 2 or point_array.shape[1] != 3 or not len(point_array):
        message = f"points has shape {point_array.shape}; it must be (N, 3) with N at least 1"
        raise ValueError(message)
    if volume_array.shape != (len(point_array),):
        message = (
            f"volumes has shape {volume_array.shape}; it must be ({len(point_array)},), "
            "one for each point"
        )
        raise ValueError(message)
    _check_points(point_array)
    for i, volume in enumerate(volume_array):
        _check_positive(f"volume of cell {i}", volume)
    return point_array, volume_array


def _check_points(points: FloatArray) -> None:
    """Raise ValueError unless points are finite and apart."""
    for i in np.flatnonzero(~np.isfinite(points).all(axis=1)):
        message = f"point {i} is {_position(points[i])}; coordinates must be finite"
        raise ValueError(message)
    for i, j in sorted(cKDTree(points).query_pairs(_CLOSEST_UM)):
        message = (
            f"points {i} and {j} coincide at {_position(points[i])}; "
            f"points must be at least {_CLOSEST_UM:g} um apart"
        )
        raise ValueError(message)


def _check_positive(name: str, value: float) -> None:
    """Raise ValueError unless a value is finite and positive."""
    if not (np.isfinite(value) and value > 0):
        message = f"{name} is {value}; it must be finite and positive"
        raise ValueError(message)


def _checked_corner(name: str, value: npt.ArrayLike | None, default: FloatArray) -> FloatArray:
    """Return a corner of the box (um), checked."""
    corner = default if value is None else np.array(value, dtype=float)
    if corner.shape != (3,) or not np.isfinite(corner).all():
        message = f"{name} is {value}; it must be three finite coordinates in um, or None"
        raise ValueError(message)
    return corner


def _check_box(points: FloatArray, lower: FloatArray, upper: FloatArray, spacing: float) -> None:
    """Raise ValueError unless the box contains the points and its lattice fits in memory."""
    for i in np.flatnonzero(~((lower < points) & (points < upper)).all(axis=1)):
        message = (
            f"point {i} at {_position(points[i])} is outside the box from lower {_position(lower)} "
            f"to upper {_position(upper)}; move the point, or change lower or upper"
        )
        raise ValueError(message)
    samples = np.prod((upper - lower) / spacing)
    if samples > _MAX_SAMPLES:
        message = (
            f"spacing {spacing:g} um makes {samples:.3g} samples of the box; at most "
            f"{_MAX_SAMPLES:.3g} are allowed; increase spacing, or give closer lower and upper"
        )
        raise ValueError(message)


def _check_inside(points: FloatArray, inside: Inside) -> None:
    """Raise ValueError unless all points are in the confinement."""
    for i in np.flatnonzero(_evaluate(inside, *points.T) < 0.5):
        message = (
            f"point {i} at {_position(points[i])} is outside the confinement; "
            "move it in, or check the confinement's place and units (um)"
        )
        raise ValueError(message)


def _check_capacity(volumes: FloatArray, capacity: float) -> None:
    """Raise ValueError unless the cells fit in the confinement."""
    total = float(volumes.sum())
    if total >= capacity:
        message = (
            f"the volumes sum to {total:.6g} um^3 and the confinement holds {capacity:.6g} um^3; "
            "the sum must be less: scale the volumes down or use a larger confinement"
        )
        raise ValueError(message)


def _check_reached(
    volumes: FloatArray, reached: FloatArray, tolerance: float, spacing: float
) -> None:
    """Raise RuntimeError naming the cells that do not have their volumes."""
    error = np.abs(reached - volumes) / volumes
    wrong = [int(i) for i in np.argsort(-error) if error[i] > tolerance]
    if wrong:
        cells = ", ".join(f"cell {i}: {reached[i]:.6g} of {volumes[i]:.6g} um^3" for i in wrong[:5])
        message = (
            f"{len(wrong)} of {len(volumes)} cells did not reach their volumes within "
            f"{tolerance:g} ({cells}); try a spacing below {spacing:g} um, a larger tolerance, "
            "points further apart, or less total volume"
        )
        raise RuntimeError(message)


def _position(point: FloatArray) -> str:
    """Return a position as text, in um."""
    return "({:.6g}, {:.6g}, {:.6g}) um".format(*point)
