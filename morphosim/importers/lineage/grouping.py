"""Which cells of a lineage divide together, and when."""

from collections.abc import Iterable, Mapping
from typing import Any

from morphosim.importers.lineage.rows import Rows, refuse
from morphosim.importers.lineage.tree import DivisionGroup

Key = tuple[Any, ...]
"""What the cells of one group have in common; a mother's sorts before her daughters'."""


def division_groups(rows: Rows, founders: Mapping[str, str]) -> tuple[DivisionGroup, ...]:
    """Groups in the order in which they divide.

    They are those of the column `group`. Without it, they are the cells of the same founder and
    generation if there is a column `founder`, or else the cells with the same time of division.
    """
    _check_times(rows)
    keys = _keys(rows, founders)
    members: dict[Key, list[str]] = {}
    for name, key in keys.items():
        members.setdefault(key, []).append(name)
    times = _times(rows, keys, members) if rows.has("division_min") else {}
    explicit = rows.has("group")
    order = sorted(members, key=lambda key: key if explicit else (times[key], key))
    _check_order(rows, keys, order)
    sizes = [len(members[key]) for key in order]
    start = sum(parent is None for parent in rows.parents.values())
    return tuple(
        DivisionGroup(
            number=key[0] if explicit else place,
            mothers=tuple(members[key]),
            founder=_common(founders[name] for name in members[key]),
            cells_after=start + sum(sizes[:place]),
            time=times.get(key),
        )
        for place, key in enumerate(order, start=1)
    )


def _common(names: Iterable[str]) -> str | None:
    """Return the one name that all have, or None if they differ."""
    different = set(names)
    return different.pop() if len(different) == 1 else None


def _check_times(rows: Rows) -> None:
    """Raise unless all cells that divide have a time after their mother's, or none has one."""
    if not rows.has("division_min"):
        if rows.daughters and not rows.has("group"):
            message = (
                f"{rows.path} says nothing of when cells divide; "
                "expected a column group (1, 2, ...) or division_min (time of division, minutes)"
            )
            raise ValueError(message)
        return
    for name in (name for name in rows.downwards() if name in rows.daughters):
        time = rows.needed(name, "division_min", "its time of division in minutes")
        mother = rows.parents[name]
        if mother is not None and not time > rows.value(mother, "division_min"):
            before = f"it must be after the division of its parent {mother!r}"
            value = rows.value(mother, "division_min")
            refuse(rows.where[name], "division_min", time, f"{before}, {value:g}")


def _keys(rows: Rows, founders: Mapping[str, str]) -> dict[str, Key]:
    """Key of each cell that divides."""
    if rows.has("group"):
        return {name: (_group(rows, name),) for name in rows.parents if _divides(rows, name)}
    if rows.has("founder"):
        return {name: (rows.depth(name), founders[name]) for name in rows.daughters}
    return {name: (rows.value(name, "division_min"),) for name in rows.daughters}


def _divides(rows: Rows, name: str) -> bool:
    """Whether a cell divides; a group for a cell without daughters is an error."""
    if name not in rows.daughters and rows.value(name, "group") is not None:
        refuse(
            rows.where[name], "group", rows.value(name, "group"),
            f"no row has {name!r} as its parent; leave it empty or add two daughters",
        )  # fmt: skip
    return name in rows.daughters


def _group(rows: Rows, name: str) -> int:
    number: int = rows.needed(name, "group", "the number of the group it divides with")
    mother = rows.parents[name]
    if mother is not None and not number > (before := rows.value(mother, "group") or 0):
        wanted = f"it must be after that of its parent {mother!r}, {before}"
        refuse(rows.where[name], "group", number, wanted)
    return number


def _check_order(rows: Rows, keys: Mapping[str, Key], order: list[Key]) -> None:
    """Raise unless every cell divides after its mother, where founders make the groups."""
    for name, key in keys.items():
        mother = rows.parents[name]
        if mother is not None and order.index(key) < order.index(keys[mother]):
            refuse(
                rows.where[name], "founder", rows.value(name, "founder"),
                f"cell {name!r} would divide with its founder's cells of the same generation "
                f"before its parent {mother!r}; give it another founder, or use a column group",
            )  # fmt: skip


def _times(
    rows: Rows, keys: Mapping[str, Key], members: Mapping[Key, list[str]]
) -> dict[Key, float]:
    """Time of each group: that of the mothers' group plus the shortest cycle of its cells."""
    times: dict[Key, float] = {}
    for key in sorted(members):
        times[key] = min(_reached(rows, name, keys, times) for name in members[key])
    return times


def _reached(rows: Rows, name: str, keys: Mapping[str, Key], times: Mapping[Key, float]) -> float:
    """Time of a cell's division if its mother divided when the mother's group does."""
    own: float = rows.value(name, "division_min")
    mother = rows.parents[name]
    if mother is None:
        return own
    return times[keys[mother]] + own - float(rows.value(mother, "division_min"))
