"""Objects as tables of a scene file: `kind` names a class of this package, `use` one of your own.

Such a class is a dataclass, and its table has a key for each of its fields. The annotation of a
field says what it holds where that is not plain numbers and texts: an array (`NDArray`), a function
(`Callable`) or `PhysicsValues`.
"""

from collections.abc import Callable, Mapping
from dataclasses import is_dataclass
from functools import lru_cache
from pathlib import Path
from types import UnionType
from typing import Any, Union, get_args, get_origin, get_type_hints

import numpy as np

from morphosim import _import_path, _validate
from morphosim.scene.arrays import array_of
from morphosim.scene.tables import build, physics_said, physics_values, plain
from morphosim.scene.target import PhysicsValues


def object_of(table: Any, kinds: Mapping[str, type], where: str, folder: Path = Path()) -> Any:
    """Object that a table says.

    Parameters
    ----------
    table : mapping with `kind` or `use`, and values by field
    kinds : classes by kind
    where : the table's place in the file, for errors
    folder : where array files are looked up

    Raises
    ------
    FileNotFoundError
        An array file does not exist.
    ValueError
        The kind, or a key or a value is not allowed, or something named "module:name" cannot be
        loaded.
    """
    cls = _class_of(table, kinds, where)
    hints = _hints(cls)
    values = {
        key: _value_of(value, hints.get(key), folder, f"{where}.{key}")
        for key, value in table.items()
        if key not in ("kind", "use")
    }
    return build(cls, values, where)


def _class_of(table: Any, kinds: Mapping[str, type], where: str) -> type:
    """Class that `kind` or `use` names."""
    if not isinstance(table, Mapping) or len(table.keys() & {"kind", "use"}) != 1:
        message = (
            f"{where} = {table!r}: expected a table with a kind out of {list(kinds)}, or with "
            'use = "module:Class" for a class of your own'
        )
        raise ValueError(message)
    if "kind" in table:
        _validate.choice(f"{where}.kind", table["kind"], kinds)
        return kinds[table["kind"]]
    cls = _import_path.loaded(str(table["use"]), f"{where}.use")
    if not isinstance(cls, type) or not is_dataclass(cls):
        message = f"{where}.use = {table['use']!r} is not a dataclass; decorate it with @dataclass"
        raise ValueError(message)
    return cls


def _value_of(value: Any, hint: Any, folder: Path, where: str) -> Any:
    """Value of a field, as its class takes it."""
    if hint == PhysicsValues:
        return physics_values(value)
    if _may_be(hint, np.ndarray):
        return array_of(value, folder, where)
    if _may_be(hint, Callable) and isinstance(value, str):
        return _import_path.loaded(value, where)
    return value


def table_of(item: Any, kinds: Mapping[str, type], where: str) -> dict[str, Any]:
    """Table that says an object; `object_of` makes the same of it.

    Its arrays are arrays; all else is what TOML can hold.

    Raises
    ------
    ValueError
        A file cannot say it: it is neither of a known class nor a dataclass of a module, or holds
        a function or an object that a file cannot say.
    """
    named = _named(item, kinds, where)
    cls: type = type(item)
    hints = _hints(cls)
    said = {
        name: _said(getattr(item, name), hints[name], where) for name in _validate.names_of(cls)
    }
    return named | {name: value for name, value in said.items() if value is not None}


def _named(item: Any, kinds: Mapping[str, type], where: str) -> dict[str, Any]:
    """What names the class of an object: its `kind`, or `use`."""
    cls = type(item)
    for kind, known in kinds.items():
        if known is cls:
            return {"kind": kind}
    if is_dataclass(cls) and (path := _import_path.path_of(cls)):
        return {"use": path}
    message = (
        f"{where}: {item!r} cannot be written to a scene file; it can say {list(kinds)}, and "
        "dataclasses of a module that can be imported"
    )
    raise ValueError(message)


def _said(value: Any, hint: Any, where: str) -> Any:
    """What a file says of the value of a field."""
    if value is None:
        return None
    if hint == PhysicsValues:
        return plain(physics_said(value))
    if _may_be(hint, np.ndarray):
        return np.asarray(value)
    said = _import_path.path_of(value) if _may_be(hint, Callable) else plain(value)
    if not _sayable(said):
        message = (
            f"{where}: {value!r} cannot be written to a scene file; it can say numbers, texts, "
            "lists and tables of them, and a function of a module where one is expected"
        )
        raise ValueError(message)
    return said


def _sayable(value: Any) -> bool:
    """Whether TOML can hold a value."""
    if isinstance(value, dict):
        return all(isinstance(key, str) and _sayable(inner) for key, inner in value.items())
    if isinstance(value, list):
        return all(map(_sayable, value))
    return isinstance(value, str | int | float)


@lru_cache
def _hints(cls: type) -> dict[str, Any]:
    """Annotations of the fields of a class."""
    try:
        return get_type_hints(cls, include_extras=True)
    except NameError as error:
        message = (
            f"{cls.__module__}:{cls.__qualname__}: {error}; a class that a scene file says must "
            "have annotations of what its module imports"
        )
        raise ValueError(message) from error


def _may_be(hint: Any, kind: Any) -> bool:
    """Whether the value of a field with this annotation may be an array, or a function."""
    if get_origin(hint) in (Union, UnionType):
        return any(_may_be(part, kind) for part in get_args(hint))
    return kind in (hint, get_origin(hint))
