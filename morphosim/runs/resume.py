"""Going on from a saved run: exactly, or with another scene."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from morphosim.cell_field import CellField
from morphosim.geometry.shapes import Field
from morphosim.runs.checkpoint import Checkpoint
from morphosim.runs.directory import RunDirectory
from morphosim.runs.reader import read_run
from morphosim.runs.saved_fields import load_fields, time_index
from morphosim.scene.cell import Cell, VolumeCourse
from morphosim.scene.file import load_scene
from morphosim.scene.fingerprint import settings
from morphosim.scene.scene import Scene
from morphosim.scene.tables import physics_of


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


def saved_state(directory: Path) -> tuple[Scene, Checkpoint | None]:
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
    state = Checkpoint.read(path)
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
    with read_run(directory) as run:
        index = time_index(run, time)
        fields = load_fields(run, index)
        spacing = float(run.attrs["spacing_um"])
        if scene is None:
            scene = _scene_at(directory, run.isel(time=index), fields)
    return scene.with_fields(fields, spacing)


def _scene_at(directory: Path, save: Any, fields: Sequence[CellField]) -> Scene:
    """A run's own scene with the cells and physics of one save, and without its stages.

    Surface tensions, and whether cells are frozen, are those of the scene's cells or of the
    mothers among them; no save holds what events have made of them.
    """
    scene = saved_scene(directory)
    known = {cell.name: cell for cell in scene.cells}
    names = save["cell"].values.astype(str).tolist()
    parents = dict(zip(names, save["parent"].values.astype(str).tolist(), strict=True))
    cells = []
    for field in fields:
        row, first = save.sel(cell=field.name), field.name
        shape = Field(phi=field.phi, spacing=scene.numerics.spacing)
        while first and first not in known:
            first = parents.get(first, "") if parents.get(first) != first else ""
        like = known[first] if first else Cell(name=field.name, shape=shape)
        target, given = float(row["target_volume"]), like.volume if first == field.name else None
        cells.append(
            replace(
                like, name=field.name, type=str(row["type"].item()), parent=parents[field.name],
                volume=_later(given, float(save["time"]), target), shape=shape,
            )
        )  # fmt: skip
    physics = physics_of(_physics_at(directory, int(save["step"])), [])
    names, types = [cell.name for cell in cells], {cell.type for cell in cells}
    return replace(scene, cells=cells, stages=(), physics=physics.among(names, types))


def _later(volume: Any, time: float, target: float) -> Any:
    """Target volume of a cell from a time on: its course if that led to `target`, or `target`."""
    if not callable(volume) or not np.isclose(volume(time), target):
        return target
    if isinstance(volume, VolumeCourse):
        return replace(volume, times=[t - time for t in volume.times])
    return lambda t: volume(t + time)


def _physics_at(directory: Path, step: int) -> dict[str, Any]:
    """Physics that held at a save."""
    import netCDF4

    for path in reversed(RunDirectory(directory).saves):
        with netCDF4.Dataset(path) as file:
            if int(file["step"][0]) == step:
                return dict(json.loads(file.getncattr("physics")))
    message = f"{directory} has no save of step {step}"
    raise FileNotFoundError(message)
