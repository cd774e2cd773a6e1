"""Going on from a saved run: exactly, or with another scene."""

from dataclasses import replace
from pathlib import Path

from morphosim import _validate
from morphosim.runs.files import RunDirectory
from morphosim.runs.reader import load_fields, open_run, time_index
from morphosim.scene import Cell, Scene
from morphosim.scenefile import load_scene
from morphosim.shapes import Field
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
        There is no run.
    ValueError
        The run has ended by an error.
    """
    files = RunDirectory(directory)
    scene = saved_scene(directory)
    if not files.saves:
        return scene, None
    _check_sound(directory)
    return scene, Snapshot.read(files.restart(files.last))


def _check_sound(directory: Path) -> None:
    import netCDF4

    files = RunDirectory(directory)
    with netCDF4.Dataset(files.save(files.last)) as file:
        error = file.getncattr("error")
    if error:
        message = (
            f"{directory} has ended by an error and cannot go on: {error}. Start another scene "
            f"from it: morphosim run SCENE --from {directory} --time T"
        )
        raise ValueError(message)


def branched_scene(directory: Path, scene: Scene | None, time: float | None) -> Scene:
    """Scene whose cells start from the fields that a run has saved.

    See `Simulation.from_run`.
    """
    own = saved_scene(directory) if scene is None else scene
    with open_run(directory) as run:
        fields = {f.name: f for f in load_fields(run, time_index(run, time))}
        spacing = float(run.attrs["spacing_um"])
    if scene is None:
        own = replace(own, cells=[cell for cell in own.cells if cell.name in fields])
    cells: list[Cell] = []
    for cell in own.cells:
        _validate.choice(f"cell of scene {own.name!r} in the run {directory}", cell.name, fields)
        field = fields[cell.name]
        shape = Field(phi=field.phi, origin=field.origin * spacing, spacing=spacing)
        cells.append(replace(cell, shape=shape, volume=cell.volume or cell.shape.volume))
    return replace(own, cells=cells)
