"""Forces at points: names that tell all that is compiled, and errors in one line."""

import subprocess
import sys
from collections.abc import Callable
from types import ModuleType, SimpleNamespace
from typing import Any

import numba
import numpy as np
import pytest

from morphosim.kernels.points import PointForce, point_force, records

DOUBLE = np.dtype(np.float64)
SCALE = 0.5
TABLE = np.zeros(5000)
OTHER = SimpleNamespace(k=2.0)
constants = ModuleType("constants")
constants.K = 0.9  # type: ignore[attr-defined]
constants.unused = object()  # type: ignore[attr-defined]


def made(force: Callable[..., Any]) -> PointForce:
    return point_force(force)


def by_global(values, phi, gx, gy, gz, laplacian):  # type: ignore[no-untyped-def]
    return SCALE * phi


def by_array(values, phi, gx, gy, gz, laplacian):  # type: ignore[no-untyped-def]
    return TABLE[2500] * phi


def by_module(values, phi, gx, gy, gz, laplacian):  # type: ignore[no-untyped-def]
    return constants.K * np.sqrt(gx * gx) * phi  # type: ignore[attr-defined]


def by_object(values, phi, gx, gy, gz, laplacian):  # type: ignore[no-untyped-def]
    return OTHER.k * phi


def by_inner(values, phi, gx, gy, gz, laplacian):  # type: ignore[no-untyped-def]
    def inner(x):  # type: ignore[no-untyped-def]
        return SCALE * x

    return inner(phi)


@numba.njit
def factorial(n):  # type: ignore[no-untyped-def]
    return 1.0 if n < 1 else n * factorial(n - 1)


def by_itself(values, phi, gx, gy, gz, laplacian):  # type: ignore[no-untyped-def]
    return factorial(3) * phi


def unnamed(values, phi, gx, gy, gz, laplacian):  # type: ignore[no-untyped-def]
    return phi.no_such_thing


def undefined(values, phi, gx, gy, gz, laplacian):  # type: ignore[no-untyped-def]
    return no_such_name * phi  # type: ignore[name-defined]  # noqa: F821


def as_text(values, phi, gx, gy, gz, laplacian):  # type: ignore[no-untyped-def]
    return "much"


def text_at_times(values, phi, gx, gy, gz, laplacian):  # type: ignore[no-untyped-def]
    return phi if phi < 2 else None


def far(values, phi, gx, gy, gz, laplacian):  # type: ignore[no-untyped-def]
    return values[5] * phi


def printed(values, phi, gx, gy, gz, laplacian):  # type: ignore[no-untyped-def]
    return float(f"{phi:.2f}") * sum({"a": phi}.values())


def root(values, phi, gx, gy, gz, laplacian):  # type: ignore[no-untyped-def]
    return np.sqrt(-phi) / values[0]


@pytest.mark.parametrize(
    ("force", "place", "key"),
    [
        (by_global, None, "SCALE"),
        (by_inner, None, "SCALE"),
        (by_module, constants, "K"),
    ],
)
def test_a_changed_constant_gives_another_name(
    force: Callable[..., Any], place: Any, key: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    place = place or sys.modules[__name__]
    found = made(force)
    before = found.name
    assert made(force).name == before
    monkeypatch.setattr(place, key, 7.0)
    assert found.name == made(force).name != before
    assert found.compiled is found.compiled


def test_a_changed_array_gives_another_name() -> None:
    before = made(by_array).name
    TABLE[2500] = 7.0
    after = made(by_array).name
    TABLE[2500] = 0.0
    assert made(by_array).name == before != after


def test_a_changed_number_in_its_code_gives_another_name() -> None:
    """As when a script that has run is edited and run again."""
    forces = [
        made(lambda values, phi, gx, gy, gz, laplacian: 2.0 * phi),
        made(lambda values, phi, gx, gy, gz, laplacian: 3.0 * phi),
    ]
    codes = {force.function.__code__.co_code for force in forces}
    assert len(codes) == 1, "they differ in more than a number"
    assert forces[0].name != forces[1].name


def test_the_module_is_part_of_the_name(monkeypatch: pytest.MonkeyPatch) -> None:
    """As when a file is moved: Numba imports it from where it was to load what it has compiled."""
    before = made(by_global).name
    monkeypatch.setattr(by_global, "__module__", "elsewhere")
    assert made(by_global).name != before


def test_a_changed_default_gives_another_name() -> None:
    def forced(k: float, keyword: float) -> PointForce:
        def helper(x, k=k, *, keyword=keyword):  # type: ignore[no-untyped-def]
            return k * x + keyword

        helper = numba.njit(helper)
        return made(lambda values, phi, gx, gy, gz, laplacian: helper(phi))

    names = [forced(k, word).name for k, word in ((0.1, 0.0), (0.2, 0.0), (0.1, 0.3))]
    assert len(set(names)) == 3
    assert forced(0.1, 0.0).name == names[0]


def test_helpers_may_call_themselves() -> None:
    values = records([(made(by_itself), np.ones((1, 1)))], DOUBLE, 1)
    assert values is not None
    assert made(by_itself).name == made(by_itself).name


@numba.njit
def even(n):  # type: ignore[no-untyped-def]
    return True if n == 0 else odd(n - 1)


@numba.njit
def odd(n):  # type: ignore[no-untyped-def]
    return False if n == 0 else even(n - 1)


def by_each_other(values, phi, gx, gy, gz, laplacian):  # type: ignore[no-untyped-def]
    return phi if even(4) else gx


def test_helpers_may_call_each_other() -> None:
    assert made(by_each_other).name == made(by_each_other).name != made(by_itself).name


def test_names_are_the_same_in_another_process() -> None:
    """No address is part of them."""
    code = (
        "from tests.kernels.test_points import *\n"
        "print(*[made(f).name for f in (by_inner, by_array, by_module, by_itself)])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    here = [made(f).name for f in (by_inner, by_array, by_module, by_itself)]
    assert done.stdout.split() == here


def test_a_helper_that_is_compiled_must_stay_as_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    """Numba would go on with the constants of before, under another name."""
    force = made(by_helper)
    records([(force, np.ones((1, 1)))], DOUBLE, 1)
    monkeypatch.setattr(constants, "K", 3.0)
    if not numba.config.DISABLE_JIT:
        with pytest.raises(ValueError, match="helper has been compiled, and what it takes has cha"):
            _ = force.name


@numba.njit
def helper(x):  # type: ignore[no-untyped-def]
    return constants.K * x  # type: ignore[attr-defined]


def by_helper(values, phi, gx, gy, gz, laplacian):  # type: ignore[no-untyped-def]
    return helper(phi)


def test_what_cannot_be_told_is_refused() -> None:
    with pytest.raises(ValueError, match=r"OTHER is of type SimpleNamespace; take numbers, arrays"):
        point_force(by_object)
    with pytest.raises(ValueError, match="no force at a point; it must be a function"):
        point_force(np.sqrt)
    with pytest.raises(ValueError, match=r"rest\) is no force at a point; it must take"):
        point_force(lambda values, phi, gx, gy, gz, *rest: phi)


@pytest.mark.parametrize(
    ("force", "error"),
    [
        (unnamed, "'unnamed' fails with numbers: AttributeError: .*no_such_thing"),
        (undefined, "'undefined' fails with numbers: NameError: .*no_such_name"),
        (as_text, "'as_text' gives 'much'; it must give a number"),
        (text_at_times, r"'text_at_times' gives .* when it is compiled; it must give a number"),
        (far, "'far': index 5 is out of bounds .*; point_values gives 2 values of each cell"),
        (printed, "'printed' cannot be compiled: .*; take arithmetic and NumPy functions of numb"),
    ],
)
def test_a_force_that_does_not_work_is_one_line(force: Callable[..., Any], error: str) -> None:
    if numba.config.DISABLE_JIT and "compiled" in error:
        pytest.skip("nothing is compiled")
    with pytest.raises(ValueError, match=error) as caught:
        records([(made(force), np.ones((3, 2)))], DOUBLE, 3)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("values", [np.ones(3), np.ones((1, 1)), [[1.0]] * 3, 1.0])
def test_values_must_be_rows_of_cells(values: Any) -> None:
    with pytest.raises(ValueError, match=r"'by_global': point_values gives .* of shape \(3, K\)"):
        records([(made(by_global), values)], DOUBLE, 3)


def test_what_is_not_decorated_is_named() -> None:
    with pytest.raises(ValueError, match="by_global is no force at a point; decorate the function"):
        records([(by_global, np.ones((3, 1)))], DOUBLE, 3)  # type: ignore[list-item]


def test_values_without_a_number_are_the_runs_to_tell() -> None:
    """Infinite and NaN are numbers; and a process may have no cell."""
    assert records([(made(root), np.zeros((3, 1)))], DOUBLE, 3) is not None
    assert records([(made(root), np.zeros((0, 1)))], DOUBLE, 0) is not None


def test_a_force_is_looked_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    force, values = made(by_global), np.ones((3, 1))
    records([(force, values)], np.dtype(np.float32), 3)

    def fail(*_: Any) -> None:
        raise AssertionError

    monkeypatch.setattr("morphosim.kernels.points._compile", fail)
    records([(force, values)], np.dtype(np.float32), 3)
