"""What is written on pictures, by matplotlib: title, names, scale bar, axes."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from numpy.typing import NDArray

from morphosim.pictures.camera import Camera
from morphosim.pictures.lettering import POINTS_PER_INCH, inches_wide, plain, shortened
from morphosim.pictures.name_tags import Measure, NameTag, place_names
from morphosim.pictures.painter import Panel
from morphosim.pictures.palettes import RGB

BAR_SHARE = 0.25
"""Most of a picture's width that the scale bar takes."""
ARROW = 0.18
"""Length of an axis, inches."""
NARROW = 1.0
"""Inches within which there is no room for both scale bar and axes."""
HALO = 1.2
"""Width of the rim around letters, points, which what is behind them does not cross."""
SMALLEST = 7.0
"""Letters of a title, points."""
PIXELS: dict[str, Any] = {"interpolation": "nearest", "origin": "upper"}
LUMINANCE = np.array([0.299, 0.587, 0.114])
BRIGHT = 0.5
"""Brightness above which letters on a colour are black."""
INDIFFERENT = 0.08
"""So near to it either is read well."""


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


def draw_title(figure: Figure, text: str, size: float, left: float | None = None) -> None:
    """Title at the top, in letters of at most this size in points; in the middle, or from `left`.

    A long one has smaller letters; what still has no room is left out.
    """
    wide, high = figure.get_size_inches()
    room = wide - 0.2
    fitting = float(np.clip(size * room / max(inches_wide(text, size), 1e-9), SMALLEST, size))
    shown = plain(shortened(text, fitting, room))
    y = 1 - 0.12 / high
    if left is None:
        figure.suptitle(shown, fontsize=fitting, y=y, va="top")
    else:
        figure.suptitle(shown, fontsize=fitting, x=left / wide, y=y, ha="left", va="top")


def write_names(
    ax: Axes, panel: Panel, before: Mapping[str, NameTag] | None = None, foot: int = 0
) -> dict[str, NameTag]:
    """Names on the cells, none over another and none within `foot` pixels of the bottom.

    Names stay where they were `before`, in the frame of a film, as long as they fit there.
    """
    before, written = before or {}, {}
    measure = _measure(_dpi(ax))
    for tag in place_names(panel, measure, before=before, foot=foot):
        ground = _ground(panel, tag, measure(tag.text, tag.size))
        letters = ink(ground, before[tag.name].ink if tag.name in before else "")
        ax.text(
            tag.column, tag.row, tag.text, fontsize=tag.size, color=letters, ha="center",
            va="center_baseline", clip_on=True, parse_math=False,
            path_effects=[withStroke(linewidth=2 * HALO, foreground=ground)],
        )  # fmt: skip
        written[tag.name] = replace(tag, ink=letters)
    return written


def ink(ground: RGB, before: str = "") -> str:
    """Black or white, whichever is better read on a colour; as before where both are read well."""
    as_before = {"black": -INDIFFERENT, "white": INDIFFERENT}.get(before, 0.0)
    return "black" if np.dot(ground, LUMINANCE) > BRIGHT + as_before else "white"


def _ground(panel: Panel, tag: NameTag, size: tuple[int, int]) -> RGB:
    """Colour on which a tag of this size (pixels) lies, whatever lines cross it."""
    top, left = int(tag.row - size[1] / 2), int(tag.column - size[0] / 2)
    part = panel.image[max(top, 0) : top + size[1], max(left, 0) : left + size[0]]
    red, green, blue = (np.median(part.reshape(-1, 3), axis=0) / 255).tolist()
    return red, green, blue


def draw_bar(ax: Axes, camera: Camera) -> None:
    """Scale bar in the lower left corner."""
    length = round_below(BAR_SHARE * camera.size[0] * camera.scale)
    left, bottom = inches(ax, 0.08), camera.size[1] - inches(ax, 0.1)
    right = left + length / camera.scale
    ax.plot([left, right], [bottom, bottom], color="black", lw=2.5, solid_capstyle="butt")
    text = f"{length:g} µm"
    middle = max((left + right) / 2, left + inches(ax, inches_wide(text, 8) / 2))
    ax.text(middle, bottom - inches(ax, 0.05), text, fontsize=8, ha="center", va="bottom")


def round_below(value: float) -> float:
    """Largest of 1, 2, 5, 10, … times a power of ten up to a value."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(max(step * power for step in (1, 2, 5) if step * power <= value * (1 + 1e-9)))


def draw_axes(ax: Axes, camera: Camera, mirror: bool) -> None:
    """Arrows along x, y and z in the lower right corner, without those that would be too short.

    Narrow pictures have none: they would lie on the scale bar.
    """
    if camera.size[0] < inches(ax, NARROW):
        return
    along = np.diag([1.0, 1.0, -1.0 if mirror else 1.0])
    arrows = np.stack([along @ camera.right, -along @ camera.up], axis=1)
    length, rim = inches(ax, ARROW), inches(ax, 0.14)
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


def _measure(dpi: float) -> Measure:
    """Function that measures texts for a resolution."""

    def measure(text: str, size: float) -> tuple[int, int]:
        return round(inches_wide(text, size) * dpi) + 4, round(size * dpi / POINTS_PER_INCH) + 2

    return measure


def _dpi(ax: Axes) -> float:
    return float(ax.figure.dpi)
