"""From the files of all saves to one Dataset."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from morphosim.runs.lazy_concat import Segment, chained
from morphosim.runs.schema import ALL, CONTACT_LIST, CONTACT_MATRIX, LABELS, PHI_STEP

if TYPE_CHECKING:
    import xarray as xr

LAZY = {"phi": "fields", "label": "labels"}
"""Variables that are read when they are used, and their groups."""
INDICES = {
    "box_time": "time", "box_cell": "cell", "contact_time": "time", "contact_cell": "cell",
    "contact_neighbour": "cell", "label_time": "time",
}  # fmt: skip
"""What counts within a save and must count within the run."""
MATRIX = "contact_area"
MOST_IN_MATRIX = 1 << 27
"""Numbers of a run's matrix of contacts (512 MB); beyond, contacts are a list."""
Table = dict[str, NDArray[Any]]


@dataclass(frozen=True, slots=True)
class Save:
    """What is read of one save at once.

    Attributes
    ----------
    table : variables of the root, without the matrix of contacts
    groups : variables of the groups, without the lazy ones; contacts are a list in any case
    matrix : whether contacts are a matrix in the file
    lengths : values of the lazy variables
    packed : whether the fields are whole multiples of `PHI_STEP`
    attributes : of the file
    """

    path: Path
    table: Table
    groups: Mapping[str, Table]
    matrix: bool
    lengths: Mapping[str, int]
    packed: bool
    attributes: Mapping[str, Any]

    @classmethod
    def read(cls, path: Path) -> "Save":
        """Read a save; OSError names the file if it is damaged."""
        import netCDF4

        with netCDF4.Dataset(path) as file:
            file.set_auto_mask(False)
            table = _values(file)
            groups = {name: _values(group) for name, group in file.groups.items()}
            areas = table.pop(MATRIX, None)
            if areas is not None:
                groups["contacts"] = _list_of(areas[0])
            return cls(
                path=path,
                table=table,
                groups=groups,
                matrix=areas is not None,
                lengths={
                    name: len(file[group][name]) for name, group in LAZY.items()
                    if group in file.groups
                },
                packed="fields" in file.groups and file["fields"]["phi"].dtype.kind == "i",
                attributes={name: file.getncattr(name) for name in file.ncattrs()},
            )  # fmt: skip

    @property
    def cells(self) -> list[str]:
        """Names of the cells."""
        return [str(name) for name in self.table["cell"]]


def _values(group: Any) -> Table:
    return {name: v[...] for name, v in group.variables.items() if name not in LAZY}


def merged(paths: Sequence[Path]) -> "xr.Dataset":
    """One Dataset of all saves; cells in the order in which they first appear."""
    import xarray as xr

    saves = _kept([Save.read(path) for path in paths])
    place = {name: k for k, name in enumerate(dict.fromkeys(n for s in saves for n in s.cells))}
    columns = [np.array([place[name] for name in save.cells]) for save in saves]
    names = np.array(list(place))
    table = {name: saves[0].table[name] for name in ("axis", "principal")}
    table |= {"cell": names, "neighbour": names}
    table |= _stacked(saves, columns, len(place))
    if all(save.matrix for save in saves) and len(saves) * len(place) ** 2 <= MOST_IN_MATRIX:
        table |= {MATRIX: _matrix(saves, columns, len(place))}
    else:
        del table["neighbour"]
        table |= _pairs(saves, columns)
    for group in ("fields", "labels"):
        table |= _joined(saves, columns, group)
    variables = {name: _variable(name, value) for name, value in table.items()}
    for name, group in LAZY.items():
        if any(group in save.groups for save in saves):
            packed = all(save.packed for save in saves if "fields" in save.groups)
            packing = {"dtype": "int16", "scale_factor": np.float32(PHI_STEP)}
            encoding = packing if packed and name == "phi" else {}
            variables[name] = (*_variable(name, _chain(saves, columns, name)), encoding)
    coordinates = {name: variables.pop(name) for name in ("time", *LABELS) if name in variables}
    parent = coordinates.pop("parent")
    return xr.Dataset(variables | {"parent": parent}, coordinates, saves[-1].attributes)


def _kept(saves: Sequence[Save]) -> list[Save]:
    """Saves without those that a later one has gone back behind."""
    kept: list[Save] = []
    for save in reversed(saves):
        if not kept or save.table["step"][0] < kept[-1].table["step"][0]:
            kept.append(save)
    return kept[::-1]


def _variable(name: str, value: Any) -> tuple[Any, ...]:
    return ALL[name].dims, value, ALL[name].attributes


def _stacked(saves: Sequence[Save], columns: Sequence[NDArray[np.int64]], count: int) -> Table:
    """Variables of the root that have a time or a cell, over all cells and saves."""
    present = {name: value for save in saves for name, value in save.table.items()}
    result: Table = {}
    for name, value in present.items():
        dims = ALL[name].dims
        if name in LABELS and name != "parent":
            continue
        sizes = {"time": len(saves), "cell": count, "neighbour": count}
        shape = [sizes.get(d, n) for d, n in zip(dims, value.shape, strict=True)]
        result[name] = full = _absent(shape, value.dtype)
        for k, (save, column) in enumerate(zip(saves, columns, strict=True)):
            if name in save.table:
                here = {"time": np.array([k]), "cell": column, "neighbour": column}
                index = [here.get(d, np.arange(n)) for d, n in zip(dims, shape, strict=True)]
                full[np.ix_(*index)] = save.table[name]
        if full.dtype == object:
            result[name] = full.astype(str)
    return result


def _absent(shape: Sequence[int], dtype: np.dtype[Any]) -> NDArray[Any]:
    """Array of what stands for a cell that is not there."""
    if dtype.kind in "OU":
        return np.full(shape, "", dtype=object)
    return np.full(shape, np.nan if dtype.kind == "f" else 0, dtype)


def _joined(saves: Sequence[Save], columns: Sequence[NDArray[np.int64]], group: str) -> Table:
    """Variables of a group, one save after the other, with indices that count within the run."""
    parts: list[Table] = []
    for k, (save, column) in enumerate(zip(saves, columns, strict=True)):
        if group not in save.groups:
            continue
        part = dict(save.groups[group])
        for name in part.keys() & INDICES:
            part[name] = np.full_like(part[name], k) if INDICES[name] == "time" else (
                column[part[name]].astype(part[name].dtype)
            )  # fmt: skip
        parts.append(part)
    return {name: np.concatenate([p[name] for p in parts]) for name in (parts[0] if parts else ())}


def _list_of(areas: NDArray[Any]) -> Table:
    """List of the pairs of one save that touch, from its matrix."""
    i, j = np.nonzero(np.triu(areas))
    values = (np.zeros(len(i)), i, j, areas[i, j])
    return {
        name: value.astype(CONTACT_LIST[name].kind)
        for name, value in zip(CONTACT_LIST, values, strict=True)
    }


def _pairs(saves: Sequence[Save], columns: Sequence[NDArray[np.int64]]) -> Table:
    """Contacts of all saves as a list of pairs, the cell that comes first in the run first."""
    table = _joined(saves, columns, "contacts")
    first, second = table["contact_cell"], table["contact_neighbour"]
    pair = {
        "contact_cell": np.minimum(first, second),
        "contact_neighbour": np.maximum(first, second),
    }
    return table | pair


def _matrix(
    saves: Sequence[Save], columns: Sequence[NDArray[np.int64]], count: int
) -> NDArray[Any]:
    """Contact areas of all saves: 0 between cells that do not touch, NaN of those not there."""
    areas = _absent((len(saves), count, count), np.dtype(CONTACT_MATRIX[MATRIX].kind))
    for area, save, column in zip(areas, saves, columns, strict=True):
        area[np.ix_(column, column)] = 0
        _, i, j, values = (save.groups["contacts"][name] for name in CONTACT_LIST)
        area[column[i], column[j]] = area[column[j], column[i]] = values
    return areas


def _chain(saves: Sequence[Save], columns: Sequence[NDArray[np.int64]], name: str) -> Any:
    """Lazy variable of all saves; label images count the cells of the run."""
    segments = []
    for save, column in zip(saves, columns, strict=True):
        if name in save.lengths:
            table = np.concatenate([[0], column + 1]).astype("i4") if name == "label" else None
            segments.append(Segment(save.path, LAZY[name], name, save.lengths[name], table))
    return chained(segments)
