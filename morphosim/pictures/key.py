"""Legend or colour bar of a figure, in as much room as there is."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from morphosim.pictures.colours import Colouring, Scale
from morphosim.pictures.lettering import inches_wide, plain, shortened
from morphosim.pictures.palettes import RGB

SIZE = 9.0
"""Of letters, points."""
ROW, SWATCH, RIM = 0.22, 0.42, 0.1
"""Height of a row, what an entry takes besides its text, and free rim, inches."""
TEXTS = (6.0, 3.0, 2.0, 1.4, 1.0)
"""Widths that texts may be cut to, inches: the largest with which all entries fit."""
MOST = 0.2
"""Share of a figure's height that a legend takes."""
BAR_WIDTH, BAR_HEIGHT = 4.0, 0.42


@dataclass(frozen=True, slots=True)
class _Legend:
    """Entries as they are written, and in how many columns."""

    entries: Sequence[tuple[str, RGB | None]]
    columns: int

    @property
    def rows(self) -> int:
        return -(-len(self.entries) // self.columns)


def key_height(colouring: Colouring, wide: float, high: float) -> float:
    """Inches that the legend or colour bar takes in a figure of this size."""
    if colouring.legend:
        return RIM + ROW * _legend(colouring.legend, wide, high).rows
    return BAR_HEIGHT if colouring.scale is not None else 0.0


def draw_key(figure: Figure, colouring: Colouring, top: float) -> None:
    """Legend or colour bar, below `top` in inches from the top of the figure."""
    wide, high = figure.get_size_inches()
    if colouring.legend:
        plan = _legend(colouring.legend, wide, high)
        figure.legend(
            handles=[_handle(text, colour) for text, colour in plan.entries], ncols=plan.columns,
            loc="upper center", bbox_to_anchor=(0.5, 1 - top / high), frameon=False,
            fontsize=SIZE, borderaxespad=0, handlelength=1.0, handleheight=1.0,
            columnspacing=1.2, handletextpad=0.5,
        )  # fmt: skip
    elif colouring.scale is not None:
        text = inches_wide(colouring.title, SIZE) + RIM
        bar = float(np.clip(wide - text - 4 * RIM, 0.5, BAR_WIDTH))
        left = max((wide - bar) / 2, text + RIM)
        place = (left / wide, 1 - (top + 0.14) / high, bar / wide, 0.13 / high)
        _colour_bar(figure.add_axes(place), colouring.scale, colouring.title, bar)


def _legend(legend: Sequence[tuple[str, RGB]], wide: float, high: float) -> _Legend:
    """All entries, if need be in shorter words; of too many the first, and how many are left."""
    rows = max(int(MOST * high / ROW), 2)
    for most in TEXTS:
        texts = [shortened(text, SIZE, most) for text, _ in legend]
        widest = max(inches_wide(text, SIZE) for text in texts)
        columns = int(np.clip((wide - 2 * RIM) // (widest + SWATCH), 1, len(legend)))
        if columns * rows >= len(legend):
            break
    entries = [(text, colour) for text, (_, colour) in zip(texts, legend, strict=True)]
    shown = columns * rows - 1
    if len(entries) > shown + 1:
        return _Legend([*entries[:shown], (f"{len(entries) - shown} more", None)], columns)
    return _Legend(entries, columns)


def _handle(text: str, colour: RGB | None) -> Patch:
    if colour is None:
        return Patch(facecolor="none", edgecolor="none", label=text)
    return Patch(facecolor=colour, edgecolor="black", linewidth=0.5, label=plain(text))


def _colour_bar(ax: Axes, scale: Scale, title: str, wide: float) -> None:
    stops = np.array(scale.stops)
    shades = LinearSegmentedColormap.from_list("scale", [tuple(stop) for stop in stops.tolist()])
    ramp = np.linspace(0, 1, 256)[None]
    ax.imshow(ramp, cmap=shades, aspect="auto", extent=(scale.low, scale.high, 0, 1))
    values, texts = zip(*_ticks(scale, wide), strict=True)
    ax.set_xticks(values, [plain(text) for text in texts], fontsize=8)
    ax.set_yticks([])
    ax.set_ylabel(title, fontsize=SIZE, rotation=0, ha="right", va="center")


def _ticks(scale: Scale, wide: float) -> list[tuple[float, str]]:
    """All ticks, or the outer ones where those are too near each other; in words that fit."""
    room = wide / max(len(scale.ticks) - 1, 1) - 0.05
    fit = all(inches_wide(text, 8) <= room for _, text in scale.ticks)
    ticks = list(scale.ticks) if fit else [scale.ticks[0], scale.ticks[-1]]
    return [(value, shortened(text, 8, wide - 0.05)) for value, text in ticks]
