"""Scenes from the files of the published MATLAB program (guidebook, Supplementary Note 3).

Its arrays are ordered y, x, z; the voxel with index k lies at k · spacing on each axis.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from morphosim import _validate
from morphosim._files import listed
from morphosim.geometry.confinement import Confinement, MaskWalls
from morphosim.geometry.eggshell import EGGSHELL
from morphosim.geometry.shapes import Field, Mask
from morphosim.importers.matlab.mat_file import read_mat
from morphosim.importers.matlab.name_table import NameTable, read_name_table
from morphosim.numerics.parameters import Numerics
from morphosim.physics.attraction import Attraction
from morphosim.physics.parameters import Physics
from morphosim.scene.cell import Cell
from morphosim.scene.scene import Scene

NEGLIGIBLE = 1e-6
"""Fields are cropped to where |φ| exceeds this."""


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

    Physics is the package's default and numerics the preset "published", which repeats the
    published program, on the lattice of the files.

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
    masks, known = Path(masks), read_name_table(Path(table))
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
        numerics=Numerics.preset("published", spacing=spacing),
        confinement=walls,
        name=masks.stem if name is None else name,
    )


def _read_images(path: Path, names: Sequence[str]) -> _Images:
    """Image of every cell in a file of masks or fields."""
    found = read_mat(path, ("Mask", "phi_save"), ("CellIdx",))
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
    table: NameTable, names: Sequence[str], masks: Path | None, spacing: float
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
        message = f"{path} (masks_for_volume) has no mask of the cells {listed(missing)}"
        raise ValueError(message)
    return {name: shape.volume for name, shape in shapes.items()}


def _read_walls(path: Path, shape: tuple[int, ...], spacing: float) -> MaskWalls:
    """Confinement from PhiShell."""
    values = _xyz(f"{path}: PhiShell", read_mat(path, ("PhiShell",))["PhiShell"])
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
