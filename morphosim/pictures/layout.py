"""Where the parts of a figure go."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from morphosim import _validate
from morphosim.pictures.camera import View, extent
from morphosim.pictures.sight import Sight

WIDE, HIGH = 13.0, 12.0
"""Largest figure that is chosen, inches."""
LONELY = 9.0
"""Width of a figure with one part, inches."""
RIM, GAP, TITLE = 0.15, 0.2, 0.5
"""Around the figure, between its parts, and for its title, inches."""
HALVINGS = 50
"""Of the range in which the scale is looked for."""
SPARE = 1.04
"""Room of a view, of what it shows."""
NARROWEST, LOWEST = 1.15, 0.3
"""Least width of a view, for scale bar and axes, and least height above them, inches."""
VIEW = 0.4
"""Length of the largest view below which it needs the room of others, inches."""
BLOCK, SHARE = 4.0, 0.5
"""Side of a block that a figure of the usual size has room for, inches, and the largest block as a
share of a figure of a given size."""

LEAST, MOST = 2, 48
"""Sides that a figure may have, inches."""

Place = tuple[float, float, float, float]
"""Left, bottom, width and height, inches."""


@dataclass(frozen=True, slots=True)
class Layout:
    """Plan of a figure.

    Attributes
    ----------
    size : (float, float)
        Width and height, inches.
    per_micrometre : float
        Inches in all views.
    places : of the parts: the views, and the contact matrix
    key_top : float
        Where the legend begins, inches from the top.
    foot : float
        Inches below each view; 0 where there is no room for it.
    """

    size: tuple[float, float]
    per_micrometre: float
    places: list[Place]
    key_top: float
    foot: float

    def share(self, place: Place) -> Place:
        """Place as a share of the figure."""
        left, bottom, width, height = place
        wide, high = self.size
        return left / wide, bottom / high, width / wide, height / high


@dataclass(frozen=True, slots=True)
class _Grid:
    """Parts in rows of so many columns: the views, and a block.

    Attributes
    ----------
    views : (V, 2) µm
        Room that they take.
    block : (float, float) or None
        Width and height in inches.
    foot : float
        Inches below each view.
    """

    views: NDArray[np.float64]
    block: tuple[float, float] | None
    foot: float

    @property
    def count(self) -> int:
        return len(self.views) + (self.block is not None)

    @property
    def columns(self) -> int:
        return 1 if self.count == 1 else 2 if self.count <= 4 else 3

    def sides(self, scale: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Widths of the columns and heights of the rows in inches, `scale` inches per µm."""
        least = (NARROWEST, LOWEST) if self.foot else (0.0, 0.0)
        parts = np.maximum(self.views * scale, least) + np.array([0, self.foot])
        if self.block is not None:
            parts = np.concatenate([parts, [self.block]])
        widths = [parts[k :: self.columns, 0].max() for k in range(self.columns)]
        rows = range(0, len(parts), self.columns)
        return np.array(widths), np.array([parts[k : k + self.columns, 1].max() for k in rows])

    def fits(self, scale: float, room: tuple[float, float]) -> bool:
        """Whether all parts are within a width and height in inches."""
        return all(
            lengths.sum() + _spent(len(lengths)) <= most
            for lengths, most in zip(self.sides(scale), room, strict=True)
        )

    def scale(self, room: tuple[float, float]) -> float:
        """Largest scale with which all fits, inches per µm."""
        low, high = 0.0, float(max(room)) / max(float(self.views.max()), 1e-9)
        for _ in range(HALVINGS):
            middle = (low + high) / 2
            low, high = (middle, high) if self.fits(middle, room) else (low, middle)
        return max(low, 1e-9)


def layout(
    seen: Sight, views: Sequence[View], block: tuple[float, float] | None, foot: float,
    size: tuple[float, float] | None,
) -> Layout:  # fmt: skip
    """Plan a figure: its parts in rows of up to three, all views to the same scale.

    Parameters
    ----------
    seen : Sight
    views : of it
    block : (float, float), optional
        Width and height of a further part after the views, inches: the contact matrix.
    foot : float
        Inches below each view.
    size : (float, float), optional
        Width and height in inches.
    """
    from morphosim.pictures.key import key_height

    given = _checked_size(size)
    extents = np.array([extent(seen.points, view) for view in views]) * SPARE
    wide, high = given or (LONELY if len(views) == 1 and not block else WIDE, HIGH)
    top = TITLE + key_height(seen.colouring, wide, high)
    if given:
        grid, scale = _within((wide, high - top), extents, block, foot)
    else:
        grid = _Grid(extents, block, foot)
        more = [max(side - BLOCK, 0.0) for side in block or (0.0, 0.0)]
        scale = grid.scale((wide + more[0], high + more[1] - top))
        lengths = [side.sum() + _spent(len(side)) for side in grid.sides(scale)]
        wide, high = max(lengths[0], wide * 0.5), lengths[1] + top
    return Layout(
        (float(wide), float(high)), scale,
        _places(grid.count, *grid.sides(scale), (wide, high - top)), TITLE, grid.foot,
    )  # fmt: skip


def _within(
    room: tuple[float, float], extents: NDArray[np.float64], block: tuple[float, float] | None,
    foot: float,
) -> tuple[_Grid, float]:  # fmt: skip
    """Grid and scale for a given room: in a small one without block, or even without feet."""
    if block is not None:
        block = min(block[0], SHARE * room[0]), min(block[1], SHARE * room[1])
    for grid in (_Grid(extents, block, foot), _Grid(extents, None, foot)):
        scale = grid.scale(room)
        if scale * extents.max() >= VIEW:
            return grid, scale
    grid = _Grid(extents, None, 0.0)
    return grid, grid.scale(room)


def _spent(parts: int) -> float:
    """Inches that rims and gaps take along one axis."""
    return 2 * RIM + (parts - 1) * GAP


def _places(
    count: int, widths: np.ndarray, heights: np.ndarray, room: tuple[float, float]
) -> list[Place]:
    """Places of the parts, row by row from the top, in the middle of a room."""
    left = (room[0] - widths.sum() - GAP * (len(widths) - 1)) / 2
    top = room[1] - max(room[1] - heights.sum() - GAP * (len(heights) - 1), 0.0) / 2
    lefts = left + np.cumsum([0, *(widths[:-1] + GAP)])
    bottoms = top - np.cumsum(heights) - GAP * np.arange(len(heights))
    places = []
    for k in range(count):
        row, column = divmod(k, len(widths))
        place = lefts[column], bottoms[row], widths[column], heights[row]
        places.append(tuple(float(value) for value in place))
    return places  # type: ignore[return-value]


def _checked_size(size: tuple[float, float] | None) -> tuple[float, float] | None:
    if size is None:
        return None
    wide, high = _validate.array("size", size, (2,)).tolist()
    width, height = (_validate.number("size", n, least=LEAST, most=MOST) for n in (wide, high))
    return width, height
