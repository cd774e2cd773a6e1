"""Force terms as tables of a scene file.

A table says by `kind`, or by `use` for one of a user's own, which class the term has, and by the
other keys the class's fields: `{ kind = "gravity", weight = 0.1 }`, or
`{ use = "mymodule:Swim", speed = 0.1 }`, or `"swim.py:Swim"` by its file.
"""

from collections.abc import Sequence
from dataclasses import is_dataclass
from pathlib import Path
from typing import Any

from morphosim import _validate
from morphosim.physics.kinds import TERMS
from morphosim.physics.term import Term
from morphosim.scene.objects import named_in, object_of, table_of


def terms_of(rows: Any, where: str, folder: Path = Path()) -> list[Term]:
    """Terms from a list of tables, or of terms.

    Raises
    ------
    FileNotFoundError
        An array file is not in `folder`.
    ValueError
        A table names no class of terms that can be imported, or has a value that is not allowed.
    """
    if isinstance(rows, str) or not isinstance(rows, Sequence):
        message = f"{where} = {_validate.brief(rows)}: expected a list of tables, such as "
        raise ValueError(f"{message}[{{kind = 'gravity'}}] or [{{use = 'mymodule:X'}}]")
    return [
        row if isinstance(row, Term) else _term(row, f"{where}[{k}]", folder)
        for k, row in enumerate(rows)
    ]


def term_table(term: Term) -> dict[str, Any]:
    """Table of a term: its kind or where its class is, and its parameters; its arrays are arrays.

    Raises
    ------
    ValueError
        The class is not at the top of a module, or is no dataclass, or a file cannot say one of its
        parameters.
    """
    kinds = TERMS if type(term) in TERMS.values() else {}
    return table_of(term, kinds, f"term {term.name}")


def _term(table: Any, where: str, folder: Path) -> Term:
    kind = named_in(table, TERMS, where, folder)
    if not (isinstance(kind, type) and issubclass(kind, Term) and is_dataclass(kind)):
        message = f"{where}.use = {table['use']!r} is no force term: expected a dataclass of Term"
        raise ValueError(message)
    term: Term = object_of(table, TERMS, where, folder)
    return term
