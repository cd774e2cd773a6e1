"""Opening runs."""

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from morphosim._files import guarded
from morphosim.errors import DamageWarning
from morphosim.runs.directory import RunDirectory
from morphosim.runs.merge import NEEDED, Save, merged
from morphosim.runs.save_facts import most_common

if TYPE_CHECKING:
    import xarray as xr


def read_run(path: str | Path) -> "xr.Dataset":
    """One Dataset of a run, directory or packed file; see `accessor.open_run`.

    Raises
    ------
    FileNotFoundError
        There is no run at `path`.
    ValueError
        All of its files are damaged.

    Warns
    -----
    DamageWarning
        A save is damaged, or of another run, and left out.
    """
    path = Path(path)
    if path.is_file():
        return _packed(path)
    paths = RunDirectory(path).saves
    if not paths:
        message = f"{path} holds no run: there is no save-*.nc"
        raise FileNotFoundError(message)
    run = merged(_in_order(_of_one_run(_readable(paths))))
    run.encoding["source"] = str(path.absolute())  # as xarray tells it of a file
    return run


def _packed(path: Path) -> "xr.Dataset":
    """Dataset of a packed file."""
    import xarray as xr

    run = guarded(path, lambda: xr.open_dataset(path, engine="netcdf4"))
    lacking = [name for name in NEEDED if name not in run.variables]
    if lacking:
        run.close()
        message = f"{path} is no packed run: it has no variable {lacking[0]!r}"
        raise ValueError(message)
    return run


def _readable(paths: Sequence[Path]) -> list[Save]:
    """Those of the saves that can be read; ValueError if none can."""
    saves: list[Save] = []
    faults: list[ValueError] = []
    for path in paths:
        try:
            saves.append(Save.read(path))
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
        if not kept or save.step < kept[-1].step:
            kept.append(save)
        else:
            _leave_out(f"{save.path} is not of an earlier time than {kept[-1].path}")
    return kept[::-1]


def _leave_out(why: str) -> None:
    warnings.warn(f"{why}; it is left out", DamageWarning, stacklevel=4)
