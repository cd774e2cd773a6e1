"""Going on from a saved run: exactly, or with another scene."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from morphosim.runs.fields import load_fields, time_index
from morphosim.runs.files import RunDirectory
from morphosim.runs.reader import open_run
from morphosim.scene import Scene
from morphosim.scenefile import load_scene, settings
from morphosim.snapshot import Snapshot


def saved_scene(directory: Path) -> Scene:
    """Scene of a run; FileNotFoundError if the run has none."""
    files = RunDirectory(directory)
    if not files.scene.exists():
        message = (
            f"{directory} has no {files.scene.name}: there is no run, or its scene could not be "
            "written; give the scene"
        )
        raise FileNotFoundError(message)
    return load_scene(files.scene)


def saved_state(directory: Path) -> tuple[Scene, Snapshot | None]:
    """Scene of a run, and its state at the last save; None before the first.

    Raises
    ------
    FileNotFoundError
        There is no run, or no state.
    ValueError
        The run has ended by an error, or its scene file has been changed.
    """
    files = RunDirectory(directory)
    scene = saved_scene(directory)
    if not files.saves:
        return scene, None
    _check_sound(files)
    path = files.restart(files.last)
    if not path.exists():
        message = f"{path} is missing: the run cannot go on to the same bits. {_branch(directory)}"
        raise FileNotFoundError(message)
    state = Snapshot.read(path)
    _check_same(files, state.settings, settings(scene))
    return scene, state


def _branch(directory: Path) -> str:
    """What to try where a run cannot go on."""
    return f"Start a new run from its fields: morphosim run SCENE --from {directory} -o NEW"


def _check_sound(files: RunDirectory) -> None:
    import netCDF4

    with netCDF4.Dataset(files.save(files.last)) as file:
        error = file.getncattr("error")
    if error:
        message = (
            f"{files.path} has ended by an error and cannot go on: {error}. {_branch(files.path)}"
        )
        raise ValueError(message)


def _check_same(files: RunDirectory, had: Mapping[str, Any], has: Mapping[str, Any]) -> None:
    """Raise ValueError naming what differs between the run's settings and its scene file."""
    for table in had:
        for key in sorted(had[table].keys() | has[table].keys()):
            before, now = had[table].get(key), has[table].get(key)
            if before != now:
                message = (
                    f"{files.scene}: {table}.{key} is {now}, the run had {before}; a run goes on "
                    f"unchanged. {_branch(files.path)}"
                )
                raise ValueError(message)


def branched_scene(directory: Path, scene: Scene | None, time: float | None) -> Scene:
    """Scene whose cells start from the fields that a run has saved.

    See `Simulation.from_run`.
    """
    own = saved_scene(directory) if scene is None else scene
    with open_run(directory) as run:
        fields = load_fields(run, time_index(run, time))
        spacing = float(run.attrs["spacing_um"])
    if scene is None:
        alive = {field.name for field in fields}
        own = replace(own, cells=[cell for cell in own.cells if cell.name in alive])
    return own.with_fields(fields, spacing)
