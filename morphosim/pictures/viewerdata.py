"""What the viewer's page shows, as plain data: a run, or one time of a running simulation."""

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from morphosim import _validate
from morphosim._extras import need
from morphosim.pictures.colours import (
    BY,
    TITLES,
    Scale,
    colours_of_saves,
    living,
    measures,
    type_colours,
)
from morphosim.pictures.cut import Cut, read_cut
from morphosim.pictures.detail import whole_meshes
from morphosim.pictures.meshcode import MOST_TRIANGLES, packed
from morphosim.pictures.meshes import CellMesh, run_confinement, shell_mesh
from morphosim.pictures.palettes import hexed
from morphosim.progress import Tell
from morphosim.runs.saved_fields import save_count, time_index, variable
from morphosim.runs.views import contacts

if TYPE_CHECKING:
    import xarray as xr

ALL_TRIANGLES = 3_000_000
"""A page holds about so many triangles by default: some 17 MB."""
FEWEST, MOST = 200, 1500
"""Triangles of a cell by default are between these."""
LIVE_TRIANGLES = 800
SHELL_TRIANGLES = 3000
LARGE = ("phi", "label")
"""Variables of a run that the figures of cells do not need."""
FIGURES = {"volume": "volume", "target": "target_volume", "surface": "surface_area"}
"""Figures of a cell, and the variables of a run that hold them."""
MEASURES = ("pressure", "age", "generation")
"""Numbers by which cells can be coloured, of a run that has them, besides the one asked for."""


def run_data(
    run: "xr.Dataset",
    times: int | Iterable[float] | None = None,
    triangles: int | None = None,
    total: int = ALL_TRIANGLES,
    tell: Tell | None = None,
    *,
    by: str | None = None,
    cut: str | None = None,
) -> dict[str, Any]:
    """All that the viewer shows of a run. Needs PyVista.

    Parameters
    ----------
    run : Dataset of `open_run`
    times : whole number or numbers, optional
        So many saves, evenly spread from the first to the last, or the saves nearest to these
        times. By default all.
    triangles : int, optional
        Most triangles of a cell. By default 200 to 1500.
    total : int
        By default so many triangles are shared out between the cells of all times; then a page of
        up to 15000 cells, summed over all times, has less than 20 MB.
    tell : callable, optional
        Told how many saves are done, and of how many.
    by : str, optional
        What colours tell at first, see `cell_colours`; the page offers others.
    cut : str, optional
        Where the cells are cut open at first, see `plot`.

    Returns
    -------
    dict that JSON can hold
        `title`; `cells` with `name` and `parent`; `colourings`; `shell`, a packed mesh or None;
        `bounds`, two corners in µm; `frames`, one of each save as `frame` makes them, with
        `values`, of each cell by measure; `by` and `cut` that the page begins with.

    Raises
    ------
    ValueError
        A save was made without fields, the Dataset is not a whole run, `times` is empty, or `by`
        or `cut` is not known. Or a save has so many cells that they do not fit into memory.
    ImportError
        PyVista is not installed.
    """
    need("pyvista", "the viewer", "pictures")
    saves, half = _saves(run, times), read_cut(cut)
    if by is not None:
        _validate.choice("by", by, dict.fromkeys((*BY, *measures(run))))
    figures = run.drop_vars(LARGE, errors="ignore").load()
    confinement = run_confinement(run)
    shell = [] if confinement is None else [shell_mesh(confinement)]
    corners = [_corners(shell)] if shell else []
    triangles = _default_triangles(figures, saves, total) if triangles is None else triangles
    known = [of for of in measures(run) if of in (by, *MEASURES) and of not in BY]
    frames = []
    for done, save in enumerate(saves, 1):
        meshes = whole_meshes(run, save)
        frames.append(_save_frame(figures, save, meshes, triangles))
        frames[-1]["values"] = _values(figures, save, meshes, known)
        corners += [_corners(meshes)] if meshes else []
        if tell is not None:
            tell(done, len(saves))
    return {
        "title": str(run.attrs.get("scene", "")),
        "cells": _family(figures),
        "colourings": _colourings(figures, saves, by, known),
        "by": by,
        "cut": None if half is None else _cut(half),
        "shell": packed(shell, SHELL_TRIANGLES) if shell else None,
        "bounds": _bounds(corners),
        "frames": frames,
    }


def frame(
    time: float,
    meshes: Sequence[CellMesh],
    figures: Mapping[str, Mapping[str, Any]] | None = None,
    *,
    stage: str = "",
    triangles: int = LIVE_TRIANGLES,
) -> dict[str, Any]:
    """One time for the viewer. Needs PyVista.

    Parameters
    ----------
    time : float, *in silico*
    meshes : of the cells that are there, as `cell_meshes` and `field_meshes` make them
    figures : optional
        Of cells by name: any of `volume` and `target` (µm³), `surface` (µm²) and `neighbours`,
        the contact area (µm²) by name. What is missing is not shown.
    stage : str
        Of the protocol.
    triangles : int
        Most triangles of a cell.
    """
    need("pyvista", "the viewer", "pictures")
    triangles = min(_validate.integer("triangles", triangles, least=4), MOST_TRIANGLES)
    names = [mesh.name for mesh in meshes]
    known = [(figures or {}).get(name, {}) for name in names]
    return {
        "time": _validate.number("time", time),
        "stage": stage,
        "cells": names,
        "types": [mesh.type for mesh in meshes],
        **{key: [_rounded(of.get(key)) for of in known] for key in FIGURES},
        "contacts": _contact_list(names, known),
        "mesh": packed(meshes, triangles),
    }


def _saves(run: "xr.Dataset", times: int | Iterable[float] | None) -> list[int]:
    """Numbers of the saves to show, in order, each once."""
    count = save_count(run)
    if times is None:
        return list(range(count))
    if not isinstance(times, Iterable):
        number = min(_validate.integer("times", times, least=1), count)
        # one time alone is the last
        return [round(save) for save in np.linspace(count - 1, 0, number)[::-1].tolist()]
    saves = sorted({time_index(run, _validate.number("times", time)) for time in times})
    if not saves:
        message = "times is empty; give at least one, or None for all"
        raise ValueError(message)
    return saves


def _default_triangles(figures: "xr.Dataset", saves: Sequence[int], total: int) -> int:
    """Triangles of a cell, of so many in all."""
    cells = sum(len(living(figures, save)) for save in saves)
    return int(np.clip(total // max(cells, 1), FEWEST, MOST))


def _save_frame(
    figures: "xr.Dataset", save: int, meshes: Sequence[CellMesh], triangles: int
) -> dict[str, Any]:
    """Frame of a save."""
    names = variable(figures, "cell", "cell").values.astype(str).tolist()
    of_cells: dict[str, dict[str, Any]] = {name: {"neighbours": {}} for name in names}
    for key, column in FIGURES.items():
        if column in figures:
            values = variable(figures, column, "time", "cell")[save].values
            for name, value in zip(names, values.tolist(), strict=True):
                of_cells[name][key] = value
    for a, b, area in contacts(figures, save):
        of_cells[a]["neighbours"][b] = area
    return frame(
        float(figures["time"].values[save]),
        meshes,
        of_cells,
        stage=str(variable(figures, "stage", "time").values[save]),
        triangles=triangles,
    )


def _values(
    figures: "xr.Dataset", save: int, meshes: Sequence[CellMesh], known: Sequence[str]
) -> dict[str, list[float | None]]:
    """Numbers of the cells that are shown, by measure."""
    places = {name: k for k, name in enumerate(variable(figures, "cell", "cell").values.tolist())}
    shown = [places[mesh.name] for mesh in meshes]
    return {
        of: [_rounded(value) for value in figures[of].values[save, shown].tolist()] for of in known
    }


def _cut(half: Cut) -> dict[str, Any]:
    """Cut as the page has it; by default through the middle."""
    return {"axis": half.axis, "place": half.place, "keepsLow": half.keeps_low}


def _contact_list(
    names: Sequence[str], figures: Sequence[Mapping[str, Any]]
) -> list[tuple[int, int, float | None]]:
    """Places of two cells in `names` and their contact area, each pair once."""
    places = {name: k for k, name in enumerate(names)}
    areas: dict[tuple[int, int], float | None] = {}
    for k, of in enumerate(figures):
        for other, area in of.get("neighbours", {}).items():
            if other in places:
                pair = (min(k, places[other]), max(k, places[other]))
                areas[pair] = _rounded(area)
    return [(i, j, area) for (i, j), area in areas.items()]


def _rounded(value: float | None) -> float | None:
    """Five digits, more than anybody reads; None where there is no number."""
    if value is None or not np.isfinite(value):
        return None
    return float(f"{float(value):.5g}")


def _family(figures: "xr.Dataset") -> list[dict[str, str]]:
    """Name and mother of every cell of the run."""
    names, parents = (
        variable(figures, key, "cell").values.astype(str).tolist() for key in ("cell", "parent")
    )
    return [{"name": name, "parent": of} for name, of in zip(names, parents, strict=True)]


Corners = tuple[np.ndarray, np.ndarray]


def _corners(meshes: Sequence[CellMesh]) -> Corners:
    """Lowest and highest coordinates, µm: two of (3,)."""
    points = np.concatenate([mesh.vertices for mesh in meshes])
    return points.min(axis=0), points.max(axis=0)


def _bounds(corners: Sequence[Corners]) -> list[list[float]]:
    """Corners of all that is ever shown."""
    low, high = zip(*corners, strict=True) if corners else ([np.zeros(3)], [np.ones(3)])
    return [np.min(low, axis=0).astype(float).tolist(), np.max(high, axis=0).astype(float).tolist()]


def _colourings(
    figures: "xr.Dataset", saves: Sequence[int], first: str | None, known: Sequence[str]
) -> list[dict[str, Any]]:
    """What cells can be coloured by, leaving out what gives all the same colour."""
    made = [_colouring(figures, saves, by) for by in (*BY, *known)]
    return [
        of
        for of in made
        if of["by"] in ("cell", "volume", first, *known)
        or len(set(of["cells"].values()) | set(of["types"].values())) > 1
    ]


def _colouring(figures: "xr.Dataset", saves: Sequence[int], by: str) -> dict[str, Any]:
    """Colours of all cells that are in these saves, or of their types.

    `legend` holds the entries of all saves; the page shows those of cells that are there.
    """
    if by == "type":
        types = _types(figures, saves)
        return {"by": by, "title": TITLES[by], "cells": {}, "types": types, "legend": [],
                "scale": None}  # fmt: skip
    made = colours_of_saves(figures, saves, by)
    cells = {name: hexed(colour) for one in made for name, colour in one.colours.items()}
    scale, legend = made[0].scale, made[0].legend
    return {
        "by": by,
        "title": made[0].title,
        "cells": cells if by in TITLES else {},
        "types": {},
        # names of cells stand on them
        "legend": [] if by == "cell" else [(text, hexed(colour)) for text, colour in legend],
        "scale": None if scale is None else _bar(scale),
        "measured": by not in BY,
    }


def _types(figures: "xr.Dataset", saves: Sequence[int]) -> dict[str, str]:
    """Colour of each type that a cell has in these saves."""
    kinds = variable(figures, "type", "time", "cell").values.astype(str)
    there = np.isfinite(variable(figures, "volume", "time", "cell").values)
    seen = {kind for save in saves for kind in kinds[save][there[save]].tolist()}
    palette = type_colours(figures)
    return {kind or "no type": hexed(palette[kind]) for kind in palette if kind in seen}


def _bar(scale: Scale) -> dict[str, Any]:
    """Colour bar."""
    return {
        "low": float(scale.low),
        "high": float(scale.high),
        "stops": [hexed(stop) for stop in scale.stops],
        "ticks": [[float(value), text] for value, text in scale.ticks],
    }
