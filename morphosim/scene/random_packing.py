"""Start states: equal cells at random places, pushed apart (Eq. 12, 13 of the paper)."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from morphosim import _validate
from morphosim.geometry.shapes import Sphere
from morphosim.scene.cell import Cell

K_CELLS, K_WALLS = 0.05, 0.1
"""Strengths k₁ and k₂ of the repulsion between cells and by the walls (paper §3.2)."""
DENSEST = 0.64
"""Share of a volume that balls at random places can fill (random close packing)."""
MOST_ITERATIONS = 5000
MOST_CELLS = 10**7


def random_positions(
    count: int, radius: float, lower: ArrayLike, upper: ArrayLike, seed: int = 0
) -> NDArray[np.float64]:
    """Centres of balls at random in a box, no two nearer than twice the radius.

    The centres are drawn uniformly and then moved by Eq. 12 and 13 until no pair is nearer than
    2 R. As there, the walls push a ball back that is nearer than R, yet do not have the last word.

    Parameters
    ----------
    count : int
    radius : float
        R, µm.
    lower, upper : (3,) corners of the box, µm
    seed : int
        The same seed gives the same places.

    Returns
    -------
    (count, 3) float64, µm

    Raises
    ------
    ValueError
        The balls do not fit.
    """
    count = _validate.integer("count", count, least=1)
    radius = _validate.number("radius", radius, above=0)
    seed = _validate.integer("seed", seed, least=0)
    low, high = _validate.vector("lower", lower), _validate.vector("upper", upper)
    filling = _checked_filling(count, radius, high - low)
    positions = np.random.default_rng(seed).uniform(low, high, (count, 3))
    for _ in range(MOST_ITERATIONS):
        push = _apart(positions, radius)
        if push is None:
            return positions
        positions = positions + push + _inwards(positions, radius, low, high)
    message = (
        f"{count} cells of radius {radius:g} µm, {100 * filling:.0f} % of the box, are not apart "
        f"after {MOST_ITERATIONS} iterations of Eq. 12; take a larger box or fewer cells (up to "
        "50 % is safe)"
    )
    raise ValueError(message)


def _checked_filling(count: int, radius: float, size: NDArray[np.float64]) -> float:
    """Share of the box that the balls fill."""
    if (size < 2 * radius).any():
        message = (
            f"a box of {size[0]:g} × {size[1]:g} × {size[2]:g} µm does not hold a cell of radius "
            f"{radius:g} µm; every side must be at least {2 * radius:g} µm"
        )
        raise ValueError(message)
    filling = float(count * 4 / 3 * np.pi * radius**3 / size.prod())
    if filling > DENSEST:
        fits = int(DENSEST / filling * count)
        message = (
            f"{count} cells of radius {radius:g} µm fill {100 * filling:.0f} % of the box; at "
            f"random places they fill {100 * DENSEST:.0f} % at most, which is {fits} cells here. "
            "Take a larger box, or fewer or smaller cells"
        )
        raise ValueError(message)
    return filling


def _apart(positions: NDArray[np.float64], radius: float) -> NDArray[np.float64] | None:
    """Sum over neighbours of Eq. 12, (N, 3); None if no pair is nearer than 2 R."""
    from scipy.spatial import cKDTree

    pairs = cKDTree(positions).query_pairs(2 * radius * (1 - 1e-9), output_type="ndarray")
    if not len(pairs):
        return None
    force = K_CELLS * (positions[pairs[:, 0]] - positions[pairs[:, 1]])
    push = np.zeros_like(positions)
    np.add.at(push, pairs[:, 0], force)
    np.subtract.at(push, pairs[:, 1], force)
    return push


def _inwards(
    positions: NDArray[np.float64], radius: float, low: NDArray, high: NDArray
) -> NDArray[np.float64]:
    """Repulsion by the walls, (N, 3): Eq. 13, directed inwards along each axis."""
    deep_low = np.clip(radius - (positions - low), 0, None)
    deep_high = np.clip(radius - (high - positions), 0, None)
    return np.asarray(K_WALLS * (deep_low - deep_high))


def packed_cells(
    counts: Mapping[str, int], radius: float, lower: ArrayLike, upper: ArrayLike, seed: int = 0
) -> list[Cell]:
    """Spherical cells of several types, mixed at random in a box.

    Parameters
    ----------
    counts : mapping from cell type to number of cells
        Cells are named by type and number, as G1, G2, …
    radius, lower, upper, seed : see `random_positions`

    Raises
    ------
    ValueError
        The cells do not fit.

    Examples
    --------
    >>> cells = packed_cells({"R": 2, "G": 1}, 5.0, (0, 0, 0), (40, 40, 40), seed=1)
    >>> [cell.name for cell in cells]
    ['R1', 'R2', 'G1']
    """
    _check_counts("counts", counts)
    positions = random_positions(sum(counts.values()), radius, lower, upper, seed)
    return _balls(counts, radius, positions)


@dataclass(frozen=True, slots=True, kw_only=True)
class Aggregate:
    """Spherical cells of several types, mixed at random in a ball, as of cells shaken together.

    Attributes
    ----------
    counts : mapping from cell type to number of cells
        Cells are named by type and number, as G1, G2, …
    radius : float
        That of the cells, µm.
    filling : float
        Share of the ball that cells fill; up to 0.5 is safe.
    center : (3,) µm
    seed : int, optional
        That of the places; by default that of the scene's numerics.

    Examples
    --------
    >>> cells = Aggregate(counts={"A": 20, "B": 30}, radius=4.0).cells(None, seed=0)
    >>> len(cells), cells[20].name
    (50, 'B1')
    """

    counts: Mapping[str, int]
    radius: float
    filling: float = 0.5
    center: ArrayLike = (0.0, 0.0, 0.0)
    seed: int | None = None

    def __post_init__(self) -> None:
        _check_counts("cells.counts", self.counts)
        _validate.number("cells.radius", self.radius, above=0)
        _validate.number("cells.filling", self.filling, above=0, most=DENSEST)
        _validate.vector("cells.center", self.center)
        if self.seed is not None:
            _validate.integer("cells.seed", self.seed, least=0)

    def cells(self, confinement: object, seed: int) -> list[Cell]:
        """Cells of the ball, wherever the walls are: of a packed cube those nearest its middle."""
        count = sum(self.counts.values())
        half = self.radius * (count / self.filling) ** (1 / 3)
        seed = seed if self.seed is None else self.seed
        around = math.ceil(count * 6 / math.pi)
        places = random_positions(around, self.radius, np.full(3, -half), np.full(3, half), seed)
        inner = np.argsort((places**2).sum(axis=1), kind="stable")[:count]
        mixed = np.random.default_rng(seed).permutation(inner)
        return _balls(self.counts, self.radius, places[mixed] + np.asarray(self.center, float))


def _check_counts(name: str, counts: Mapping[str, int]) -> None:
    """Raise ValueError or TypeError unless these are numbers of cells by type."""
    _validate.instance(name, counts, Mapping)
    for kind, count in counts.items():
        _validate.label(f"{name}: type", kind)
        _validate.integer(f"{name}[{kind!r}]", count, least=0, most=MOST_CELLS)
    _validate.integer(f"sum of {name}", sum(counts.values()), least=1, most=MOST_CELLS)


def _balls(counts: Mapping[str, int], radius: float, positions: NDArray[np.float64]) -> list[Cell]:
    """Cells at these places, type after type."""
    named = [(kind, f"{kind}{k + 1}") for kind, count in counts.items() for k in range(count)]
    return [
        Cell(name=name, type=kind, shape=Sphere(center=tuple(place), radius=radius))
        for (kind, name), place in zip(named, positions.tolist(), strict=True)
    ]
