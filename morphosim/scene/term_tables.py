"""Force terms of the user's own as tables of a scene file.

A table says by `use` which class the term has, and by the other keys the class's fields:
`{ use = "mymodule:Gravity", strength = 0.1 }`. `use` is a module that Python can import, or a file
that ends in .py, then a colon and the name of the class.
"""

import sys
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from importlib import import_module
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import Any

from morphosim import _validate
from morphosim.physics.term import Term

MAIN = "__main__"


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
    kind = type(term)
    if "<" in kind.__qualname__ or not is_dataclass(term):
        message = (
            f"term {kind.__qualname__} cannot be written to a scene file: define it at the top of "
            "a module, as a frozen dataclass"
        )
        raise ValueError(message)
    return {"use": f"{_module_said(kind)}:{kind.__qualname__}"} | {
        f.name: getattr(term, f.name) for f in fields(term)
    }


def _module_said(kind: type) -> str:
    """Module of a class; the file, where it was started as a script."""
    file = getattr(sys.modules.get(MAIN), "__file__", None)
    if kind.__module__ == MAIN and file is not None:
        return str(Path(file).resolve())
    return kind.__module__


def _term(table: Any, where: str) -> Term:
    if not isinstance(table, Mapping) or not isinstance(table.get("use"), str):
        message = f"{where} = {table!r}: expected a table with use = 'module:Class'"
        raise ValueError(message)
    kind = _imported(table["use"], f"{where}.use")
    if not (isinstance(kind, type) and issubclass(kind, Term) and is_dataclass(kind)):
        message = f"{where}.use = {table['use']!r} is no force term: expected a dataclass of Term"
        raise ValueError(message)
    values = {key: value for key, value in table.items() if key != "use"}
    _validate.keys(where, values, [f.name for f in fields(kind)])
    try:
        term: Term = kind(**values)
    except TypeError as error:
        message = f"{where}: {error}"
        raise ValueError(message) from error
    return term


def _imported(use: str, where: str) -> Any:
    """What "module:name" or "file.py:name" names."""
    module, _, name = use.rpartition(":")
    try:
        return getattr(_module(module), name)
    except Exception as error:  # a module may raise anything while it is imported
        message = f"{where} = {use!r} cannot be imported ({error}). {_advice(module)}"
        raise ValueError(message) from error


def _module(name: str) -> ModuleType:
    if not name.endswith(".py"):
        return import_module(name)
    path = Path(name).resolve()
    for module in list(sys.modules.values()):  # it may be the script that runs
        file = getattr(module, "__file__", None)
        if file is not None and Path(file).resolve() == path:
            return module
    spec = spec_from_file_location(path.stem, path)
    if spec is None or spec.loader is None or not path.exists():
        message = f"there is no file {path}"
        raise ImportError(message)
    module = module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def _advice(module: str) -> str:
    if module == MAIN:
        return "It was defined in a notebook or console: define it there again, or in a module"
    if module.endswith(".py"):
        return "Put the file there, or the new place into the scene file"
    return "Start where Python finds the module, set PYTHONPATH, or give the path of its .py file"
