"""Ctrl-C, a batch system's SIGTERM and a closed terminal's SIGHUP wait for the end of a step."""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

SIGNALS = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
)
"""Signals that end a run; not every system has the last."""


def interrupt_by_signals() -> None:
    """Have `SIGNALS` raise KeyboardInterrupt, but those that `nohup` or a shell has us ignore."""
    for number in SIGNALS:
        if signal.getsignal(number) is signal.SIG_DFL:
            signal.signal(number, signal.default_int_handler)


@contextmanager
def deferred_interrupts() -> Iterator[Callable[[], None]]:
    """Keep Ctrl-C until the function that this gives is called; a second one acts at once.

    Holds for each of `SIGNALS` that raises KeyboardInterrupt, in the main thread alone; elsewhere
    nothing changes. A run in a script's background ignores SIGINT, and still hears SIGTERM.
    """
    asked = False

    def remember(number: int, frame: FrameType | None) -> None:
        nonlocal asked
        if asked:
            raise KeyboardInterrupt
        asked = True

    def check() -> None:
        if asked:
            raise KeyboardInterrupt

    handler = signal.default_int_handler
    main = threading.current_thread() is threading.main_thread()
    held = [s for s in SIGNALS if main and signal.getsignal(s) is handler]
    for number in held:
        signal.signal(number, remember)
    try:
        yield check
    finally:
        for number in held:
            signal.signal(number, handler)
