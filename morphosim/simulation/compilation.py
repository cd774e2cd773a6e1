"""Telling that kernels are compiled, for which a process stands still a while."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from numba.core import event

from morphosim import kernels
from morphosim.kernels._jit import CACHE, NEEDED


@contextmanager
def compilation_told(tell: Callable[[str], None]) -> Iterator[None]:
    """Call `tell` with a text, once, when kernels are compiled within that no cache has."""
    with event.install_listener("numba:compile", _Listener(tell)):
        yield


class _Listener(event.Listener):  # type: ignore[misc]
    """Hears what Numba compiles; of what it loads from a cache there is no such event."""

    def __init__(self, tell: Callable[[str], None]) -> None:
        self._tell, self._told = tell, False

    def on_start(self, event: event.Event) -> None:
        """Tell, at the first of our kernels."""
        module = event.data["dispatcher"].py_func.__module__
        if not self._told and str(module).startswith(f"{kernels.__name__}."):
            self._told = True
            self._tell(compilation_text())

    def on_end(self, event: event.Event) -> None:
        """Nothing to tell."""


def compilation_text() -> str:
    """What is compiled, for how long, and when it will be again."""
    what = (
        "compiling the kernels for this kind of scene (its precision, order, solver and forces), "
        "usually 20 to 60 s; "
    )
    if CACHE.kept:
        return f"{what}once: later runs take them from {CACHE.folder}"
    return f"{what}at every start: {NEEDED}. Name one by NUMBA_CACHE_DIR"
