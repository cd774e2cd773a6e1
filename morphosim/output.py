"""Runs on disk: one netCDF file that plain xarray opens, written as the run goes on.

`run.nc` holds per time and cell the centroid, volumes, box and certificate, and the fields as
CF contiguous ragged arrays: `row_size[box]` values of `phi`, one after the other, are the box of
cell `box_cell[box]` at time `box_time[box]`, of shape `box_shape[box]`, z fastest.
"""

import json
import platform
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from morphosim import _validate
from morphosim.fields import CellField
from morphosim.simulation import Simulation

if TYPE_CHECKING:
    import xarray as xr

RUN_FILE = "run.nc"
_PER_CELL = {
    "volume": ("um3", "volume, integral of phi"),
    "target_volume": ("um3", "target volume V(t)"),
    "core_volume": ("um3", "volume where phi exceeds 1/2"),
    "face_peak": (
        "1",
        "largest |phi| so far at the faces of the cell's box or band",
    ),
    "lost_volume": ("um3", "integral of phi cut off by moving the box or band so far"),
}


class RunWriter:
    """Observer that saves a simulation every so often, and at its end.

    Parameters
    ----------
    directory : path
        Made if it does not exist; must not hold a run yet.
    every : float
        *In silico* time between saves.

    Raises
    ------
    FileExistsError
        The directory holds a run.
    """

    def __init__(self, directory: str | Path, every: float) -> None:
        self.directory = Path(directory)
        self.every = _validate.number("every", every, above=0)
        self.path = self.directory / RUN_FILE
        self._check_free()
        self.directory.mkdir(parents=True, exist_ok=True)
        self._saved_step = -1
        self._rows = self._boxes = self._samples = 0

    def _check_free(self) -> None:
        if self.path.exists():
            message = f"{self.directory} already holds a run; take another directory or delete it"
            raise FileExistsError(message)

    def start(self, simulation: Simulation) -> None:
        """Make the file and save the start."""
        self._check_free()
        self._file = _create(self.path, simulation)
        self._columns = {cell.name: k for k, cell in enumerate(simulation.cells)}
        self._save(simulation)

    def after_step(self, simulation: Simulation) -> None:
        """Save if a save is due."""
        dt = simulation.scene.numerics.dt
        if int(simulation.time / self.every + 1e-9) > int(
            (simulation.time - dt) / self.every + 1e-9
        ):
            self._save(simulation)

    def finish(self, simulation: Simulation) -> None:
        """Save the last state and close the file."""
        try:
            self._save(simulation)
        finally:
            self._file.close()

    def _save(self, simulation: Simulation) -> None:
        if simulation.engine.steps == self._saved_step:
            return
        row = self._rows
        self._file["time"][row] = simulation.time
        self._save_table(simulation, row)
        self._save_fields(simulation, row)
        self._file.sync()
        self._saved_step = simulation.engine.steps
        self._rows += 1

    def _save_table(self, simulation: Simulation, row: int) -> None:
        engine = simulation.engine
        columns = [self._columns[name] for name in simulation.names]
        values = {
            "volume": engine.volumes,
            "target_volume": _targets(simulation),
            "core_volume": engine.core_volumes,
            "face_peak": engine.face_peak,
            "lost_volume": engine.lost_volume,
            "centroid": simulation.centroids,
        }
        for name, data in values.items():
            variable = self._file[name]
            full = np.full((len(self._columns), *variable.shape[2:]), np.nan)
            full[columns] = data
            variable[row] = full

    def _save_fields(self, simulation: Simulation, row: int) -> None:
        file = self._file
        box, sample = self._boxes, self._samples
        fields = simulation.fields
        stop = box + len(fields)
        file["row_size"][box:stop] = [f.phi.size for f in fields]
        file["box_time"][box:stop] = row
        file["box_cell"][box:stop] = [self._columns[f.name] for f in fields]
        file["box_origin"][box:stop] = np.array([f.origin for f in fields])
        file["box_shape"][box:stop] = np.array([f.phi.shape for f in fields])
        file["phi"][sample : sample + sum(f.phi.size for f in fields)] = np.concatenate(
            [f.phi.ravel() for f in fields]
        )
        self._boxes, self._samples = stop, sample + sum(f.phi.size for f in fields)


def _targets(simulation: Simulation) -> Any:
    """Target volumes; NaN where a volume function fails, which has then ended the run."""
    try:
        return simulation.targets
    except (TypeError, ValueError):
        return np.nan


def _create(path: Path, simulation: Simulation) -> Any:
    """New netCDF file with its dimensions, variables and attributes."""
    import netCDF4

    file = netCDF4.Dataset(path, "w", format="NETCDF4")
    scene = simulation.scene
    file.setncatts(
        {
            "Conventions": "CF-1.11",
            "title": f"MorphoSim run of {scene.name}",
            "source": f"morphosim {version('morphosim')} on {platform.platform()}",
            "spacing_um": scene.numerics.spacing,
            "dt": scene.numerics.dt,
            "numerics": json.dumps(
                {n: getattr(scene.numerics, n) for n in scene.numerics.__slots__}
            ),
        }
    )
    for name, size in (
        ("time", None),
        ("cell", len(scene.cells)),
        ("axis", 3),
        ("box", None),
        ("sample", None),
    ):
        file.createDimension(name, size)
    _variable(file, "time", "f8", ("time",), units="1", long_name="in silico time", axis="T")
    for name, values, text in (
        ("cell", scene.names, "name of the cell"),
        ("type", scene.types, "type of the cell"),
    ):
        _variable(file, name, str, ("cell",), long_name=text)[:] = np.array(values, dtype=object)
    _variable(file, "axis", str, ("axis",), long_name="axis of space")[:] = np.array(
        list("xyz"), dtype=object
    )
    for name, (units, text) in _PER_CELL.items():
        _variable(file, name, "f8", ("time", "cell"), units=units, long_name=text)
    _variable(file, "centroid", "f8", ("time", "cell", "axis"), units="um", long_name="centroid")
    _create_fields(file, np.dtype(simulation.engine.dtype))
    return file


def _create_fields(file: Any, dtype: np.dtype) -> None:
    """Ragged part of the file."""
    _variable(
        file,
        "row_size",
        "i8",
        ("box",),
        units="1",
        long_name="values of this box",
        sample_dimension="sample",
    )
    _variable(
        file, "box_time", "i4", ("box",), long_name="index into time", instance_dimension="time"
    )
    _variable(
        file, "box_cell", "i4", ("box",), long_name="index into cell", instance_dimension="cell"
    )
    _variable(
        file,
        "box_origin",
        "i8",
        ("box", "axis"),
        units="1",
        long_name="lattice position of the first value; times spacing_um it is in um",
    )
    _variable(
        file, "box_shape", "i4", ("box", "axis"), units="1", long_name="points per axis, z fastest"
    )
    phi = file.createVariable(
        "phi",
        dtype.str[1:],
        ("sample",),
        zlib=True,
        complevel=1,
        shuffle=True,
        chunksizes=(1 << 17,),
    )
    phi.setncatts({"units": "1", "long_name": "phase field"})


def _variable(
    file: Any, name: str, kind: Any, dimensions: tuple[str, ...], **attributes: Any
) -> Any:
    variable = file.createVariable(name, kind, dimensions)
    variable.setncatts(attributes)
    return variable


def open_run(directory: str | Path) -> "xr.Dataset":
    """Open a run as one lazy xarray Dataset.

    Raises
    ------
    FileNotFoundError
        There is no run in the directory.
    """
    import xarray as xr

    path = Path(directory) / RUN_FILE
    if not path.exists():
        message = f"{directory} holds no run: {RUN_FILE} is missing"
        raise FileNotFoundError(message)
    return xr.open_dataset(path, engine="netcdf4")


def time_index(run: "xr.Dataset", time: float | None) -> int:
    """Index of the save nearest to `time`; the last save for None."""
    if time is None:
        return int(run.sizes["time"]) - 1
    return int(np.abs(run["time"].values - time).argmin())


def load_fields(run: "xr.Dataset", index: int) -> list[CellField]:
    """Fields of all cells at one save; a negative index counts from the last.

    Raises
    ------
    IndexError
        There is no such save.
    """
    index = range(run.sizes["time"])[index]
    boxes = np.flatnonzero(run["box_time"].values == index)
    sizes = run["row_size"].values
    starts = np.concatenate([[0], np.cumsum(sizes)])
    first, last = int(starts[boxes[0]]), int(starts[boxes[-1] + 1])
    values = run["phi"].isel(sample=slice(first, last)).values
    names = run["cell"].values
    shapes, origins = run["box_shape"].values, run["box_origin"].values
    cells = run["box_cell"].values
    return [
        CellField(
            str(names[cells[b]]),
            origins[b],
            values[starts[b] - first : starts[b + 1] - first].reshape(shapes[b]),
        )
        for b in boxes
    ]
