"""Opening runs."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from morphosim._files import guarded
from morphosim.errors import DamageWarning, warn
from morphosim.runs.directory import RunDirectory
from morphosim.runs.lazy_concat import MOST_AT_ONCE
from morphosim.runs.merge import LAZY, Save, check_complete, merged, with_coordinates
from morphosim.runs.netcdf_variables import PACKED_PHI
from morphosim.runs.save_facts import most_common
from morphosim.runs.save_index import indexed_saves

if TYPE_CHECKING:
    import xarray as xr

SIGNATURES = (b"\x89HDF", b"CDF")
"""So begin netCDF files of version 4, and before."""


def read_run(path: str | Path) -> "xr.Dataset":
    """One Dataset of a run, directory or packed file, or of one save; see `accessor.open_run`.

    Raises
    ------
    FileNotFoundError
        There is no run at `path`.
    ValueError
        All of its files are damaged, or it is a file of another kind.

    Warns
    -----
    DamageWarning
        A save is damaged, or of another run, and left out.
    """
    path = Path(path)
    if path.is_file():
        return _packed(path)
    files = RunDirectory(path)
    if not files.saves:
        message = f"{path} holds no run: there is no save-*.nc"
        raise FileNotFoundError(message)
    run = merged(_in_order(_of_one_run(_readable(files))))
    run.encoding["source"] = str(path.absolute())  # as xarray tells it of a file
    return run


def _packed(path: Path) -> "xr.Dataset":
    """Dataset of a packed file, of whatever version, or of one save, in the form of `merged`."""
    if path.suffix.lower() != ".nc" and not _is_netcdf(path):
        message = f"{path} is no netCDF file; give the directory of a run, or a packed run"
        raise ValueError(message)
    file = guarded(path, lambda: _opened(path))
    try:
        check_complete(path, "packed run", file.variables, file.attrs)
    except ValueError:
        file.close()
        raise
    if "time" in file["parent"].dims and file.sizes["time"] == 1:  # a save, with groups
        file.close()
        return merged([Save.read(path)])
    run = with_coordinates(file)
    run.set_close(file.close)
    if "phi" in run and run["phi"].encoding["dtype"] == PACKED_PHI["dtype"]:
        run["phi"].encoding |= PACKED_PHI
    return run


def _is_netcdf(path: Path) -> bool:
    """Whether a file begins as netCDF files do."""
    with path.open("rb") as file:
        return file.read(4).startswith(SIGNATURES)


def _opened(path: Path) -> "xr.Dataset":
    """Dataset of a file as it is.

    What is large is read each time it is used, and not cached: of copies of what xarray has in its
    cache it cannot tell, but by reading them, that they are the same.
    """
    import xarray as xr

    file = xr.open_dataset(path, engine="netcdf4", cache=False)
    try:
        for name, values in file.variables.items():
            if name not in LAZY and values.size <= MOST_AT_ONCE:
                values.load()
                values.encoding = {}  # of characters and chunks, which a selection does not have
    except BaseException:
        file.close()
        raise
    return file


def _readable(files: RunDirectory) -> list[Save]:
    """Those of the saves that can be read; ValueError if none can."""
    known, saves = indexed_saves(files), list[Save]()
    faults: list[ValueError] = []
    for path in files.saves:
        try:
            saves.append(known.get(path) or Save.read(path))
        except ValueError as error:
            faults.append(error)
    if not saves:
        raise faults[0]
    for fault in faults:
        _leave_out(str(fault))
    return saves


def _of_one_run(saves: Sequence[Save]) -> list[Save]:
    """Saves without those of another run than most of them are of."""
    ours = most_common(save.run_id for save in saves)
    for save in saves:
        if save.run_id != ours:
            _leave_out(f"{save.path} is of another run than the other saves")
    return [save for save in saves if save.run_id == ours]


def _in_order(saves: Sequence[Save]) -> list[Save]:
    """Saves without those that a later one has gone back behind."""
    kept: list[Save] = []
    for save in reversed(saves):
        if not kept or save.time < kept[-1].time:
            kept.append(save)
        else:
            _leave_out(f"{save.path} is not of an earlier time than {kept[-1].path}")
    return kept[::-1]


def _leave_out(why: str) -> None:
    warn(f"{why}; it is left out", DamageWarning)
