"""Commands on saved runs: `info`, `contacts`, `pack`, `export`, `quality-control`."""

import json
from pathlib import Path
from typing import Annotated

import typer

from morphosim.cli.app import app
from morphosim.exports.formats import FORMATS

EXPORTS = ", ".join(f"{name}: {form.title}" for name, form in FORMATS.items())
ONLY_LAST = ", ".join(name for name, form in FORMATS.items() if form.last_only)


@app.command()
def info(
    directory: Annotated[Path, typer.Argument(help="directory of a run")],
) -> None:
    """Say what a run holds."""
    from morphosim.accessor import open_run

    with open_run(directory) as data:
        times = data["time"].values
        typer.echo(f"{data.attrs['title']}; {data.attrs['source']}")
        typer.echo(f"{len(times)} saves, t = {times[0]:g} to {times[-1]:g}")
        if data.attrs["error"]:
            typer.echo(f"ended by an error: {data.attrs['error']}")
        elif not data.attrs.get("finished", times[-1] >= data.attrs["duration"] - 1e-9):
            typer.echo(f"is not at its end: morphosim run --resume {directory}")
        typer.echo(f"{'cell':10} {'type':8} {'volume um3':>11}   centroid um")
        last = data.isel(time=-1)
        for k, name in enumerate(data["cell"].values):
            x, y, z = last["centroid"].values[k]
            volume = float(last["volume"].values[k])
            kind = last["type"].values[k] or "-"
            typer.echo(f"{name:10} {kind:8} {volume:11.1f}   {x:.3f} {y:.3f} {z:.3f}")


@app.command()
def contacts(
    directory: Annotated[Path, typer.Argument(help="directory of a run")],
    time: Annotated[float | None, typer.Option(help="nearest save; the last by default")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="machine-readable output")] = False,
) -> None:
    """List which cells touch, and over what area."""
    from morphosim.accessor import open_run
    from morphosim.measure.contacts import contact_areas, touching
    from morphosim.runs.saved_fields import load_fields, time_index

    with open_run(directory) as data:
        index = time_index(data, time)
        fields = load_fields(data, index)
        at = float(data["time"].values[index])
        areas = contact_areas(fields, float(data.attrs["spacing_um"]))
    shared = touching(fields)
    pairs = sorted(shared.keys() | areas.keys())
    if as_json:
        rows = [
            {"cells": pair, "touching_voxels": shared.get(pair, 0), "area_um2": areas.get(pair, 0)}
            for pair in pairs
        ]
        typer.echo(json.dumps({"time": at, "contacts": rows}))
        return
    typer.echo(f"t = {at:g}: {len(shared)} pairs touch")
    for a, b in pairs:
        mark = "touch" if (a, b) in shared else "-"
        typer.echo(f"{a:10} {b:10} {mark:6} {areas.get((a, b), 0.0):8.1f} um2")


@app.command()
def pack(
    directory: Annotated[Path, typer.Argument(help="directory of a run")],
    file: Annotated[Path, typer.Argument(help="netCDF file to write")],
) -> None:
    """Write a run into one netCDF file, which opens as the directory does."""
    from morphosim.progress import progress_line
    from morphosim.runs.pack import pack as write

    with progress_line() as tell:
        write(directory, file, lambda done, of: tell("packing", done, of))
    typer.echo(f"{file}: {file.stat().st_size / 1e6:.1f} MB")


@app.command()
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
) -> None:
    """Write a run for other programs: surfaces, label images or tables, in um."""
    from morphosim.accessor import open_run
    from morphosim.exports.export import export as write
    from morphosim.progress import progress_line

    place = directory.resolve()
    target = output or place.with_name(f"{place.stem if place.is_file() else place.name}-{to}")
    with open_run(directory) as data, progress_line() as tell:
        files = write(data, target, to, time, lambda done, of: tell(f"export to {to}", done, of))
    size = sum(file.stat().st_size for file in files)
    typer.echo(f"{target}: {len(files)} files, {size / 1e6:.1f} MB")


@app.command("quality-control")
def quality_control(
    directory: Annotated[Path, typer.Argument(help="directory or packed file of a run")],
    json_file: Annotated[
        Path | None, typer.Option("--json", help="write the criteria to this file as well")
    ] = None,
) -> None:
    """Judge a run of celegans-1-to-8 by criteria A to H of Supplementary Note 1."""
    from morphosim._files import write_text
    from morphosim.accessor import open_run
    from morphosim.library.celegans.quality_control import quality_control as judge
    from morphosim.library.celegans.quality_report import report_text, to_json

    with open_run(directory) as data:
        criteria = judge(data)
    if json_file is not None:
        write_text(json_file, to_json(criteria) + "\n")
    typer.echo(report_text(criteria))
