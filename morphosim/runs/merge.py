"""From the files of all saves to one Dataset."""

from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from morphosim._files import guarded
from morphosim.measure.variable import IN_SPACE, PER_TIME, Variable
from morphosim.runs.lazy_concat import Segment, chained, stacked
from morphosim.runs.netcdf_variables import PACKED_PHI, described
from morphosim.runs.schema import (
    CONTACT_LIST,
    CONTACT_MATRIX,
    COORDINATES,
    GROUPS,
    IN_GROUPS,
)

if TYPE_CHECKING:
    import xarray as xr

LAZY = {name: group for group, held in GROUPS.items() for name in held if held[name].lazy}
"""Variables that are read when they are used, and their groups."""
MATRIX = "contact_area"
MOST_IN_MATRIX = 1 << 27
"""Numbers of a run's matrix of contacts (512 MB); beyond, contacts are a list."""
MOST_HELD = 1 << 15
"""Numbers of a variable that a save keeps; more are read when they are used."""
NEEDED = ("time", "step", "cell", "parent", "axis", "principal", "volume")
"""Variables without which a file is no save."""
NEEDED_ATTRIBUTES = ("title", "source", "spacing_um", "error", "duration")
Table = dict[str, NDArray[Any]]


@dataclass(frozen=True, slots=True)
class Save:
    """What is read of one save at once.

    Attributes
    ----------
    of_root : names of the variables of the root
    table : these variables, without the matrix of contacts and without numbers of more values
        than `MOST_HELD`, which `values` reads again
    groups : variables of the groups, without the lazy ones; contacts are a list in any case
    variables : what the file says of all of them
    matrix : whether contacts are a matrix in the file
    lengths : values of the lazy variables
    packed : whether the fields are whole multiples of `PHI_STEP`
    attributes : of the file
    """

    path: Path
    of_root: Sequence[str]
    table: Table
    groups: Mapping[str, Table]
    variables: Mapping[str, Variable]
    matrix: bool
    lengths: Mapping[str, int]
    packed: bool
    attributes: Mapping[str, Any]

    @classmethod
    def read(cls, path: Path) -> "Save":
        """Read a save; ValueError that names the file if it is damaged, or no save."""
        save = guarded(path, lambda: cls._read(path))
        check_complete(path, "save of a run", save.of_root, save.attributes)
        return save

    @classmethod
    def _read(cls, path: Path) -> "Save":
        import netCDF4

        with netCDF4.Dataset(path) as file:
            file.set_auto_mask(False)
            return cls.of(
                path,
                {"": _values(file)} | {name: _values(group) for name, group in file.groups.items()},
                {
                    name: described(variable)
                    for group in (file, *file.groups.values())
                    for name, variable in group.variables.items()
                },
                lengths={
                    name: len(file[group][name]) for name, group in LAZY.items()
                    if group in file.groups
                },
                attributes={name: file.getncattr(name) for name in file.ncattrs()},
            )  # fmt: skip

    @classmethod
    def of(
        cls, path: Path, tables: Mapping[str, Table], variables: Mapping[str, Variable], *,
        lengths: Mapping[str, int], attributes: Mapping[str, Any],
    ) -> "Save":  # fmt: skip
        """Save of what a file holds; `tables` by group, where "" is the root."""
        table, groups = dict(tables[""]), {name: tables[name] for name in tables if name}
        variables, areas = dict(variables), table.pop(MATRIX, None)
        if areas is not None:
            groups["contacts"] = _list_of(areas[0])
        if "time" in variables["parent"].dims:  # in saves before 0.2 it is not
            variables["parent"] = replace(variables["parent"], dims=("cell",))
            table["parent"] = table["parent"][0]
        return cls(
            path=path,
            of_root=list(table),
            table={name: held for name, held in table.items() if is_held(held)},
            groups=groups,
            variables=variables,
            matrix=areas is not None,
            lengths=lengths,
            packed="phi" in lengths and np.dtype(variables["phi"].kind).kind == "i",
            attributes=attributes,
        )

    def values(self, name: str) -> NDArray[Any]:
        """Values of a variable of the root."""
        if name in self.table:
            return self.table[name]
        return guarded(self.path, lambda: self._reread(name))

    def _reread(self, name: str) -> NDArray[Any]:
        import netCDF4

        with netCDF4.Dataset(self.path) as file:
            file.set_auto_mask(False)
            return np.asarray(file[name][...])

    @property
    def cells(self) -> list[str]:
        """Names of the cells."""
        return [str(name) for name in self.table["cell"]]

    @property
    def time(self) -> float:
        """*In silico* time."""
        return float(self.table["time"][0])

    @property
    def run_id(self) -> str:
        """Which run it is of; "" in saves of version 0.1."""
        return str(self.attributes.get("run_id", ""))


def check_complete(
    path: Path, what: str, variables: Container[Any], attributes: Container[Any]
) -> None:
    """Raise ValueError if a file lacks what every run has."""
    lacking = [f"variable {name!r}" for name in NEEDED if name not in variables]
    lacking += [f"attribute {name!r}" for name in NEEDED_ATTRIBUTES if name not in attributes]
    if lacking:
        message = f"{path} is no {what}: it has no {lacking[0]}"
        raise ValueError(message)


def _values(group: Any) -> Table:
    read = {name: v[...] for name, v in group.variables.items() if name not in LAZY}
    return {name: shortened(v) if v.dtype.kind in "OU" else v for name, v in read.items()}


def shortened(texts: NDArray[Any]) -> NDArray[Any]:
    """Texts without room for longer ones: files count the bytes of UTF-8."""
    plain = texts.astype(str)
    return plain.astype(f"U{max(int(np.char.str_len(plain).max(initial=1)), 1)}")


def is_held(values: NDArray[Any]) -> bool:
    """Whether a save keeps what it has read, all of which has been read once to see it is whole."""
    return values.size <= MOST_HELD or values.dtype.kind == "U"


def merged(saves: Sequence[Save]) -> "xr.Dataset":
    """One Dataset of all saves; cells in the order in which they first appear.

    Raises
    ------
    ValueError
        Saves hold different variables of one name.
    """
    import xarray as xr

    place = {name: k for k, name in enumerate(dict.fromkeys(n for s in saves for n in s.cells))}
    columns = [np.array([place[name] for name in save.cells]) for save in saves]
    table = _tables(saves, columns, list(place))
    stored = _stored(saves)
    variables: dict[str, tuple[Any, ...]] = {
        name: (stored[name].dims, value, stored[name].attributes) for name, value in table.items()
    }
    for name in LAZY:
        if any(name in save.lengths for save in saves):
            values = _chain(saves, columns, name)
            encoding = _encoding(saves) if name == "phi" else {}
            variables[name] = (stored[name].dims, values, stored[name].attributes, encoding)
    coordinates = {n: variables.pop(n) for n in ("time", *COORDINATES) if n in variables}
    return with_coordinates(xr.Dataset(variables, coordinates, saves[-1].attributes))


def with_coordinates(run: "xr.Dataset") -> "xr.Dataset":
    """Make coordinates of what there is no arithmetic with.

    That are texts, by which xarray then groups; and what has a length of its own, the fields among
    it, which xarray then leaves as they are instead of giving them all dimensions, as `where` does.
    """
    texts = [name for name, values in run.variables.items() if values.dtype.kind in "OSU"]
    return run.set_coords([name for name in (*texts, *IN_GROUPS) if name in run.variables])


def _tables(
    saves: Sequence[Save], columns: Sequence[NDArray[np.int64]], names: list[str]
) -> dict[str, Any]:
    """All variables but those of `LAZY`, over all saves and these cells."""
    table: dict[str, Any] = {name: saves[0].values(name) for name in ("axis", "principal")}
    table |= {"cell": np.array(names), "neighbour": np.array(names)}
    for name in dict.fromkeys(name for save in saves for name in save.of_root):
        if name not in COORDINATES:
            table[name] = _stacked(name, saves, columns, len(names))
    if all(save.matrix for save in saves) and len(saves) * len(names) ** 2 <= MOST_IN_MATRIX:
        table |= {MATRIX: _matrix(saves, columns, len(names))}
    else:
        del table["neighbour"]
        table |= _pairs(saves, columns)
    for group in dict.fromkeys(group for save in saves for group in save.groups):
        if group != "contacts":
            table |= _joined(saves, columns, group)
    return table


def _stored(saves: Sequence[Save]) -> dict[str, Variable]:
    """What the files say of each variable, the last one first; contacts may be in another form."""
    stored = CONTACT_MATRIX | CONTACT_LIST
    for save in saves:
        stored |= save.variables
    return stored


def _encoding(saves: Sequence[Save]) -> dict[str, Any]:
    """How the fields are stored, if it is alike in all saves."""
    packed = all(save.packed for save in saves if "fields" in save.groups)
    return PACKED_PHI | {"zlib": True, "complevel": 1} if packed else {}


def _stacked(
    name: str, saves: Sequence[Save], columns: Sequence[NDArray[np.int64]], count: int
) -> Any:
    """Variable of the root over all saves and cells; absent are NaN and ""."""
    having = [save for save in saves if name in save.of_root]
    _check_alike(name, having)
    variable, dtype = having[-1].variables[name], _common_type(name, having)
    if dtype.kind == "i" and len(having) < len(saves):
        dtype = np.dtype(float)
    sizes = {"cell": count} | IN_SPACE
    if variable.dims[:1] != PER_TIME:  # the mothers: of the last save that has the cell
        full = _absent([sizes[d] for d in variable.dims], dtype)
        for save, column in zip(saves, columns, strict=True):
            if name in save.of_root:
                full[column] = save.values(name)
        return full
    shape = [sizes[d] for d in variable.dims[1:]]
    places = columns if variable.dims[1:2] == ("cell",) else [...] * len(saves)
    at = partial(_values_at, name, saves, places, shape, dtype)
    return stacked((len(saves), *shape), dtype, at)


def _values_at(
    name: str, saves: Sequence[Save], places: Sequence[Any], shape: Sequence[int],
    dtype: np.dtype[Any], save: int,
) -> NDArray[Any]:  # fmt: skip
    """Values of one save, at the places of its cells."""
    values = _absent(shape, dtype)
    if name in saves[save].of_root:
        values[places[save]] = saves[save].values(name)[0]
    return values


def _common_type(name: str, having: Sequence[Save]) -> np.dtype[Any]:
    """Type that holds a variable of all these saves."""
    return np.result_type(
        *(
            save.table[name].dtype if name in save.table else save.variables[name].kind
            for save in having
        )
    )


def _check_alike(name: str, having: Sequence[Save]) -> None:
    """Raise ValueError unless a variable is of one form in all saves that have it."""
    first = having[0]
    for save in having:
        before, now = first.variables[name].form, save.variables[name].form
        if before != now:
            message = (
                f"variable {name!r} is {before} in {first.path} and {now} in {save.path}; give one "
                "of the two another name"
            )
            raise ValueError(message)


def _absent(shape: Sequence[int], dtype: np.dtype[Any]) -> NDArray[Any]:
    """Array of what stands for a cell, or a variable, that is not there."""
    if dtype.kind == "U":
        return np.full(shape, "", dtype)
    return np.full(shape, np.nan if dtype.kind == "f" else 0, dtype)


def _joined(saves: Sequence[Save], columns: Sequence[NDArray[np.int64]], group: str) -> Table:
    """Variables of a group, one save after the other, with indices that count within the run."""
    parts: list[Table] = []
    for k, (save, column) in enumerate(zip(saves, columns, strict=True)):
        if group not in save.groups:
            continue
        part = dict(save.groups[group])
        for name in part.keys() & IN_GROUPS:
            if IN_GROUPS[name].index == "time":
                part[name] = np.full_like(part[name], k)
            elif IN_GROUPS[name].index == "cell":
                part[name] = column[part[name]].astype(part[name].dtype)
        parts.append(part)
    return {name: np.concatenate([p[name] for p in parts]) for name in parts[0]}


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


def _matrix(saves: Sequence[Save], columns: Sequence[NDArray[np.int64]], count: int) -> Any:
    """Contact areas of all saves: 0 between cells that do not touch, NaN of those not there."""
    kind = np.dtype(CONTACT_MATRIX[MATRIX].kind)
    at = partial(_matrix_at, saves, columns, count, kind)
    return stacked((len(saves), count, count), kind, at)


def _matrix_at(
    saves: Sequence[Save], columns: Sequence[NDArray[np.int64]], count: int,
    kind: np.dtype[Any], save: int,
) -> NDArray[Any]:  # fmt: skip
    """Contact areas of one save."""
    column, area = columns[save], _absent((count, count), kind)
    area[np.ix_(column, column)] = 0
    _, i, j, values = (saves[save].groups["contacts"][name] for name in CONTACT_LIST)
    area[column[i], column[j]] = area[column[j], column[i]] = values
    return area


def _chain(saves: Sequence[Save], columns: Sequence[NDArray[np.int64]], name: str) -> Any:
    """Lazy variable of all saves; label images count the cells of the run."""
    segments = []
    for save, column in zip(saves, columns, strict=True):
        if name in save.lengths:
            table = np.concatenate([[0], column + 1]).astype("i4") if name == "label" else None
            segments.append(Segment(save.path, LAZY[name], name, save.lengths[name], table))
    return chained(segments)
