"""Scenes from the files of the published MATLAB program (guidebook, Supplementary Note 3).

Its arrays are ordered y, x, z; the voxel with index k lies at k · spacing on each axis.
"""

import csv
import importlib
import io
import re
import unicodedata
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from morphosim import _validate
from morphosim.attraction import Attraction
from morphosim.confinement import Confinement, EllipsoidShell, MaskWalls
from morphosim.physics import Physics
from morphosim.scene import Cell, Scene
from morphosim.shapes import Field, Mask

EGGSHELL = EllipsoidShell(
    center=(30.0, 20.0, 15.0),
    semi_axes=(28.2846, 28.2846 * 0.665, 28.2846 * 0.455),
    cut=(np.inf, np.inf, 28.2846 * 0.361),
)
"""The program's eggshell; on its lattice the same voxels as its file Example_Eggshell.mat."""

NEGLIGIBLE = 1e-6
"""Fields are cropped to where |φ| exceeds this."""

Entry = str | float
T = TypeVar("T")


@dataclass(frozen=True, slots=True, kw_only=True)
class _Table:
    """Names, attraction sigma[j, i] of j on i, and volumes (µm³; none where not stated)."""

    names: Sequence[str]
    sigma: NDArray[np.float64]
    volumes: Mapping[str, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Images:
    """One image per cell, axes x, y, z, from the variable "Mask" or "phi_save"."""

    variable: str
    arrays: Mapping[str, NDArray[Any]]

    @property
    def shape(self) -> tuple[int, ...]:
        return next(iter(self.arrays.values())).shape


def import_matlab(
    masks: Path,
    table: Path,
    *,
    shell: Path | None = None,
    confinement: Confinement | None = EGGSHELL,
    spacing: float = 0.5,
    masks_for_volume: Path | None = None,
    name: str | None = None,
) -> Scene:
    """Scene from the files of the published MATLAB program.

    Physics and numerics are the package's defaults, which are the published values; change them
    with `Scene.with_physics` and `Scene.with_numerics`.

    Parameters
    ----------
    masks : Path
        MAT-file (v4 to v7.3) with the variable `Mask`, or a state saved by the program with the
        variable `phi_save`: a cell array with one 3-D array (y, x, z) per cell. Where there is a
        variable `CellIdx` it says which cells of the table these are, counted from 1.
    table : Path
        Names and attraction, .xls or .xlsx (first sheet) or .csv. First row: an empty entry, then
        names. Further rows: a name, then the attraction from this cell to that of the column.
        A column headed "volume" or "volume (um^3)" gives target volumes in µm³. A single column
        of names is a table without attraction. The rows give the order of the cells.
    shell : Path, optional
        MAT-file with the variable `PhiShell` (y, x, z): inside where it is below 1/2, outside
        elsewhere. It takes the place of `confinement`.
    confinement : Confinement or None
        By default the program's eggshell; None is open space.
    spacing : float
        Distance of the files' voxels in µm.
    masks_for_volume : Path, optional
        A file like `masks` whose volumes become the target volumes: a run that starts from a
        saved state takes its targets from the masks. By default a cell's target is the volume of
        what it starts from, ∫ φ or that of its mask.
    name : str, optional
        Name of the scene; by default the file name of `masks`.

    Returns
    -------
    Scene

    Raises
    ------
    FileNotFoundError
        A file does not exist.
    ValueError
        A file cannot be read, or what it holds does not fit; the message names file and value.
    ImportError
        A package that reads this kind of file is not installed; the message names it.

    Examples
    --------
    >>> scene = import_matlab(Path("Example_8Cell.mat"), Path("Table.xls"))  # doctest: +SKIP
    """
    _validate.number("spacing", spacing, above=0)
    masks, known = Path(masks), _read_table(Path(table))
    images = _read_images(masks, known.names)
    names = list(images.arrays)
    volumes = _target_volumes(known, names, masks_for_volume, spacing)
    shapes = _shapes(masks, images, spacing)
    walls = confinement if shell is None else _read_walls(Path(shell), images.shape, spacing)
    rows = [known.names.index(n) for n in names]
    sigma = Attraction.from_matrix(names, known.sigma[np.ix_(rows, rows)])
    return Scene(
        cells=[Cell(name=n, shape=shapes[n], volume=volumes.get(n)) for n in names],
        physics=Physics(sigma=sigma),
        confinement=walls,
        name=masks.stem if name is None else name,
    )


# --- cells -------------------------------------------------------------------------------------


def _read_images(path: Path, names: Sequence[str]) -> _Images:
    """Image of every cell in a file of masks or fields."""
    found = _read_mat(path, ("Mask", "phi_save"), ("CellIdx",))
    if "Mask" in found and "phi_save" in found:
        message = f"{path} holds both Mask and phi_save; expected one of them"
        raise ValueError(message)
    variable = "Mask" if "Mask" in found else "phi_save"
    cells = found[variable]
    if not isinstance(cells, list):
        message = f"{path}: {variable} is not a cell array; expected one 3-D array per cell, N x 1"
        raise ValueError(message)
    owners = _owners(path, len(cells), names, found.get("CellIdx"))
    arrays = {
        owner: _xyz(f"{path}: {variable}{{{k}}} (cell {owner!r})", cell)
        for k, (owner, cell) in enumerate(zip(owners, cells, strict=True), start=1)
    }
    _check_shapes(path, variable, arrays)
    return _Images(variable=variable, arrays=arrays)


def _owners(path: Path, count: int, names: Sequence[str], index: Any) -> Sequence[str]:
    """Names of the cells to which the images of a file belong."""
    if index is not None:
        return _names_by_index(path, count, names, index)
    if count != len(names):
        message = (
            f"{path} has {count} cells, but the table has {len(names)} names "
            f"({names[0]!r} to {names[-1]!r}); expected the same number, or a variable CellIdx"
        )
        raise ValueError(message)
    return names


def _names_by_index(path: Path, count: int, names: Sequence[str], index: Any) -> list[str]:
    """Names at the rows of the table that CellIdx gives, counted from 1."""
    numbers = _validate.array(f"{path}: CellIdx", np.ravel(index), (None,))
    if len(numbers) != count or count == 0:
        message = f"{path}: CellIdx has {len(numbers)} numbers for {count} cells; expected as many"
        raise ValueError(message)
    for value in numbers:
        if not 1 <= value <= len(names) or value != int(value):
            message = f"{path}: CellIdx holds {value:g}; allowed are rows 1 to {len(names)}"
            raise ValueError(f"{message} of the table")
    owners = [names[int(value) - 1] for value in numbers]
    _validate.unique(f"{path}: cell in CellIdx", owners)
    return owners


def _xyz(where: str, values: Any) -> NDArray[Any]:
    """Check one 3-D array and turn its axes from y, x, z to x, y, z."""
    if not isinstance(values, np.ndarray) or values.dtype.kind not in "buif":
        message = f"{where} is not an array of real numbers"
        raise ValueError(message)
    if values.ndim != 3 or values.size == 0:
        message = f"{where} has shape {values.shape}; expected three axes (y, x, z)"
        raise ValueError(message)
    if not np.isfinite(values).all():
        count = int((~np.isfinite(values)).sum())
        message = f"{where} holds {count} values that are not finite; expected finite numbers"
        raise ValueError(message)
    return values.transpose(1, 0, 2)


def _check_shapes(path: Path, variable: str, arrays: Mapping[str, NDArray[Any]]) -> None:
    (first, model), *others = arrays.items()
    for name, array in others:
        if array.shape != model.shape:
            message = (
                f"{path}: {variable} of cell {name!r} has shape {array.shape} (x, y, z), that of "
                f"{first!r} {model.shape}; all cells must have the same shape"
            )
            raise ValueError(message)


def _shapes(path: Path, images: _Images, spacing: float) -> dict[str, Mask | Field]:
    """Cropped start shape of every cell."""
    make = _mask if images.variable == "Mask" else _field
    return {
        name: make(f"{path}: {images.variable} of cell {name!r}", array, spacing)
        for name, array in images.arrays.items()
    }


def _mask(where: str, array: NDArray[Any], spacing: float) -> Mask:
    inside = array != 0
    if not inside.any():
        message = f"{where} is empty; expected at least one voxel that is not 0"
        raise ValueError(message)
    cropped, origin = _crop(inside, inside, spacing)
    return Mask(mask=cropped, origin=origin, spacing=spacing)


def _field(where: str, array: NDArray[Any], spacing: float) -> Field:
    if not (array > 0.5).any():
        message = f"{where} has no value above 0.5 (largest {array.max():g}): no cell is there"
        raise ValueError(message)
    cropped, origin = _crop(array, np.abs(array) > NEGLIGIBLE, spacing)
    return Field(phi=cropped, origin=origin, spacing=spacing)


def _crop(
    image: NDArray[Any], kept: NDArray[np.bool_], spacing: float
) -> tuple[NDArray[Any], NDArray[np.float64]]:
    """Copy of the smallest box that holds the voxels kept, and its origin in µm."""
    used = [np.flatnonzero(kept.any(axis=axes)) for axes in ((1, 2), (0, 2), (0, 1))]
    box = tuple(slice(int(k[0]), int(k[-1]) + 1) for k in used)
    origin = np.array([k[0] * spacing for k in used])
    return np.array(image[box], order="C"), origin


def _target_volumes(
    table: _Table, names: Sequence[str], masks: Path | None, spacing: float
) -> Mapping[str, float]:
    """Target volumes (µm³) that the table or the second file of masks states."""
    if masks is None:
        return table.volumes
    if table.volumes:
        message = f"masks_for_volume = {masks}, but the table has a volume column; give one only"
        raise ValueError(message)
    path = Path(masks)
    shapes = _shapes(path, _read_images(path, table.names), spacing)
    missing = [name for name in names if name not in shapes]
    if missing:
        message = f"{path} (masks_for_volume) has no mask of the cells {_listed(missing)}"
        raise ValueError(message)
    return {name: shape.volume for name, shape in shapes.items()}


def _read_walls(path: Path, shape: tuple[int, ...], spacing: float) -> MaskWalls:
    """Confinement from PhiShell."""
    values = _xyz(f"{path}: PhiShell", _read_mat(path, ("PhiShell",))["PhiShell"])
    if values.shape != shape:
        message = (
            f"{path}: PhiShell has shape {values.shape} (x, y, z); expected the cells' {shape}"
        )
        raise ValueError(message)
    inside = values < 0.5
    if not inside.any():
        message = f"{path}: PhiShell has no inside; expected 0 inside and 1 outside"
        raise ValueError(message)
    cropped, origin = _crop(inside, inside, spacing)
    return MaskWalls(inside=cropped, origin=origin, spacing=spacing)


# --- MAT-files ---------------------------------------------------------------------------------


def _read_mat(path: Path, wanted: Sequence[str], also: Sequence[str] = ()) -> dict[str, Any]:
    """Those of the variables that are there; cell arrays become lists, in MATLAB's order.

    Raises ValueError unless one of `wanted` is there.
    """
    _check_file(path, (".mat",))
    with path.open("rb") as file:
        start = file.read(1024)
    is_hdf5 = start.find(b"\x89HDF\r\n\x1a\n") in (0, 512)
    read = _read_hdf5 if is_hdf5 else _read_classic
    names, found = _guarded(path, lambda: read(path, (*wanted, *also)))
    if not any(name in found for name in wanted):
        message = f"{path} has no variable {' or '.join(wanted)}; it holds {_listed(names)}"
        raise ValueError(message)
    return found


def _read_classic(path: Path, wanted: Iterable[str]) -> tuple[list[str], dict[str, Any]]:
    """Names of all variables, and those wanted, of a MAT-file before v7.3."""
    from scipy.io import loadmat, whosmat

    names = [str(name) for name, _, _ in whosmat(path)]
    found = loadmat(path, variable_names=[name for name in wanted if name in names])
    return names, {
        name: list(value.ravel(order="F")) if value.dtype == object else value
        for name, value in found.items()
        if name in names
    }


def _read_hdf5(path: Path, wanted: Iterable[str]) -> tuple[list[str], dict[str, Any]]:
    """Names of all variables, and those wanted, of a MAT-file v7.3."""
    h5py = _need("h5py", path)
    with h5py.File(path, "r") as file:
        names = [name for name in file if not name.startswith("#")]
        return names, {name: _hdf5_value(h5py, file, name) for name in wanted if name in names}


def _hdf5_value(h5py: Any, file: Any, name: str) -> Any:
    """One variable; a cell array is a dataset of references to datasets."""
    item = file[name]
    if not isinstance(item, h5py.Dataset) or h5py.check_ref_dtype(item.dtype) is None:
        return _hdf5_array(item)
    return [_hdf5_array(file[reference]) for reference in item[()].ravel()]


def _hdf5_array(item: Any) -> NDArray[Any] | None:
    """Array in MATLAB's order of axes (HDF5 has them reversed); None for a struct."""
    if not hasattr(item, "dtype"):
        return None
    if item.attrs.get("MATLAB_empty", 0):
        return np.empty(tuple(int(n) for n in item[()]))
    return np.asarray(item[()]).T


# --- tables ------------------------------------------------------------------------------------


def _read_table(path: Path) -> _Table:
    """Names, attraction and volumes from an .xls, .xlsx or .csv file."""
    readers = {".xls": _rows_of_xls, ".xlsx": _rows_of_xlsx, ".csv": _rows_of_csv}
    _check_file(path, readers)
    rows = _without_empty(_guarded(path, lambda: readers[path.suffix.lower()](path)))
    if not rows:
        message = f"{path} is empty; expected a table of cell names and attraction"
        raise ValueError(message)
    if len(rows[0]) > 1:
        return _parse(path, rows)
    names = _checked_names(path, "row", [row[0] for row in rows])
    return _Table(names=names, sigma=np.zeros((len(names), len(names))), volumes={})


def _rows_of_xls(path: Path) -> list[list[Entry]]:
    xlrd = _need("xlrd", path)
    book = xlrd.open_workbook(str(path), logfile=io.StringIO())

    def plain(cell: Any) -> Entry:
        if cell.ctype == xlrd.XL_CELL_ERROR:
            return str(xlrd.error_text_from_code.get(cell.value, "error"))
        return _plain(bool(cell.value) if cell.ctype == xlrd.XL_CELL_BOOLEAN else cell.value)

    return [[plain(cell) for cell in row] for row in book.sheet_by_index(0).get_rows()]


def _rows_of_xlsx(path: Path) -> list[list[Entry]]:
    openpyxl = _need("openpyxl", path)
    sheet = openpyxl.load_workbook(path, data_only=True).worksheets[0]
    return [[_plain(value) for value in row] for row in sheet.iter_rows(values_only=True)]


def _rows_of_csv(path: Path) -> list[list[Entry]]:
    text = path.read_text(encoding="utf-8-sig")
    first = text.partition("\n")[0]
    delimiter = max(",;\t", key=first.count)
    return [[_plain(v) for v in row] for row in csv.reader(io.StringIO(text), delimiter=delimiter)]


def _plain(value: Any) -> Entry:
    """Return a number as float, anything else as text, nothing as the empty text."""
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        return float(value)
    return "" if value is None else str(value).strip()


def _without_empty(rows: Iterable[list[Entry]]) -> list[list[Entry]]:
    """Drop empty rows and columns, and bring all rows to the same length."""
    filled = [row for row in rows if any(value != "" for value in row)]
    width = max(map(len, filled), default=0)
    full = [row + [""] * (width - len(row)) for row in filled]
    used = [k for k in range(width) if any(row[k] != "" for row in full)]
    return [[row[k] for k in used] for row in full]


def _parse(path: Path, rows: list[list[Entry]]) -> _Table:
    """Table whose first row is a header."""
    header, body = _checked_names(path, "column", rows[0][1:]), rows[1:]
    names = _checked_names(path, "row", [row[0] for row in body])
    columns = {name: k for k, name in enumerate(header, start=1)}
    volume = [columns.pop(name) for name in header if _is_volume(name)]
    if len(volume) > 1:
        message = f"{path} has {len(volume)} columns headed volume; expected at most one"
        raise ValueError(message)
    sigma = np.zeros((len(names), len(names)))
    if columns or not volume:
        _check_columns(path, names, columns)
        for j, row in enumerate(body):
            sigma[j] = [_sigma(path, names[j], i, row[columns[i]]) for i in names]
    volumes = {
        name: _number(f"{path}: volume of cell {name!r}", row[k], above=0)
        for k in volume
        for name, row in zip(names, body, strict=True)
    }
    return _Table(names=names, sigma=sigma, volumes=volumes)


def _checked_names(path: Path, kind: str, entries: Sequence[Entry]) -> list[str]:
    """Names of the rows or the columns as texts, neither missing nor twice."""
    names = [entry if isinstance(entry, str) else f"{entry:.15g}" for entry in entries]
    if not names or "" in names:
        at = f" (number {names.index('') + 1})" if names else ""
        message = f"{path}: a {kind}{at} has no name; expected a cell's name at each {kind}"
        raise ValueError(message)
    _validate.unique(f"{path}: {kind}", names)
    return names


def _is_volume(heading: str) -> bool:
    """Whether a heading is "volume" in any case, alone or with µm³ in any spelling."""
    letters = re.sub(r"[\W_]", "", unicodedata.normalize("NFKC", heading).casefold())
    return letters in ("volume", "volumeum3", "volumeμm3")


def _check_columns(path: Path, names: Sequence[str], columns: Iterable[str]) -> None:
    extra = [name for name in columns if name not in names]
    missing = [name for name in names if name not in columns]
    if extra or missing:
        message = (
            f"{path}: the names of rows and columns differ: columns without a row "
            f"{_listed(extra)}, rows without a column {_listed(missing)}; expected the same names, "
            "and besides at most a column 'volume (um^3)'"
        )
        raise ValueError(message)


def _sigma(path: Path, j: str, i: str, entry: Entry) -> float:
    """Attraction from j to i; an empty diagonal is allowed, as it means nothing."""
    if j == i and entry == "":
        return 0.0
    return _number(f"{path}: attraction from {j!r} (row) to {i!r} (column)", entry, least=0)


def _number(name: str, entry: Entry, **bounds: float) -> float:
    try:
        value = float(entry)
    except ValueError:
        message = f"{name} = {entry!r} is not a number"
        raise ValueError(message) from None
    return _validate.number(name, value, **bounds)


# --- files -------------------------------------------------------------------------------------


def _check_file(path: Path, suffixes: Iterable[str]) -> None:
    _validate.choice(f"extension of {path}", path.suffix.lower(), suffixes)
    if not path.is_file():
        message = f"{path} does not exist or is not a file"
        raise FileNotFoundError(message)


def _guarded(path: Path, read: Callable[[], T]) -> T:
    """Call `read`; what its parser raises on a damaged file becomes a ValueError."""
    try:
        return read()
    except (ImportError, MemoryError):
        raise
    except Exception as error:  # the parsers' errors have no common base
        message = f"{path} cannot be read as a {path.suffix.lower()} file; it may be damaged: "
        raise ValueError(f"{message}{type(error).__name__}: {error}") from error


def _need(package: str, path: Path) -> Any:
    try:
        return importlib.import_module(package)
    except ImportError as error:
        message = f"{path} needs the package {package}; try: pip install 'morphosim[matlab]'"
        raise ImportError(message) from error


def _listed(names: Sequence[str]) -> str:
    return ", ".join(repr(name) for name in names) if names else "(none)"
