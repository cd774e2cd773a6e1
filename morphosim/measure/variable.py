"""Variables that saves of a run hold, declared where they are computed.

`measured` over a function, or over what would be a property of a class, is all that a new variable
takes: it is saved, merged, packed and opened under the function's name.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import FunctionType
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from morphosim import _validate

T = TypeVar("T")
PER_TIME, PER_CELL = ("time",), ("time", "cell")
IN_SPACE = {"axis": 3, "principal": 3}
DIMENSIONS = (*PER_CELL, *IN_SPACE)
NUMBERS = ("f8", "i8", "i4")
"""Types that a measured number may be stored as."""


class VariableError(ValueError):
    """A variable cannot be measured, or is not of the type or shape that it was declared with."""


@dataclass(frozen=True, slots=True)
class Variable:
    """How a variable is stored.

    Attributes
    ----------
    dims : names of its dimensions
    kind : netCDF type, or `str`
    units : "1" for a pure number, None for a text
    text : its meaning
    extra : further CF attributes
    index : dimension whose places the values are; a save counts its own, a run those of all saves
    lazy : whether the values are read when they are used, and stored in the type that they have
    """

    dims: tuple[str, ...]
    kind: Any
    units: str | None
    text: str | None
    extra: tuple[tuple[str, Any], ...] = ()
    index: str = ""
    lazy: bool = False

    @classmethod
    def stored(cls, dims: Sequence[str], kind: Any, attributes: Mapping[str, Any]) -> "Variable":
        """A variable as a file describes it, of whatever version."""
        extra = dict(attributes)
        units, text = extra.pop("units", None), extra.pop("long_name", None)
        return cls(tuple(dims), kind, units, text, tuple(extra.items()))

    @property
    def attributes(self) -> dict[str, Any]:
        """CF attributes."""
        own = {"units": self.units, "long_name": self.text}
        return {name: value for name, value in own.items() if value is not None} | dict(self.extra)

    @property
    def form(self) -> str:
        """What it is in words, such as "numbers of (time, cell)"."""
        return f"{'texts' if self.kind is str else 'numbers'} of ({', '.join(self.dims)})"

    def fitted(self, name: str, value: Any, cells: int) -> NDArray[Any]:
        """Value at one time as an array of the declared type and shape.

        Raises
        ------
        VariableError
            It is of another shape, or cannot be stored as that type.
        """
        try:
            array = np.asarray(value)
        except ValueError as error:
            message = f"variable {name!r} is no array: {error}"
            raise VariableError(message) from error
        self._check_type(name, array.dtype)
        shape = self.shape(cells)
        if array.shape != shape:
            along = f"along {', '.join(self.dims[1:])}" if shape else "a single value"
            message = f"variable {name!r} has shape {array.shape}; expected {shape}, {along}"
            raise VariableError(message)
        return array if self.kind is str else array.astype(self.kind, copy=False)

    def shape(self, cells: int) -> tuple[int, ...]:
        """Shape of a value at one time."""
        return tuple(IN_SPACE.get(dimension, cells) for dimension in self.dims[1:])

    def absent(self, cells: int) -> NDArray[Any]:
        """What stands for a value that there is not: NaN, 0 for a whole number, or ""."""
        if self.kind is str:
            return np.full(self.shape(cells), "")
        nothing = 0 if np.dtype(self.kind).kind == "i" else np.nan
        return np.full(self.shape(cells), nothing, self.kind)

    def _check_type(self, name: str, given: np.dtype[Any]) -> None:
        if self.kind is str:
            fits, wanted = given.kind == "U", "texts"
        else:
            fits, wanted = np.can_cast(given, self.kind, "same_kind"), f"numbers of {self.kind!r}"
        if not fits:
            message = (
                f"variable {name!r} holds {given}, not {wanted}; convert what the function "
                "returns, or declare another kind"
            )
            raise VariableError(message)


class Measured(cached_property[T]):
    """A value that every save holds: a property of its class, or a function of a state.

    Attributes
    ----------
    name : str
    variable : Variable
    column : column of the cell table without which there is no such value; "" if it needs none
    owner : the class whose property it is, or None
    """

    def __init__(self, function: Callable[[Any], T], variable: Variable, column: str = "") -> None:
        super().__init__(function)
        self.name, self.variable, self.column = function.__name__, variable, column
        self.owner: type | None = None

    def __set_name__(self, owner: type, name: str) -> None:
        super().__set_name__(owner, name)
        self.owner = owner

    def __call__(self, state: Any) -> T:
        """Value of a state."""
        return self.func(state)


MEASURED: dict[str, Measured[Any]] = {}
"""All measured variables by name."""
_RESERVED: set[str] = set()


def measured(
    *,
    dims: str | Sequence[str],
    units: str | None = None,
    text: str,
    kind: Any = "f8",
    extra: Mapping[str, str] | None = None,
    column: str = "",
) -> Callable[[Callable[[Any], T]], Measured[T]]:
    """Declare a variable that every save holds from now on; the function's name is its name.

    Parameters
    ----------
    dims : names of dimensions
        "time" alone, or ("time", "cell") and after these "axis" (x, y, z) or "principal". The
        function gives the value at one time, which lacks the first.
    units : str
        "1" for a pure number; None for a text.
    text : str
        What it is, in a few words: its `long_name`.
    kind : {"f8", "i8", "i4", str}
        How it is stored.
    extra : mapping, optional
        Further CF attributes.
    column : str, optional
        State of a rule (see `Event`) or of a force term that it is measured of: runs of scenes
        without such a rule or term do not have it.

    Raises
    ------
    ValueError
        The name is taken, a dimension is not known, or units and kind do not go together.

    Examples
    --------
    >>> from morphosim import measured
    >>> @measured(dims=("time", "cell"), units="1", text="largest phi of the cell")
    ... def peak(state):
    ...     return [field.phi.max() for field in state.fields]
    """

    def declare(function: Callable[[Any], T]) -> Measured[T]:
        _validate.instance("function of a variable", function, FunctionType)
        names = (dims,) if isinstance(dims, str) else tuple(dims)
        variable = Variable(names, kind, units, text, tuple((extra or {}).items()))
        _check_name(function)
        _check_dims(function.__name__, names)
        _check_kind(function.__name__, variable)
        MEASURED[function.__name__] = new = Measured(function, variable, column)
        return new

    return declare


def reserve(names: Iterable[str]) -> None:
    """Keep names that files of runs use otherwise from being taken by variables."""
    _RESERVED.update(names)


def _check_name(function: Any) -> None:
    name, known = function.__name__, MEASURED.get(function.__name__)
    if not name.isidentifier():
        message = f"variable {name!r} needs a name; declare a function made with def"
        raise ValueError(message)
    # The same function may come again: from a notebook's cell, or a module that is reloaded.
    if name in _RESERVED or (known is not None and _source(known.func) != _source(function)):
        where = "files of runs" if known is None else known.func.__module__
        message = f"variable {name!r} is there already, in {where}; give the function another name"
        raise ValueError(message)


def _source(function: Any) -> tuple[str, str]:
    return function.__module__, function.__qualname__


def _check_dims(name: str, dims: tuple[str, ...]) -> None:
    for dimension in dims:
        _validate.choice(f"dimension of variable {name!r}", dimension, DIMENSIONS)
    _validate.unique(f"dimension of variable {name!r}:", dims)
    if dims[:1] != PER_TIME:
        message = (
            f"dims of variable {name!r} = {dims!r} is not allowed: every save is at one time; put "
            "'time' first, as in ('time', 'cell')"
        )
        raise ValueError(message)


def _check_kind(name: str, variable: Variable) -> None:
    what, kind, units = f"variable {name!r}", variable.kind, variable.units
    _validate.text(f"text of {what}", variable.text)
    _validate.choice(f"kind of {what}", kind, (*NUMBERS, str))
    if kind is str and units is not None:
        message = f"units of {what} = {units!r} is not allowed: a text has none; leave units out"
        raise ValueError(message)
    if kind is not str and not isinstance(units, str):
        message = f"units of {what} = {units!r} is not a text; give units='1' for a pure number"
        raise TypeError(message)
    if kind in ("i4", "i8") and "cell" in variable.dims:
        message = (
            f"kind of {what} = {kind!r} is not allowed along 'cell': a cell that is not there has "
            "NaN; take 'f8'"
        )
        raise ValueError(message)
