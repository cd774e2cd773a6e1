"""Going on from a saved run: exactly, or with another scene."""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from morphosim.cell_field import CellField
from morphosim.errors import DamageWarning, warn
from morphosim.geometry.shapes import Field
from morphosim.runs.checkpoint import Checkpoint
from morphosim.runs.directory import RunDirectory
from morphosim.runs.identity import Identity
from morphosim.runs.reader import read_run
from morphosim.runs.save_facts import SaveFacts, facts_of, whole_saves
from morphosim.runs.saved_fields import load_fields, spacing, time_index
from morphosim.scene.cell import Cell, VolumeCourse
from morphosim.scene.file import load_scene
from morphosim.scene.fingerprint import first_difference, settings
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
    """Scene of a run, and its last state that is whole; None before the first save.

    Raises
    ------
    FileNotFoundError
        There is no run, or no state.
    ValueError
        The run has ended by an error, no state is whole, or the scene file has been changed.

    Warns
    -----
    DamageWarning
        A state is damaged, or does not belong to the run, so that it goes on from the one before.
    """
    files = RunDirectory(directory)
    scene = saved_scene(directory)
    if not files.saved and not files.restarts:
        return scene, None
    number, last = next(whole_saves(files), (-1, None))
    state = _last_state(files, number, last)
    error = state.error or ("" if last is None else last.error)
    if error:
        message = f"{directory} has ended by an error and cannot go on: {error}. {_branch(files)}"
        raise ValueError(message)
    if found := first_difference(state.settings, settings(scene)):
        key, had, has = found
        message = (
            f"{files.scene}: {key} is {has}, the run had {had}; a run goes on unchanged. "
            f"{_branch(files)}"
        )
        raise ValueError(message)
    return scene, state


def _branch(files: RunDirectory) -> str:
    """What to try where a run cannot go on."""
    return f"Start a new run from its fields: morphosim run SCENE --from {files.path} -o NEW"


def _last_state(files: RunDirectory, at: int, last: SaveFacts | None) -> Checkpoint:
    """The last state that is whole and belongs to the saves, of which `last` is number `at`."""
    faults: list[ValueError] = []
    again: Checkpoint | None = None
    for number in reversed(files.restarts):
        try:
            state = Checkpoint.read(files.restart(number))
            _check_belongs(files, number, state, last)
        except ValueError as error:
            faults.append(error)
            continue
        if last is not None and number > at and state.time <= last.time:
            again = state  # from a stage's end that went back; the run comes to it once more
            continue
        for fault in faults:
            message = f"{fault}; the run goes on from {files.restart(number).name}"
            warn(message, DamageWarning)
        return state
    if again is not None:
        return again
    if faults:
        message = f"{faults[0]}. {_branch(files)}"
        raise ValueError(message)
    path = files.restart(max(files.last, 0))
    message = f"{path} is missing: the run cannot go on to the same bits. {_branch(files)}"
    raise FileNotFoundError(message)


def _check_belongs(
    files: RunDirectory, number: int, state: Checkpoint, last: SaveFacts | None
) -> None:
    """Raise ValueError unless a state is of the run of these saves, and of the save beside it."""
    path = files.restart(number)
    if last is not None and state.identity.id != last.run_id:
        message = f"{path} is of another run than the saves in {path.parent}"
        raise ValueError(message)
    save = facts_of(files.save(number))
    if last is None or save is None or save.run_id != last.run_id:
        return
    spacing = state.settings["numerics"]["spacing"]
    at = (
        ("step", state.steps, save.step), ("time", state.time, save.time),
        ("cells", state.names, save.cells),
    )  # fmt: skip
    for what, its, saved in at:
        if its != saved:
            message = f"{path} does not fit its save: {what} {its}, where the save has {saved}"
            raise ValueError(message)
    apart = np.abs(state.arrays["origin"] * spacing - save.low).max(axis=1) > 0.5 * spacing
    if apart.any():
        name = state.names[int(np.flatnonzero(apart)[0])]
        message = f"{path} does not fit its save: cell {name!r} is elsewhere"
        raise ValueError(message)


def branched_scene(
    directory: Path, scene: Scene | None, time: float | None
) -> tuple[Scene, Identity]:
    """Scene whose cells start from the fields that a run has saved, and the new run's identity.

    See `Simulation.from_run`.
    """
    with read_run(directory) as run:
        index = time_index(run, time)
        fields = load_fields(run, index)
        if scene is None:
            scene = _scene_at(directory, run.isel(time=index), fields)
        identity = Identity(
            source=str(directory.absolute()),
            source_id=str(run.attrs.get("run_id", "")),
            source_time=float(run["time"][index]),
        )
        return scene.with_fields(fields, spacing(run)), identity


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
    physics = physics_of(_physics_at(directory, float(save["time"])), [])
    names, types = [cell.name for cell in cells], {cell.type for cell in cells}
    return replace(scene, cells=cells, stages=(), physics=physics.among(names, types))


def _later(volume: Any, time: float, target: float) -> Any:
    """Target volume of a cell from a time on: its course if that led to `target`, or `target`."""
    if not callable(volume) or not np.isclose(volume(time), target):
        return target
    if isinstance(volume, VolumeCourse):
        return replace(volume, times=[t - time for t in volume.times])
    return lambda t: volume(t + time)


def _physics_at(directory: Path, time: float) -> dict[str, Any]:
    """Physics that held at a save."""
    import netCDF4

    files = RunDirectory(directory)
    for number, facts in whole_saves(files):
        if facts.time == time:
            with netCDF4.Dataset(files.save(number)) as file:
                return dict(json.loads(file.getncattr("physics")))
    message = f"{directory} has no save of t = {time:g}"
    raise FileNotFoundError(message)
