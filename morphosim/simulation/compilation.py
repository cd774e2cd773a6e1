"""Telling that kernels are compiled, for which a process stands still a while."""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from contextvars import ContextVar

from numba.core import event

from morphosim.kernels._jit import CACHE, NEEDED
from morphosim.progress import TellWhat, progress_line

KERNELS = "morphosim.kernels."
"""What the names of our kernels' modules begin with."""
Progress = Callable[[], AbstractContextManager[TellWhat]]
_PROGRESS: ContextVar[Progress] = ContextVar("progress", default=progress_line)


@contextmanager
def compilation_told(
    tell: Callable[[str], None], progress: Progress | None = None
) -> Iterator[None]:
    """Tell that kernels are compiled within, which no cache has.

    Parameters
    ----------
    tell : callable
        Called with a text, once, when this process compiles one, unless progress has been told.
    progress : function that gives a context of what is told progress, optional
        For kernels that several processes compile ahead (`warming`). By default `tell` is called
        with a text after each.
    """
    listener = _Listener(tell)

    def begin() -> AbstractContextManager[TellWhat]:
        listener.told = True
        return (progress or (lambda: _in_texts(tell)))()

    before = _PROGRESS.set(begin)
    try:
        with event.install_listener("numba:compile", listener):
            yield
    finally:
        _PROGRESS.reset(before)


def progress_of_compilation() -> AbstractContextManager[TellWhat]:
    """What is told progress here: that of `compilation_told`, else a line on standard error."""
    return _PROGRESS.get()()


@contextmanager
def _in_texts(tell: Callable[[str], None]) -> Iterator[TellWhat]:
    yield lambda what, done, of: tell(f"{what}: {done} of {of}")


class _Listener(event.Listener):  # type: ignore[misc]
    """Hears what Numba compiles; of what it loads from a cache there is no such event."""

    def __init__(self, tell: Callable[[str], None]) -> None:
        self._tell, self.told = tell, False

    def on_start(self, event: event.Event) -> None:
        """Tell, at the first of our kernels."""
        module = event.data["dispatcher"].py_func.__module__
        if not self.told and str(module).startswith(KERNELS):
            self.told = True
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
