"""The table of living cells: one row per cell, each column declared once.

A row is a cell; rows are in the order of the cells' ids, which are never used twice. What a column
declares (its type, what daughters inherit, whether it is saved) is all that division, removal,
checkpoints and MPI ranks need to know of it.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

Rows = NDArray[np.int64]
RESERVED = frozenset(
    [
        "phi",
        "history",
        "low",
        "high",
        "points",
        "kinds",
        "next_id",
        "check",
        "facts",
        "rows",
        "file",
    ]
)
"""Names that checkpoints and ranks use for other things than columns."""


@dataclass(frozen=True, slots=True)
class Column:
    """One value per cell.

    Attributes
    ----------
    name : str
    dtype : NumPy type of the values; object for texts
    shape : shape of one cell's value, () for a number
    default : value of a new cell
    inherits : bool or function
        Whether daughters begin with their mother's value or with `default`; or a function that
        gives the (2 n, …) values of daughters from the (n, …) values of their mothers.
    saved : bool
        Whether the next step depends on it, so that a checkpoint must hold it. What `Term.prepare`
        sets anew, and scratch space, need not be saved.
    shared : bool
        Whether every MPI rank knows it of all cells; else only the rank that steps the cell does.
        Such columns are the engine's, which changes them on all ranks alike.
    aimed : bool
        Whether all ranks set it alike before forces are added up, in each step, as
        `Engine.targets` does: then it needs no word to the engine when it changes.
    optional : bool
        Whether a saved state may lack it, and has its default then: states of earlier versions.

    Raises
    ------
    ValueError
        The name is no identifier, or is taken.
    """

    name: str
    dtype: DTypeLike = np.float64
    shape: tuple[int, ...] = ()
    default: Any = 0
    inherits: bool | Callable[[NDArray], ArrayLike] = True
    saved: bool = True
    shared: bool = False
    aimed: bool = False
    optional: bool = False

    def __post_init__(self) -> None:
        if not self.name.isidentifier() or self.name in RESERVED:
            message = (
                f"column name = {self.name!r} is not allowed: take letters, digits and _, and "
                f"none of {sorted(RESERVED)}"
            )
            raise ValueError(message)

    def new(self, count: int) -> NDArray[Any]:
        """Values of new cells: (count, *shape)."""
        return np.full((count, *self.shape), self.default, self.dtype)

    def passed_on(self, mothers: NDArray[Any]) -> NDArray[Any]:
        """Values of two daughters of each of these mothers, (2 n, *shape)."""
        if callable(self.inherits):
            return self.fitted(self.inherits(mothers), 2 * len(mothers))
        return np.repeat(mothers, 2, axis=0) if self.inherits else self.new(2 * len(mothers))

    def fitted(self, values: Any, count: int) -> NDArray[Any]:
        """Array (count, *shape) of the column's type; ValueError if the values do not fit."""
        try:
            result = self.new(count)
            result[...] = np.asarray(values, self.dtype)
        except (TypeError, ValueError) as error:
            message = (
                f"column {self.name!r} of {count} cells takes values of shape "
                f"{(count, *self.shape)} and type {np.dtype(self.dtype)}, or one for all: {error}"
            )
            raise ValueError(message) from error
        return result


IDENTITY = (
    Column("id", np.uint64, shared=True),
    Column("name", object, default="", shared=True),
    Column("parent", object, default="", shared=True),
    Column("kind", np.int64, shared=True),  # place of the cell's type in `CellTable.kinds`
)


class CellTable:
    """Columns of N living cells.

    Parameters
    ----------
    columns : further ones than `IDENTITY`; their names must differ

    Attributes
    ----------
    kinds : list of str
        Cell types that occur or have occurred; the column "kind" counts in it.
    next_id : int
        Id of the next new cell.

    Raises
    ------
    ValueError
        Two columns have the same name.

    Examples
    --------
    >>> cells = CellTable([Column("age")])
    >>> cells.add({"name": ["a", "b"]}, types=["", "soft"])
    array([0, 1])
    >>> cells.divide([0], {"name": ["c", "d"], "parent": ["a", "a"]})
    array([1, 2])
    >>> cells["name"].tolist(), cells["id"].tolist(), cells.types
    (['b', 'c', 'd'], [1, 2, 3], ['soft', '', ''])
    """

    def __init__(self, columns: Iterable[Column] = ()) -> None:
        self.columns = _by_name((*IDENTITY, *columns))
        self.kinds: list[str] = []
        self.next_id = 0
        self._values = {name: column.new(0) for name, column in self.columns.items()}
        self._ids: dict[str, int] = {}

    def __len__(self) -> int:
        return len(self._values["id"])

    def __getitem__(self, name: str) -> NDArray[Any]:
        return self._values[name]

    def __setitem__(self, name: str, values: Any) -> None:
        self._values[name][...] = values

    def __contains__(self, name: str) -> bool:
        return name in self.columns

    @property
    def names(self) -> list[str]:
        """Names of the cells."""
        return list(self._values["name"].tolist())

    @property
    def types(self) -> list[str]:
        """Types of the cells."""
        return [self.kinds[k] for k in self._values["kind"].tolist()]

    @property
    def present_kinds(self) -> list[int]:
        """Places in `kinds` of the types that living cells have, in alphabetical order."""
        present = np.unique(self._values["kind"]).tolist()
        return sorted(present, key=lambda kind: self.kinds[kind])

    @property
    def nbytes(self) -> int:
        """Bytes of all columns."""
        return sum(values.nbytes for values in self._values.values())

    def has(self, name: str) -> bool:
        """Whether a cell of this name is alive."""
        return name in self._ids

    def row(self, name: str) -> int:
        """Row of a living cell; KeyError if there is none of this name."""
        return int(np.searchsorted(self._values["id"], np.uint64(self._ids[name])))

    def rows(self, names: Iterable[str]) -> Rows:
        """Rows of living cells, in the order of these names."""
        ids = np.array([self._ids[name] for name in names], np.uint64)
        return np.asarray(np.searchsorted(self._values["id"], ids), np.int64)

    def number_of(self, kind: str) -> int:
        """Place of a type in `kinds`, which it joins if it is new."""
        if kind not in self.kinds:
            self.kinds.append(kind)
        return self.kinds.index(kind)

    def set_types(self, rows: Rows, types: Sequence[str]) -> None:
        """Give cells other types."""
        self._values["kind"][rows] = [self.number_of(kind) for kind in types]

    def require(self, columns: Iterable[Column]) -> list[str]:
        """Have exactly these columns besides `IDENTITY`; return the names of the new ones.

        Columns that are declared as before keep their values, new ones have their defaults.
        """
        before, values, count = self.columns, self._values, len(self)
        self.columns = _by_name((*IDENTITY, *columns))
        kept = {name for name, column in self.columns.items() if before.get(name) == column}
        self._values = {
            name: values[name] if name in kept else column.new(count)
            for name, column in self.columns.items()
        }
        return [name for name in self.columns if name not in kept]

    def add(self, values: Mapping[str, Any], types: Sequence[str]) -> Rows:
        """Append cells; columns that are not among `values` have their defaults. Return the rows.

        Parameters
        ----------
        values : by column, (n, …) values; "name" among them
        types : (n,) types of the cells

        Raises
        ------
        ValueError
            Values do not fit a column; the table is as it was.
        """
        return self._append(self._fitted(values, types))

    def remove(self, rows: ArrayLike) -> None:
        """Drop cells; those behind them move up."""
        gone = np.atleast_1d(np.asarray(rows, np.int64))
        for name in self._values["name"][gone].tolist():
            del self._ids[name]
        for name, values in self._values.items():
            self._values[name] = np.delete(values, gone, axis=0)

    def divide(
        self, rows: ArrayLike, values: Mapping[str, Any], types: Sequence[str] | None = None
    ) -> Rows:
        """Replace cells by two daughters each, which come last; return the daughters' rows.

        Parameters
        ----------
        rows : (n,)
        values : by column, (2 n, …) values of the daughters instead of what they inherit; "name"
            among them
        types : (2 n,), optional
            By default the mothers'.

        Raises
        ------
        ValueError
            Values do not fit a column; the table is as it was.
        """
        return self.replace(rows, self.born(rows, values, types))

    def born(
        self, rows: ArrayLike, values: Mapping[str, Any], types: Sequence[str] | None = None
    ) -> dict[str, NDArray[Any]]:
        """All columns of the daughters of cells; see `divide`. They are not in the table yet."""
        mothers = np.atleast_1d(np.asarray(rows, np.int64))
        inherited = {
            name: column.passed_on(self._values[name][mothers])
            for name, column in self.columns.items() if name not in values
        }  # fmt: skip
        if types is None:
            types = [self.kinds[kind] for kind in inherited["kind"].tolist()]
        return self._fitted(inherited | dict(values), types)

    def replace(self, rows: ArrayLike, born: Mapping[str, NDArray[Any]]) -> Rows:
        """Replace cells by those that `born` gave; return their rows."""
        self.remove(rows)
        return self._append(born)

    def select(self, rows: Rows, columns: Iterable[str] | None = None) -> dict[str, NDArray]:
        """Copies of some rows of columns, by default of all of them."""
        names = self.columns if columns is None else columns
        return {name: self._values[name][rows] for name in names}

    def arrange(self, kept: Rows, places: Rows, count: int) -> None:
        """Hold other cells: some of the present ones, at new places, and new ones.

        Ids and names of new cells are for the caller to `fill` in.

        Parameters
        ----------
        kept : (k,) present rows of the cells that stay
        places : (k,) their new rows
        count : number of cells then
        """
        for name, column in self.columns.items():
            after = column.new(count)
            after[places] = self._values[name][kept]
            self._values[name] = after

    def fill(self, values: Mapping[str, NDArray]) -> None:
        """Overwrite columns (N, …); if ids or names are others than before, say `index`."""
        for name, value in values.items():
            self._values[name][:] = value

    def index(self) -> None:
        """Find cells by their present names from now on."""
        ids = self._values["id"].tolist()
        self._ids = dict(zip(self._values["name"].tolist(), ids, strict=True))

    def saved(self) -> dict[str, NDArray[Any]]:
        """Copies of all that a checkpoint holds; texts as arrays of text."""
        columns = {
            name: values.astype(str) if values.dtype == object else values.copy()
            for name, values in self._values.items() if self.columns[name].saved
        }  # fmt: skip
        return columns | {"kinds": np.array(self.kinds, str), "next_id": np.array(self.next_id)}

    def restore(self, values: Mapping[str, NDArray[Any]]) -> None:
        """Hold exactly the cells that `saved` gave; columns that are not saved have defaults.

        Raises
        ------
        ValueError
            `values` lacks a column.
        """
        needed = [c.name for c in self.columns.values() if c.saved and not c.optional]
        lacking = [name for name in needed if name not in values]
        if lacking:
            message = f"the saved state lacks the columns {lacking}: its terms were others"
            raise ValueError(message)
        count = len(values["id"])
        self.kinds, self.next_id = values["kinds"].tolist(), int(values["next_id"])
        for name, column in self.columns.items():
            self._values[name] = column.new(count)
            if column.saved and name in values:
                self._values[name][:] = values[name]
        self.index()

    def _fitted(self, values: Mapping[str, Any], types: Sequence[str]) -> dict[str, NDArray[Any]]:
        """All columns of new cells of these types, with the ids that come next."""
        count = len(types)
        given = dict(values) | {
            "id": np.arange(self.next_id, self.next_id + count, dtype=np.uint64),
            "kind": [self.number_of(kind) for kind in types],
        }
        return {
            name: column.fitted(given[name], count) if name in given else column.new(count)
            for name, column in self.columns.items()
        }

    def _append(self, new: Mapping[str, NDArray[Any]]) -> Rows:
        """Append rows of all columns, and return them."""
        first, count = len(self), len(new["id"])
        for name, values in new.items():
            self._values[name] = np.concatenate([self._values[name], values])
        self._ids.update(zip(new["name"].tolist(), new["id"].tolist(), strict=True))
        self.next_id += count
        return np.arange(first, first + count)


def _by_name(columns: Iterable[Column]) -> dict[str, Column]:
    """Columns by name; ValueError if two have the same."""
    found: dict[str, Column] = {}
    for column in columns:
        if column.name in found:
            message = (
                f"two columns of the cell table are named {column.name!r}; give a term's column "
                "another name"
            )
            raise ValueError(message)
        found[column.name] = column
    return found
