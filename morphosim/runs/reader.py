"""Opening runs."""

from pathlib import Path
from typing import TYPE_CHECKING

from morphosim.runs.files import RunDirectory
from morphosim.runs.merge import merged

if TYPE_CHECKING:
    import xarray as xr


def open_run(path: str | Path) -> "xr.Dataset":
    """Open a run, directory or packed file, as one Dataset; the fields are read when used.

    A directory may be opened while its run goes on: it shows the saves there are.

    Raises
    ------
    FileNotFoundError
        There is no run at `path`.
    """
    import xarray as xr

    import morphosim.accessor  # noqa: F401  (offers `Dataset.morpho`)

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
