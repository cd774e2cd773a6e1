"""A run as files for other programs."""

from collections.abc import Iterable
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from morphosim import _validate
from morphosim._extras import need
from morphosim._files import PARTIAL, filling
from morphosim.exports.formats import FORMATS
from morphosim.progress import Tell, silent

if TYPE_CHECKING:
    import xarray as xr


def export(
    run: "xr.Dataset",
    directory: str | Path,
    to: str,
    times: Iterable[float] | None = None,
    tell: Tell | None = None,
    *,
    overwrite: bool = False,
) -> list[Path]:
    """Write a run in a format of other programs. Lengths are in µm.

    Parameters
    ----------
    run : Dataset of `open_run`
    directory : path
        Made if it does not exist; must be empty, unless `overwrite`. The files appear in it when
        all are written.
    to : {"vtk", "stl", "ome-tiff", "csv", "tissue"}
        Surfaces of cells and label images for ParaView, which needs PyVista; surfaces as binary
        STL; label images as one OME-TIFF series; tables of cells, contacts and saves; tables of
        growth, pair correlation, neighbours, profiles and clones.
    times : numbers, optional
        The saves nearest to these. By default all, for "stl" the last.
    tell : callable, optional
        Told after each save how many are done, and of how many.
    overwrite : bool
        Whether to write into a directory that holds files: those of the same names are replaced,
        others stay.

    Returns
    -------
    paths of all files written

    Raises
    ------
    ValueError
        The format is not known, or the run lacks what it takes.
    FileExistsError
        The directory is not empty, or is a file.
    ImportError
        The format takes a package that is not installed.
    WriteError
        The files cannot be written; there are none then.
    """
    _validate.choice("to", to, FORMATS)
    form, directory = FORMATS[to], Path(directory)
    _check_empty(directory, overwrite)
    saves = _saves(run, times, form.last_only)
    if form.needs:
        need(form.needs, f"export to {to!r}", form.extra)
    write = import_module(f"morphosim.exports.{form.module}").write
    with filling(directory) as folder:
        paths: list[Path] = write(run, folder, saves, tell or silent)
    return [directory / path.relative_to(folder) for path in paths]


def _check_empty(directory: Path, overwrite: bool) -> None:
    """Raise FileExistsError unless the directory can be written to without replacing files."""
    if directory.exists() and not directory.is_dir():
        message = f"{directory} is a file, not a directory; choose another for the export"
        raise FileExistsError(message)
    held = [p for p in directory.iterdir() if p.name != PARTIAL] if directory.exists() else []
    if held and not overwrite:
        message = (
            f"{directory} is not an empty directory; choose another for the export, or replace "
            "files there by --overwrite (overwrite=True)"
        )
        raise FileExistsError(message)


def _saves(run: "xr.Dataset", times: Iterable[float] | None, last_only: bool) -> list[int]:
    """Numbers of the saves nearest to these times, in order, each once."""
    from morphosim.accessor import MorphoAccessor

    morpho = MorphoAccessor(run)
    last = morpho.save_number()
    if times is not None:
        saves = {morpho.save_number(time) for time in times}
        if not saves:
            message = "times is empty; give at least one, or None for the default"
            raise ValueError(message)
        return sorted(saves)
    return [last] if last_only else list(range(last + 1))
