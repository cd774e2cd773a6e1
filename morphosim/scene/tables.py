"""Physics, numerics and cells as plain tables, and back: what scene files and saved states say."""

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np

from morphosim import _validate
from morphosim.numerics.parameters import Numerics
from morphosim.physics.attraction import Attraction
from morphosim.physics.parameters import Physics
from morphosim.scene.cell import Cell, VolumeCourse
from morphosim.scene.term_tables import term_table, terms_of


def build(cls: type, table: Mapping[str, Any], where: str) -> Any:
    """Instance of a dataclass from a table; unknown and missing keys are errors."""
    _validate.keys(where, table, _validate.names_of(cls))
    try:
        return cls(**table)
    except TypeError as error:
        message = f"{where}: {error}"
        raise ValueError(message) from error


def numerics_of(table: Mapping[str, Any]) -> Numerics:
    """Numerics from a table; `preset` names what the other values differ from."""
    _validate.keys("numerics", table, ["preset", *_validate.names_of(Numerics)])
    values = dict(table)
    chosen = Numerics.preset(values.pop("preset", "standard"))
    numerics: Numerics = build(Numerics, asdict(chosen) | values, "numerics")
    return numerics


def numerics_table(numerics: Numerics) -> dict[str, Any]:
    """Numerics as a scene file says them."""
    return dataclass_table(numerics)


def physics_of(table: Mapping[str, Any], names: list[Any]) -> Physics:
    """Physics from what a scene file says; `names` are those of the cells."""
    _validate.keys("physics", table, _validate.names_of(Physics))
    values = dict(table)
    sigma = values.get("sigma")
    if isinstance(sigma, Mapping):
        values["sigma"] = _attraction(sigma, names)
    if "terms" in values:
        values["terms"] = terms_of(values["terms"], "physics.terms")
    physics: Physics = build(Physics, values, "physics")
    return physics


def _attraction(table: Mapping[str, Any], names: list[Any]) -> Attraction:
    """Attraction from a table.

    It has a full `matrix` in the order of the cells, row j the pull of cell j; or a `default`,
    that of `sisters`, and lists of [from, to, value] in `types` and `pairs`.
    """
    _validate.keys("physics.sigma", table, ("default", "sisters", "types", "pairs", "matrix"))
    if "matrix" in table:
        _validate.keys("physics.sigma with a matrix", table, ("matrix",))
        return Attraction.from_matrix(names, table["matrix"])
    values: dict[str, Any] = {k: table[k] for k in ("default", "sisters") if k in table}
    for key in ("types", "pairs"):
        values[key] = {}
        _validate.instance(f"physics.sigma.{key}", table.get(key, []), list)
        for row in table.get(key, []):
            if not isinstance(row, list) or len(row) != 3:
                message = f"physics.sigma.{key}: {row!r}; expected [from, to, value]"
                raise ValueError(message)
            values[key][row[0], row[1]] = row[2]
    return Attraction(**values)


def physics_table(physics: Physics) -> dict[str, Any]:
    """Physics as a scene file says them."""
    sigma = physics.attraction
    table = dataclass_table(physics)
    if not physics.kappa_by_type:
        del table["kappa_by_type"]
    del table["terms"]
    if physics.terms:
        table["terms"] = [plain(term_table(term)) for term in physics.terms]
    table["sigma"] = {"default": sigma.default}
    if sigma.sisters is not None:
        table["sigma"]["sisters"] = sigma.sisters
    table["sigma"] |= {
        key: [[j, i, value] for (j, i), value in getattr(sigma, key).items()]
        for key in ("types", "pairs")
        if getattr(sigma, key)
    }
    return table


def physics_values(table: Mapping[str, Any]) -> dict[str, Any]:
    """Keywords of `Physics` from those values that a table has."""
    _validate.keys("physics of a stage", table, _validate.names_of(Physics))
    values = dict(table)
    if "sigma" in values:
        values["sigma"] = physics_of({"sigma": values["sigma"]}, []).attraction
    if "terms" in values:
        values["terms"] = terms_of(values["terms"], "physics.terms")
    return values


def physics_said(values: Mapping[str, Any]) -> dict[str, Any]:
    """Table of those values of `Physics`.

    Raises
    ------
    ValueError
        M = None without the volume constraint whose default it means.
    """
    physics = Physics(**values)
    table = {"kappa_by_type": {}, "terms": []} | physics_table(physics)
    if "M" in values and physics.M is None:
        if "volume_constraint" not in values:
            message = "M = None cannot be written without volume_constraint; give its number"
            raise ValueError(message)
        table["M"] = physics.volume_strength
    return {key: table[key] for key in values}


def cell_of(row: Mapping[str, Any], shape: Any) -> Cell:
    """Cell from what a scene file says of it, and its shape."""
    values = dict(row) | {"shape": shape}
    if isinstance(row.get("volume"), Mapping):
        values["volume"] = build(VolumeCourse, row["volume"], f"cell {row.get('name')!r}: volume")
    cell: Cell = build(Cell, values, f"cell {row.get('name')!r}")
    return cell


def cell_values(cell: Cell) -> dict[str, Any]:
    """What a scene file says of a cell besides its shape.

    Raises
    ------
    ValueError
        The volume is a function that a file cannot say.
    """
    table: dict[str, Any] = {"name": cell.name}
    for name in ("type", "gamma", "frozen", "parent"):
        if value := getattr(cell, name):
            table[name] = value
    if isinstance(cell.volume, VolumeCourse):
        table["volume"] = dataclass_table(cell.volume)
    elif callable(cell.volume):
        message = f"cell {cell.name!r}: a volume function cannot be written; use VolumeCourse"
        raise ValueError(message)
    else:
        table["volume"] = cell.target_volume(0.0)
    return table


def plain(value: Any) -> Any:
    """Value as TOML can hold it."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, tuple | list):
        return [plain(v) for v in value]
    return value


def dataclass_table(item: Any) -> dict[str, Any]:
    """Values of a dataclass but those that are None."""
    values = {name: getattr(item, name) for name in _validate.names_of(type(item))}
    return {name: plain(value) for name, value in values.items() if value is not None}
