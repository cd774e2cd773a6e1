"""Who touches whom at a save: the matrix of contact areas, read from a run and drawn."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from morphosim.pictures.annotate import PIXELS
from morphosim.pictures.colours import groups, living
from morphosim.pictures.layout import Place
from morphosim.pictures.lettering import POINTS_PER_INCH, inches_wide, plain, shortened
from morphosim.runs.views import contacts

if TYPE_CHECKING:
    import xarray as xr
    from scipy.sparse import coo_array

SIZES = (9.0, 8.0, 7.0, 6.0)
"""Letters of names, points: the largest for which there is room. Smaller ones are not read."""
LINE = 1.1
"""Height of a line, of its letters."""
USUAL, LARGEST = 4.6, 6.6
"""Height of the block of a matrix with names, inches: if letters are large, and at all."""
LEAST = 3.4
"""Height of the block of a matrix that is small or has no names, inches."""
CELL = 0.55
"""Most side of an entry, inches."""
LONGEST = 0.35
"""Share of the block that names may take."""
RIGHT, ABOVE, RIM = 0.65, 0.3, 0.08
"""Inches for the colour bar, for the title, and around names."""
CLOSE = 1e-6
"""Lengths this near to each other are the same, inches."""
TINY = 0.9
"""Side of a matrix that is too small for a colour bar and names, inches."""
MOST_GROUPS = 14
"""Up to so many groups of many cells have their names at the matrix."""
AREAS = LinearSegmentedColormap.from_list(
    "areas", ["#dceaf5", "#a5cbe3", "#4a98c9", "#0b3c7d"]
).with_extremes(bad="white")
"""White is no contact: the smallest one is seen."""

Room = tuple[float, float]
"""Width and height, inches."""


class ContactMatrix(NamedTuple):
    """Contacts of the N cells of a save, group by group.

    Attributes
    ----------
    names : of the cells
    areas : (N, N) µm², sparse
    groups : (N,) what cells belong to: their type, or founder
    """

    names: list[str]
    areas: "coo_array"
    groups: list[str]


def contact_matrix(run: "xr.Dataset", save: int) -> ContactMatrix:
    """Contact matrix of the cells that are there at a save."""
    from scipy.sparse import coo_array

    group, there = groups(run, save), set(living(run, save))
    names = [name for name in group if name in there]
    place = {name: k for k, name in enumerate(names)}
    pairs = {  # of which some runs have both orders
        (*sorted((place[a], place[b])), area)
        for a, b, area in contacts(run, save) if a in place and b in place
    }  # fmt: skip
    i, j, areas = np.array(sorted(pairs)).reshape(-1, 3).T
    both = np.concatenate([i, j]).astype(int), np.concatenate([j, i]).astype(int)
    shape = len(names), len(names)
    whole = coo_array((np.concatenate([areas, areas]), both), shape)
    return ContactMatrix(names, whole, [group[name] for name in names])


def block_room(matrix: ContactMatrix) -> Room:
    """Width and height of a block in which all names can be read, or groups if there are too many.

    In inches.
    """
    side = LEAST
    for size, most in [*((size, USUAL) for size in SIZES), *((size, LARGEST) for size in SIZES)]:
        if len(matrix.names) * _row(size) > most:
            continue
        labels = _label_room(matrix.names, size, most)
        needed = len(matrix.names) * _row(size) + labels + ABOVE
        if needed <= most:
            side = max(needed, LEAST)
            break
    return side + RIGHT - ABOVE, side


@dataclass(frozen=True, slots=True)
class _Plan:
    """How a matrix is drawn: side of its square, letters, and room for names, inches.

    `size` is None without names of cells.
    """

    side: float
    size: float | None
    left: float
    below: float
    right: float


def draw_matrix(figure: Figure, place: Place, matrix: ContactMatrix) -> Axes:
    """Draw it in the middle of a place of a figure: left, bottom, width and height in inches.

    Names of cells are as large as there is room. Where they could not be read, groups that follow
    each other are marked.
    """
    names, areas, groups = matrix
    left, bottom, width, height = place
    plan = _plan(matrix, (width, height))
    spare = width - plan.left - plan.side - plan.right, height - plan.below - plan.side - ABOVE
    wide, high = figure.get_size_inches()
    ax = figure.add_axes((
        (left + plan.left + max(spare[0], 0) / 2) / wide,
        (bottom + plan.below + max(spare[1], 0) / 2) / high, plan.side / wide, plan.side / high,
    ))  # fmt: skip
    peak = float(np.nanmax(areas.data, initial=0))
    shown = _pooled(areas, max(int(plan.side * figure.dpi), 1))
    end = len(names) - 0.5
    image = ax.imshow(
        np.ma.masked_equal(shown, 0), cmap=AREAS, norm=Normalize(0, peak or 1.0),
        extent=(-0.5, end, end, -0.5), **PIXELS,
    )  # fmt: skip
    text = "contact area, µm²" if peak else "no contacts"
    room = plan.side + min(plan.left, plan.right) * 2
    ax.set_title(text, fontsize=float(np.clip(9 * room / inches_wide(text, 9), 5, 9)))
    for spine in ax.spines.values():
        spine.set_linewidth(0.5)
    ax.tick_params(length=0)
    if plan.size is not None:
        _name_rows(ax, names, plan)
    else:
        _name_groups(ax, groups, plan)
    if peak:
        _write_areas(ax, areas, peak, plan.side / len(names))
        if plan.right >= RIGHT:
            _draw_bar(ax, image, plan.side)
    return ax


def _pooled(areas: "coo_array", most: int) -> NDArray[np.float64]:
    """Largest areas of entries that share a pixel, where there are more than `most` in a row."""
    step = max(-(-areas.shape[0] // most), 1)
    count = -(-areas.shape[0] // step)
    pooled = np.zeros((count, count))
    np.maximum.at(pooled, (areas.row // step, areas.col // step), areas.data)
    return pooled


def _row(size: float) -> float:
    """Height of a row whose name is in letters of this size, inches."""
    return size * LINE / POINTS_PER_INCH


def _plan(matrix: ContactMatrix, room: Room) -> _Plan:
    """Names in the largest letters for which there is room, or groups, or nothing."""
    count = max(len(matrix.names), 1)
    for size in SIZES:
        if count * _row(size) > min(room):
            continue
        labels = _label_room(matrix.names, size, min(room))
        side = min(room[0] - labels - RIGHT, room[1] - labels - ABOVE, count * CELL)
        if side >= max(count * _row(size), min(TINY, count * CELL)):
            return _Plan(side, size, labels, labels, RIGHT)
    labels = _label_room(sorted(set(matrix.groups)), SIZES[1], min(room))
    side = min(room[0] - labels - RIGHT, room[1] - labels - ABOVE)
    if side >= TINY:
        return _Plan(side, None, labels, labels, RIGHT)
    side = max(min(room[0], room[1] - ABOVE), RIM)
    return _Plan(side, None, 0.0, 0.0, 0.0)


def _label_room(texts: Sequence[str], size: float, within: float) -> float:
    """Inches that names take beside a matrix in a block of this side."""
    widest = max((inches_wide(text, size) for text in texts), default=0.0)
    return min(widest, LONGEST * within) + RIM


def _name_rows(ax: Axes, names: Sequence[str], plan: _Plan) -> None:
    size = plan.size or SIZES[-1]
    texts = [plain(shortened(name, size, plan.left - RIM + CLOSE)) for name in names]
    ax.set_yticks(range(len(names)), texts, fontsize=size)
    ax.set_xticks(range(len(names)), texts, fontsize=size, rotation=90)
    ax.tick_params(pad=2)


def _name_groups(ax: Axes, groups: Sequence[str], plan: _Plan) -> None:
    """Lines between groups, and the names of those with room; none if there are too many."""
    ax.set_xticks([])
    ax.set_yticks([])
    starts = [k for k, group in enumerate(groups) if k == 0 or groups[k - 1] != group]
    if not plan.left or not 1 < len(starts) <= MOST_GROUPS:
        return
    for start in starts[1:]:
        ax.axhline(start - 0.5, color="0.6", lw=0.5)
        ax.axvline(start - 0.5, color="0.6", lw=0.5)
    size, each = SIZES[1], plan.side / len(groups)
    named = [
        (shortened(groups[a], size, plan.left - RIM + CLOSE), (a + b - 1) / 2, (b - a) * each)
        for a, b in zip(starts, [*starts[1:], len(groups)], strict=True)
        if (b - a) * each >= size / POINTS_PER_INCH
    ]
    middles, texts = [at for _, at, _ in named], [plain(text) for text, *_ in named]
    lying = all(inches_wide(text, size) < room - 0.02 for text, _, room in named)
    ax.set_yticks(middles, texts, fontsize=size)
    ax.set_xticks(middles, texts, fontsize=size, rotation=0 if lying else 90)


def _write_areas(ax: Axes, areas: "coo_array", peak: float, side: float) -> None:
    """Areas as numbers, if they fit into entries of this side in inches."""
    size = float(np.clip(0.8 * side / inches_wide(f"{peak:.0f}.", 1), 0, 8))
    if size < SIZES[-1]:
        return
    entries = (part.tolist() for part in (areas.row, areas.col, areas.data))
    for row, column, area in zip(*entries, strict=True):
        if area > 0:
            colour = "white" if area > 0.55 * peak else "black"
            text = f"{area:.0f}" if area >= 0.95 else f"{area:.1f}"
            ax.text(column, row, text, fontsize=size, color=colour, ha="center", va="center")


def _draw_bar(ax: Axes, image: AxesImage, side: float) -> None:
    bar = ax.inset_axes((1 + 0.1 / side, 0.0, 0.13 / side, 1.0))
    ax.figure.colorbar(image, cax=bar, ticks=MaxNLocator(max(int(2.5 * side), 1)))
    bar.tick_params(labelsize=8)
