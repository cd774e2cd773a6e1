"""Checks of input, with errors that name the thing, its value, what is allowed and what to try."""

import difflib
import inspect
import math
import unicodedata
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from itertools import islice
from numbers import Real
from typing import Any, TypeGuard

import numpy as np
from numpy.typing import ArrayLike, NDArray

LARGEST, SMALLEST = 1e30, 1e-30
"""Beyond these, products of a few numbers are infinite or 0."""
LONGEST_NAME = 100
MOST_LISTED = 30


@contextmanager
def told_of(where: str) -> Iterator[None]:
    """Say in errors whose fault they tell, unless they begin with it."""
    try:
        yield
    except (TypeError, ValueError) as error:
        if str(error).startswith(where):
            raise
        kind = TypeError if isinstance(error, TypeError) else ValueError
        raise kind(f"{where}: {error}") from error


def number(name: str, value: Any, *, above: float | None = None, least: float | None = None,
           most: float | None = None) -> float:  # fmt: skip
    """Return `value` as a finite float within the bounds, or raise ValueError or TypeError."""
    if not _is_number(value):
        message = f"{name} = {brief(value)} is not a number"
        raise TypeError(message)
    allowed = [f"> {above:g}"] if above is not None else []
    allowed += [f">= {least:g}"] if least is not None else []
    allowed += [f"<= {most:g}"] if most is not None else []
    found = _as_float(value)
    bad = (
        not math.isfinite(found)
        or (above is not None and not found > above)
        or (least is not None and not found >= least)
        or (most is not None and not found <= most)
    )
    if bad:
        message = f"{name} = {brief(value)} is not allowed: it must be finite" + "".join(
            f" and {bound}" for bound in allowed
        )
        raise ValueError(message)
    tiny = above == 0 and found < SMALLEST
    if tiny or abs(found) > LARGEST:
        bound = f">= {SMALLEST:g}" if tiny else f"within ±{LARGEST:g}"
        message = f"{name} = {brief(value)} is out of range: it must be {bound}"
        raise ValueError(message)
    return found


def _is_number(value: Any) -> TypeGuard[int | float]:
    """Whether a value is a number of Python or NumPy, and no flag."""
    return isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool)


def _as_float(value: Any) -> float:
    try:
        return float(value)
    except OverflowError:  # an integer of more than 308 digits
        return math.inf if value > 0 else -math.inf


def parsed_number(name: str, entry: Any, **bounds: float) -> float:
    """Return an entry of a table as `number` does; ValueError if it is a text that is none."""
    if not isinstance(entry, str):
        return number(name, entry, **bounds)
    try:
        value = float(entry)
    except ValueError:
        message = f"{name} = {brief(entry)} is not a number"
        raise ValueError(message) from None
    return number(name, value, **bounds)


def integer(name: str, value: Any, *, least: int, most: int | None = None) -> int:
    """Return `value` as an int within the bounds, or raise ValueError or TypeError."""
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)):
        message = f"{name} = {brief(value)} is not a whole number"
        raise TypeError(message)
    if value < least or (most is not None and value > most):
        upper = "" if most is None else f" and <= {most}"
        message = f"{name} = {brief(value)} is not allowed: it must be >= {least}{upper}"
        raise ValueError(message)
    return int(value)


def choice(name: str, value: Any, allowed: Iterable[Any]) -> None:
    """Raise ValueError unless `value` is one of `allowed`; suggests the nearest."""
    allowed = list(allowed)
    if value in allowed if isinstance(value, str) else any(_same(value, a) for a in allowed):
        return
    asked = brief(value).strip("'\"")
    near = difflib.get_close_matches(asked, [str(a) for a in allowed], n=1)
    hint = f"; did you mean {near[0]!r}?" if near else ""
    message = f"{name} = {brief(value)} is not known; allowed are {_listed(allowed)}{hint}"
    raise ValueError(message)


def _same(value: Any, allowed: Any) -> bool:
    """Whether two values are equal and of one kind: 2.0 is not 2, and True is not 1."""
    if isinstance(value, np.generic):
        value = value.item()
    for kind in (bool, int, float):
        if isinstance(value, kind):
            return isinstance(allowed, kind) and bool(value == allowed)
    return value is allowed


def names_of(cls: type) -> list[str]:
    """Names of the values that a dataclass takes, the keys of its tables; another has none."""
    return [f.name for f in fields(cls) if f.init] if is_dataclass(cls) else []


def keys(where: str, table: Any, allowed: Iterable[str], needed: Iterable[str] = ()) -> None:
    """Raise ValueError if `table` has a key that is not in `allowed`, or lacks one of `needed`.

    TypeError if it is no table.
    """
    if not isinstance(table, Mapping):
        message = f"{where} = {brief(table)} is not a table of keys and values"
        raise TypeError(message)
    for key in table:
        choice(f"key of {where}", key, allowed)
    missing = [key for key in needed if key not in table]
    if missing:
        message = f"{where}: {missing[0]!r} is missing; it is needed"
        raise ValueError(message)


def vector(name: str, value: ArrayLike) -> NDArray[np.float64]:
    """Return `value` as a finite (3,) float64 array, or raise ValueError."""
    return array(name, value, (3,))


def direction(name: str, value: ArrayLike) -> NDArray[np.float64]:
    """Return the (3,) unit vector along `value`, or raise ValueError."""
    along = vector(name, value)
    largest = np.abs(along).max()
    if largest < SMALLEST:
        message = f"{name} = {brief(value)} has no direction"
        raise ValueError(message)
    return np.asarray(along / largest / np.linalg.norm(along / largest))


def array(
    name: str, value: ArrayLike, shape: tuple[int | None, ...] | None, *, infinite: bool = False
) -> NDArray[np.float64]:
    """Return `value` as a float64 array of `shape` (None: any, or any length), or raise.

    It is finite but where it may be `infinite`.
    """
    found = _numbers(name, value, flags=False)
    if shape is not None:
        _check_shape(name, found.shape, shape)
    with np.errstate(over="ignore"):
        result = found.astype(np.float64, copy=False)
    beyond = ~(np.abs(result) <= LARGEST) & ~(infinite & np.isinf(result))
    if beyond.any():
        where = tuple(int(k) for k in np.argwhere(beyond)[0])
        known = "finite" if not np.isfinite(result[where]) else f"within ±{LARGEST:g}"
        message = f"{name}{list(where)} = {result[where]} is not {known}"
        raise ValueError(message)
    return result


def _numbers(name: str, value: Any, *, flags: bool) -> NDArray[Any]:
    """Return `value` as an array of numbers or, where `flags`, of true and false."""
    try:
        found = np.asarray(value)
        if found.dtype == object and all(isinstance(v, Real) for v in found.flat):
            found = np.array([_as_float(v) for v in found.flat]).reshape(found.shape)
    except (TypeError, ValueError, RecursionError):
        found = np.array(None)
    if found.dtype.kind not in ("biuf" if flags else "iuf") or not (flags or _free_of_flags(value)):
        message = f"{name} is not an array of numbers: {brief(value)}"
        raise ValueError(message)
    return found


def _free_of_flags(value: Any) -> bool:
    """Whether no list within a list holds true or false; NumPy would take them for 1 and 0."""
    if isinstance(value, list | tuple):
        return all(map(_free_of_flags, value))
    return not isinstance(value, bool | np.bool_)


def _check_shape(name: str, found: tuple[int, ...], shape: tuple[int | None, ...]) -> None:
    """Raise ValueError unless the shape found is the one wanted (None: any length)."""
    fits = len(found) == len(shape) and all(
        want is None or have == want for have, want in zip(found, shape, strict=True)
    )
    if not fits:
        wanted = tuple("any" if n is None else n for n in shape)
        message = f"{name} has shape {found}; expected {wanted}"
        raise ValueError(message)


def text(name: str, value: Any) -> None:
    """Raise TypeError unless `value` is a text, ValueError if it has control characters."""
    if not isinstance(value, str):
        message = f"{name} = {brief(value)} is not a text"
        raise TypeError(message)
    _check_printable(name, value, lines=True)


def words(name: str, value: Any) -> str:
    """Return `value`, a text of at least a word, in one line; else raise as `text` does."""
    text(name, value)
    if not value.split():
        message = f"{name} = {brief(value)}; expected a text not empty"
        raise ValueError(message)
    return " ".join(value.split())


def label(name: str, value: Any, *, empty: bool = False) -> None:
    """Raise unless `value` is a text that may name something: of one line, and not too long."""
    if not isinstance(value, str) or not (empty or value.strip()):
        message = f"{name} = {brief(value)}; expected a text" + ("" if empty else " not empty")
        raise (TypeError if not isinstance(value, str) else ValueError)(message)
    if len(value) > LONGEST_NAME:
        message = f"{name} = {brief(value, 40)} has {len(value)} characters; at most {LONGEST_NAME}"
        raise ValueError(f"{message} are allowed")
    _check_printable(name, value, lines=False)


def labels(
    name: str, value: Any, count: int | None = None, *, empty: bool = False
) -> tuple[str, ...]:
    """Return `value`, so many texts that may be names, as a tuple, or raise."""
    found = several(name, value, "texts", count)
    for k, entry in enumerate(found):
        label(f"{name}[{k}]", entry, empty=empty)
    return found


def several(name: str, value: Any, of: str, count: int | None = None) -> tuple[Any, ...]:
    """Return a list, tuple or other collection as a tuple; a text or a table is none.

    Parameters
    ----------
    name, value : what it is, and what is given
    of : what it is a list of, for the error
    count : how many there must be, optional
    """
    known = isinstance(value, Collection) and not isinstance(value, str | bytes | Mapping)
    if not known or getattr(value, "ndim", 1) == 0:
        message = f"{name} = {brief(value)} is not a list of {of}"
        raise TypeError(message)
    if count is not None and len(value) != count:
        message = f"{name} = {brief(value)}; expected {count} {of}, not {len(value)}"
        raise ValueError(message)
    return tuple(value)


def _check_printable(name: str, value: str, *, lines: bool) -> None:
    """Raise ValueError if a text has characters that act on a terminal, or cannot be stored."""
    if value.isprintable():
        return
    for place, character in enumerate(value):
        if not is_printable(character) and not (lines and character in "\n\t"):
            message = f"{name} = {brief(value)} has a control character at place {place + 1}"
            raise ValueError(f"{message} ({character!a}); leave it out")


def is_printable(character: str) -> bool:
    """Whether a character shows, and cannot act on a terminal; joiners of letters count as such."""
    category = unicodedata.category(character)
    return (category[0] != "C" and category not in ("Zl", "Zp")) or character in "\u200c\u200d"


def function(name: str, value: Any, arguments: int) -> None:
    """Raise TypeError unless `value` can be called with so many arguments."""
    if not callable(value):
        message = f"{name} = {brief(value)} cannot be called"
        raise TypeError(message)
    try:
        signature = inspect.signature(value)
    except (TypeError, ValueError):  # one that is not written in Python may not tell
        return
    try:
        signature.bind(*[None] * arguments)
    except TypeError:
        message = (
            f"{name} = {brief(value)} takes {signature}; it is called with {arguments} argument"
            f"{'s' * (arguments != 1)}"
        )
        raise TypeError(message) from None


def flag(name: str, value: Any) -> None:
    """Raise TypeError unless `value` is True or False."""
    if not isinstance(value, (bool, np.bool_)):
        message = f"{name} = {brief(value)} is not true or false"
        raise TypeError(message)


def instance(name: str, value: Any, kind: type) -> None:
    """Raise TypeError unless `value` is of this class."""
    if not isinstance(value, kind):
        message = f"{name} = {brief(value)} is not of type {kind.__name__}"
        raise TypeError(message)


def spacing(name: str, value: ArrayLike) -> NDArray[np.float64]:
    """Return `value`, one number or three, as (3,) positive numbers, or raise ValueError."""
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value.item()
    if not isinstance(value, np.ndarray | Sequence) or isinstance(value, str | bytes):
        return np.full(3, number(name, value, above=0))
    steps = array(name, value, (3,))
    for step in steps:
        number(name, step, above=0)
    return steps


def image(name: str, value: ArrayLike) -> NDArray[np.bool_]:
    """Return a 3-D image as bool, true where it is not 0; raise ValueError if it holds NaN."""
    found = _numbers(name, value, flags=True)
    if found.ndim != 3:
        message = f"{name} has shape {found.shape}; expected three axes (x, y, z)"
        raise ValueError(message)
    return np.asarray((found if found.dtype == bool else array(name, found, None)) != 0)


def unique(name: str, values: Iterable[str]) -> None:
    """Raise ValueError naming the first value that occurs twice."""
    seen = set()
    for value in values:
        if value in seen:
            message = f"{name} {value!r} occurs twice; each must be unique"
            raise ValueError(message)
        seen.add(value)


def brief(value: Any, most: int = 200) -> str:
    """What a value is, in one line that is not too long."""
    if isinstance(value, np.generic):  # whose name for it tells users nothing
        value = value.item()
    try:
        told = " ".join(
            repr(value[: most + 1] if isinstance(value, str | bytes) else value).split()
        )
    except (ValueError, RecursionError):  # an integer of thousands of digits; lists too deep
        return f"({type(value).__name__} too large to show)"
    return told if len(told) <= most else f"{told[:most]} ..."


def _listed(values: Collection[Any]) -> str:
    shown = ", ".join(repr(value) for value in islice(values, MOST_LISTED)) or "none"
    return shown + (f" and {len(values) - MOST_LISTED} more" if len(values) > MOST_LISTED else "")
