"""What is taken of each member: variables of its run, or functions of it."""

import importlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from morphosim import _validate
from morphosim.runs.measured_state import built_in_variables
from morphosim.runs.schema import CONTACT_MATRIX

if TYPE_CHECKING:
    import xarray as xr

OVER_TIME = "(time)"
"""Ending of a variable that is wanted at all saves."""
_NO_FIGURES = ("time",)
VARIABLES = [n for n in built_in_variables() | CONTACT_MATRIX if n not in _NO_FIGURES]
"""Those of every run: a member's process does not know what a script declares."""
Function = Callable[["xr.Dataset"], Any]


@dataclass(frozen=True, slots=True)
class Figure:
    """One figure: `what` is a variable, "variable(time)", "module:name" or a function."""

    name: str
    what: str | Function

    @property
    def computed(self) -> bool:
        """Whether a function gives it, which may want the fields."""
        return callable(self.what) or ":" in self.what

    @property
    def description(self) -> str:
        """What tells it from another figure."""
        if isinstance(self.what, str):
            return self.what
        return f"{self.what.__module__}:{getattr(self.what, '__qualname__', repr(self.what))}"

    def check(self) -> None:
        """Raise ImportError or ValueError if its function cannot be loaded in this process."""
        if isinstance(self.what, str) and self.computed:
            loaded(self.what)

    def of(self, run: "xr.Dataset") -> "xr.DataArray":
        """Its value for a run."""
        if self.computed:
            function = self.what if callable(self.what) else loaded(self.what)
            return _as_array(self.name, function(run))
        assert isinstance(self.what, str)
        if self.what.endswith(OVER_TIME):
            return _variable(run, self.what.removesuffix(OVER_TIME))
        return _of_living(_variable(run, self.what).isel(time=-1, drop=True), run)


def _variable(run: "xr.Dataset", name: str) -> "xr.DataArray":
    if name not in run:
        message = (
            f"the run has no variable {name!r}; contact_area is there for up to 500 cells and some "
            "10⁸ numbers in all saves"
        )
        raise ValueError(message)
    return run[name].load()


def _of_living(values: "xr.DataArray", run: "xr.Dataset") -> "xr.DataArray":
    """Values of those cells that are there at the end."""
    alive = np.flatnonzero(np.isfinite(run["volume"].isel(time=-1).values))
    return values.isel({dim: alive for dim in ("cell", "neighbour") if dim in values.dims})


def _as_array(name: str, value: Any) -> "xr.DataArray":
    import xarray as xr

    if isinstance(value, xr.DataArray):
        return value.load()
    if np.ndim(value):
        message = (
            f"figure {name!r} is an array without names of its dimensions; return a number or an "
            "xarray.DataArray"
        )
        raise TypeError(message)
    return xr.DataArray(value)


def loaded(text: str) -> Function:
    """Function named as "module:name".

    Raises
    ------
    ImportError
        The module cannot be imported here.
    ValueError
        It has no such function.
    """
    module, _, name = text.partition(":")
    message = f"figure {text!r} cannot be loaded as module:name "
    try:
        function = getattr(importlib.import_module(module), name)
    except ImportError as error:
        raise ImportError(f"{message}({error})") from error
    except (AttributeError, ValueError) as error:
        raise ValueError(f"{message}({error})") from error
    if not callable(function):
        message = f"figure {text!r} is not a function of a run"
        raise ValueError(message)
    return function  # type: ignore[no-any-return]


def make_figures(given: Sequence[Any] | Mapping[str, Any]) -> list[Figure]:
    """Figures of a list, or of a mapping from name to what it is.

    Raises
    ------
    ImportError
        The module of a function cannot be imported.
    ValueError
        A variable or function does not exist, or two figures have one name.
    TypeError
        A figure is neither a text nor a function, or cannot be sent to other processes.
    """
    if isinstance(given, Mapping):
        figures = [Figure(name, what) for name, what in given.items()]
    else:
        each = [given] if isinstance(given, str) else _validate.several("figures", given, "figures")
        figures = [Figure(_name(what), what) for what in each]
    if not figures:
        message = "figures is empty; a scan needs at least one, such as 'volume'"
        raise ValueError(message)
    _validate.unique("figure", [figure.name for figure in figures])
    for figure in figures:
        _check(figure)
    return figures


def _name(what: Any) -> str:
    if isinstance(what, str):
        return what.removesuffix(OVER_TIME).rpartition(":")[2]
    return str(getattr(what, "__name__", what))


def _check(figure: Figure) -> None:
    if callable(figure.what):
        _check_sendable(figure)
        return
    _validate.text(f"figure {figure.name!r}", figure.what)
    figure.check()
    if not figure.computed:
        _validate.choice("figure", figure.what.removesuffix(OVER_TIME), VARIABLES)


def _check_sendable(figure: Figure) -> None:
    import cloudpickle

    try:
        cloudpickle.dumps(figure.what)
    except Exception as error:  # pickling runs foreign code
        message = (
            f"figure {figure.name!r} cannot be sent to other processes ({error}); take a function "
            "of a module that holds no open files or locks"
        )
        raise TypeError(message) from error
