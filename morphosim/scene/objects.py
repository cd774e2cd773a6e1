"""Objects as tables of a file: `kind` names a class of this package, `use` one of your own.

Such a class is a dataclass, and its table has a key for each of its fields. The annotation of a
field says what it holds where that is not plain numbers and texts: an array (`NDArray`), a function
(`Callable`), or what a `Manner` tells.
"""

from collections.abc import Callable, Mapping
from dataclasses import MISSING, dataclass, fields, is_dataclass
from functools import lru_cache
from pathlib import Path
from types import UnionType
from typing import Any, Union, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

from morphosim import _import_path, _validate
from morphosim.scene.arrays import array_of
from morphosim.scene.values import build, plain


@dataclass(frozen=True, slots=True)
class Manner:
    """How files say the fields with a certain annotation.

    Attributes
    ----------
    hint : the annotation
    of : value from what a file says, the folder of its array files, and its place for errors
    said : what a file says of a value
    """

    hint: Any
    of: Callable[[Any, Path, str], Any]
    said: Callable[[Any], Any]


def object_of(
    table: Any,
    kinds: Mapping[str, type],
    where: str,
    folder: Path = Path(),
    manner: Manner | None = None,
) -> Any:
    """Object that a table says.

    Parameters
    ----------
    table : mapping with `kind` or `use`, and values by field
    kinds : classes by kind
    where : the table's place in the file, for errors
    folder : where array files, and files of Python, are looked up
    manner : how some fields are said

    Raises
    ------
    FileNotFoundError
        An array file does not exist.
    ValueError
        The kind, or a key or a value is not allowed, or something named "module:name" cannot be
        loaded.
    """
    cls = named_in(table, kinds, where, folder)
    if not isinstance(cls, type) or (not is_dataclass(cls) and "use" in table):
        message = f"{where}.use = {table['use']!r} is not a dataclass; decorate it with @dataclass"
        raise ValueError(message)
    hints = _hints(cls)
    values = {key: value for key, value in table.items() if key not in ("kind", "use")}
    _validate.keys(where, values, _validate.names_of(cls))
    values = {
        key: _value_of(value, hints.get(key), folder, f"{where}.{key}", manner)
        for key, value in values.items()
    }
    return build(cls, values, where)


def named_in(table: Any, kinds: Mapping[str, type], where: str, folder: Path = Path()) -> Any:
    """What `kind` or `use` of a table names; ValueError if it is not known or cannot be loaded."""
    if (
        not isinstance(table, Mapping)
        or len(table.keys() & {"kind", "use"}) != 1
        or not isinstance(table.get("use", ""), str)
        or not (kinds or "use" in table)
    ):
        wanted = f"with a kind out of {list(kinds)}, or " if kinds else ""
        message = (
            f"{where} = {_validate.brief(table)}: expected a table {wanted}with use = "
            "'module:Class' for a class of your own"
        )
        raise ValueError(message)
    if "kind" in table:
        _validate.choice(f"{where}.kind", table["kind"], kinds)
        return kinds[table["kind"]]
    return _import_path.loaded(table["use"], f"{where}.use", folder)


def names_code(table: Any, kinds: Mapping[str, type]) -> bool:
    """Whether a table names a class or a function of a user's own, which `object_of` imports."""
    if not isinstance(table, Mapping):
        return False
    cls = next((cls for kind, cls in kinds.items() if kind == table.get("kind")), None)
    hints = _hints(cls).values() if cls else ()
    return "use" in table or any(_may_be(hint, Callable) for hint in hints)


def _value_of(value: Any, hint: Any, folder: Path, where: str, manner: Manner | None) -> Any:
    """Value of a field, as its class takes it."""
    if manner is not None and hint == manner.hint:
        return manner.of(value, folder, where)
    if _may_be(hint, np.ndarray):
        return array_of(value, folder, where)
    # a text that the field may hold itself names a function only as "module:name"
    named = isinstance(value, str) and (":" in value or not _may_be(hint, str))
    if named and _may_be(hint, Callable):
        return _import_path.loaded(value, where, folder)
    return value


def table_of(
    item: Any, kinds: Mapping[str, type], where: str, manner: Manner | None = None
) -> dict[str, Any]:
    """Table that says an object; `object_of` makes the same of it.

    Its arrays are arrays; all else is what TOML can hold. Fields that are None, or that the class
    sets by itself, are left out.

    Raises
    ------
    ValueError
        A file cannot say it: it is neither of a known class nor a dataclass of a module, or holds
        a function or an object that a file cannot say.
    """
    table = _named(item, kinds, where)
    cls: type = type(item)
    hints = _hints(cls)
    for name in _validate.names_of(cls):
        value = getattr(item, name)
        if value is not None:
            table[name] = _said(value, hints[name], where, name, manner)
        elif not _none_by_default(cls, name):
            message = (
                f"{where}: {name} = None cannot be written to a scene file, which has no word for "
                "it; make None its default"
            )
            raise ValueError(message)
    return table


def _named(item: Any, kinds: Mapping[str, type], where: str) -> dict[str, Any]:
    """What names the class of an object: its `kind`, or `use`."""
    cls = type(item)
    for kind, known in kinds.items():
        if known is cls:
            return {"kind": kind}
    if is_dataclass(cls) and (path := _import_path.path_of(cls)):
        return {"use": path}
    message = (
        f"{where}: {_validate.brief(item)} cannot be written to a scene file; it can say "
        f"{list(kinds)}, and dataclasses of a module that can be imported"
    )
    if not kinds:
        message = (
            f"{where} cannot be written to a scene file: define its class at the top of a module, "
            "as a frozen dataclass"
        )
    raise ValueError(message)


def _said(value: Any, hint: Any, where: str, name: str, manner: Manner | None) -> Any:
    """What a file says of the value of a field."""
    if manner is not None and hint == manner.hint:
        return manner.said(value)
    if _may_be(hint, np.ndarray):
        return _array(value, where, name)
    said = plain(value)
    if _may_be(hint, Callable) and callable(value):
        said = _import_path.path_of(value)
    if not _sayable(said):
        message = (
            f"{where}: {_validate.brief(value)} cannot be written to a scene file as {name}; it "
            "can say numbers, texts, lists and tables of them, and a function of a module where "
            "one is expected"
        )
        raise ValueError(message)
    return said


def _array(value: Any, where: str, name: str) -> NDArray[Any]:
    array = np.asarray(value)
    if array.dtype.hasobject:
        message = f"{where}: {name} is an array of objects; a file can hold arrays of numbers"
        raise ValueError(message)
    return array


def _none_by_default(cls: type, name: str) -> bool:
    """Whether a field that a file leaves out is None, or is asked for."""
    (found,) = (f for f in fields(cls) if f.name == name)
    made = found.default_factory is not MISSING
    return not made and found.default in (None, MISSING)


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
    except (NameError, AttributeError) as error:
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
