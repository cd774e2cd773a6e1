"""Colours of cells that colour-blind eyes tell apart, and what a legend needs.

The palette is that of Okabe and Ito (https://jfly.uni-koeln.de/color/).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from morphosim import _validate
from morphosim.pictures.lineages import founders
from morphosim.pictures.palettes import (
    DIVERGING,
    GREY,
    RGB,
    SEQUENTIAL,
    blended,
    evenly,
    rgb,
    set_apart,
    some_colours,
)
from morphosim.runs.saved_fields import check_saves, save_count, time_index, variable

if TYPE_CHECKING:
    import xarray as xr

BY = ("cell", "type", "volume", "stage", "lineage")
EMBRYO = ("AB", "MS", "E", "C", "D", "P", "EMS")
"""Founders of C. elegans, which have the same colours in every run."""
UNITS = {"um": "µm", "um2": "µm²", "um3": "µm³"}
MOST_IN_LEGEND = {"cell": 9, "type": 40, "stage": 9, "lineage": 40}
"""Of more groups there is no legend, of more stages a colour bar. Names of cells stand on them."""
SHADES = 96
"""Of a colour bar whose steps are not seen."""
LEAST_ERROR = 1.0
"""%, least range of the colours of volume errors."""
MOST_STEPS = 5
"""Between the marks of a colour bar."""
ROUNDING = 1e-9
COMMON = 95
"""% of all volume errors that the range of colours takes in."""


@dataclass(frozen=True, slots=True)
class Scale:
    """Colour bar.

    Attributes
    ----------
    low, high : float
    stops : colours at even distances from `low` to `high`
    ticks : value and text of each mark
    """

    low: float
    high: float
    stops: Sequence[RGB]
    ticks: Sequence[tuple[float, str]]


@dataclass(frozen=True, slots=True)
class Colouring:
    """Colours of the cells of one save.

    Attributes
    ----------
    by : str
        One of `BY`, or of `measures`.
    title : str
        Of the legend or colour bar.
    colours : RGB of each cell that is there, by name, in the order of `run.cell`
    legend : text and RGB of each entry, or ()
    scale : Scale or None
    """

    by: str
    title: str
    colours: Mapping[str, RGB]
    legend: Sequence[tuple[str, RGB]] = ()
    scale: Scale | None = None


def cell_colours(
    run: "xr.Dataset",
    time: float | None = None,
    by: str = "cell",
    colours: Mapping[str, object] | None = None,
) -> Colouring:
    """Colours of the cells of the save nearest to `time`, the same in every save of the run.

    Parameters
    ----------
    run : Dataset of `open_run`
    time : float, optional
        The last save by default.
    by : {"cell", "type", "volume", "stage", "lineage"}, or a variable
        "cell": cells that touch differ. "type": of the cell at that time. "volume": error in %
        of the target volume. "stage": of the protocol, in which the cell was first seen.
        "lineage": the founder that a C. elegans cell stems from by its name; in a run with other
        names, the cell without a mother that it stems from. Or the name of a number that each cell
        has at each time, such as "pressure", "age", "generation" or "sphericity".
    colours : optional
        Colour ("#d55e00", or red, green and blue from 0 to 1) of some cells, types, stages or
        founders by name, whichever `by` says. It may hold names of other runs as well.

    Raises
    ------
    ValueError
        `by` is not known, `colours` names nothing of the run or gives no colour, or the run lacks
        what it takes.
    """
    if time is not None:
        _validate.number("time", time)
    return colours_of_saves(run, [time_index(run, time)], by, colours)[0]


def colours_of_saves(
    run: "xr.Dataset",
    saves: Sequence[int],
    by: str = "cell",
    colours: Mapping[str, object] | None = None,
) -> list[Colouring]:
    """Colours of the cells of each of some saves; the legend is of all of them, in each the same.

    For the parameters and errors see `cell_colours`.
    """
    return [*map(colouring_by_save(run, saves, by, colours), saves)]


def colouring_by_save(
    run: "xr.Dataset",
    saves: Sequence[int],
    by: str = "cell",
    colours: Mapping[str, object] | None = None,
) -> Callable[[int], Colouring]:
    """What gives `colours_of_saves` save by save, for a film of more cells than fit at once."""
    _validate.choice("by", by, dict.fromkeys((*BY, *measures(run))))
    if by not in TITLES:
        return (_by_volume if by == "volume" else _by_measure)(run, by, colours)
    make = {"cell": _of_cells, "type": _of_types, "stage": _of_stages, "lineage": _of_founders}
    of_cells, palette = make[by](run)
    _recolour(palette, colours or {}, by)

    def groups(save: int) -> list[str]:
        return [str(group) for group in of_cells[save][_there(run, save)]]

    def of_save(save: int) -> Colouring:
        cells = dict(
            zip(living(run, save), (palette[group] for group in groups(save)), strict=True)
        )
        return _with_legend(by, cells, shown, palette)

    shown = {group for save in saves for group in groups(save)}
    return of_save


def key_colours(colouring: Colouring) -> list[RGB]:
    """Colours of the legend, or so many shades of the colour bar that it looks even."""
    if colouring.scale is not None:
        return evenly(colouring.scale.stops, SHADES)
    return [colour for _, colour in colouring.legend]


def _recolour(palette: dict[str, RGB], colours: Mapping[str, object], by: str) -> None:
    """Replace colours of a palette; names that it lacks may be those of another run."""
    if colours and not colours.keys() & palette.keys():
        _validate.choice(f"colours of {by}", next(iter(colours)), palette)
    palette |= {name: rgb(colour) for name, colour in colours.items() if name in palette}


def living(run: "xr.Dataset", save: int) -> list[str]:
    """Names of the cells of a save, in the order of `run.cell`."""
    return [str(name) for name in variable(run, "cell", "cell").values[_there(run, save)]]


def _there(run: "xr.Dataset", save: int) -> NDArray[np.bool_]:
    """Which cells of the run are there at a save."""
    return np.asarray(np.isfinite(variable(run, "volume", "time", "cell")[save].values))


def type_colours(run: "xr.Dataset") -> dict[str, RGB]:
    """Colour of each type that a cell of the run ever has; "" where it has none."""
    return _of_types(run)[1]


Groups = tuple[NDArray[np.str_], dict[str, RGB]]
"""Group of each cell of the run in each save, (saves, cells), and colour of each group."""


def _of_cells(run: "xr.Dataset") -> Groups:
    names = _names(run)
    places = set_apart(len(names), _ever_touching(run))
    return _always(run, names), dict(zip(names, places, strict=True))


def _of_types(run: "xr.Dataset") -> Groups:
    kinds = variable(run, "type", "time", "cell").values.astype(str)
    there = np.isfinite(variable(run, "volume", "time", "cell").values)
    known = sorted(set(kinds[there].tolist()) - {""})
    return kinds, dict(zip(known, some_colours(len(known)), strict=True)) | {"": GREY}


def _of_stages(run: "xr.Dataset") -> Groups:
    stages = variable(run, "stage", "time").values.astype(str)
    there = np.isfinite(variable(run, "volume", "time", "cell").values)
    order = list(dict.fromkeys(stages.tolist()))
    palette = dict(zip(order, evenly(SEQUENTIAL, len(order)), strict=True))
    return _always(run, stages[there.argmax(axis=0)].tolist()), palette


def _of_founders(run: "xr.Dataset") -> Groups:
    founder = founders(run)
    order = list(dict.fromkeys(founder.values()))
    if set(order) <= set(EMBRYO):
        order = list(EMBRYO)
    palette = dict(zip(order, some_colours(len(order)), strict=True))
    return _always(run, [founder[name] for name in _names(run)]), palette


def _always(run: "xr.Dataset", groups: Sequence[str]) -> NDArray[np.str_]:
    """Groups (cells,) that are the same in every save."""
    return np.broadcast_to(np.array(groups, str), (save_count(run), len(groups)))


def measures(run: "xr.Dataset") -> list[str]:
    """Names of the numbers that each cell of a run has at each time."""
    return [
        str(name) for name, values in run.data_vars.items()
        if values.dims == ("time", "cell") and values.dtype.kind in "fiu"
    ]  # fmt: skip


def _by_measure(
    run: "xr.Dataset", by: str, colours: Mapping[str, object] | None
) -> Callable[[int], Colouring]:
    """Values of a variable on the scale of all saves; grey where there is none."""
    _refuse_colours(by, colours)
    values, units = run[by].values.astype(float), run[by].attrs.get("units", "1")
    known = values[np.isfinite(values)]
    low, high = (float(known.min()), float(known.max())) if len(known) else (0.0, 1.0)
    if low == high:
        low, high = low - 0.5, high + 0.5
    scale = Scale(low, high, SEQUENTIAL, _round_marks(low, high, bool((known % 1 == 0).all())))
    title = by.replace("_", " ") + (f", {UNITS.get(units, units)}" if units != "1" else "")
    return _on_scale(run, by, title, scale, values)


def _round_marks(low: float, high: float, whole: bool) -> list[tuple[float, str]]:
    """Two to six round numbers of a range, whole ones if values are."""
    step = _round_up((high - low) / MOST_STEPS)
    step = max(step, 1.0) if whole else step
    marks = step * np.arange(np.ceil(low / step - ROUNDING), np.floor(high / step + ROUNDING) + 1)
    return [(mark, f"{mark:.6g}".replace("-", "−")) for mark in (marks + 0.0).tolist()]


def _refuse_colours(by: str, colours: Mapping[str, object] | None) -> None:
    if colours is not None:
        message = f"colours has no effect where by = {by!r}: values are on a scale"
        raise ValueError(message)


def _on_scale(
    run: "xr.Dataset", by: str, title: str, scale: Scale, values: NDArray[np.float64]
) -> Callable[[int], Colouring]:
    """Colours of values (saves, cells) on a scale; grey where there is none."""

    def of_save(save: int) -> Colouring:
        places = (values[save][_there(run, save)] - scale.low) / (scale.high - scale.low)
        shades = dict(zip(living(run, save), blended(scale.stops, places), strict=True))
        return Colouring(by, title, shades, scale=scale)

    return of_save


def _by_volume(
    run: "xr.Dataset", by: str, colours: Mapping[str, object] | None
) -> Callable[[int], Colouring]:
    """Relative error of the volumes, in %; grey where there is no target."""
    _refuse_colours(by, colours)
    target = variable(run, "target_volume", "time", "cell").values
    errors = 100 * (variable(run, "volume", "time", "cell").values / target - 1)
    common = np.nanpercentile(np.abs(errors), COMMON) if np.isfinite(errors).any() else 0.0
    high = _round_up(max(float(common), LEAST_ERROR))
    marks = (-high, -high / 2, 0.0, high / 2, high)
    ticks = [(mark, f"{mark:+g}".replace("-", "−") if mark else "0") for mark in marks]
    scale = Scale(-high, high, DIVERGING, ticks)
    return _on_scale(run, by, "volume error, %", scale, errors)


def _round_up(value: float) -> float:
    """Next of 1, 2, 5, 10, … times a power of ten."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(next(step * power for step in (1, 2, 5, 10) if step * power >= value * 0.999))


def groups(run: "xr.Dataset", save: int) -> dict[str, str]:
    """Group of each cell, sorted by group: by type if there are several, or else by lineage."""
    of_cells, palette = _of_types(run)
    if len(palette) <= 2:  # one type, and none
        of_cells, palette = _of_founders(run)
    of_cell = dict(zip(_names(run), of_cells[save].tolist(), strict=True))
    order = {group: k for k, group in enumerate(palette)}
    return dict(sorted(of_cell.items(), key=lambda item: order[item[1]]))


TITLES = {"cell": "cell", "type": "type", "stage": "first seen in", "lineage": "lineage"}


def _with_legend(
    by: str, colours: Mapping[str, RGB], shown: set[str], palette: Mapping[str, RGB]
) -> Colouring:
    """Legend of what is there; many stages become a colour bar."""
    groups = [name for name in palette if name in shown]
    if len(groups) <= MOST_IN_LEGEND[by]:
        legend = [(name or f"no {by}", palette[name]) for name in groups]
        return Colouring(by, TITLES[by], colours, legend)
    if by != "stage":
        return Colouring(by, TITLES[by], colours)
    order = list(palette)
    marks = np.unique(np.linspace(0, len(order) - 1, 5).round().astype(int)).tolist()
    scale = Scale(0, len(order) - 1, SEQUENTIAL, [(mark, order[mark]) for mark in marks])
    return Colouring(by, TITLES[by], colours, scale=scale)


def _names(run: "xr.Dataset") -> list[str]:
    return [str(name) for name in variable(run, "cell", "cell").values]


def _ever_touching(run: "xr.Dataset") -> NDArray[np.int64]:
    """Pairs of cells, as places in `run.cell`, that touch in some save: (P, 2)."""
    if "contact_area" in run:
        areas = variable(run, "contact_area", "time", "cell", "neighbour").values
        return np.argwhere(np.nan_to_num(areas).max(axis=0) > 0)
    if "contact_time" not in run:
        return np.zeros((0, 2), np.int64)
    saves, *pairs = (
        variable(run, f"contact_{name}", "contact").values for name in ("time", "cell", "neighbour")
    )
    check_saves(run, saves)
    return np.unique(np.stack(pairs, axis=1).astype(np.int64), axis=0)
