"""Figures of a run: the cells in several views, and who touches whom.

`plot` makes a whole figure. For figures of another layout, `draw` fills the axes of one panel, and
`render` gives the bare pixels.
"""

from collections.abc import Mapping, Sequence
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from morphosim import _validate
from morphosim._extras import need
from morphosim._files import replacing, writable
from morphosim.pictures.camera import THREE, VIEWS, View, camera, checked_pixels, directions
from morphosim.pictures.colours import cell_colours
from morphosim.pictures.cut import read_cut
from morphosim.pictures.layout import Layout, layout
from morphosim.pictures.sight import (
    Sight,
    Surroundings,
    checked_bounds,
    placed_cut,
    sight,
    surroundings,
)
from morphosim.runs.saved_fields import time_index

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from morphosim.pictures.matrix import ContactMatrix
    from morphosim.pictures.name_tags import NameTag
    from morphosim.pictures.painter import Painter, Panel

FORMATS = (".png", ".jpg", ".jpeg", ".pdf", ".svg", ".tif", ".tiff", ".webp")
DPI = 120
MOST_NAMED = 500
"""Names of more cells would hide their colours, and are not read."""
FOOT = 0.45
"""Inches below the cells for scale bar and axes."""


def plot(
    run: "xr.Dataset",
    time: float | None = None,
    *,
    by: str = "cell",
    views: str | Sequence[View] = "three",
    colours: Mapping[str, object] | None = None,
    names: bool = True,
    shell: bool = True,
    matrix: bool = True,
    mirror: bool = False,
    cut: str | None = None,
    size: tuple[float, float] | None = None,
    path: str | Path | None = None,
) -> "Figure":
    """Figure of the save nearest to `time`: the cells, and the areas of their contacts.

    Parameters
    ----------
    run : Dataset of `open_run`
    time : float, optional
        The last save by default.
    by : {"cell", "type", "volume", "stage", "lineage"}, or a variable such as "pressure"
        What colours tell, see `cell_colours`.
    views : "three", a view, or several
        "three": along z, x and y, placed as in a technical drawing. A view is "x", "y", "z",
        "-x", "-y", "-z" (the camera is at that end of the axis), "corner", or the direction (3,)
        from the cells to the camera.
    colours : optional
        Colours by name, in place of those chosen.
    names : bool
        Whether cells that are seen well have their names; none is over another. Of more than
        `MOST_NAMED` none has.
    shell : bool
        Whether the shell is drawn, translucent, or the edges of the box.
    matrix : bool
        Whether to add the contact matrix, µm², of two cells or more.
    mirror : bool
        Whether to reverse z. The coordinates of the embryo scenes are left-handed (x to the
        posterior, y dorsal, z to the right), so that drawn as they are, they show the embryo's
        mirror image. With `mirror` the picture is the anatomy: the view along z shows it from
        its left, with small z in front.
    cut : str, optional
        "z" cuts away the upper half along z, towards the camera of that view, "-z" the lower one;
        "z=12.5" what is above 12.5 µm, "-z=12.5" what is below; x and y likewise. Coordinates are
        those of the run, whatever `mirror` says.
    size : (float, float), optional
        Width and height in inches, from 2 to 48; by default what the views need. Figures that are
        too small for them have no matrix, or no scale bars and axes.
    path : path, optional
        Picture to write: PNG, JPEG, TIFF or WebP, or PDF or SVG around pixels.

    Returns
    -------
    matplotlib Figure

    Raises
    ------
    ValueError
        A word is not known, the cut does not meet the cells, or the run lacks what it takes:
        fields, or contacts. Or there are so many cells that they do not fit into memory.
    ImportError
        PyVista or matplotlib is not installed.
    OSError
        The picture cannot be written, or the system has no library to draw with.
    """
    chosen = _views(views)
    for name, flag in (("names", names), ("shell", shell), ("matrix", matrix)):
        _validate.flag(name, flag)
    target = None if path is None else writable(path, FORMATS)
    need("matplotlib", "a figure", "pictures")
    from morphosim.pictures.matrix import contact_matrix

    seen = _sight(run, time, by, colours, shell, mirror, cut)
    contacts = contact_matrix(run, time_index(run, time)) if matrix else None
    if contacts is not None and len(contacts.names) < 2:
        contacts = None
    figure = _composed(seen, chosen, names, mirror, size, contacts)
    if target is not None:
        picture = BytesIO()  # its writers do not close a file on a full disk, or hide the error
        figure.savefig(picture, format=target.suffix[1:].lower())
        with replacing(target) as partial:
            partial.write_bytes(picture.getbuffer())
    return figure


def draw(
    ax: "Axes",
    run: "xr.Dataset",
    time: float | None = None,
    view: View = "z",
    *,
    by: str = "cell",
    colours: Mapping[str, object] | None = None,
    names: bool = True,
    shell: bool = True,
    mirror: bool = False,
    cut: str | None = None,
    bounds: ArrayLike | None = None,
    scale_bar: bool = True,
    axes: bool = True,
    foot: float | None = None,
) -> "Panel":
    """Draw the cells in the axes of a matplotlib figure, in as many pixels as these have.

    Parameters
    ----------
    ax : Axes
        Must have its final size.
    view : see `views` of `plot`
    bounds : (2, 3) µm, optional
        Corners of the box to have in view, the same for panels that are to be compared; by
        default the shell or box, or else the cells.
    scale_bar, axes : bool
        Whether to draw a scale bar, and arrows along x, y and z.
    foot : float, optional
        Inches to leave free below the cells, the same for panels that are to be compared; by
        default what scale bar and axes take.

    For the other parameters and errors see `plot`.

    Returns
    -------
    Panel, which knows where things are
    """
    from morphosim.pictures.painter import Painter

    need("matplotlib", "a figure", "pictures")
    box = None if bounds is None else checked_bounds(bounds, mirror)
    seen = _sight(run, time, by, colours, shell, mirror, cut)
    with Painter() as painter:
        return draw_sight(
            ax, seen, painter, view, box, names=names, mirror=mirror, scale_bar=scale_bar,
            axes=axes, foot=foot,
        )  # fmt: skip


def draw_sight(
    ax: "Axes",
    seen: Sight,
    painter: "Painter",
    view: View,
    points: NDArray[np.float64] | None = None,
    *,
    names: bool,
    mirror: bool,
    scale_bar: bool = True,
    axes: bool = True,
    foot: float | None = None,
    scale: float | None = None,
    before: "dict[str, NameTag] | None" = None,
) -> "Panel":
    """Draw what is to be seen in axes.

    Parameters
    ----------
    points : (N, 3) µm, optional
        What to have in view.
    scale : float, optional
        µm per pixel, in place of the smallest that has it all in view.
    before : optional
        Names in the frame before, of a film; those of this one take their place.

    For the other parameters see `draw`.
    """
    from morphosim.pictures import annotate

    seen.load(painter)
    if foot is None:
        foot = FOOT if scale_bar or axes else 0.0
    free = annotate.inches(ax, _validate.number("foot", foot, least=0))
    shown = seen.points if points is None else points
    panel = painter.paint(camera(view, shown, annotate.pixels_of(ax), scale=scale, foot=free))
    annotate.show_panel(ax, panel)
    if names and len(seen.meshes) <= MOST_NAMED:
        written = annotate.write_names(ax, panel, before, free)
        if before is not None:
            before.clear()
            before.update(written)
    if scale_bar:
        annotate.draw_bar(ax, panel.camera)
    if axes:
        annotate.draw_axes(ax, panel.camera, mirror)
    return panel


def render(
    run: "xr.Dataset",
    time: float | None = None,
    view: View = "z",
    *,
    by: str = "cell",
    colours: Mapping[str, object] | None = None,
    shell: bool = True,
    mirror: bool = False,
    cut: str | None = None,
    bounds: ArrayLike | None = None,
    size: tuple[int, int] = (800, 600),
) -> NDArray[np.uint8]:
    """Pixels of the cells in one view: (height, width, 3), red, green and blue from 0 to 255.

    Parameters
    ----------
    size : (int, int)
        Width and height in pixels, from 8 to 8192, and together at most 33 million.

    For the other parameters and errors see `draw` and `plot`.
    """
    from morphosim.pictures.painter import Painter

    pixels = checked_pixels(size, least=8)
    box = None if bounds is None else checked_bounds(bounds, mirror)
    seen = _sight(run, time, by, colours, shell, mirror, cut)
    with Painter() as painter:
        seen.load(painter)
        where = camera(view, seen.points if box is None else box, pixels)
        return painter.paint(where).image


def _sight(
    run: "xr.Dataset", time: float | None, by: str, colours: Mapping[str, object] | None,
    shell: bool, mirror: bool, cut: str | None,
) -> Sight:  # fmt: skip
    """What a picture of one save shows."""
    half = read_cut(cut)
    colouring = cell_colours(run, time, by, colours)
    around = surroundings(run, mirror) if shell else Surroundings()
    placed = placed_cut(run, [time_index(run, time)], half, around, mirror)
    return sight(run, time, colouring, mirror, around, placed)


def _views(views: str | Sequence[View]) -> list[View]:
    """Views of a figure; ValueError if one is not known."""
    if isinstance(views, str):
        _validate.choice("views", views, ("three", *VIEWS))
        return list(THREE) if views == "three" else [views]
    single = len(views) > 0 and not any(isinstance(view, str) or np.ndim(view) for view in views)
    chosen: list[Any] = [views] if single else list(views)
    if not chosen:
        message = "views is empty; give at least one, or 'three'"
        raise ValueError(message)
    for view in chosen:
        directions(view)
    return chosen


def _composed(
    seen: Sight, views: Sequence[View], names: bool, mirror: bool,
    size: tuple[float, float] | None, contacts: "ContactMatrix | None",
) -> "Figure":  # fmt: skip
    """Figure of views and contact matrix, with title and legend above."""
    from morphosim.pictures import annotate
    from morphosim.pictures.key import draw_key
    from morphosim.pictures.matrix import block_room, draw_matrix
    from morphosim.pictures.painter import Painter

    block = None if contacts is None else block_room(contacts)
    plan: Layout = layout(seen, views, block, FOOT, size)
    figure = annotate.Picture(figsize=plan.size, dpi=DPI)
    annotate.draw_title(figure, seen.title, 12)
    draw_key(figure, seen.colouring, plan.key_top)
    with Painter() as painter:
        for view, place in zip(views, plan.places, strict=False):
            draw_sight(
                figure.add_axes(plan.share(place)), seen, painter, view, names=names,
                mirror=mirror, scale=1 / plan.per_micrometre / DPI, foot=plan.foot,
                scale_bar=plan.foot > 0, axes=plan.foot > 0,
            )  # fmt: skip
    if contacts is not None and len(plan.places) > len(views):
        draw_matrix(figure, plan.places[-1], contacts)
    return figure
