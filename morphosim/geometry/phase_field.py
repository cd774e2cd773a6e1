"""From shapes to phase fields on the lattice."""

import math

import numpy as np
from numpy.typing import NDArray

from morphosim import _validate
from morphosim.geometry.confinement import Confinement
from morphosim.geometry.shapes import Field, Shape
from morphosim.provenance import memory

Floats = NDArray[np.float64]
NEGLIGIBLE = 1e-5
"""Fields are laid out to where their profile falls below this."""
LEAST_POINTS = 27
"""A cell that is above 1/2 at fewer lattice points is not resolved: its radius is below 2 h."""
BALL_ERROR = 1e-4
"""Share of the volume by which a start field may be off."""
FARTHEST = 2**31
"""Cells lie within this many lattice points of the origin."""
TAIL = 9.0
"""Farther out than this over the scale, φ = (1 + tanh(scale depth)) / 2 is below 2e-8."""
START_BYTES = 32
"""Least memory that a lattice point takes while the field of its cell is made."""


def lattice_field(
    shape: Shape | Field, name: str, scale: float, spacing: float, volume: float | None = None
) -> tuple[NDArray[np.int64], Floats]:
    """Lattice origin and phase field of a cell's start shape.

    The interface has its equilibrium profile and lies where ∫ φ is the volume. The tails of the
    profile hold more outside of the surface than is missing within (`ball_radius`), so that the
    surface φ = 1/2 of a ball of 5 µm encloses 9 % less at c = 2.

    Parameters
    ----------
    shape : Shape or Field
    name : of the cell, for the error
    scale : float
        √(c/2) in 1/µm, `Physics.interface_scale`.
    spacing : float, µm
    volume : float, optional
        ∫ φ of the field, µm³, by default the volume of the shape; a `Field` has its own.

    Returns
    -------
    origin : (3,) int64, lattice position of the first value
    phi : (nx, ny, nz) float64

    Raises
    ------
    ValueError
        The shape is too small for the lattice: its field exceeds 1/2 at too few points. Or it is
        too large for the memory, or too far out. Or it cannot have the volume.
    """
    volume = shape.volume if volume is None else volume
    first, last = lattice_corners(shape, name, scale, spacing, volume)
    size = float((last - first + 1.0).prod())
    check_memory(f"cell {name!r} takes", size, START_BYTES * size, spacing)
    axes = [np.arange(a, b + 1) * spacing for a, b in zip(first, last, strict=True)]
    points = list(np.meshgrid(*axes, indexing="ij", sparse=True))
    if isinstance(shape, Field):
        origin, phi = first, shape.values(*points)
    else:
        depth = np.ascontiguousarray(np.broadcast_to(shape.depth(*points), _grid_shape(points)))
        with _validate.told_of(f"cell {name!r}"):
            origin, phi = first, start_profile(depth, shape.volume, volume, scale, spacing)
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
    shape: Shape | Field, name: str, scale: float, spacing: float, volume: float,
    least: float = NEGLIGIBLE,
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:  # fmt: skip
    """First and last lattice point, (3,) each, of the box that a start field of a volume takes.

    Of a shape, the box holds where φ exceeds `least`.

    Raises
    ------
    ValueError
        The shape is too far out for the lattice.
    """
    tail = 0.0
    if not isinstance(shape, Field):  # no shape needs to grow by more than a ball does
        growth = radius_of(volume) - radius_of(shape.volume)
        tail = max(growth, 0.0) - np.log(least) / (2 * scale)
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


def check_memory(what: str, points: float, needed: float, spacing: float) -> None:
    """Raise ValueError if boxes of so many lattice points do not fit into memory.

    Parameters
    ----------
    what : what takes them, the subject of the error
    points : of all boxes
    needed : bytes, at least
    spacing : float, µm
    """
    if needed > memory():
        message = (
            f"{what} {points:.3g} lattice points at numerics.spacing = {spacing:g} µm, "
            f"at least {needed / 1e9:.3g} GB of memory; there are {memory() / 1e9:.3g} GB. Take "
            "a coarser spacing, or smaller cells"
        )
        raise ValueError(message)


def start_profile(depth: Floats, own: float, volume: float, scale: float, spacing: float) -> Floats:
    """φ = (1 + tanh(scale (depth + shift))) / 2 with the shift at which ∫ φ is a volume.

    Parameters
    ----------
    depth : (nx, ny, nz) µm, below the surface of a shape
    own : volume of the shape, µm³
    volume : of the field, µm³
    scale : 1/µm
    spacing : µm
    """
    phi = profile(depth + ball_radius(volume, scale) - radius_of(own), scale)  # exact for a ball
    if abs(float(phi.sum()) * spacing**3 - volume) > BALL_ERROR * volume:
        phi = profile(depth + volume_shift(depth, volume, scale, spacing), scale)
    return phi


def _grid_shape(points: list[Floats]) -> tuple[int, ...]:
    return np.broadcast_shapes(*(p.shape for p in points))


def profile(depth: Floats, scale: float) -> Floats:
    """Equilibrium interface (1 + tanh(scale · depth)) / 2."""
    return np.asarray(0.5 * (1 + np.tanh(scale * depth)))


def ball_integral(volume: float, scale: float) -> float:
    """∫ φ of a free ball whose surface φ = 1/2 encloses a volume, µm³."""
    return volume * (1 + (math.pi / (2 * scale * radius_of(volume))) ** 2)


def ball_radius(integral: float, scale: float) -> float:
    """Radius of the surface φ = 1/2 of a free ball, µm: R³ + π² R / (4 scale²) = 3 ∫ φ / (4 π)."""
    unit = math.pi / (scale * math.sqrt(12))
    half = radius_of(integral) ** 3 / 2
    return 2 * unit * math.sinh(math.asinh(half / unit**3) / 3)


def radius_of(volume: float) -> float:
    """Radius of the ball of a volume, µm."""
    return float((3 * volume / (4 * math.pi)) ** (1 / 3))


def volume_shift(depth: Floats, volume: float, scale: float, spacing: float) -> float:
    """Displacement of the surface, µm, at which ∫ φ is `volume`.

    Raises
    ------
    ValueError
        There is none: all of the box is less.
    """
    from scipy.optimize import brentq

    def excess(shift: float) -> float:
        return float(profile(near + shift, scale).sum() * spacing**3 - volume)

    if depth.size * spacing**3 <= volume:
        message = (
            f"its shape has a volume of {volume:.3g} µm³, but lies in a box (`bounds`) of "
            f"{depth.size * spacing**3:.3g}; correct one of them"
        )
        raise ValueError(message)
    reach, near = 0.5, depth[depth > -0.5 - TAIL / scale]
    while excess(-reach) > 0 or excess(reach) < 0:
        reach *= 2
        near = depth[depth > -reach - TAIL / scale]
    return float(brentq(excess, -reach, reach, xtol=1e-6))
