"""Force terms as tables of a scene file.

A table says by `use` which class the term has, and by the other keys the class's fields:
`{ use = "mymodule:Gravity", weight = 0.1 }`, or `"gravity.py:Gravity"` by its file.
"""

from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from typing import Any

from morphosim import _import_path, _validate
from morphosim.physics.term import Term


def terms_of(rows: Any, where: str) -> list[Term]:
    """Terms from a list of tables, or of terms.

    Raises
    ------
    ValueError
        A table names no class of terms that can be imported, or has a value that is not allowed.
    """
    if isinstance(rows, str) or not isinstance(rows, Sequence):
        message = f"{where} = {rows!r}: expected a list of tables, such as [{{use = 'mymodule:X'}}]"
        raise ValueError(message)
    return [
        row if isinstance(row, Term) else _term(row, f"{where}[{k}]") for k, row in enumerate(rows)
    ]


def term_table(term: Term) -> dict[str, Any]:
    """Table of a term: where its class is, and its parameters.

    Raises
    ------
    ValueError
        The class is not at the top of a module, or is no dataclass.
    """
    path = _import_path.path_of(type(term))
    if path is None or not is_dataclass(term):
        message = (
            f"term {term.name} cannot be written to a scene file: define its class at the top of "
            "a module, as a frozen dataclass"
        )
        raise ValueError(message)
    return {"use": path} | {f.name: getattr(term, f.name) for f in fields(term)}


def _term(table: Any, where: str) -> Term:
    if not isinstance(table, Mapping) or not isinstance(table.get("use"), str):
        message = f"{where} = {table!r}: expected a table with use = 'module:Class'"
        raise ValueError(message)
    kind = _import_path.loaded(table["use"], f"{where}.use")
    if not (isinstance(kind, type) and issubclass(kind, Term) and is_dataclass(kind)):
        message = f"{where}.use = {table['use']!r} is no force term: expected a dataclass of Term"
        raise ValueError(message)
    values = {key: value for key, value in table.items() if key != "use"}
    _validate.keys(where, values, [f.name for f in fields(kind)])
    try:
        return kind(**values)
    except TypeError as error:
        message = f"{where}: {error}"
        raise ValueError(message) from error
