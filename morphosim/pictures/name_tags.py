"""Where the names of cells go in a picture, so that each lies on its cell and none on another."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from morphosim.pictures.painter import Panel

SIZES = (10.0, 8.5, 7.0, 6.0)
"""Sizes of letters, points, the largest that fits is taken."""
FULL = 0.5
"""What is seen of a cell of which most is seen, of the rectangle around it."""
GAP = 3
"""Pixels between a cell and its name beside it."""

Part = tuple[slice, slice]
"""Rows and columns around what is seen of a cell."""
Measure = Callable[[str, float], tuple[int, int]]
"""Width and height in pixels of a text in letters of a size in points."""


@dataclass(frozen=True, slots=True)
class NameTag:
    """Name in a picture.

    Attributes
    ----------
    name : str
    column, row : float
        Its middle, pixels.
    size : float
        Of the letters, points.
    inside : bool
        Whether it lies on its cell, not beside it.
    """

    name: str
    column: float
    row: float
    size: float
    inside: bool


def place_names(panel: Panel, measure: Measure, sizes: Sequence[float] = SIZES) -> list[NameTag]:
    """Names of the cells that are seen well enough.

    A name lies on its cell where there is most room. One that does not fit there goes beside its
    cell if most of that is seen and the place is free; other names are left out.
    """
    from scipy.ndimage import find_objects

    tags: list[NameTag] = []
    small: list[tuple[int, Part]] = []
    parts: list[Any] = find_objects(panel.seen + 1, len(panel.names))
    for place, part in enumerate(parts):
        if part is None:
            continue
        tag = _inside(panel, place, part, measure, sizes)
        if tag is not None:
            tags.append(tag)
        else:
            small.append((place, part))
    taken = panel.seen >= 0
    for place, part in small:
        tag = _beside(panel, place, part, measure, sizes[-2], taken)
        if tag is not None:
            tags.append(tag)
    return tags


def _inside(
    panel: Panel, place: int, part: Part, measure: Measure, sizes: Sequence[float]
) -> NameTag | None:
    """Name on its cell, in the largest letters that fit."""
    mask = np.pad(panel.seen[part] == place, 1)
    for size in sizes:
        width, height = measure(panel.names[place], size)
        where = _roomiest(mask, width, height)
        if where is not None:
            row, column = where[0] + part[0].start - 1, where[1] + part[1].start - 1
            return NameTag(panel.names[place], column, row, size, inside=True)
    return None


def _roomiest(mask: NDArray[np.bool_], width: int, height: int) -> tuple[int, int] | None:
    """Row and column of the middle of a rectangle within the mask, far from its rim."""
    from scipy.ndimage import distance_transform_cdt, minimum_filter1d

    if width > mask.shape[1] or height > mask.shape[0]:
        return None
    fits = minimum_filter1d(mask.view(np.uint8), width, axis=1, mode="constant")
    fits = minimum_filter1d(fits, height, axis=0, mode="constant")
    if not fits.any():
        return None
    depth = distance_transform_cdt(fits, "taxicab")
    rows, columns = np.nonzero(depth == depth.max())
    middle = len(rows) // 2
    return int(rows[middle]), int(columns[middle])


def _beside(
    panel: Panel, place: int, part: Part, measure: Measure, size: float,
    taken: NDArray[np.bool_],
) -> NameTag | None:  # fmt: skip
    """Name beside a cell of which most is seen; its place is taken then."""
    if (panel.seen[part] == place).sum() < FULL * panel.rectangles[place]:
        return None
    width, height = measure(panel.names[place], size)
    rows, columns = part
    row, column = (rows.start + rows.stop) / 2, (columns.start + columns.stop) / 2
    for middle in (
        (row, columns.stop + GAP + width / 2), (row, columns.start - GAP - width / 2),
        (rows.start - GAP - height / 2, column), (rows.stop + GAP + height / 2, column),
    ):  # fmt: skip
        top, left = int(middle[0] - height / 2), int(middle[1] - width / 2)
        if min(top, left) < 0 or top + height > taken.shape[0] or left + width > taken.shape[1]:
            continue
        space = taken[top : top + height, left : left + width]
        if not space.any():
            space[:] = True
            return NameTag(panel.names[place], middle[1], middle[0], size, inside=False)
    return None
