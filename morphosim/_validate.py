"""Checks of input, with errors that name the thing, its value, what is allowed and what to try."""

import difflib
import math
from collections.abc import Iterable, Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray


def number(name: str, value: Any, *, above: float | None = None, least: float | None = None,
           most: float | None = None) -> float:  # fmt: skip
    """Return `value` as a finite float within the bounds, or raise ValueError or TypeError."""
    if isinstance(value, bool) or not isinstance(value, (int, float, np.integer, np.floating)):
        message = f"{name} = {value!r} is not a number"
        raise TypeError(message)
    allowed = [f"> {above:g}"] if above is not None else []
    allowed += [f">= {least:g}"] if least is not None else []
    allowed += [f"<= {most:g}"] if most is not None else []
    bad = (
        not math.isfinite(value)
        or (above is not None and not value > above)
        or (least is not None and not value >= least)
        or (most is not None and not value <= most)
    )
    if bad:
        message = f"{name} = {value!r} is not allowed: it must be finite" + "".join(
            f" and {bound}" for bound in allowed
        )
        raise ValueError(message)
    return float(value)


def parsed_number(name: str, entry: Any, **bounds: float) -> float:
    """Return an entry of a table as `number` does; ValueError if it is a text that is none."""
    try:
        value = float(entry)
    except ValueError:
        message = f"{name} = {entry!r} is not a number"
        raise ValueError(message) from None
    return number(name, value, **bounds)


def integer(name: str, value: Any, *, least: int, most: int | None = None) -> int:
    """Return `value` as an int within the bounds, or raise ValueError or TypeError."""
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)):
        message = f"{name} = {value!r} is not a whole number"
        raise TypeError(message)
    if value < least or (most is not None and value > most):
        bounds = f">= {least}" + (f" and <= {most}" if most is not None else "")
        message = f"{name} = {value} is not allowed: it must be {bounds}"
        raise ValueError(message)
    return int(value)


def choice(name: str, value: Any, allowed: Iterable[Any]) -> None:
    """Raise ValueError unless `value` is one of `allowed`; suggests the nearest."""
    allowed = list(allowed)
    if value in allowed:
        return
    near = difflib.get_close_matches(str(value), [str(a) for a in allowed], n=1)
    hint = f"; did you mean {near[0]!r}?" if near else ""
    message = f"{name} = {value!r} is not known; allowed are {_listed(allowed)}{hint}"
    raise ValueError(message)


def names_of(cls: type) -> list[str]:
    """Names of the values that a dataclass takes, the keys of its tables; another has none."""
    return [f.name for f in fields(cls) if f.init] if is_dataclass(cls) else []


def keys(where: str, table: Mapping[str, Any], allowed: Iterable[str]) -> None:
    """Raise ValueError if `table` has a key that is not in `allowed`."""
    if not isinstance(table, Mapping):
        message = f"{where} = {table!r} is not a table of keys and values"
        raise TypeError(message)
    for key in table:
        choice(f"key of {where}", key, allowed)


def vector(name: str, value: ArrayLike) -> NDArray[np.float64]:
    """Return `value` as a finite (3,) float64 array, or raise ValueError."""
    return array(name, value, (3,))


def array(name: str, value: ArrayLike, shape: tuple[int | None, ...] | None) -> NDArray[np.float64]:
    """Return `value` as a finite float64 array of `shape` (None: any, or any length), or raise."""
    try:
        result = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        message = f"{name} is not an array of numbers: {value!r}"
        raise ValueError(message) from error
    if shape is not None:
        _check_shape(name, result.shape, shape)
    if not np.isfinite(result).all():
        where = tuple(int(k) for k in np.argwhere(~np.isfinite(result))[0])
        message = f"{name}{list(where)} = {result[where]} is not finite"
        raise ValueError(message)
    return result


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
    """Raise TypeError unless `value` is a text."""
    if not isinstance(value, str):
        message = f"{name} = {value!r} is not a text"
        raise TypeError(message)


def flag(name: str, value: Any) -> None:
    """Raise TypeError unless `value` is True or False."""
    if not isinstance(value, (bool, np.bool_)):
        message = f"{name} = {value!r} is not true or false"
        raise TypeError(message)


def instance(name: str, value: Any, kind: type) -> None:
    """Raise TypeError unless `value` is of this class."""
    if not isinstance(value, kind):
        message = f"{name} = {value!r} is not of type {kind.__name__}"
        raise TypeError(message)


def spacing(name: str, value: ArrayLike) -> NDArray[np.float64]:
    """Return `value`, one number or three, as (3,) positive numbers, or raise ValueError."""
    if np.ndim(value) == 0:
        return np.full(3, number(name, np.asarray(value).item(), above=0))
    steps = array(name, value, (3,))
    for step in steps:
        number(name, step, above=0)
    return steps


def image(name: str, value: ArrayLike) -> NDArray[np.bool_]:
    """Return a 3-D image as bool, true where it is not 0; raise ValueError if it holds NaN."""
    if np.ndim(value) != 3:
        message = f"{name} has shape {np.shape(value)}; expected three axes (x, y, z)"
        raise ValueError(message)
    return np.asarray(array(name, value, (None, None, None)) != 0)


def unique(name: str, values: Iterable[str]) -> None:
    """Raise ValueError naming the first value that occurs twice."""
    seen = set()
    for value in values:
        if value in seen:
            message = f"{name} {value!r} occurs twice; each must be unique"
            raise ValueError(message)
        seen.add(value)


def _listed(values: Iterable[Any]) -> str:
    return ", ".join(repr(value) for value in values) or "none"
