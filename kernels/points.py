"""Forces that a user's own compiled function computes at each point.

The function is f(values, phi, gx, gy, gz, laplacian), with the values of the cell, φ, ∇φ and Δφ at
the point in the type of the fields. It reaches the kernels by the type of an argument: the cells'
values are records whose only field is named after the function (`records`), and the kernels, which
are compiled for that type, inline the function known by that name. So compiled kernels are cached
on disk as all others are, and a function that is changed has another name.
"""

import hashlib
import inspect
from collections.abc import Callable, Sequence
from typing import Any

import numba
import numpy as np
from numba.core import types
from numba.extending import overload

from morphosim.kernels._jit import FAST_MATH

_KNOWN: dict[str, Any] = {}
"""Compiled functions by the name of their field."""


class PointForce:
    """A compiled function f(values, phi, gx, gy, gz, laplacian); see `point_force`."""

    def __init__(self, function: Callable[..., Any], name: str) -> None:
        self.function, self.name = function, name
        self.compiled = numba.njit(
            error_model="numpy", fastmath=set(FAST_MATH), forceinline=True
        )(function)  # fmt: skip

    def __call__(self, *arguments: Any) -> Any:
        """Value of the plain function."""
        return self.function(*arguments)


def point_force(function: Callable[..., Any]) -> PointForce:
    """Make a force at a point of a plain function of numbers.

    Parameters
    ----------
    function : f(values, phi, gx, gy, gz, laplacian)
        `values` are the cell's, indexed from 0; the others are numbers. Numba compiles it into the
        force kernel: take arithmetic and NumPy functions of numbers only. `values` have the type of
        the fields, constants in the function are double, which costs speed in single precision.

    Raises
    ------
    ValueError
        The function does not take these six arguments.
    """
    given = list(inspect.signature(function).parameters)
    if len(given) != 6:
        message = (
            f"{function.__qualname__}({', '.join(given)}) is no force at a point; it must take "
            "(values, phi, gx, gy, gz, laplacian)"
        )
        raise ValueError(message)
    digest = hashlib.sha256(repr(_content(function)).encode()).hexdigest()
    return PointForce(function, f"point_{digest[:16]}")


def _content(function: Any) -> Any:
    """All that the compiled code of a function depends on: its own and what it calls by name."""
    function = getattr(function, "py_func", function)
    if not inspect.isfunction(function):
        return function
    code, outside = function.__code__, inspect.getclosurevars(function)
    used = {**outside.globals, **outside.nonlocals}
    known = {name: _content(value) for name, value in used.items() if not inspect.ismodule(value)}
    return code.co_code, code.co_consts, code.co_names, sorted(known.items())


def records(parts: Sequence[tuple[PointForce, np.ndarray]], dtype: np.dtype) -> np.ndarray | None:
    """Values of all forces at points, for `layout.CellTerms.points`; None if there are none.

    Parameters
    ----------
    parts : of each force, its function and the (N, K) values of the cells
    dtype : of the fields
    """
    if not parts:
        return None
    forces = [force for force, _ in parts]
    widths = [values.shape[1] for _, values in parts]
    name, function = forces[0].name, forces[0].compiled
    for k, force in enumerate(forces[1:], 1):
        function = _both(function, sum(widths[:k]), force.compiled)
        name = f"{name}_{sum(widths[:k])}_{force.name}"
    _KNOWN[name] = function
    result = np.zeros(len(parts[0][1]), [(name, dtype, (sum(widths),))])
    result[name] = np.concatenate([values for _, values in parts], axis=1)
    return result


def _both(first: Any, place: int, second: Any) -> Any:
    """Sum of two functions; the values of the second begin at `place`."""

    @numba.njit(error_model="numpy", fastmath=set(FAST_MATH), forceinline=True)
    def both(values, phi, gx, gy, gz, laplacian):
        return first(values, phi, gx, gy, gz, laplacian) + second(
            values[place:], phi, gx, gy, gz, laplacian
        )

    return both


def force_at_point(points: Any, i: Any, phi: Any, gx: Any, gy: Any, gz: Any, laplacian: Any) -> Any:
    """Force of all point functions on cell i."""
    (name,) = points.dtype.names
    return _KNOWN[name].py_func(points[i][name], phi, gx, gy, gz, laplacian)


@overload(force_at_point, jit_options={"forceinline": True})
def _typed_force_at_point(points, i, phi, gx, gy, gz, laplacian):  # without types: as in `_jit`
    """Call the function that the type of `points` names."""
    if isinstance(points, types.NoneType):
        return lambda points, i, phi, gx, gy, gz, laplacian: phi
    (name,) = points.dtype.fields
    function = _KNOWN[name]
    return lambda points, i, phi, gx, gy, gz, laplacian: function(
        points[i][name], phi, gx, gy, gz, laplacian
    )
