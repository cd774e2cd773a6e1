"""Commands that compute: `scenes`, `run`, `warm`, `bench`."""

import json
from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from morphosim._files import check_free, toml_of, writable, write_text
from morphosim.cli.app import (
    INTERRUPTED,
    RUN_ERROR,
    Overwrite,
    command,
    note,
    progress,
    remark,
    say,
    voice,
)
from morphosim.progress import silent, tell_line

if TYPE_CHECKING:
    from collections.abc import Callable

    from morphosim.runs.checkpoint import Checkpoint
    from morphosim.scene.scene import Scene
    from morphosim.simulation.progress_bar import ProgressBar
    from morphosim.simulation.simulation import Simulation


Preset = Annotated[
    str | None,
    typer.Option(
        help="draft, fast, standard, reference or published; replaces the scene's numerics"
    ),
]
Settings = Annotated[
    list[str] | None,
    typer.Option("--set", help="a value of the scene, as physics.gamma=0.3; repeatable"),
]


@dataclass(frozen=True, slots=True)
class How:
    """How a simulation is run: over ranks, in place of a run that is there, or only told."""

    mpi: bool
    overwrite: bool = False
    dry: bool = False
    resume: bool = False

    def __post_init__(self) -> None:
        if self.mpi and self.dry:
            message = "--dry-run goes without --mpi: it tells what all ranks together would do"
            raise ValueError(message)


@command()
def scenes(
    show: Annotated[
        str | None, typer.Option("--show", help="write this scene as a file that can be edited")
    ] = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="with --show: file to write, as mine.toml")
    ] = None,
    overwrite: Overwrite = False,
) -> None:
    """List the built-in scenes, or show one."""
    from morphosim.library.built_in import scene_description, scene_names, scene_text

    if show is None:
        if output is not None:
            message = "--output says where to write a scene; name the scene by --show"
            raise ValueError(message)
        for name in scene_names():
            say(f"{name:24} {scene_description(name)}")
    elif output is None:
        say(scene_text(show).rstrip())
    else:
        check_free(writable(output, [".toml"]), overwrite)
        write_text(output, scene_text(show))
        note(f"scene in {output}: morphosim run {output} -o DIR")


@command()
def run(
    scene: Annotated[
        str | None, typer.Argument(help="built-in scene (see scenes), scene file, or its directory")
    ] = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="directory of the run")
    ] = None,
    preset: Preset = None,
    until: Annotated[float | None, typer.Option(help="end, in silico time")] = None,
    dt: Annotated[float | None, typer.Option(help="time step")] = None,
    tolerance: Annotated[
        float | None,
        typer.Option(help="choose steps for this error, nm per 100 units of time, as 5"),
    ] = None,
    save_every: Annotated[float | None, typer.Option(help="time between saves")] = None,
    threads: Annotated[int | None, typer.Option(help="number of threads")] = None,
    set_: Settings = None,
    from_: Annotated[
        Path | None, typer.Option("--from", help="start from the fields of this saved run")
    ] = None,
    time: Annotated[
        float | None, typer.Option(help="with --from: the save to start from; the last by default")
    ] = None,
    stage: Annotated[
        str | None, typer.Option(help="with --from: the scene's stage to begin with")
    ] = None,
    resume: Annotated[
        Path | None, typer.Option(help="go on with this run, to the same end, bit for bit")
    ] = None,
    mpi: Annotated[
        bool, typer.Option("--mpi", help="share out the cells over the ranks of mpirun")
    ] = False,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="replace the run that the directory holds")
    ] = False,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="tell what would run: steps, saves, memory, stability")
    ] = False,
) -> None:
    """Simulate a scene and save the run, or go on with a saved one."""
    how = How(mpi=mpi, overwrite=overwrite, dry=dry_run)
    overrides = _overrides(set_ or [])
    for key, value in (
        ("numerics.preset", preset), ("duration", until), ("numerics.dt", dt),
        ("numerics.tolerance", tolerance), ("save_every", save_every),
        ("numerics.threads", threads),
    ):  # fmt: skip
        if value is not None:
            overrides[key] = value
    if resume is not None:
        _check_resume([scene, output, from_, time, stage, overwrite or None], overrides)
        _resume(resume, overrides, how)
        return
    if scene is None or (output is None and not dry_run):
        message = "run needs a scene and --output, or --resume and the directory of a run"
        raise typer.BadParameter(message)
    if overwrite and from_ is not None and output is not None and output.exists():
        _check_apart(from_, output)
    if from_ is None and (time is not None or stage is not None):
        message = "--time and --stage say how to start from a saved run; give the run by --from"
        raise ValueError(message)
    given = scene
    _simulate(lambda: _chosen(given, overrides, stage, until), output, from_, time, how)


def _check_apart(source: Path, output: Path) -> None:
    """Raise ValueError if a run would delete the one that it starts from."""
    if source.resolve() == output.resolve():
        message = f"--overwrite would delete {source}, which --from names; take another --output"
        raise ValueError(message)


def _chosen(
    name: str, overrides: dict[str, Any], stage: str | None, until: float | None
) -> "Scene":
    """The scene as it shall run."""
    from morphosim.library.built_in import find_scene

    scene = find_scene(name, overrides)
    if stage is None:
        return scene
    scene = scene.from_stage(stage)
    return scene if until is None else replace(scene, duration=until)


def _overrides(settings: list[str]) -> dict[str, Any]:
    """Values of `--set key=value`; the value is TOML, or else a plain text."""
    result = {}
    for setting in settings:
        key, equals, text = setting.partition("=")
        if not equals:
            message = f"--set {setting!r}: expected key=value, such as physics.gamma=0.3"
            raise ValueError(message)
        result[key.strip()] = _value(text)
    return result


def _value(text: str) -> Any:
    """Value that a text says in TOML, or the text."""
    try:
        table = toml_of(f"value = {text}", "--set")
    except ValueError:
        return text
    return table["value"] if len(table) == 1 else text


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


def _resume(directory: Path, overrides: dict[str, Any], how: How) -> None:
    """Go on with a run; a later end is written to its scene file."""
    from morphosim.runs.directory import RunDirectory
    from morphosim.runs.resume import saved_scene, saved_state
    from morphosim.scene.file import save_scene

    def make() -> "Simulation":
        scene, snapshot = saved_state(directory)
        _check_end(directory, overrides.get("duration"), scene, snapshot)
        threads = overrides.get("numerics.threads", scene.numerics.threads)
        end = overrides.get("duration", scene.duration)
        scene = replace(scene, duration=end).with_numerics(threads=threads)
        return _kind(how.mpi)(scene, snapshot)

    def lengthen() -> None:
        scene = saved_scene(directory)
        end = overrides.get("duration", scene.duration)
        if end > scene.duration:
            files = RunDirectory(directory)
            with files.locked():
                save_scene(replace(scene, duration=end), files.scene)

    _start(make, directory, replace(how, resume=True), lengthen)


def _check_end(
    directory: Path, until: float | None, scene: "Scene", state: "Checkpoint | None"
) -> None:
    """Raise ValueError if a run that goes on has passed the end that is asked for."""
    reached = 0.0 if state is None else state.time
    if until is not None and until < reached - 1e-9:
        message = (
            f"--until {until:g}: the run has reached t = {reached:g} already; give a later end, or "
            "start a new run from an earlier save: morphosim run SCENE "
            f"--from {directory} --time T -o NEW"
        )
        raise ValueError(message)


def _simulate(
    scene: "Callable[[], Scene]", output: Path | None, source: Path | None, time: float | None,
    how: How,
) -> None:  # fmt: skip
    """Simulate a scene from its start, or from a save of another run."""

    def make() -> "Simulation":
        if source is None:
            return _kind(how.mpi)(scene())
        return _kind(how.mpi).from_run(source, scene=scene(), time=time)

    _start(make, output, how)


def _kind(mpi: bool) -> "type[Simulation]":
    if mpi:
        from morphosim.mpi.distributed_simulation import DistributedSimulation

        return DistributedSimulation
    from morphosim.simulation.simulation import Simulation

    return Simulation


def _start(
    make: "Callable[[], Simulation]", output: Path | None, how: How,
    before: "Callable[[], None]" = lambda: None,
) -> None:  # fmt: skip
    """Run here, or over the ranks of an MPI job; or only tell what would run."""
    from morphosim.runs.directory import RunDirectory
    from morphosim.simulation.compilation import compilation_told

    if output is not None and not (how.resume or how.overwrite):
        RunDirectory(output).check_free()
    if output is None or how.dry:
        from morphosim.cli.plan import plan_text

        with compilation_told(remark, progress):
            say(plan_text(make()))
    elif how.mpi:
        _go_over_ranks(make, output, how, before)
    else:
        with compilation_told(remark, progress):
            simulation = make()
            before()
            _go(simulation, output, how)


def _go_over_ranks(
    make: "Callable[[], Simulation]", output: Path, how: How, before: "Callable[[], None]"
) -> None:
    from morphosim.mpi.communicator import world
    from morphosim.mpi.run import go
    from morphosim.simulation.compilation import compilation_told

    with compilation_told(remark, progress) if world().rank == 0 else compilation_told(silent):
        status = go(
            make, output, note, before=before, summary=_summary, resume=how.resume,
            overwrite=how.overwrite, bar=_bar,
        )  # fmt: skip
    raise typer.Exit(status)


def _bar() -> "ProgressBar":
    from morphosim.simulation.progress_bar import ProgressBar

    return ProgressBar(events=voice.verbose, quiet=voice.quiet)


def _go(simulation: "Simulation", output: Path, how: How) -> None:
    """Run with output and progress; end with a summary, whatever happens."""
    from morphosim.errors import SaveError, SimulationError
    from morphosim.runs.writer import RunWriter
    from morphosim.simulation.ending import words_of_ending

    writer = RunWriter.of(simulation.scene, output, how.resume, how.overwrite)
    bar = _bar()
    status = 0
    try:
        simulation.run(observers=[writer, bar])
    except (KeyboardInterrupt, SaveError, SimulationError, MemoryError) as error:
        tell_line(words_of_ending(error, simulation, writer))
        status = INTERRUPTED if isinstance(error, KeyboardInterrupt) else RUN_ERROR
        if isinstance(error, SaveError | MemoryError):
            raise typer.Exit(status) from error
    note(_summary(simulation, bar, output))
    raise typer.Exit(status)


def _summary(simulation: "Simulation", bar: "ProgressBar", output: Path) -> str:
    """Volumes, certificate and speed of a run, and why it has stopped before its end."""
    from morphosim.simulation.ending import words_of_stop

    lines = [f"{'cell':10} {'volume':>10} {'target':>10}  um3   face |phi|   lost um3"]
    rows = zip(
        simulation.names, simulation.volumes, simulation.targets, simulation.face_peak,
        simulation.lost_volume, strict=True,
    )  # fmt: skip
    shown = 20
    for name, volume, target, peak, lost in list(rows)[:shown]:
        lines.append(f"{name:10} {volume:10.1f} {target:10.1f} {peak:15.1e} {lost:10.2g}")
    if len(simulation.names) > shown:
        lines.append(f"... and {len(simulation.names) - shown} cells more")
    if bar.steps:
        speed = 1e3 * bar.seconds / bar.steps
        threads = "1 thread" if simulation.threads == 1 else f"{simulation.threads} threads"
        lines.append(
            f"t = {simulation.time:g} in {bar.seconds:.1f} s: {speed:.2f} ms per step on "
            f"{threads} (first step, with compilation: {bar.first_step:.1f} s)"
        )
    lines.append(f"error: {simulation.errors}")
    lines.append(f"saved in {output}")
    if simulation.stopped:
        lines.append(words_of_stop(simulation, output))
    return "\n".join(lines)


@command()
def warm(
    scenes: Annotated[
        list[str] | None,
        typer.Argument(metavar="[SCENE]...", help="built-in scenes or scene files; all built-in"),
    ] = None,
    preset: Preset = None,
    set_: Settings = None,
) -> None:
    """Compile the kernels that scenes need, on all processors; later runs find them."""
    from morphosim.library.built_in import find_scene, scene_names
    from morphosim.simulation.warming import warm as compile_for

    overrides = _overrides(set_ or []) | ({} if preset is None else {"numerics.preset": preset})
    chosen = [find_scene(name, overrides) for name in scenes or scene_names()]
    with progress() as tell:
        count = compile_for(chosen, tell)
    note(f"{count} kernels are compiled" if count else "all kernels are compiled already")


@command()
def bench(
    seconds: Annotated[float, typer.Option(help="about how long to time steps")] = 60.0,
    json_file: Annotated[
        Path | None,
        typer.Option("--json", dir_okay=False, help="also write the result to this file"),
    ] = None,
    threads: Annotated[int, typer.Option(help="number of threads to compare with one; 0: all")] = 0,
    overwrite: Overwrite = False,
) -> None:
    """Time this machine: steps of 100 cells and of the embryo, the embryo to its end, bandwidth."""
    from morphosim.bench import measure, text
    from morphosim.simulation.compilation import compilation_told

    if json_file is not None:
        check_free(json_file, overwrite)
        json_file.parent.mkdir(parents=True, exist_ok=True)
    with progress() as tell, compilation_told(silent, lambda: nullcontext(tell)):
        result = measure(seconds, threads, tell)
    say(text(result))
    if json_file is not None:
        write_text(json_file, json.dumps(result, indent=1) + "\n")
        note(f"written to {json_file}")
