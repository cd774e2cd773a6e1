"""Opening runs."""

from pathlib import Path
from typing import TYPE_CHECKING

from morphosim.runs.directory import RunDirectory
from morphosim.runs.merge import merged

if TYPE_CHECKING:
    import xarray as xr


def read_run(path: str | Path) -> "xr.Dataset":
    """One Dataset of a run, directory or packed file; see `accessor.open_run`.

    Raises
    ------
    FileNotFoundError
        There is no run at `path`.
    """
    import xarray as xr

    path = Path(path)
    if path.is_file():
        return xr.open_dataset(path, engine="netcdf4")
    saves = RunDirectory(path).saves
    if not saves:
        message = f"{path} holds no run: there is no save-*.nc"
        raise FileNotFoundError(message)
    run = merged(saves)
    run.encoding["source"] = str(path.absolute())  # as xarray tells it of a file
    return run
