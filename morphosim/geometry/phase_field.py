"""From shapes to phase fields on the lattice."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from morphosim.geometry.confinement import Confinement
from morphosim.geometry.shapes import Field, Shape
from morphosim.provenance import memory

Floats = NDArray[np.float64]
NEGLIGIBLE = 1e-5
"""Fields are laid out to where their profile falls below this."""
LEAST_POINTS = 27
"""A cell that is above 1/2 at fewer lattice points is not resolved: its radius is below 2 h."""
FARTHEST = 2**31
"""Cells lie within this many lattice points of the origin."""
KEPT_BYTES, START_BYTES = 8, 32
"""Least memory that a lattice point takes: of all cells, and of the cell whose field is made."""


def lattice_field(
    shape: Shape | Field, name: str, scale: float, spacing: float
) -> tuple[NDArray[np.int64], Floats]:
    """Lattice origin and phase field of a cell's start shape.

    Parameters
    ----------
    shape : Shape or Field
    name : of the cell, for the error
    scale : float
        √(c/2) in 1/µm, `Physics.interface_scale`.
    spacing : float, µm

    Returns
    -------
    origin : (3,) int64, lattice position of the first value
    phi : (nx, ny, nz) float64

    Raises
    ------
    ValueError
        The shape is too small for the lattice: its field exceeds 1/2 at too few points. Or it is
        too large for the memory, or too far out.
    """
    first, last = lattice_corners(shape, name, scale, spacing)
    check_memory(f"cell {name!r} takes", [float((last - first + 1.0).prod())], spacing)
    axes = [np.arange(a, b + 1) * spacing for a, b in zip(first, last, strict=True)]
    points = list(np.meshgrid(*axes, indexing="ij", sparse=True))
    if isinstance(shape, Field):
        origin, phi = first, shape.values(*points)
    else:
        origin, phi = first, _from_depth(shape, points, scale, spacing)
    check_resolved(
        phi, spacing, f"cell {name!r}: its start field",
        "make the shape larger, the spacing finer, or a mask's smoothing smaller",
    )  # fmt: skip
    return origin, phi


def check_resolved(phi: NDArray[np.floating], spacing: float, what: str, advice: str) -> None:
    """Raise ValueError if a field exceeds 1/2 at fewer points than a cell needs.

    Parameters
    ----------
    phi : (nx, ny, nz)
    spacing : float, µm
    what : whose field it is: the subject of the error
    advice : what to try
    """
    points = np.count_nonzero(phi > 0.5)
    if points < LEAST_POINTS:
        message = (
            f"{what} exceeds 0.5 at {points} points of a lattice of {spacing:g} µm, at least "
            f"{LEAST_POINTS} are needed; {advice}"
        )
        raise ValueError(message)


def share_outside(
    confinement: Confinement | None, origin: NDArray[np.int64], phi: Floats, spacing: float
) -> float:
    """Share of ∫ φ of a field on the lattice that lies beyond a confinement; 0 in open space."""
    if confinement is None:
        return 0.0
    axes = [(o + np.arange(n)) * spacing for o, n in zip(origin, phi.shape, strict=True)]
    walls = confinement.field(*np.meshgrid(*axes, indexing="ij", sparse=True))
    return float((phi * (walls > 0.5)).sum() / phi.sum())


def least_volume(spacing: float) -> float:
    """Volume in µm³ that a cell needs on a lattice of this spacing, µm."""
    return LEAST_POINTS * spacing**3


def lattice_corners(
    shape: Shape | Field, name: str, scale: float, spacing: float
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """First and last lattice point, (3,) each, of the box that a cell's start field takes.

    Raises
    ------
    ValueError
        The shape is too far out for the lattice.
    """
    tail = 0.0 if isinstance(shape, Field) else -np.log(NEGLIGIBLE) / (2 * scale)
    low, high = (
        (corner + s * tail) / spacing for corner, s in zip(shape.bounds(), (-1, 1), strict=True)
    )
    farthest = float(np.abs([low, high]).max())
    if farthest > FARTHEST:
        message = (
            f"cell {name!r} reaches to lattice point {farthest:.3g} of numerics.spacing = "
            f"{spacing:g} µm; at most {FARTHEST:g} is allowed. Take a coarser spacing, or move the "
            "cell to the origin"
        )
        raise ValueError(message)
    return np.floor(low + 1e-9).astype(np.int64), np.ceil(high - 1e-9).astype(np.int64)


def check_memory(what: str, points: Sequence[float], spacing: float) -> None:
    """Raise ValueError if boxes of so many lattice points do not fit into memory.

    Parameters
    ----------
    what : what takes them, the subject of the error
    points : of each cell
    spacing : float, µm
    """
    needed = KEPT_BYTES * sum(points) + START_BYTES * max(points)
    if needed > memory():
        message = (
            f"{what} {sum(points):.3g} lattice points at numerics.spacing = {spacing:g} µm, at "
            f"least {needed / 1e9:.3g} GB of memory; there are {memory() / 1e9:.3g} GB. Take a "
            "coarser spacing, or smaller cells"
        )
        raise ValueError(message)


def _from_depth(shape: Shape, points: list[Floats], scale: float, spacing: float) -> Floats:
    """φ = (1 + tanh(scale (depth + shift))) / 2 with the shift that gives the shape's volume."""
    depth = np.ascontiguousarray(np.broadcast_to(shape.depth(*points), _grid_shape(points)))
    shift = 0.0 if shape.exact else volume_shift(depth, shape.volume, scale, spacing)
    return profile(depth + shift, scale)


def _grid_shape(points: list[Floats]) -> tuple[int, ...]:
    return np.broadcast_shapes(*(p.shape for p in points))


def profile(depth: Floats, scale: float) -> Floats:
    """Equilibrium interface (1 + tanh(scale · depth)) / 2."""
    return np.asarray(0.5 * (1 + np.tanh(scale * depth)))


def volume_shift(depth: Floats, volume: float, scale: float, spacing: float) -> float:
    """Displacement of the surface, µm, at which ∫ φ is `volume`."""
    from scipy.optimize import brentq

    def excess(shift: float) -> float:
        return float(profile(depth + shift, scale).sum() * spacing**3 - volume)

    reach = 5.0
    return float(brentq(excess, -reach, reach, xtol=1e-6))
