"""Commands on saved runs: `info`, `contacts`, `pack`, `export`, `quality-control`."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from morphosim._files import check_free, write_text
from morphosim.cli.app import Overwrite, command, note, progress, say
from morphosim.exports.formats import FORMATS

if TYPE_CHECKING:
    import xarray as xr

EXPORTS = ", ".join(f"{name}: {form.title}" for name, form in FORMATS.items())
ONLY_LAST = ", ".join(name for name, form in FORMATS.items() if form.last_only)


@command()
def info(
    directory: Annotated[Path, typer.Argument(help="directory or packed file of a run")],
) -> None:
    """Say what a run holds, and how it stands."""
    from morphosim.accessor import open_run
    from morphosim.cli.run_facts import run_facts

    with open_run(directory) as data:
        say(run_facts(data, directory))


@command()
def contacts(
    directory: Annotated[Path, typer.Argument(help="directory or packed file of a run")],
    time: Annotated[float | None, typer.Option(help="nearest save; the last by default")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="machine-readable output")] = False,
) -> None:
    """List which cells touch, and over what area; of a run without fields, areas alone."""
    from morphosim.accessor import open_run
    from morphosim.runs.saved_fields import time_index

    with open_run(directory) as data:
        index = time_index(data, time)
        at = float(data["time"].values[index])
        areas, shared = _contacts(data, index)
    pairs = sorted({*areas, *(shared or ())})
    if as_json:
        rows = [
            {
                "cells": pair, "area_um2": areas.get(pair, 0),
                "touching_voxels": None if shared is None else shared.get(pair, 0),
            }
            for pair in pairs
        ]  # fmt: skip
        say(json.dumps({"time": at, "contacts": rows}))
        return
    if shared is None:
        say(f"t = {at:g}: {len(areas)} pairs have contact area; what touches, saved fields tell")
    else:
        say(f"t = {at:g}: {len(shared)} pairs touch")
    for a, b in pairs:
        mark = "?" if shared is None else "touch" if (a, b) in shared else "-"
        say(f"{a:10} {b:10} {mark:6} {areas.get((a, b), 0.0):8.1f} um2")


Pairs = dict[tuple[str, str], Any]


def _contacts(data: "xr.Dataset", index: int) -> tuple[Pairs, Pairs | None]:
    """Contact areas in µm² of pairs of cells at a save, and lattice points of those that touch.

    The cell that comes first in the run is the first of a pair. None for a run without fields.
    """
    from morphosim.measure.contacts import touching
    from morphosim.runs.saved_fields import each_field
    from morphosim.runs.views import contact_places

    names = data["cell"].values.astype(str)
    places, areas = contact_places(data, index)
    known = dict(zip(map(tuple, names[places].tolist()), areas.tolist(), strict=True))
    if "phi" not in data:
        return known, None
    place = {name: k for k, name in enumerate(names.tolist())}
    shared = touching(each_field(data, index))
    return known, {
        (a, b) if place[a] < place[b] else (b, a): count for (a, b), count in shared.items()
    }


@command()
def pack(
    directory: Annotated[Path, typer.Argument(help="directory or packed file of a run")],
    file: Annotated[Path, typer.Argument(help="netCDF file to write")],
    overwrite: Overwrite = False,
) -> None:
    """Write a run into one netCDF file, which opens as the directory does."""
    from morphosim.runs.pack import pack as write

    with progress() as tell:
        write(directory, file, lambda done, of: tell("packing", done, of), overwrite=overwrite)
    note(f"{file}: {file.stat().st_size / 1e6:.1f} MB")


@command()
def export(
    directory: Annotated[Path, typer.Argument(help="directory or packed file of a run")],
    to: Annotated[str, typer.Option(help=EXPORTS)],
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", help="directory to write; by default RUN-FORMAT"),
    ] = None,
    time: Annotated[
        list[float] | None,
        typer.Option(help=f"nearest save; repeatable; by default all, for {ONLY_LAST} the last"),
    ] = None,
    overwrite: Overwrite = False,
) -> None:
    """Write a run for other programs: surfaces, label images or tables, in um."""
    from morphosim.accessor import open_run
    from morphosim.exports.export import export as write

    place = directory.resolve()
    target = output or place.with_name(f"{place.stem if place.is_file() else place.name}-{to}")
    with open_run(directory) as data, progress() as tell:
        files = write(
            data, target, to, time, lambda done, of: tell(f"export to {to}", done, of),
            overwrite=overwrite,
        )  # fmt: skip
    size = sum(file.stat().st_size for file in files)
    note(f"{target}: {len(files)} files, {size / 1e6:.1f} MB")


@command("quality-control")
def quality_control(
    directory: Annotated[Path, typer.Argument(help="directory or packed file of a run")],
    json_file: Annotated[
        Path | None, typer.Option("--json", help="write the criteria to this file as well")
    ] = None,
    overwrite: Overwrite = False,
) -> None:
    """Judge a run of celegans-1-to-8 by criteria A to H of Supplementary Note 1."""
    from morphosim.accessor import open_run
    from morphosim.library.celegans.quality_control import quality_control as judge
    from morphosim.library.celegans.quality_report import report_text, to_json

    if json_file is not None:
        check_free(json_file, overwrite)
    with open_run(directory) as data:
        criteria = judge(data)
    if json_file is not None:
        write_text(json_file, to_json(criteria) + "\n")
    say(report_text(criteria))
