"""Lineages from tables (.csv, .xls, .xlsx)."""

from collections.abc import Iterable, Mapping
from importlib.resources import as_file, files
from pathlib import Path

import numpy as np

from morphosim.importers.lineage.grouping import division_groups
from morphosim.importers.lineage.rows import Rows, read_rows, refuse
from morphosim.importers.lineage.tree import DivisionGroup, Lineage, LineageCell, Vector

FRACTION_TOLERANCE = 0.01
"""How far a stated fraction may be from the ratio of the stated volumes."""


def read_lineage(path: Path | str | None = None) -> Lineage:
    """Lineage from a table with one row per cell.

    Parameters
    ----------
    path
        A .csv, .xls or .xlsx file, or None for the built-in lineage of *C. elegans* from 1 to 102
        cells. Columns, in any order, empty where nothing is known:

        - `name` and `parent` (empty: the lineage starts with this cell),
        - `volume_um3` (or `volume`), µm³: needed for cells that the lineage starts with,
        - `fraction`: share of the first daughter; needed where daughters have no volumes,
        - `axis_x`, `axis_y`, `axis_z`: in the row of a cell that divides its division axis, of
          any length, from the second daughter to the first,
        - `group`: in that row too, the number of the group it divides with, or `division_min`,
          minutes. Without `group`, cells of the same founder and generation divide together if
          there is a column `founder`, or else cells with the same time,
        - optional: `founder` and `generation` (if empty: the parent's, and counted),
          `daughter1` and `daughter2` (if empty: in the order of their rows),
          `measured_axis_x`, `measured_axis_y`, `measured_axis_z`, `measured_n`, `measured_r`.

    Raises
    ------
    FileNotFoundError
        The file does not exist.
    TypeError, ValueError
        The file cannot be read, or an entry is missing or not allowed; names row and column.
    """
    if path is None:
        with as_file(files("morphosim.importers.lineage") / "celegans.csv") as built_in:
            return read_lineage(built_in)
    rows = read_rows(Path(path))
    founders = _founders(rows)
    groups = division_groups(rows, founders)
    return Lineage(cells=_cells(rows, founders, groups), division_groups=groups)


def _cells(
    rows: Rows, founders: Mapping[str, str], groups: Iterable[DivisionGroup]
) -> dict[str, LineageCell]:
    numbers = {name: group.number for group in groups for name in group.mothers}
    fractions = {name: _fraction(rows, name) for name in rows.daughters}
    volumes, generations = _volumes(rows, fractions), _generations(rows, founders)
    return {
        name: LineageCell(
            name=name, parent=parent, founder=founders[name], generation=generations[name],
            volume=volumes[name], stated_volume=rows.value(name, "volume_um3"),
            daughters=rows.daughters.get(name, ()), group=numbers.get(name),
            fraction=fractions.get(name), axis=_axis(rows, name),
            measured_axis=_vector(rows, name, "measured_axis"),
            measured_n=rows.value(name, "measured_n"), measured_r=rows.value(name, "measured_r"),
            division_min=rows.value(name, "division_min"),
        )
        for name, parent in rows.parents.items()
    }  # fmt: skip


def _founders(rows: Rows) -> dict[str, str]:
    """Founder of each cell: stated, or the parent's, or the cell itself."""
    founders: dict[str, str] = {}
    for name in rows.downwards():
        parent = rows.parents[name]
        founders[name] = rows.value(name, "founder") or (founders[parent] if parent else name)
    return founders


def _generations(rows: Rows, founders: Mapping[str, str]) -> dict[str, int]:
    """Generation of each cell: stated, or divisions since the founder."""
    generations: dict[str, int] = {}
    for name in rows.downwards():
        stated, parent = rows.value(name, "generation"), rows.parents[name]
        same = parent is not None and founders[parent] == founders[name]
        counted = generations[parent] + 1 if parent is not None and same else 0
        generations[name] = counted if stated is None else stated
    return generations


def _fraction(rows: Rows, name: str) -> float:
    """Share of the first daughter: stated, or else from the daughters' stated volumes."""
    stated = rows.value(name, "fraction")
    first, second = (rows.value(daughter, "volume_um3") for daughter in rows.daughters[name])
    if first is None or second is None:
        wanted = "a number between 0 and 1, or the volumes of both daughters"
        return float(rows.needed(name, "fraction", wanted))
    ratio = float(first / (first + second))
    if stated is not None and abs(stated - ratio) > FRACTION_TOLERANCE:
        refuse(
            rows.where[name], "fraction", stated,
            f"the volumes of its daughters say {ratio:.4f}; leave one of them empty",
        )  # fmt: skip
    return ratio if stated is None else float(stated)


def _volumes(rows: Rows, fractions: Mapping[str, float]) -> dict[str, float]:
    """Volumes for a simulation: those of the first cells, shared down the tree."""
    volumes: dict[str, float] = {}
    for name in rows.downwards():
        if rows.parents[name] is None:
            volumes[name] = rows.needed(
                name, "volume_um3", "its volume, as the lineage starts here"
            )
        if name in fractions:
            first, second = rows.daughters[name]
            volumes[first] = volumes[name] * fractions[name]
            volumes[second] = volumes[name] - volumes[first]
    return volumes


def _axis(rows: Rows, name: str) -> Vector | None:
    """Division axis by the table, which a cell that divides must have."""
    if name in rows.daughters:
        for k in "xyz":
            rows.needed(name, f"axis_{k}", "its division axis, as it has daughters")
    return _vector(rows, name, "axis")


def _vector(rows: Rows, name: str, column: str) -> Vector | None:
    """Unit vector of three columns, or None if all are empty."""
    stated = [rows.value(name, f"{column}_{k}") for k in "xyz"]
    if stated == [None, None, None]:
        return None
    for k in "xyz":
        rows.needed(name, f"{column}_{k}", "a number, as the other components have one")
    vector = np.array(stated)
    length = np.linalg.norm(vector)
    if not length > 0:
        refuse(rows.where[name], f"{column}_x, _y, _z", stated, "it must not be zero")
    x, y, z = (float(k) for k in vector / length)
    return x, y, z
