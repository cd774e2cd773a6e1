"""Command line: `morphosim COMMAND --help` tells what each command takes."""

import json
import signal
import sys
import tomllib
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from morphosim.progress import ProgressBar
    from morphosim.scene import Scene
    from morphosim.simulation import Simulation

app = typer.Typer(no_args_is_help=True, pretty_exceptions_enable=False, add_completion=False)
INPUT_ERROR, RUN_ERROR, INTERRUPTED = 2, 1, 130


@app.command()
def scenes() -> None:
    """List the built-in scenes."""
    from morphosim.library import built_in_scene, scene_names

    for name in scene_names():
        typer.echo(f"{name:18} {built_in_scene(name).description}")


@app.command()
def run(
    scene: Annotated[
        str | None, typer.Argument(help="built-in scene, scene file, or its directory")
    ] = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="directory of the run")
    ] = None,
    preset: Annotated[
        str | None,
        typer.Option(
            help="draft, fast, standard, reference or published; replaces the scene's numerics"
        ),
    ] = None,
    until: Annotated[float | None, typer.Option(help="end, in silico time")] = None,
    dt: Annotated[float | None, typer.Option(help="time step")] = None,
    save_every: Annotated[float | None, typer.Option(help="time between saves")] = None,
    threads: Annotated[int | None, typer.Option(help="number of threads")] = None,
    set_: Annotated[
        list[str] | None,
        typer.Option("--set", help="any value of the scene, as physics.gamma=0.3; repeatable"),
    ] = None,
    from_: Annotated[
        Path | None, typer.Option("--from", help="start from the fields of this saved run")
    ] = None,
    time: Annotated[
        float | None, typer.Option(help="with --from: the save to start from; the last by default")
    ] = None,
    resume: Annotated[
        Path | None, typer.Option(help="go on with this run, to the same end, bit for bit")
    ] = None,
) -> None:
    """Simulate a scene and save the run, or go on with a saved one."""
    from morphosim.library import find_scene

    overrides = _overrides(set_ or [])
    for key, value in (
        ("numerics.preset", preset), ("duration", until), ("numerics.dt", dt),
        ("save_every", save_every), ("numerics.threads", threads),
    ):  # fmt: skip
        if value is not None:
            overrides[key] = value
    if resume is not None:
        _check_resume([scene, output, from_, time], overrides)
        _resume(resume, overrides)
    if scene is None or output is None:
        message = "run needs a scene and --output, or --resume and the directory of a run"
        raise typer.BadParameter(message)
    if from_ is None and time is not None:
        message = f"--time {time:g} says from which save of a run to start; give the run by --from"
        raise ValueError(message)
    _simulate(find_scene(scene, overrides), output, from_, time)


def _overrides(settings: list[str]) -> dict[str, Any]:
    """Values of `--set key=value`; the value is TOML, or else a plain text."""
    result = {}
    for setting in settings:
        key, equals, text = setting.partition("=")
        if not equals:
            message = f"--set {setting!r}: expected key=value, such as physics.gamma=0.3"
            raise ValueError(message)
        try:
            result[key.strip()] = tomllib.loads(f"value = {text}")["value"]
        except tomllib.TOMLDecodeError:
            result[key.strip()] = text
    return result


def _check_resume(others: list[Any], overrides: dict[str, Any]) -> None:
    """Raise ValueError if a run that goes on is asked to change."""
    changed = [key for key in overrides if key not in ("duration", "numerics.threads")]
    if changed or any(value is not None for value in others):
        what = f": {', '.join(changed)} cannot change" if changed else ""
        message = (
            f"--resume goes with --until and --threads alone{what}; to change more, start a new "
            "run from the saved one: morphosim run SCENE --from DIR -o NEW"
        )
        raise ValueError(message)


def _resume(directory: Path, overrides: dict[str, Any]) -> None:
    """Go on with a run; a later end is written to its scene file."""
    from dataclasses import replace

    from morphosim.runs.files import RunDirectory
    from morphosim.runs.resume import saved_state
    from morphosim.scenefile import save_scene
    from morphosim.simulation import Simulation

    scene, snapshot = saved_state(directory)
    end = overrides.get("duration", scene.duration)
    if end > scene.duration:
        files = RunDirectory(directory)
        with files.locked():
            save_scene(replace(scene, duration=end), files.scene)
    threads = overrides.get("numerics.threads", scene.numerics.threads)
    scene = replace(scene, duration=end).with_numerics(threads=threads)
    _go(Simulation(scene, snapshot), directory, resume=True)


def _simulate(scene: "Scene", output: Path, source: Path | None, time: float | None) -> None:
    """Simulate a scene from its start, or from a save of another run."""
    from morphosim.simulation import Simulation

    if source is None:
        simulation = Simulation(scene)
    else:
        simulation = Simulation.from_run(source, scene=scene, time=time)
    _go(simulation, output)


def _go(simulation: "Simulation", output: Path, resume: bool = False) -> None:
    """Run with output and progress; end with a summary, whatever happens."""
    from morphosim.errors import SaveError, SimulationError
    from morphosim.progress import ProgressBar
    from morphosim.runs.writer import RunWriter

    scene = simulation.scene
    writer = RunWriter(
        output, scene.save_every, fields=scene.save_fields, labels=scene.save_labels, resume=resume
    )
    bar = ProgressBar(scene.duration)
    status = 0
    try:
        simulation.run(observers=[writer, bar])
    except KeyboardInterrupt:
        kept = "saved" if simulation.engine.whole else "the saves before are kept"
        typer.echo(
            f"interrupted at t = {simulation.time:g}; {kept}. "
            f"Go on with: morphosim run --resume {output}", err=True
        )  # fmt: skip
        status = INTERRUPTED
    except SaveError as error:
        typer.echo(f"error: {error}", err=True)
        raise typer.Exit(RUN_ERROR) from error
    except SimulationError as error:
        typer.echo(f"error: {error}. The last state is saved", err=True)
        status = RUN_ERROR
    typer.echo(_summary(simulation, bar, output))
    raise typer.Exit(status)


def _summary(simulation: "Simulation", bar: "ProgressBar", output: Path) -> str:
    """Volumes, certificate and speed of a run."""
    engine = simulation.engine
    lines = [f"{'cell':10} {'volume':>10} {'target':>10}  um3   face |phi|   lost um3"]
    rows = zip(
        simulation.names, simulation.volumes, simulation.targets, engine.face_peak,
        engine.lost_volume, strict=True,
    )  # fmt: skip
    shown = 20
    for name, volume, target, peak, lost in list(rows)[:shown]:
        lines.append(f"{name:10} {volume:10.1f} {target:10.1f} {peak:15.1e} {lost:10.2g}")
    if len(simulation.cells) > shown:
        lines.append(f"... and {len(simulation.cells) - shown} cells more")
    if bar.steps:
        speed = 1e3 * bar.seconds / bar.steps
        lines.append(
            f"t = {simulation.time:g} in {bar.seconds:.1f} s: {speed:.2f} ms per step on "
            f"{engine.workers} threads (first step, with compilation: {bar.first_step:.1f} s)"
        )
    lines.append(f"saved in {output}")
    return "\n".join(lines)


@app.command()
def info(
    directory: Annotated[Path, typer.Argument(help="directory of a run")],
) -> None:
    """Say what a run holds."""
    from morphosim.runs.reader import open_run

    with open_run(directory) as data:
        times = data["time"].values
        typer.echo(f"{data.attrs['title']}; {data.attrs['source']}")
        typer.echo(f"{len(times)} saves, t = {times[0]:g} to {times[-1]:g}")
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
    from morphosim.contacts import contact_areas, touching
    from morphosim.runs.fields import load_fields, time_index
    from morphosim.runs.reader import open_run

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
    to: Annotated[str, typer.Option(help="vtk (ParaView), stl, ome-tiff or csv")],
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", help="directory to write; by default RUN-FORMAT"),
    ] = None,
    time: Annotated[
        list[float] | None,
        typer.Option(help="nearest save; repeatable; by default all, for stl the last"),
    ] = None,
) -> None:
    """Write a run for other programs: surfaces, label images or tables, in um."""
    from morphosim.exports import export as write
    from morphosim.progress import progress_line
    from morphosim.runs.reader import open_run

    place = directory.resolve()
    target = output or place.with_name(f"{place.stem if place.is_file() else place.name}-{to}")
    with open_run(directory) as data, progress_line() as tell:
        files = write(data, target, to, time, lambda done, of: tell(f"export to {to}", done, of))
    size = sum(file.stat().st_size for file in files)
    typer.echo(f"{target}: {len(files)} files, {size / 1e6:.1f} MB")


@app.command("import-matlab")
def import_matlab(
    masks: Annotated[Path, typer.Argument(help=".mat file with Mask or phi_save")],
    table: Annotated[Path, typer.Option(help="names and attraction: .xls, .xlsx or .csv")],
    output: Annotated[Path, typer.Option("-o", "--output", help="directory of the scene")],
    shell: Annotated[Path | None, typer.Option(help=".mat file with PhiShell")] = None,
    open_space: Annotated[bool, typer.Option("--open", help="no confinement")] = False,
    target_masks: Annotated[
        Path | None, typer.Option(help="masks that give the target volumes of a saved state")
    ] = None,
    spacing: Annotated[float, typer.Option(help="voxel size, um")] = 0.5,
) -> None:
    """Turn the published MATLAB program's files into a scene that `run` takes."""
    from morphosim.matlab import EGGSHELL
    from morphosim.matlab import import_matlab as read
    from morphosim.scenefile import save_scene

    scene = read(
        masks, table, shell=shell, confinement=None if open_space else EGGSHELL,
        spacing=spacing, masks_for_volume=target_masks,
    )  # fmt: skip
    output.mkdir(parents=True, exist_ok=True)
    save_scene(scene, output / "scene.toml")
    typer.echo(f"{len(scene.cells)} cells: {', '.join(scene.names)}")
    typer.echo(f"scene in {output / 'scene.toml'}")


@app.command("import-labels")
def import_labels(
    image: Annotated[Path, typer.Argument(help="label image: .tif, .npy, .npz or .nc")],
    output: Annotated[Path, typer.Option("-o", "--output", help="directory of the scene")],
    spacing: Annotated[
        tuple[float, float, float] | None,
        typer.Option(help="voxel size x y z, um; by default what the file says"),
    ] = None,
    origin: Annotated[
        tuple[float, float, float] | None, typer.Option(help="first voxel's centre x y z, um")
    ] = None,
    axes: Annotated[str | None, typer.Option(help="order of the file's axes, as zyx")] = None,
    key: Annotated[str | None, typer.Option(help="array of an .npz, variable of a .nc")] = None,
    time_index: Annotated[int | None, typer.Option(help="which time, from 0")] = None,
    table: Annotated[
        Path | None,
        typer.Option(help=".csv: label, name, type, parent, volume, gamma, frozen"),
    ] = None,
    frozen: Annotated[str, typer.Option(help="cells that do not move: A,B")] = "",
    active: Annotated[str, typer.Option(help="the only cells that move: A,B")] = "",
    shell: Annotated[
        bool, typer.Option("--shell/--open", help="a wall around all cells, or open space")
    ] = False,
    volumes: Annotated[
        str, typer.Option(help="target volumes keep the surfaces in place, or count the voxels")
    ] = "surface",
    sigma: Annotated[float, typer.Option(help="attraction between all cells")] = 0.0,
    least_voxels: Annotated[int | None, typer.Option(help="refuse smaller labels")] = None,
    relax: Annotated[
        float, typer.Option(help="first run all cells for this time; 10 suits frozen cells")
    ] = 0.0,
) -> None:
    """Turn a segmented image into a scene that `run` takes."""
    from morphosim.physics import Physics
    from morphosim.relaxation import relaxed
    from morphosim.scenefile import save_scene
    from morphosim.segmentation.labelfile import read_labels
    from morphosim.segmentation.scene import import_labels as read

    labels = read_labels(
        image, axes=axes, spacing=spacing, origin=origin, key=key, time_index=time_index
    )
    scene = read(
        labels, names=table, frozen=_names(frozen), active=_names(active) if active else None,
        confinement="image" if shell else None, physics=Physics(sigma=sigma), volumes=volumes,
        least_voxels=least_voxels, name=image.name.partition(".")[0],
    )  # fmt: skip
    if relax:
        scene = relaxed(scene, relax)
    output.mkdir(parents=True, exist_ok=True)
    save_scene(scene, output / "scene.toml")
    still = sum(cell.frozen for cell in scene.cells)
    typer.echo(f"{len(scene.cells)} cells, {still} of them frozen: {', '.join(scene.names)}")
    typer.echo(f"scene in {output / 'scene.toml'}")


def _names(text: str) -> list[str]:
    """Names separated by commas."""
    return [name.strip() for name in text.split(",") if name.strip()]


@app.command()
def bench(
    seconds: Annotated[float, typer.Option(help="about how long to time")] = 60.0,
    json_file: Annotated[
        Path | None,
        typer.Option("--json", dir_okay=False, help="also write the result to this file"),
    ] = None,
    threads: Annotated[int, typer.Option(help="number of threads to compare with one; 0: all")] = 0,
) -> None:
    """Time this machine: steps of 100 cells and of the embryo, memory, bandwidth."""
    from morphosim.bench import measure, text
    from morphosim.progress import progress_line

    if json_file is not None:
        json_file.parent.mkdir(parents=True, exist_ok=True)
    with progress_line() as tell:
        result = measure(seconds, threads, tell)
    typer.echo(text(result))
    if json_file is not None:
        json_file.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
        typer.echo(f"written to {json_file}")


def main() -> None:
    """Entry point; warnings and errors of input are one line, without a traceback."""
    # A batch system that ends a job stops it as Ctrl-C does: the state is saved.
    signal.signal(signal.SIGTERM, lambda *_: signal.raise_signal(signal.SIGINT))
    warnings.formatwarning = lambda message, *_, **__: f"warning: {message}\n"
    try:
        app()
    except (ValueError, TypeError, OSError, ImportError) as error:
        typer.echo(f"error: {error}", err=True)
        sys.exit(INPUT_ERROR)
