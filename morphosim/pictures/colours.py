"""Colours of cells that colour-blind eyes tell apart, and what a legend needs.

The palette is that of Okabe and Ito (https://jfly.uni-koeln.de/color/).
"""

from collections.abc import Mapping, Sequence
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
    evenly,
    interpolated,
    rgb,
    set_apart,
    some_colours,
)
from morphosim.runs.saved_fields import check_saves, time_index, variable

if TYPE_CHECKING:
    import xarray as xr

BY = ("cell", "type", "volume", "stage", "lineage")
EMBRYO = ("AB", "MS", "E", "C", "D", "P", "EMS")
"""Founders of C. elegans, which have the same colours in every run."""
MOST_IN_LEGEND = 9
"""Of more groups there is no legend, of more stages a colour bar."""
LEAST_ERROR = 1.0
"""%, least range of the colours of volume errors."""
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
        One of `BY`.
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
    by : {"cell", "type", "volume", "stage", "lineage"}
        "cell": cells that touch differ. "type": of the cell at that time. "volume": error in %
        of the target volume. "stage": of the protocol, in which the cell was first seen.
        "lineage": the founder that a C. elegans cell stems from by its name; in a run with other
        names, the cell without a mother that it stems from.
    colours : optional
        Colour ("#d55e00", or red, green and blue from 0 to 1) of some cells, types, stages or
        founders by name, whichever `by` says. It may hold names of other runs as well.

    Raises
    ------
    ValueError
        `by` is not known, `colours` names nothing of the run or gives no colour, or the run lacks
        what it takes.
    """
    _validate.choice("by", by, BY)
    if time is not None:
        _validate.number("time", time)
    save = time_index(run, time)
    if by == "volume":
        return _by_volume(run, save, colours)
    make = {"cell": _of_cells, "type": _of_types, "stage": _of_stages, "lineage": _of_founders}
    of_cell, palette = make[by](run, save)
    _recolour(palette, colours or {}, by)
    there = {name: palette[of_cell[name]] for name in living(run, save)}
    return _with_legend(by, there, {of_cell[name] for name in there}, palette)


def _recolour(palette: dict[str, RGB], colours: Mapping[str, object], by: str) -> None:
    """Replace colours of a palette; names that it lacks may be those of another run."""
    if colours and not colours.keys() & palette.keys():
        _validate.choice(f"colours of {by}", next(iter(colours)), palette)
    palette |= {name: rgb(colour) for name, colour in colours.items() if name in palette}


def living(run: "xr.Dataset", save: int) -> list[str]:
    """Names of the cells of a save, in the order of `run.cell`."""
    there = np.isfinite(variable(run, "volume", "time", "cell")[save].values)
    return [str(name) for name in variable(run, "cell", "cell").values[there]]


def type_colours(run: "xr.Dataset") -> dict[str, RGB]:
    """Colour of each type that a cell of the run ever has; "" where it has none."""
    return _of_types(run, 0)[1]


Groups = tuple[Mapping[str, str], dict[str, RGB]]
"""Group of each cell of the run, and colour of each group."""


def _of_cells(run: "xr.Dataset", save: int) -> Groups:
    names = _names(run)
    places = set_apart(len(names), _ever_touching(run))
    return dict(zip(names, names, strict=True)), dict(zip(names, places, strict=True))


def _of_types(run: "xr.Dataset", save: int) -> Groups:
    kinds = variable(run, "type", "time", "cell").values.astype(str)
    there = np.isfinite(variable(run, "volume", "time", "cell").values)
    known = sorted(set(kinds[there].tolist()) - {""})
    palette = dict(zip(known, some_colours(len(known)), strict=True)) | {"": GREY}
    return dict(zip(_names(run), kinds[save].tolist(), strict=True)), palette


def _of_stages(run: "xr.Dataset", save: int) -> Groups:
    stages = variable(run, "stage", "time").values.astype(str)
    there = np.isfinite(variable(run, "volume", "time", "cell").values)
    order = list(dict.fromkeys(stages.tolist()))
    palette = dict(zip(order, evenly(SEQUENTIAL, len(order)), strict=True))
    return dict(zip(_names(run), stages[there.argmax(axis=0)].tolist(), strict=True)), palette


def _of_founders(run: "xr.Dataset", save: int) -> Groups:
    founder = founders(run)
    order = list(dict.fromkeys(founder.values()))
    if set(order) <= set(EMBRYO):
        order = list(EMBRYO)
    return founder, dict(zip(order, some_colours(len(order)), strict=True))


def _by_volume(run: "xr.Dataset", save: int, colours: Mapping[str, object] | None) -> Colouring:
    """Relative error of the volumes, in %; grey where there is no target."""
    if colours is not None:
        message = "colours has no effect where by = 'volume': errors are on a scale"
        raise ValueError(message)
    target = variable(run, "target_volume", "time", "cell").values
    errors = 100 * (variable(run, "volume", "time", "cell").values / target - 1)
    common = np.nanpercentile(np.abs(errors), COMMON) if np.isfinite(errors).any() else 0.0
    high = _round_up(max(float(common), LEAST_ERROR))
    shown = np.clip(errors[save] / high, -1, 1)
    error = dict(zip(_names(run), shown.tolist(), strict=True))
    there = {
        name: interpolated(DIVERGING, (error[name] + 1) / 2) if np.isfinite(error[name]) else GREY
        for name in living(run, save)
    }
    ticks = [(value, f"{value:+g}" if value else "0") for value in (-high, -high / 2, 0, high / 2)]
    scale = Scale(-high, high, DIVERGING, [*ticks, (high, f"{high:+g}")])
    return Colouring("volume", "volume error, %", there, scale=scale)


def _round_up(value: float) -> float:
    """Next of 1, 2, 5, 10, … times a power of ten."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(next(step * power for step in (1, 2, 5, 10) if step * power >= value * 0.999))


def groups(run: "xr.Dataset", save: int) -> dict[str, str]:
    """Group of each cell, sorted by group: by type if there are several, or else by lineage."""
    of_cell, palette = _of_types(run, save)
    if len(palette) <= 2:  # one type, and none
        of_cell, palette = _of_founders(run, save)
    order = {group: k for k, group in enumerate(palette)}
    return dict(sorted(of_cell.items(), key=lambda item: order[item[1]]))


TITLES = {"cell": "cell", "type": "type", "stage": "first seen in", "lineage": "lineage"}


def _with_legend(
    by: str, colours: Mapping[str, RGB], shown: set[str], palette: Mapping[str, RGB]
) -> Colouring:
    """Legend of what is there; many stages become a colour bar."""
    groups = [name for name in palette if name in shown]
    if len(groups) <= MOST_IN_LEGEND:
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
