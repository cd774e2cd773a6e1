"""A run in one file."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from morphosim._files import check_free, read_text, replacing, writable
from morphosim.measure.variable import Variable
from morphosim.progress import Tell
from morphosim.runs.directory import RunDirectory
from morphosim.runs.netcdf_variables import create, pack_phi, write_texts
from morphosim.runs.reader import read_run
from morphosim.runs.shell import pack_shell

if TYPE_CHECKING:
    import xarray as xr

BLOCK = 1 << 23
"""Values of a lazy variable that are in memory at once."""


def pack(
    directory: str | Path, file: str | Path, tell: Tell | None = None, *, overwrite: bool = False
) -> None:
    """Write a run into one netCDF-4 file, which `read_run` and plain xarray open as one Dataset.

    Parameters
    ----------
    directory : path of a run
    file : path to write
    tell : function, optional
        Told how many values are done, and of how many.
    overwrite : bool
        Whether to replace a file that is there.

    Raises
    ------
    FileExistsError
        There is a file at `file`, and `overwrite` is not set.
    FileNotFoundError
        There is no run in the directory, or no folder for the file.
    """
    target = writable(file)
    check_free(target, overwrite)
    with read_run(directory) as run, replacing(target) as partial:
        _write(run, partial, RunDirectory(Path(directory)), tell)


def _write(run: "xr.Dataset", path: Path, files: RunDirectory, tell: Tell | None) -> None:
    import netCDF4

    with netCDF4.Dataset(path, "w", format="NETCDF4") as file:
        file.setncatts(run.attrs)
        file.setncattr("coordinates", " ".join(str(n) for n in run.coords if n not in run.dims))
        scene = read_text(files.scene) if files.scene.exists() else ""
        pack_shell(files.path, scene, file)
        if scene:
            file.setncattr("scene_toml", scene)
        total, done = sum(variable.size for variable in run.variables.values()), 0
        for name, values in run.variables.items():
            for count in _copied(file, str(name), values):
                done += count
                if tell is not None:
                    tell(done, total)


def _copied(file: Any, name: str, values: "xr.Variable") -> Iterator[int]:
    """Copy a variable block by block; how many values each had."""
    dims = tuple(map(str, values.dims))
    variable = Variable.stored(dims, values.dtype, values.attrs)
    if values.dtype.kind in "OU":
        write_texts(file, name, variable, values.values)
        yield values.size
        return
    packed = values.encoding.get("dtype") == "int16"
    kind = np.dtype(np.int16) if packed else values.dtype
    created = create(file, name, variable, values.shape, kind)
    for first in range(0, len(values), BLOCK):
        block = values[first : first + BLOCK].values
        created[first : first + BLOCK] = pack_phi(block) if packed else block
        yield block.size
