"""What is written on pictures, by matplotlib: names, scale bar, axes, legend."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.patches import Patch
from matplotlib.textpath import text_to_path
from numpy.typing import NDArray

from morphosim.pictures.camera import Camera
from morphosim.pictures.colours import Colouring, Scale
from morphosim.pictures.name_tags import NameTag, place_names
from morphosim.pictures.painter import Panel
from morphosim.pictures.palettes import RGB

BAR_SHARE = 0.25
"""Most of a picture's width that the scale bar takes."""
ARROW = 0.2
"""Length of an axis, inches."""
PIXELS: dict[str, Any] = {"interpolation": "nearest", "origin": "upper"}
POINTS_PER_INCH = 72
LUMINANCE = np.array([0.299, 0.587, 0.114])
BRIGHT = 0.5
"""Brightness above which letters on a colour are black."""


class Picture(Figure):
    """Figure that notebooks show."""

    def _repr_png_(self) -> bytes:
        from io import BytesIO

        stream = BytesIO()
        self.savefig(stream, format="png")
        return stream.getvalue()


def pixels_of(ax: Axes) -> tuple[int, int]:
    """Width and height of axes in pixels."""
    box = ax.get_window_extent()
    return max(round(box.width), 8), max(round(box.height), 8)


def inches(ax: Axes, length: float) -> int:
    """Length in inches as pixels."""
    return round(length * _dpi(ax))


def show_panel(ax: Axes, panel: Panel) -> None:
    """Show the picture; data coordinates become its pixels."""
    width, height = panel.camera.size
    ax.set_axis_off()
    ax.imshow(panel.image, extent=(0, width, height, 0), aspect="equal", **PIXELS)


def write_names(ax: Axes, panel: Panel) -> None:
    """Names on the cells, none over another."""
    measure = _measure(_dpi(ax))
    for tag in place_names(panel, measure):
        colour = ink(panel, tag, measure(tag.name, tag.size))
        ax.text(
            tag.column, tag.row, tag.name, fontsize=tag.size, color=colour,
            ha="center", va="center_baseline", clip_on=True, parse_math=False,
        )  # fmt: skip


def ink(panel: Panel, tag: NameTag, size: tuple[int, int]) -> str:
    """Black or white, whichever is better read where a tag of this size (pixels) goes."""
    top, left = int(tag.row - size[1] / 2), int(tag.column - size[0] / 2)
    ground = panel.image[max(top, 0) : top + size[1], max(left, 0) : left + size[0]]
    return "black" if ground.mean(axis=(0, 1)) @ LUMINANCE > BRIGHT * 255 else "white"


def draw_bar(ax: Axes, camera: Camera) -> None:
    """Scale bar in the lower left corner."""
    length = round_below(BAR_SHARE * camera.size[0] * camera.scale)
    left, bottom = inches(ax, 0.08), camera.size[1] - inches(ax, 0.1)
    right = left + length / camera.scale
    ax.plot([left, right], [bottom, bottom], color="black", lw=2.5, solid_capstyle="butt")
    ax.text(
        (left + right) / 2, bottom - inches(ax, 0.05), f"{length:g} µm", fontsize=8,
        ha="center", va="bottom",
    )  # fmt: skip


def round_below(value: float) -> float:
    """Largest of 1, 2, 5, 10, … times a power of ten up to a value."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(max(step * power for step in (1, 2, 5) if step * power <= value * (1 + 1e-9)))


def draw_axes(ax: Axes, camera: Camera, mirror: bool) -> None:
    """Arrows along x, y and z in the lower right corner, without those that would be too short."""
    along = np.diag([1.0, 1.0, -1.0 if mirror else 1.0])
    arrows = np.stack([along @ camera.right, -along @ camera.up], axis=1)
    length, rim = inches(ax, ARROW), inches(ax, 0.17)
    arrows *= length
    low, high = np.minimum(arrows.min(axis=0), 0), np.maximum(arrows.max(axis=0), 0)
    start = np.array(camera.size) - rim - high
    start[0] = max(start[0], rim - low[0])
    texts: list[NDArray[np.float64]] = []
    for name, arrow in sorted(zip("xyz", arrows, strict=True), key=lambda a: -np.hypot(*a[1])):
        size = float(np.hypot(*arrow))
        text = start + arrow * (1 + 0.4 * length / max(size, 1e-9))
        near = [np.hypot(*(text - other)) < 0.5 * length for other in texts]
        if size < 0.2 * length or any(near):
            continue
        texts.append(text)
        ax.annotate(
            "", start + arrow, start, arrowprops={"arrowstyle": "->", "shrinkA": 0, "shrinkB": 0}
        )
        ax.text(text[0], text[1], name, fontsize=8, ha="center", va="center")


def draw_key(figure: Figure, colouring: Colouring, top: float) -> None:
    """Legend or colour bar, below `top` in inches from the top of the figure."""
    wide, high = figure.get_size_inches()
    if colouring.legend:
        handles = [
            Patch(facecolor=colour, edgecolor="black", linewidth=0.5, label=plain(text))
            for text, colour in colouring.legend
        ]
        figure.legend(
            handles=handles, ncols=_columns(colouring.legend, wide), loc="upper center",
            bbox_to_anchor=(0.5, 1 - top / high), frameon=False, fontsize=9, borderaxespad=0,
            handlelength=1.0, handleheight=1.0, columnspacing=1.2, handletextpad=0.5,
        )  # fmt: skip
    elif colouring.scale is not None:
        bar = min(4.0, wide * 0.5)
        place = ((wide - bar) / 2 / wide, 1 - (top + 0.14) / high, bar / wide, 0.13 / high)
        _colour_bar(figure.add_axes(place), colouring.scale, colouring.title)


def key_height(colouring: Colouring, wide: float) -> float:
    """Inches that the legend or colour bar takes in a figure of this width."""
    if colouring.legend:
        columns = _columns(colouring.legend, wide)
        return 0.1 + 0.22 * -(-len(colouring.legend) // columns)
    return 0.42 if colouring.scale is not None else 0.0


def _columns(legend: Sequence[tuple[str, RGB]], wide: float) -> int:
    """Columns of a legend that fit a width."""
    widest = max(_measure(POINTS_PER_INCH)(text, 9)[0] for text, _ in legend) / POINTS_PER_INCH
    return int(np.clip((wide - 0.2) // (widest + 0.42), 1, len(legend)))


def _colour_bar(ax: Axes, scale: Scale, title: str) -> None:
    stops = np.array(scale.stops)
    shades = LinearSegmentedColormap.from_list("scale", [tuple(stop) for stop in stops.tolist()])
    ramp = np.linspace(0, 1, 256)[None]
    ax.imshow(ramp, cmap=shades, aspect="auto", extent=(scale.low, scale.high, 0, 1))
    values, texts = zip(*scale.ticks, strict=True)
    ax.set_xticks(values, [plain(text) for text in texts], fontsize=8)
    ax.set_yticks([])
    ax.set_ylabel(title, fontsize=9, rotation=0, ha="right", va="center")


def _measure(dpi: float) -> Any:
    """Function that measures texts for a resolution, see `name_tags.Measure`."""

    def measure(text: str, size: float) -> tuple[int, int]:
        font = FontProperties(size=size)
        width, _, _ = text_to_path.get_text_width_height_descent(text, font, ismath=False)
        pixels = dpi / POINTS_PER_INCH
        return round(width * pixels) + 4, round(size * pixels) + 2

    return measure


def plain(text: str) -> str:
    """Text whose dollar signs matplotlib does not take as mathematics."""
    return text.replace("$", r"\$")


def _dpi(ax: Axes) -> float:
    return float(ax.figure.dpi)
