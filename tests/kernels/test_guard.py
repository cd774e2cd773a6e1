"""Every kernel is compiled lazily, cached, and without the flags that hide a divergence."""

import inspect
import pkgutil
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest
from numba.core.registry import CPUDispatcher

from morphosim import kernels
from morphosim.kernels._jit import FAST_MATH

from .conftest import NEED_COMPILATION

NOT_KERNELS = {
    "frames.frame_shapes", "frames.frame_sizes", "points.fill", "points.point_force",
    "points.records", "points.force_at_point", "points.wanted_second", "points.begin_of_block",
    "points.place_in_block", "points.feels", "rows.add_ends",
    "rows.beyond", "rows.fetch", "rows.whole_rows", "rows.write_block", "sharing.equal_shares",
    "sharing.shares_of", "sharing.take",
}  # fmt: skip
"""Helpers of the host that belong beside the kernels, and functions that kernels have of their own
form."""
MODULES = [f"{kernels.__name__}.{found.name}" for found in pkgutil.iter_modules(kernels.__path__)]


def public_functions(name: str) -> dict[str, object]:
    """Functions and kernels that a module defines, by name."""
    return {
        key: value
        for key, value in vars(import_module(name)).items()
        if getattr(value, "__module__", None) == name
        and not key.startswith("_")
        and not inspect.isclass(value)
    }


KERNELS = [
    pytest.param(value, id=f"{name.rpartition('.')[2]}.{key}")
    for name in MODULES
    if not name.rpartition(".")[2].startswith("_")
    for key, value in public_functions(name).items()
    if f"{name.rpartition('.')[2]}.{key}" not in NOT_KERNELS
]


def test_the_guard_sees_the_kernels() -> None:
    names = {param.id for param in KERNELS}
    assert {"step.step_band", "columns.accumulate", "stencils.derivative"} <= names


@pytest.mark.parametrize("kernel", KERNELS)
def test_kernel_options(kernel: object) -> None:
    assert isinstance(kernel, CPUDispatcher)
    options = kernel.targetoptions
    assert options["error_model"] == "numpy"
    assert set(options["fastmath"]) == FAST_MATH
    assert options["nogil"] is True
    assert options.get("boundscheck") is False
    generates = inspect.isgeneratorfunction(kernel.py_func)
    assert generates or kernel.stats.cache_path is not None, "not cached on disk"
    assert inspect.getdoc(kernel.py_func)


def test_fast_math_keeps_nan_and_infinity() -> None:
    assert isinstance(FAST_MATH, frozenset)
    assert not FAST_MATH & {"fast", "nnan", "ninf"}


def test_tests_that_need_compilation_are_there() -> None:
    """One that is renamed would run in plain Python, for a minute."""
    texts = [path.read_text(encoding="utf-8") for path in Path(__file__).parent.glob("test_*.py")]
    for name in NEED_COMPILATION:
        assert any(f"def {name}(" in text for text in texts), name


def test_import_compiles_nothing() -> None:
    code = (
        "import sys, importlib\n"
        "from numba.core.dispatcher import Dispatcher\n"
        "import morphosim.engine.engine\n"
        "modules = [importlib.import_module(name) for name in sys.argv[1:]]\n"
        "kernels = [k for m in modules for k in vars(m).values() if isinstance(k, Dispatcher)]\n"
        "assert len(kernels) > 10\n"
        "compiled = [k.__name__ for k in kernels if k.signatures]\n"
        "sys.exit(f'compiled at import: {compiled}' if compiled else 0)\n"
    )
    done = subprocess.run([sys.executable, "-c", code, *MODULES], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
