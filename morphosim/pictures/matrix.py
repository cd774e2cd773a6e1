"""Who touches whom at a save: the matrix of contact areas, read from a run and drawn."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap, Normalize
from numpy.typing import NDArray

from morphosim.pictures.annotate import PIXELS, plain
from morphosim.pictures.colours import groups, living
from morphosim.runs.views import contacts

if TYPE_CHECKING:
    import xarray as xr

FEW_NAMES = 30
"""Up to so many cells the matrix has their names."""
FEW_NUMBERS = 12
"""Up to so many cells the matrix has the areas as numbers."""
MOST_GROUPS = 14
"""Up to so many groups of many cells have their names at the matrix."""
AREAS = LinearSegmentedColormap.from_list("areas", ["#ffffff", "#b7d4ea", "#4a98c9", "#0b3c7d"])
ROOM = (0.75, 0.7, 0.65, 0.3)
"""Inches left, below, right and above of the contact matrix for its texts."""


class ContactMatrix(NamedTuple):
    """Contacts of the N cells of a save, group by group.

    Attributes
    ----------
    names : of the cells
    areas : (N, N) µm²
    groups : (N,) what cells belong to: their type, or founder
    """

    names: list[str]
    areas: NDArray[np.float64]
    groups: list[str]


def contact_matrix(run: "xr.Dataset", save: int) -> ContactMatrix:
    """Contact matrix of the cells that are there at a save."""
    group, there = groups(run, save), set(living(run, save))
    names = [name for name in group if name in there]
    place = {name: k for k, name in enumerate(names)}
    areas = np.zeros((len(names), len(names)))
    for a, b, area in contacts(run, save):
        if a in place and b in place:
            areas[place[a], place[b]] = areas[place[b], place[a]] = area
    return ContactMatrix(names, areas, [group[name] for name in names])


def draw_matrix(ax: Axes, matrix: ContactMatrix) -> None:
    """Draw it in axes whose right quarter inch the colour bar takes.

    Of many cells, groups that follow each other are marked.
    """
    names, areas, groups = matrix
    peak = float(areas.max(initial=0)) or 1.0
    image = ax.imshow(areas, cmap=AREAS, norm=Normalize(0, peak), **PIXELS)
    bar = ax.inset_axes((1.03, 0.0, 0.04, 1.0))
    ax.figure.colorbar(image, cax=bar)
    bar.tick_params(labelsize=8)
    ax.set_title("contact area, µm²", fontsize=9)
    for spine in ax.spines.values():
        spine.set_linewidth(0.5)
    if len(names) <= FEW_NAMES:
        _name_rows(ax, names)
    else:
        _name_groups(ax, groups)
    if len(names) <= FEW_NUMBERS:
        _write_areas(ax, areas, peak)


def _name_rows(ax: Axes, names: Sequence[str]) -> None:
    size = float(np.clip(130 / max(len(names), 1), 4.5, 8))
    texts = [plain(name) for name in names]
    ax.set_yticks(range(len(names)), texts, fontsize=size)
    ax.set_xticks(range(len(names)), texts, fontsize=size, rotation=90)
    ax.tick_params(length=0)


def _name_groups(ax: Axes, groups: Sequence[str]) -> None:
    """Lines between groups, and the names of those with room; numbers if there are too many."""
    starts = [k for k, group in enumerate(groups) if k == 0 or groups[k - 1] != group]
    ax.tick_params(length=0, labelsize=8)
    if not 1 < len(starts) <= MOST_GROUPS:
        ax.set_xlabel("number of the cell", fontsize=8)
        return
    stops = [*starts[1:], len(groups)]
    roomy = [(a, b) for a, b in zip(starts, stops, strict=True) if b - a > len(groups) / 30]
    texts = [plain(groups[a]) for a, _ in roomy]
    middles = [(a + b - 1) / 2 for a, b in roomy]
    ax.set_yticks(middles, texts)
    ax.set_xticks(middles, texts)
    for start in starts[1:]:
        ax.axhline(start - 0.5, color="0.6", lw=0.5)
        ax.axvline(start - 0.5, color="0.6", lw=0.5)


def _write_areas(ax: Axes, areas: NDArray[np.float64], peak: float) -> None:
    for (row, column), area in np.ndenumerate(areas):
        if area > 0:
            colour = "white" if area > 0.55 * peak else "black"
            text = f"{area:.0f}" if area >= 0.95 else f"{area:.1f}"
            ax.text(column, row, text, fontsize=6.5, color=colour, ha="center", va="center")
