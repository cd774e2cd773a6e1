"""Where the parts of a figure go."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from morphosim import _validate
from morphosim.pictures.camera import View, extent
from morphosim.pictures.sight import Sight

WIDE, HIGH = 13.0, 12.0
"""Largest figure that is chosen, inches."""
LONELY = 9.0
"""Width of a figure with one part, inches."""
RIM, GAP, TITLE = 0.15, 0.2, 0.5
"""Around the figure, between its parts, and for its title, inches."""
SPARE = 1.04
"""Room of a view, of what it shows."""
MATRIX = 0.5
"""Side of the contact matrix with its texts, of the largest extent of a view."""

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
    """

    size: tuple[float, float]
    per_micrometre: float
    places: list[Place]
    key_top: float

    def share(
        self, place: Place, room: Place = (0.0, 0.0, 0.0, 0.0)
    ) -> tuple[float, float, float, float]:
        """Place as a share of the figure, with room in inches left, below, right and above."""
        left, bottom, width, height = place
        wide, high = self.size
        return (
            (left + room[0]) / wide, (bottom + room[1]) / high,
            max(width - room[0] - room[2], 0.1) / wide, max(height - room[1] - room[3], 0.1) / high,
        )  # fmt: skip


def layout(
    seen: Sight, views: Sequence[View], matrix: bool, foot: float,
    size: tuple[float, float] | None,
) -> Layout:  # fmt: skip
    """Plan a figure: its parts in rows of up to three, all views to the same scale.

    Parameters
    ----------
    seen : Sight
    views : of it
    matrix : bool
        Whether there is a contact matrix, after the views.
    foot : float
        Inches below each view.
    size : (float, float), optional
        Width and height in inches.
    """
    from morphosim.pictures.annotate import key_height

    blocks = np.array([extent(seen.points, view) for view in views]) * SPARE
    if matrix:
        blocks = np.concatenate([blocks, np.full((1, 2), MATRIX * blocks.max())])
    columns = 1 if len(blocks) == 1 else 2 if len(blocks) <= 4 else 3
    widths = np.array([blocks[k::columns, 0].max() for k in range(columns)])
    heights = np.array([row.max() for row in _rows(blocks[:, 1], columns)])
    given = _checked_size(size)
    wide = given[0] if given else LONELY if len(blocks) == 1 else WIDE
    top = TITLE + key_height(seen.colouring, wide)
    spent = _spent(columns, 0.0), top + _spent(len(heights), foot)
    high = given[1] if given else HIGH
    scale = max(min((wide - spent[0]) / widths.sum(), (high - spent[1]) / heights.sum()), 1e-9)
    if given is None:
        wide = max(widths.sum() * scale + spent[0], wide * 0.5)
        high = heights.sum() * scale + spent[1]
    return Layout(
        (float(wide), float(high)), float(scale),
        _places(len(blocks), widths * scale, heights * scale + foot, (wide, high - top)), TITLE,
    )  # fmt: skip


def _rows(values: np.ndarray, columns: int) -> list[np.ndarray]:
    return [values[k : k + columns] for k in range(0, len(values), columns)]


def _spent(parts: int, each: float) -> float:
    """Inches that rims, gaps and feet take along one axis."""
    return 2 * RIM + (parts - 1) * GAP + parts * each


def _places(
    count: int, widths: np.ndarray, heights: np.ndarray, room: tuple[float, float]
) -> list[Place]:
    """Places of the parts, row by row from the top, in the middle of a room."""
    left = (room[0] - widths.sum() - GAP * (len(widths) - 1)) / 2
    top = room[1] - (room[1] - heights.sum() - GAP * (len(heights) - 1)) / 2
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
