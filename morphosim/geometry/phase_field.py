"""From shapes to phase fields on the lattice."""

import numpy as np
from numpy.typing import NDArray

from morphosim.geometry.shapes import Field, Shape

Floats = NDArray[np.float64]
NEGLIGIBLE = 1e-5
"""Fields are laid out to where their profile falls below this."""
LEAST_POINTS = 27
"""A cell that is above 1/2 at fewer lattice points is not resolved: its radius is below 2 h."""


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
        The shape is too small for the lattice: its field exceeds 1/2 at too few points.
    """
    if isinstance(shape, Field):
        origin, phi = _from_field(shape, spacing)
    else:
        origin, phi = _from_depth(shape, scale, spacing)
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


def least_volume(spacing: float) -> float:
    """Volume in µm³ that a cell needs on a lattice of this spacing, µm."""
    return LEAST_POINTS * spacing**3


def _axes(low: Floats, high: Floats, spacing: float) -> tuple[NDArray[np.int64], list[Floats]]:
    """Lattice points between two corners: first index, and coordinates per axis (open grid)."""
    first = np.floor(low / spacing + 1e-9).astype(np.int64)
    last = np.ceil(high / spacing - 1e-9).astype(np.int64)
    axes = [np.arange(a, b + 1) * spacing for a, b in zip(first, last, strict=True)]
    return first, list(np.meshgrid(*axes, indexing="ij", sparse=True))


def _from_field(shape: Field, spacing: float) -> tuple[NDArray[np.int64], Floats]:
    low, high = shape.bounds()
    origin, points = _axes(low, high, spacing)
    return origin, shape.values(*points)


def _from_depth(shape: Shape, scale: float, spacing: float) -> tuple[NDArray[np.int64], Floats]:
    """φ = (1 + tanh(scale (depth + shift))) / 2 with the shift that gives the shape's volume."""
    tail = -np.log(NEGLIGIBLE) / (2 * scale)
    low, high = shape.bounds()
    origin, points = _axes(low - tail, high + tail, spacing)
    depth = np.ascontiguousarray(np.broadcast_to(shape.depth(*points), _grid_shape(points)))
    shift = 0.0 if shape.exact else volume_shift(depth, shape.volume, scale, spacing)
    return origin, profile(depth + shift, scale)


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
