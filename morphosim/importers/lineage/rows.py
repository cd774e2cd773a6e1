"""Rows of a lineage table: reading them, and checking that they make trees."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

from morphosim import _validate
from morphosim._files import listed
from morphosim._tables import Converter, number, positive, read_table, text, whole

ALIASES = {"cell": "name", "volume": "volume_um3"}


def refuse(where: str, column: str, value: Any, wanted: str) -> NoReturn:
    """Raise ValueError that names row, column, value and what is allowed."""
    message = f"{where}: {column} = {value!r} is not allowed: {wanted}"
    raise ValueError(message)


@dataclass(frozen=True, slots=True, kw_only=True)
class Rows:
    """Entries of a lineage table, by cell and column."""

    path: Path
    columns: tuple[str, ...]
    entries: Mapping[str, Mapping[str, Any]]
    """What is said of each cell, without empty entries."""
    where: Mapping[str, str]
    """File and row of each cell, for errors."""
    parents: Mapping[str, str | None]
    daughters: Mapping[str, tuple[str, str]]
    """First and second daughter of each cell that divides."""

    def has(self, column: str) -> bool:
        """Whether the table has this column."""
        return column in self.columns

    def value(self, name: str, column: str) -> Any:
        """What a row says, or None."""
        return self.entries[name].get(column)

    def needed(self, name: str, column: str, what: str) -> Any:
        """What a row says; ValueError if it says nothing."""
        value = self.value(name, column)
        if value is None:
            message = f"{self.where[name]}: {column} of cell {name!r} is missing; expected {what}"
            raise ValueError(message)
        return value

    def depth(self, name: str) -> int:
        """Number of divisions from the start of the lineage to a cell."""
        parent = self.parents[name]
        return 0 if parent is None else 1 + self.depth(parent)

    def downwards(self) -> list[str]:
        """Cells, each after its parent."""
        order = [name for name, parent in self.parents.items() if parent is None]
        for name in order:  # grows while it is walked
            order.extend(self.daughters.get(name, ()))
        return order


def read_rows(path: Path) -> Rows:
    """Rows of a table whose cells form trees: every parent known, two daughters or none."""
    table = read_table(path, COLUMNS, ("name", "parent"), ALIASES)
    entries: dict[str, dict[str, Any]] = {}
    where: dict[str, str] = {}
    for here, said in table.rows:
        if "name" not in said:
            message = f"{here}: name is missing; expected the name of a cell"
            raise ValueError(message)
        name = said["name"]
        if name in entries:
            message = f"{here}: name {name!r} occurs twice; each must be unique"
            raise ValueError(message)
        entries[name], where[name] = said, here
    parents = {name: said.get("parent") for name, said in entries.items()}
    _check_parents(parents, where)
    daughters = _daughters(entries, parents, where)
    return Rows(
        path=path, columns=table.columns, entries=entries, where=where, parents=parents,
        daughters=daughters,
    )  # fmt: skip


def _check_parents(parents: Mapping[str, str | None], where: Mapping[str, str]) -> None:
    """Raise unless every parent has a row and none descends from itself."""
    sound: set[str] = set()
    for name, parent in parents.items():
        if parent is not None:
            _validate.choice(f"{where[name]}: parent", parent, parents)
    for name in parents:
        path = [name]
        while (parent := parents[path[-1]]) is not None and parent not in sound:
            if parent in path:
                loop = " <- ".join([*path[path.index(parent) :], parent])
                wanted = f"the cell would descend from itself ({loop}); check parents"
                refuse(where[parent], "parent", parents[parent], wanted)
            path.append(parent)
        sound.update(path)


def _daughters(
    entries: Mapping[str, Mapping[str, Any]],
    parents: Mapping[str, str | None],
    where: Mapping[str, str],
) -> dict[str, tuple[str, str]]:
    """First and second daughter of each cell that divides: as stated, or else as the rows stand."""
    found: dict[str, list[str]] = {name: [] for name in parents}
    for name, parent in parents.items():
        if parent is not None:
            found[parent].append(name)
    for name, have in found.items():
        if len(have) not in (0, 2):
            message = (
                f"{where[name]}: daughters of cell {name!r} are {listed(have)}; "
                "expected 2 or none; check the column parent"
            )
            raise ValueError(message)
        stated = [entries[name][c] for c in ("daughter1", "daughter2") if c in entries[name]]
        if stated and sorted(stated) != sorted(have):
            wanted = f"the rows with parent {name!r} are {listed(have)}; expected the same two"
            refuse(where[name], "daughter1, daughter2", ", ".join(stated), wanted)
        found[name] = stated or have
    return {name: (two[0], two[1]) for name, two in found.items() if two}


def _fraction(name: str, entry: str) -> float:
    value = positive(name, entry)
    if value >= 1:
        message = f"{name} = {value!r} is not allowed: it must be above 0 and below 1"
        raise ValueError(message)
    return value


COLUMNS: Mapping[str, Converter] = {
    **dict.fromkeys(("name", "parent", "founder", "daughter1", "daughter2"), text),
    **dict.fromkeys(
        [f"{kind}axis_{axis}" for kind in ("", "measured_") for axis in "xyz"], number
    ),
    "generation": whole(0), "group": whole(1), "volume_um3": positive, "fraction": _fraction,
    "measured_n": whole(0), "measured_r": positive, "division_min": number,
}  # fmt: skip
"""What turns an entry into a value, by column."""
