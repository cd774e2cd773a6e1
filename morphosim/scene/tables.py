"""Physics, numerics and cells as plain tables, and back: what scene files and saved states say."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, TypeGuard

from morphosim import _validate
from morphosim.numerics.parameters import Numerics, preset_values
from morphosim.physics.attraction import Attraction
from morphosim.physics.parameters import Physics
from morphosim.physics.term import Term
from morphosim.scene.arrays import listed
from morphosim.scene.cell import Cell, VolumeCourse
from morphosim.scene.term_tables import term_table, terms_of
from morphosim.scene.values import build, dataclass_table, plain

BY_TYPE = ("tau_by_type", "kappa_by_type")
"""Fields of `Physics` of which files say nothing where they are empty."""


def numerics_of(table: Mapping[str, Any]) -> Numerics:
    """Numerics from a table; `preset` names what the other values differ from."""
    _validate.keys("numerics", table, ["preset", *_validate.names_of(Numerics)])
    values = dict(table)
    if "preset" in values:
        values = preset_values(values.pop("preset"), values)
    numerics: Numerics = build(Numerics, values, "numerics")
    return numerics


def numerics_table(numerics: Numerics) -> dict[str, Any]:
    """Numerics as a scene file says them."""
    return dataclass_table(numerics)


def physics_of(table: Mapping[str, Any], names: list[Any], folder: Path = Path()) -> Physics:
    """Physics from what a scene file in `folder` says; `names` are those of the cells."""
    _validate.keys("physics", table, _validate.names_of(Physics))
    values = dict(table)
    sigma = values.get("sigma")
    if isinstance(sigma, Mapping):
        values["sigma"] = _attraction(sigma, names)
    if "terms" in values:
        values["terms"] = terms_of(values["terms"], "physics.terms", folder)
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
            fits = isinstance(row, list) and len(row) == 3
            if not fits or not all(isinstance(name, str) for name in row[:2]):
                message = f"physics.sigma.{key}: {_validate.brief(row)}; expected [from, to, value]"
                raise ValueError(message)
            if (row[0], row[1]) in values[key]:
                message = f"physics.sigma.{key}: {_validate.brief(row[:2])} occurs twice"
                raise ValueError(message)
            values[key][row[0], row[1]] = row[2]
    return Attraction(**values)


def physics_in_file(physics: Physics) -> dict[str, Any]:
    """Physics as a scene file says them; the arrays of terms are arrays.

    Raises
    ------
    ValueError
        A file cannot say one of the terms.
    """
    table = _without_terms(physics)
    if physics.terms:
        table["terms"] = [term_table(term) for term in physics.terms]
    return table


def physics_table(physics: Physics) -> dict[str, Any]:
    """Physics as the state of a simulation says them, with lists for arrays.

    A term that no file can say stands as it is: such a state cannot be written.
    """
    table = _without_terms(physics)
    if physics.terms:
        table["terms"] = [_table_or_term(term) for term in physics.terms]
    return table


def relocated(table: Mapping[str, Any], courses: Iterable[Physics]) -> dict[str, Any]:
    """Physics of a saved state, whose terms are found where a scene's physics have them now."""
    terms = [row for physics in courses for row in physics_table(physics).get("terms", ())]
    places = {_class_of(row): row["use"] for row in terms if _names_class(row)}
    moved = [
        dict(row) | {"use": places.get(_class_of(row), row["use"])} if _names_class(row) else row
        for row in table.get("terms", ())
    ]
    return dict(table) | ({"terms": moved} if moved else {})


def _names_class(row: Any) -> TypeGuard[Mapping[str, Any]]:
    """Whether a term is said by where its class is: not by its kind, and not as it stands."""
    return isinstance(row, Mapping) and "use" in row


def _class_of(row: Mapping[str, Any]) -> str:
    return str(row["use"]).rpartition(":")[2]


def _table_or_term(term: Term) -> Any:
    try:
        return listed(term_table(term))
    except ValueError:
        return term


def _without_terms(physics: Physics) -> dict[str, Any]:
    """Physics as files say them, but the terms."""
    sigma = physics.attraction
    table = dataclass_table(physics)
    for name in BY_TYPE:
        if not table[name]:
            del table[name]
    del table["terms"]
    table["sigma"] = {"default": sigma.default}
    if sigma.sisters is not None:
        table["sigma"]["sisters"] = sigma.sisters
    table["sigma"] |= {
        key: [[j, i, value] for (j, i), value in getattr(sigma, key).items()]
        for key in ("types", "pairs")
        if getattr(sigma, key)
    }
    table["sigma"] = plain(table["sigma"])
    return table


def physics_values(table: Mapping[str, Any], folder: Path, where: str) -> dict[str, Any]:
    """Keywords of `Physics` from those values that a table of a file in `folder` has.

    Errors say `where` the table is.
    """
    with _validate.told_of(where):
        _validate.keys("physics", table, _validate.names_of(Physics))
        values = dict(table)
        sigma = values.get("sigma")
        if isinstance(sigma, Mapping) and "matrix" in sigma:
            message = "physics.sigma.matrix is of the cells at the start; give types or pairs here"
            raise ValueError(message)
        if "sigma" in values:
            values["sigma"] = physics_of({"sigma": sigma}, []).attraction
        if "terms" in values:
            values["terms"] = terms_of(values["terms"], "physics.terms", folder)
    return values


def physics_said(values: Mapping[str, Any]) -> dict[str, Any]:
    """Table of those values of `Physics`; the arrays of terms are arrays.

    Raises
    ------
    ValueError
        A file cannot say one of the terms, or M = None without the volume constraint whose
        default it means.
    """
    physics = Physics(**values)
    table = {name: {} for name in BY_TYPE} | {"terms": []} | physics_in_file(physics)
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
        values["volume"] = build(VolumeCourse, row["volume"], f"cell {row['name']!r}: volume")
    cell: Cell = build(Cell, values, f"cell {row['name']!r}")
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
