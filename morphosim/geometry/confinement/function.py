"""Walls given by a function of the position."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from morphosim import _validate
from morphosim._shown import short_repr
from morphosim.geometry.confinement.protocol import Floats, check_corners
from morphosim.geometry.signed_distance import Image, depth_image


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FunctionWalls:
    """Confinement given by a function of positions, φ_e: 0 inside (where cells are), 1 outside.

    Attributes
    ----------
    function : φ_e(x, y, z) of arrays in µm that broadcast
        Gives values from 0 to 1; the wall is where they pass 1/2, and presses with g_e φ_e².
    lower, upper : (3,) µm, corners of a box that holds the inside, and a wall around it

    Examples
    --------
    An endless tube along x, of which a piece is used:

    >>> def tube(x, y, z):
    ...     return np.hypot(y, z) + 0 * x > 8.0  # outside of a radius of 8 µm
    >>> walls = FunctionWalls(function=tube, lower=(-20, -10, -10), upper=(20, 10, 10))
    >>> walls.field(0, 0, 0), walls.field(0, 0, 9)
    (array(0.), array(1.))
    """

    function: Callable[[Any, Any, Any], Any]
    lower: ArrayLike
    upper: ArrayLike

    __repr__ = short_repr

    def __post_init__(self) -> None:
        _validate.function("confinement.function", self.function, 3)
        check_corners(self.lower, self.upper)

    def field(self, x: Floats, y: Floats, z: Floats) -> Floats:
        """φ_e, checked to be finite and between 0 and 1."""
        shape = np.broadcast_shapes(np.shape(x), np.shape(y), np.shape(z))
        try:
            given = self.function(x, y, z)
        except (TypeError, ValueError) as error:
            message = (
                f"confinement.function = {_validate.brief(self.function)} fails for arrays x, "
            )
            raise ValueError(f"{message}y, z: {error}") from error
        try:
            values = np.asarray(given, dtype=np.float64)
        except (TypeError, ValueError) as error:
            message = f"confinement.function gives {_validate.brief(given)}, which is no number"
            raise ValueError(message) from error
        try:
            values = np.broadcast_to(values, shape)
        except ValueError as error:
            message = f"confinement.function gives shape {values.shape} for points of {shape}"
            raise ValueError(message) from error
        if not ((values >= 0) & (values <= 1)).all():
            message = (
                f"confinement.function gives values from {values.min():g} to {values.max():g}; "
                "φ_e must lie between 0 (inside) and 1 (outside)"
            )
            raise ValueError(message)
        return values

    def depth(self, x: Floats, y: Floats, z: Floats) -> Floats:
        """Distance to the surface φ_e = 1/2, to about 1/100 of the bounds."""
        return _sampled_depth(self).at(x, y, z)

    def bounds(self) -> tuple[Floats, Floats]:
        """See `Confinement`."""
        return np.asarray(self.lower, float), np.asarray(self.upper, float)


@lru_cache(maxsize=4)
def _sampled_depth(walls: FunctionWalls) -> Image:
    low, high = walls.bounds()
    step = float((high - low).max()) / 100
    axes = [np.arange(a, b + step, step) for a, b in zip(low, high, strict=True)]
    inside = walls.field(*np.meshgrid(*axes, indexing="ij", sparse=True)) < 0.5
    if not inside.any():
        message = "confinement.function is above 1/2 everywhere within its bounds: no inside"
        raise ValueError(message)
    return depth_image(inside, low, np.full(3, step), reach=5.0)
