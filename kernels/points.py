"""Forces that a user's own compiled function computes at each point.

The function is f(values, phi, gx, gy, gz, laplacian), with the values of the cell, φ, ∇φ and Δφ at
the point in the type of the fields, f(…, laplacian, second) with all second derivatives, or
f(…, second, place) with where the point is. It reaches the kernels by the type of an argument: the
cells' values are records whose only field is named after the function (`records`), and the kernels,
which are compiled for that type, inline the function known by that name. So compiled kernels are
cached on disk as all others are, and a function that is changed has another name.
"""

import dis
import hashlib
import inspect
import re
from collections.abc import Callable, Iterator, Sequence
from itertools import chain
from numbers import Number
from types import CodeType, ModuleType
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

import numba
import numpy as np
from numba.core import types
from numba.extending import overload

from morphosim.kernels._jit import FAST_MATH
from morphosim.kernels.frames import box_point
from morphosim.kernels.stencils import second_derivatives

_KNOWN: dict[str, "_Known"] = {}
"""What records hold, by the name of their field."""
_CHECKED: set[tuple[str, str, int]] = set()
"""Name, type of the fields and number of values of the forces that `_check` has seen."""
_HELPERS: "WeakKeyDictionary[Any, str]" = WeakKeyDictionary()
"""Digests of the compiled functions that forces call."""
SECOND = 6
"""Second derivatives: xx, yy, zz, xy, xz, yz."""
ARGUMENTS, WITH_SECOND, WITH_PLACE = 6, 7, 8
"""How many arguments such a function has: the least, and with each that it may take besides."""
_BY_NAME = {"builtins", "cmath", "math", "numba", "numpy"}
"""Packages whose functions are known by their names."""


class _Known(NamedTuple):
    """Sum of all forces at points."""

    function: Any
    """Compiled."""
    arguments: int
    """How many the greediest takes."""
    firsts: tuple[int, ...]
    """Places of the values that are 0 of cells which feel none; () if all cells may."""


class PointForce:
    """A compiled function f(values, phi, gx, gy, gz, laplacian[, second[, place]])."""

    def __init__(self, function: Callable[..., Any], rests: bool) -> None:
        self.function, self.rests = function, rests
        self._compiled: dict[str, Any] = {}

    @property
    def arguments(self) -> int:
        """How many arguments it takes."""
        return len(inspect.signature(self.function).parameters)

    @property
    def name(self) -> str:
        """Another one if the function, or a constant or function that it takes, is another."""
        seen: dict[int, Any] = {}
        digest = _digest(self.function, self.function.__qualname__, seen)
        for called in seen.values():
            _check_unchanged(called)
        return f"point_{digest[:16]}"

    @property
    def compiled(self) -> Any:
        """The function for Numba, with the constants that it takes now."""
        name = self.name
        if name not in self._compiled:
            self._compiled[name] = numba.njit(
                error_model="numpy", fastmath=set(FAST_MATH), forceinline=True
            )(self.function)  # fmt: skip
        return self._compiled[name]

    def __call__(self, *arguments: Any) -> Any:
        """Value of the plain function."""
        return self.function(*arguments)


def point_force(function: Callable[..., Any], rests: bool = False) -> PointForce:
    """Make a force at a point of a plain function of numbers.

    Parameters
    ----------
    function : f(values, phi, gx, gy, gz, laplacian), f(…, second) or f(…, second, place)
        `values` are the cell's, indexed from 0; the others are numbers. `second`, if it is taken,
        are the second derivatives of φ by xx, yy, zz, xy, xz, yz; `place` is the point's lattice
        position x, y, z: times the spacing it is in µm. Numba compiles the function into the force
        kernel: take arithmetic and NumPy functions of numbers only. `values` and the others have
        the type of the fields, constants in the function are double, which costs speed in single
        precision.
    rests : bool
        Whether it is 0 on cells whose first value is 0: these then cost nothing.

    Raises
    ------
    ValueError
        The function does not take these six to eight arguments, or takes from outside what is
        neither numbers nor arrays nor functions.
    """
    if not inspect.isfunction(getattr(function, "py_func", function)):
        message = f"{function!r} is no force at a point; it must be a function of plain Python"
        raise ValueError(message)
    function = getattr(function, "py_func", function)
    parameters = inspect.signature(function).parameters.values()
    some = any(p.kind in (p.VAR_POSITIONAL, p.VAR_KEYWORD) for p in parameters)
    if some or not ARGUMENTS <= len(parameters) <= WITH_PLACE:
        message = (
            f"{function.__qualname__}({', '.join(map(str, parameters))}) is no force at a point; "
            "it must take (values, phi, gx, gy, gz, laplacian), or after these second, or second "
            "and place"
        )
        raise ValueError(message)
    force = PointForce(function, rests)
    _ = force.name  # so that what it takes from outside is looked at now
    return force


def _digest(item: Any, where: str, seen: dict[int, Any]) -> str:
    return hashlib.sha256(repr(_content(item, where, seen)).encode()).hexdigest()


def _content(item: Any, where: str, seen: dict[int, Any]) -> Any:
    """All that compiled code depends on of a thing that it takes, as numbers and texts.

    Parameters
    ----------
    item : a value, a function, or its code
    where : what it is called, for errors
    seen : functions looked at, by the addresses of their plain ones; they may call themselves

    Raises
    ------
    ValueError
        It is none of what can be told.
    """
    kind = type(item).__name__
    if item is None or item is Ellipsis or isinstance(item, str | bytes | Number | np.generic):
        return kind, repr(item)
    if isinstance(item, tuple):
        inner = [_content(part, f"{where}[{k}]", seen) for k, part in enumerate(item)]
        return kind, getattr(item, "_fields", ()), inner
    if isinstance(item, frozenset):
        return kind, sorted(repr(_content(part, where, seen)) for part in item)
    if isinstance(item, np.ndarray) and not item.dtype.hasobject:
        return kind, repr(item.dtype), item.shape, hashlib.sha256(item.tobytes()).hexdigest()
    if isinstance(item, CodeType):
        consts = _content(item.co_consts, where, seen)
        return item.co_code, item.co_exceptiontable, item.co_names, item.co_varnames, consts
    if (name := _public_name(item)) is not None:
        return kind, name
    if inspect.isfunction(getattr(item, "py_func", item)):
        return _content_of_function(item, where, seen)
    message = f"point force: {where} is of type {kind}; take numbers, arrays or functions"
    raise ValueError(message)


def _public_name(item: Any) -> str | None:
    """Name of a module, function or type that is known by it; None for another thing."""
    if isinstance(item, np.ufunc):
        return f"numpy.{item.__name__}"
    module = item.__name__ if isinstance(item, ModuleType) else getattr(item, "__module__", None)
    name = getattr(item, "__qualname__", None) or getattr(item, "__name__", None)
    known = name is not None and str(module).partition(".")[0] in _BY_NAME
    return f"{module}.{name}" if known and not hasattr(item, "py_func") else None


def _content_of_function(item: Any, where: str, seen: dict[int, Any]) -> Any:
    """Code of a function, its defaults, and what it takes from outside by name."""
    function = getattr(item, "py_func", item)
    if id(function) in seen:
        return "again", list(seen).index(id(function))
    seen[id(function)] = item
    outside = dict(_outside(function, where))
    content = (
        function.__module__,  # which Numba imports where it loads compiled code
        _content(function.__code__, where, seen),
        _content(function.__defaults__, f"{where}.__defaults__", seen),
        [
            (name, _content(value, f"{where}({name})", seen))
            for name, value in sorted((function.__kwdefaults__ or {}).items())
        ],
        [(name, _content(outside[name], name, seen)) for name in sorted(outside)],
    )
    if function is item:
        return content
    options = sorted(
        (key, sorted(map(str, value)) if isinstance(value, set | frozenset) else str(value))
        for key, value in item.targetoptions.items()
    )
    return content, options


def _check_unchanged(helper: Any) -> None:
    """Raise ValueError if what a compiled function takes has changed: Numba compiles it once."""
    if not hasattr(helper, "py_func"):
        return
    where = helper.py_func.__qualname__
    digest = _digest(helper, where, {})
    if helper.signatures and _HELPERS.get(helper, digest) != digest:
        message = (
            f"point force: {where} has been compiled, and what it takes has changed since; give "
            "such values by point_values, or define the function anew"
        )
        raise ValueError(message)
    _HELPERS[helper] = digest


def _outside(function: Any, where: str) -> Iterator[tuple[str, Any]]:
    """What a function takes from outside: names and values, those of modules by their paths."""
    codes = list(_codes(function.__code__))
    names = {
        step.argval for code in codes for step in dis.get_instructions(code)
        if step.opname in ("LOAD_GLOBAL", "LOAD_NAME")
    }  # fmt: skip
    attributes = sorted(set(chain.from_iterable(code.co_names for code in codes)))
    found = {name: function.__globals__[name] for name in names if name in function.__globals__}
    for name, cell in zip(function.__code__.co_freevars, function.__closure__ or (), strict=True):
        try:
            found[name] = cell.cell_contents
        except ValueError:  # it is not set yet
            continue
    for name, value in found.items():
        yield from _parts(name, value, attributes, ())


def _parts(
    name: str, value: Any, attributes: Sequence[str], above: tuple[ModuleType, ...]
) -> Iterator[tuple[str, Any]]:
    """A value, or of a module that is not known by its name the values that may be asked for."""
    if not isinstance(value, ModuleType) or _public_name(value) is not None:
        yield name, value
    elif value not in above:
        for inner in attributes:
            if hasattr(value, inner):
                part = getattr(value, inner)
                yield from _parts(f"{name}.{inner}", part, attributes, (*above, value))


def _codes(code: CodeType) -> Iterator[CodeType]:
    """Code of a function, and of the functions within."""
    yield code
    for inner in code.co_consts:
        if isinstance(inner, CodeType):
            yield from _codes(inner)


def records(
    parts: Sequence[tuple[PointForce, np.ndarray]], dtype: np.dtype, count: int | None = None
) -> np.ndarray | None:
    """Values of all forces at points, for `layout.CellTerms.points`; None if there are none.

    Parameters
    ----------
    parts : of each force, its function and the (N, K) values of the cells
    dtype : of the fields
    count : N; by default that of the first force

    Raises
    ------
    ValueError
        A part is no force at a point, has values of another shape, or cannot be compiled.
    """
    if not parts:
        return None
    n = len(parts[0][1]) if count is None else count
    for force, values in parts:
        _check(force, values, dtype, n)
    widths = [values.shape[1] for _, values in parts]
    (force, _), *others = parts
    name, function = force.name, _with_all(force)
    for k, (other, _) in enumerate(others, 1):
        first = sum(widths[:k])
        name, function = f"{name}_{first}_{other.name}", _both(function, first, _with_all(other))
    if all(each.rests for each, _ in parts):
        name, firsts = f"{name}_rests", tuple(sum(widths[:k]) for k in range(len(parts)))
    else:
        firsts = ()
    if name not in _KNOWN:
        _KNOWN[name] = _Known(function, max(each.arguments for each, _ in parts), firsts)
    result = np.zeros(n, [(name, dtype, (sum(widths),))])
    fill(result, [values for _, values in parts])
    return result


def fill(points: Any, values: Sequence[np.ndarray]) -> None:
    """Set the values of all forces, (N, K) each, in the order of their `records`."""
    (name,) = points.dtype.names
    points[name] = np.concatenate(values, axis=1)


def _check(force: Any, values: Any, dtype: np.dtype, count: int) -> None:
    """Raise ValueError unless this is a force at a point that works, with values of each cell."""
    if not isinstance(force, PointForce):
        name = getattr(force, "__qualname__", repr(force))
        message = f"point = {name} is no force at a point; decorate the function with point_force"
        raise ValueError(message)
    name, shape = force.function.__qualname__, np.shape(values)
    if not isinstance(values, np.ndarray) or len(shape) != 2 or shape[0] != count:
        message = (
            f"point force {name!r}: point_values gives {type(values).__name__} of shape {shape}; "
            f"expected an array of shape ({count}, K), a row of K values for each cell"
        )
        raise ValueError(message)
    key = (force.name, dtype.str, shape[1])
    if key in _CHECKED:
        return
    if count:
        _try(force, name, values[0].astype(dtype))
    _compile(force, name, dtype)
    _CHECKED.add(key)


def _try(force: PointForce, name: str, row: np.ndarray) -> None:
    """Raise ValueError if the plain function fails with small numbers, or gives no number."""
    arguments: list[Any] = [row.dtype.type(value) for value in (0.5, 0.1, 0.1, 0.1, 0.1)]
    more = ((arguments[-1],) * SECOND, (arguments[-1],) * 3)
    arguments += more[: force.arguments - ARGUMENTS]
    try:
        with np.errstate(all="ignore"):
            result = force(row, *arguments)
    except IndexError as error:
        message = (
            f"point force {name!r}: {error}; point_values gives {len(row)} values of each cell, "
            "indexed from 0"
        )
        raise ValueError(message) from error
    except (ArithmeticError, ValueError):  # compiled it is infinite or NaN
        return
    except Exception as error:
        message = f"point force {name!r} fails with numbers: {type(error).__name__}: {error}"
        raise ValueError(_one_line(message)) from error
    given = np.asarray(result)
    if given.ndim or given.dtype.kind not in "biuf":
        message = f"point force {name!r} gives {result!r}; it must give a number"
        raise ValueError(_one_line(message))


def _compile(force: PointForce, name: str, dtype: np.dtype) -> None:
    """Compile the function alone, so that what Numba does not take is told in one line."""
    if numba.config.DISABLE_JIT:
        return
    number = numba.from_dtype(dtype)
    more = [types.containers.UniTuple(number, count) for count in (SECOND, 3)]
    more = more[: force.arguments - ARGUMENTS]
    signature = (types.Array(number, 1, "C"), *(number,) * 5, *more)
    compiled = force.compiled
    try:
        compiled.compile(signature)
        given = compiled.overloads[signature].signature.return_type
    except Exception as error:  # not all that Numba raises is a NumbaError
        message = (
            f"point force {name!r} cannot be compiled: {_cause(error)}; take arithmetic and NumPy "
            "functions of numbers"
        )
        raise ValueError(message) from error
    if not isinstance(given, types.Integer | types.Float | types.Boolean):
        message = f"point force {name!r} gives {given} when it is compiled; it must give a number"
        raise ValueError(message)


def _cause(error: Exception) -> str:
    """What is wrong, of Numba's message: the first line beyond its head, and what it announces."""
    lines = [line.strip().lstrip("-*> ") for line in str(error).splitlines()]
    told = [line for line in lines if line and not line.startswith("Failed in")]
    if not told:
        return type(error).__name__
    said = " ".join(told[:2]) if told[0].endswith(":") else told[0]
    return re.sub(" at 0x[0-9a-f]+", "", said).rstrip(".")


def _one_line(text: str) -> str:
    return " ".join(text.split())


def _with_all(force: PointForce) -> Any:
    """Its compiled function, of eight arguments; those that it does not take it does not see."""
    function, options = force.compiled, {"error_model": "numpy", "fastmath": set(FAST_MATH)}
    if force.arguments == WITH_PLACE:
        return function

    if force.arguments == WITH_SECOND:

        @numba.njit(forceinline=True, **options)
        def alike(values, phi, gx, gy, gz, laplacian, second, place):
            return function(values, phi, gx, gy, gz, laplacian, second)

    else:

        @numba.njit(forceinline=True, **options)
        def alike(values, phi, gx, gy, gz, laplacian, second, place):
            return function(values, phi, gx, gy, gz, laplacian)

    return alike


def _both(first: Any, begin: int, other: Any) -> Any:
    """Sum of two functions; the values of the other begin at `begin`."""

    @numba.njit(error_model="numpy", fastmath=set(FAST_MATH), forceinline=True)
    def both(values, phi, gx, gy, gz, laplacian, second, place):
        return first(values, phi, gx, gy, gz, laplacian, second, place) + other(
            values[begin:], phi, gx, gy, gz, laplacian, second, place
        )

    return both


def _wanted(names: Any) -> int:
    """How many arguments the functions of these records want at most."""
    (name,) = names
    return _KNOWN[name].arguments


def feels(points: Any, i: Any) -> Any:
    """Whether cell i may feel a force at points."""
    if points is None:
        return False
    (name,) = points.dtype.names
    firsts = _KNOWN[name].firsts
    return not firsts or any(points[i][name][k] != 0 for k in firsts)


@overload(feels, jit_options={"forceinline": True})
def _typed_feels(points, i):  # without types: as in `_jit`
    """Look, if the type of `points` says that cells may rest."""
    if isinstance(points, types.NoneType):
        return lambda points, i: False
    (name,) = points.dtype.fields
    firsts = _KNOWN[name].firsts
    if not firsts:
        return lambda points, i: True

    def found(points, i):
        for k in firsts:  # noqa: SIM110 (Numba has no `any`)
            if points[i][name][k] != 0:
                return True
        return False

    return found


def wanted_second(points: Any, phi: Any, p: Any, sx: Any, sy: Any, stencil: Any) -> Any:
    """Second derivatives at point p of a frame; None if no point function takes them."""
    if points is None or _wanted(points.dtype.names) < WITH_SECOND:
        return None
    return second_derivatives(phi, p, sx, sy, stencil)


@overload(wanted_second, jit_options={"forceinline": True})
def _typed_wanted_second(points, phi, p, sx, sy, stencil):  # as above
    """Compute them if the function that the type of `points` names takes them."""
    if isinstance(points, types.NoneType) or _wanted(points.dtype.fields) < WITH_SECOND:
        return lambda points, phi, p, sx, sy, stencil: None
    return lambda points, phi, p, sx, sy, stencil: second_derivatives(phi, p, sx, sy, stencil)


def begin_of_block(points: Any, i: Any, origin: Any, p: Any, sx: Any, sy: Any) -> Any:
    """Lattice position of point p of cell i's frame; None if no point function takes places."""
    if points is None or _wanted(points.dtype.names) < WITH_PLACE:
        return None
    x, y, z = box_point(p, sx, sy)
    return origin[i, 0] + x, origin[i, 1] + y, origin[i, 2] + z


@overload(begin_of_block, jit_options={"forceinline": True})
def _typed_begin_of_block(points, i, origin, p, sx, sy):  # as above
    """Find it if the function that the type of `points` names takes places."""
    if isinstance(points, types.NoneType) or _wanted(points.dtype.fields) < WITH_PLACE:
        return lambda points, i, origin, p, sx, sy: None

    def found(points, i, origin, p, sx, sy):
        x, y, z = box_point(p, sx, sy)
        return origin[i, 0] + x, origin[i, 1] + y, origin[i, 2] + z

    return found


def place_in_block(points: Any, begin: Any, j: Any) -> Any:
    """Place of a block's point j, in the type of the fields; None where `begin` is."""
    if begin is None:
        return None
    (name,) = points.dtype.names
    number = points.dtype[name].base.type
    return number(begin[0]), number(begin[1]), number(begin[2] + int(j))


@overload(place_in_block, jit_options={"forceinline": True})
def _typed_place_in_block(points, begin, j):  # as above
    """Tell it in the type of the values in `points`."""
    if isinstance(begin, types.NoneType):
        return lambda points, begin, j: None
    (name,) = points.dtype.fields
    number = points.dtype.fields[name].type.dtype
    return lambda points, begin, j: (
        number(begin[0]), number(begin[1]), number(begin[2] + np.int64(j))
    )  # fmt: skip


def force_at_point(
    points: Any, i: Any, phi: Any, gx: Any, gy: Any, gz: Any, laplacian: Any, second: Any,
    place: Any,
) -> Any:  # fmt: skip
    """Force of all point functions on cell i."""
    (name,) = points.dtype.names
    function = _KNOWN[name].function.py_func
    return function(points[i][name], phi, gx, gy, gz, laplacian, second, place)


@overload(force_at_point, jit_options={"forceinline": True})
def _typed_force_at_point(points, i, phi, gx, gy, gz, laplacian, second, place):  # as above
    """Call the function that the type of `points` names."""
    if isinstance(points, types.NoneType):
        return lambda points, i, phi, gx, gy, gz, laplacian, second, place: phi
    (name,) = points.dtype.fields
    function = _KNOWN[name].function
    return lambda points, i, phi, gx, gy, gz, laplacian, second, place: function(
        points[i][name], phi, gx, gy, gz, laplacian, second, place
    )
