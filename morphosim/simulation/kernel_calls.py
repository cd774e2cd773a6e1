"""Which kernels are called from Python, and with which types: heard while they run as plain Python.

So what is to be compiled is known before anything is.
"""

import pkgutil
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from types import ModuleType
from typing import Any

from numba.core.dispatcher import Dispatcher
from numba.core.typing.typeof import Purpose, typeof

from morphosim import kernels

PARALLEL = 2.0
"""Compiling a parallel kernel costs so much more than another of its length."""


class KernelCall:
    """A kernel and the types that it is called with.

    Attributes
    ----------
    name : str
        Of the kernel.
    cost : float
        How long compiling takes, relative to others.
    """

    def __init__(self, kernel: Any, types: tuple[Any, ...]) -> None:
        self._kernel, self._types = kernel, types
        self.name = kernel.py_func.__name__
        self.within = {kernel}

    @property
    def key(self) -> str:
        """The same in all processes."""
        return f"{self._kernel.py_func.__module__}.{self.name}{self._types}"

    @property
    def cost(self) -> float:
        """By the length of the kernel and of all that it calls."""
        length = sum(len(kernel.py_func.__code__.co_code) for kernel in self.within)
        return length * (PARALLEL if self._kernel.targetoptions.get("parallel") else 1.0)

    def compile(self) -> None:
        """Compile it, or load it from the cache."""
        self._kernel.compile(self._types)


class _Recorder:
    """Stands for a kernel: runs it as plain Python, and notes calls that come from no kernel."""

    calls: dict[tuple[Any, tuple[Any, ...]], KernelCall]
    under_way: KernelCall | None = None

    def __init__(self, kernel: Any) -> None:
        self.kernel, self.py_func = kernel, kernel.py_func

    def __call__(self, *arguments: Any) -> Any:
        outer = _Recorder.under_way
        if outer is not None:
            outer.within.add(self.kernel)
            return self.py_func(*arguments)
        types = tuple(typeof(value, Purpose.argument) for value in arguments)
        call = KernelCall(self.kernel, types)
        _Recorder.under_way = _Recorder.calls.setdefault((self.kernel, types), call)
        try:
            return self.py_func(*arguments)
        finally:
            _Recorder.under_way = None


@contextmanager
def recorded() -> Iterator[Callable[[], list[KernelCall]]]:
    """Have all kernels run as plain Python; gives a function that says what has been called.

    Modules that are first imported within keep what they have got: this is for a process that
    does nothing else.
    """
    _Recorder.calls = {}
    for found in pkgutil.iter_modules(kernels.__path__):
        import_module(f"{kernels.__name__}.{found.name}")
    places = [
        (module, name, value)
        for module in _modules()
        for name, value in vars(module).items()
        if isinstance(value, Dispatcher)
    ]
    recorders = {kernel: _Recorder(kernel) for _, _, kernel in places}
    for module, name, kernel in places:
        setattr(module, name, recorders[kernel])
    try:
        yield lambda: list(_Recorder.calls.values())
    finally:
        for module, name, kernel in places:
            setattr(module, name, kernel)


def _modules() -> list[ModuleType]:
    """Modules of the package that are loaded."""
    package = kernels.__name__.partition(".")[0]
    return [m for name, m in list(sys.modules.items()) if name.partition(".")[0] == package and m]
