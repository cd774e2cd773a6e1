"""Where the names of cells go in a picture, so that each lies on its cell and none on another."""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from morphosim.pictures.lettering import letters
from morphosim.pictures.painter import Panel

SIZES = (10.0, 8.5, 7.0, 6.0)
"""Sizes of letters, points, the largest that fits is taken."""
LETTERS = (16, 12, 9)
"""How long a name may still be that does not fit as a whole."""
FULL = 0.5
"""What is seen of a cell of which most is seen, of the rectangle around it."""
LESS = 0.8
"""Of that, for a cell whose name was there before."""
SPACE = 1.25
"""Room that letters take before they grow again, of what they need."""
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
        Of the cell.
    text : str
        The same, or what is written of a long name.
    column, row : float
        Its middle, pixels.
    size : float
        Of the letters, points.
    side : int
        Where it is beside its cell: 0 right, 1 left, 2 above, 3 below; -1 if it lies on it.
    ink : str
        Colour of the letters, once it is known.
    """

    name: str
    text: str
    column: float
    row: float
    size: float
    side: int = -1
    ink: str = ""


def place_names(
    panel: Panel,
    measure: Measure,
    sizes: Sequence[float] = SIZES,
    *,
    before: Mapping[str, NameTag] | None = None,
    foot: int = 0,
) -> list[NameTag]:
    """Names of the cells that are seen well enough.

    A name lies on its cell where there is most room. One that does not fit there goes beside its
    cell if most of that is seen and the place is free; other names are left out.

    Parameters
    ----------
    panel : Panel
    measure : Measure
    sizes : of letters, the largest first
    before : optional
        Names in the frame before, of a film. They stay as they are as long as that fits.
    foot : int
        Pixels at the bottom in which there are no names beside cells.
    """
    from scipy.ndimage import find_objects

    before, tags = before or {}, []
    small: list[tuple[int, Part]] = []
    parts: list[Any] = find_objects(panel.seen + 1, len(panel.names))
    for place, part in enumerate(parts):
        if part is None:
            continue
        tag = _inside(panel, place, part, measure, sizes, before.get(panel.names[place]))
        if tag is not None:
            tags.append(tag)
        else:
            small.append((place, part))
    taken = panel.seen >= 0
    taken[max(len(taken) - foot, 0) :] = True
    for place, part in small:
        last = before.get(panel.names[place])
        tag = _beside(panel, place, part, measure, sizes[-2], taken, last)
        if tag is not None:
            tags.append(tag)
    return tags


def _inside(
    panel: Panel, place: int, part: Part, measure: Measure, sizes: Sequence[float],
    before: NameTag | None,
) -> NameTag | None:  # fmt: skip
    """Name on its cell, where it was before, or else in the largest letters that fit.

    Beside the edges of a box if there is room, or else in front of them.
    """
    mask = np.pad(panel.seen[part] == place, 1)
    clear = mask if panel.lines is None else mask & ~np.pad(panel.lines[part], 1)
    corner = part[0].start - 1, part[1].start - 1
    if before is not None and before.side < 0 and _stays(clear, corner, before, measure, sizes):
        return before
    name = panel.names[place]
    ways = list(_ways(name, tuple(panel.names), sizes))
    for free, (text, size) in product([clear] if panel.lines is None else [clear, mask], ways):
        where = _roomiest(free, *measure(text, size))
        if where is not None:
            return NameTag(name, text, where[1] + corner[1], where[0] + corner[0], size)
    return None


def _ways(name: str, names: tuple[str, ...], sizes: Sequence[float]) -> Iterator[tuple[str, float]]:
    """Texts and sizes in which a name may be written, the best first."""
    for size in sizes:
        yield name, size
    for most in LETTERS:
        text = letters(name, most)
        if text != name and _written(names, most)[text] == 1:
            yield text, sizes[-1]


@lru_cache(maxsize=len(LETTERS))
def _written(names: tuple[str, ...], most: int) -> Counter[str]:
    """How many names come to the same text."""
    return Counter(letters(name, most) for name in names)


def _stays(
    mask: NDArray[np.bool_], corner: tuple[int, int], tag: NameTag, measure: Measure,
    sizes: Sequence[float],
) -> bool:  # fmt: skip
    """Whether a name may stay: its place is on its cell, and it could not be much larger."""
    width, height = measure(tag.text, tag.size)
    top, left = (int(at) for at in (tag.row - corner[0], tag.column - corner[1]))
    top, left = top - height // 2 + 1, left - width // 2 + 1
    if min(top, left) < 0 or not _all_in(mask, top, left, height - 2, width - 2):
        return False
    larger = [size for size in sizes if size > tag.size]
    if not larger:
        return True
    wide, high = measure(tag.name, larger[-1])
    return _roomiest(mask, round(SPACE * wide), round(SPACE * high)) is None


def _all_in(mask: NDArray[np.bool_], top: int, left: int, height: int, width: int) -> bool:
    part = mask[top : top + height, left : left + width]
    return bool(part.shape == (height, width) and part.all())


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
    taken: NDArray[np.bool_], before: NameTag | None,
) -> NameTag | None:  # fmt: skip
    """Name beside a cell of which most is seen; its place is taken then."""
    least = FULL if before is None else FULL * LESS
    if (panel.seen[part] == place).sum() < least * panel.rectangles[place]:
        return None
    name = panel.names[place]
    width, height = measure(name, size)
    rows, columns = part
    row, column = (rows.start + rows.stop) / 2, (columns.start + columns.stop) / 2
    middles = (
        (row, columns.stop + GAP + width / 2), (row, columns.start - GAP - width / 2),
        (rows.start - GAP - height / 2, column), (rows.stop + GAP + height / 2, column),
    )  # fmt: skip
    last = -1 if before is None else before.side
    for side in sorted(range(len(middles)), key=lambda side: side != last):
        middle = middles[side]
        top, left = int(middle[0] - height / 2), int(middle[1] - width / 2)
        if min(top, left) >= 0 and _all_in(~taken, top, left, height, width):
            taken[top : top + height, left : left + width] = True
            return NameTag(name, name, middle[1], middle[0], size, side)
    return None
