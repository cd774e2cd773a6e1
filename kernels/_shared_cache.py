"""Numba's cache of compiled code, for several processes at a time.

Numba leaves it to chance what becomes of two processes that compile the same kernel: each does so
for itself, and as the index of a cache is read, changed and written again, the entry of one may be
lost, or lead to the code of the other. Here what one process compiles the others wait for, and
then load; and they save one at a time.
"""

from contextlib import ExitStack, contextmanager, suppress
from hashlib import sha256
from pathlib import Path

from filelock import FileLock, Timeout
from numba.core.caching import FunctionCache

PATIENCE = 180.0
"""Seconds to wait for another process, which may have been stopped; twice what any kernel takes."""


class SharedCache(FunctionCache):  # type: ignore[misc]  # Numba has no types
    """Cache of one kernel; who finds nothing there compiles, and holds a lock until `let_go`."""

    def __init__(self, function):
        super().__init__(function)
        self._held = {}

    def load_overload(self, sig, target_context):
        """Compiled code for these types, also if another process is just at it; None to compile."""
        found = super().load_overload(sig, target_context)
        if found is None and sig not in self._held:
            self._held[sig] = ExitStack()
            self._held[sig].enter_context(_locked(self._lock_of(sig), passing=True))
            found = super().load_overload(sig, target_context)
        return found

    def save_overload(self, sig, data):
        """Keep compiled code, and its entry in the index."""
        with _locked(Path(self.cache_path, "index.lock")):
            super().save_overload(sig, data)

    def let_go(self, sig):
        """Let others have a look: it is compiled, or it cannot be."""
        self._held.pop(sig, ExitStack()).close()

    def _lock_of(self, sig):
        name = sha256(f"{self._impl.filename_base}{sig}".encode()).hexdigest()[:16]
        return Path(self.cache_path, f"{name}.lock")


def share(dispatcher):
    """Have a kernel take its compiled code from a cache that processes share, and keep it there."""
    cache = dispatcher._cache = SharedCache(dispatcher.py_func)
    compile_alone = dispatcher.compile

    def compile_once(sig):
        try:
            return compile_alone(sig)
        finally:
            cache.let_go(sig)

    dispatcher.compile = compile_once


@contextmanager
def _locked(path, passing=False):
    """Hold a lock within, if the file system has locks, and nobody keeps it from us for ever.

    The file of a `passing` lock is removed: who has opened it before holds no lock then, but looks
    into the cache first.
    """
    with ExitStack() as stack:
        with suppress(OSError, NotImplementedError, Timeout):
            path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            stack.enter_context(FileLock(path, timeout=PATIENCE))
        yield
        if passing:
            with suppress(OSError):
                path.unlink(missing_ok=True)
