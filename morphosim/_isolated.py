"""Reading in a process beside: a damaged file may crash the library that reads it.

The process takes no more memory than the machine has, and is kept for the next file; it ends when
it has had nothing to do for a while, or with the one that asks.
"""

import atexit
import contextlib
import json
import os
import pickle
import select
import struct
import subprocess
import sys
import threading
from collections.abc import Callable
from typing import Any, BinaryIO, TypeVar

T = TypeVar("T")
IDLE = 60.0
"""Seconds without work after which the process ends, where the system can wait for so long."""
PATIENCE = 5.0
"""Seconds that a process has to end by itself once it no longer answers."""
LENGTH = struct.Struct("<Q")
SERVE = "from morphosim._isolated import serve; serve()"
FROM_HERE = "import json, sys; sys.path[:] = json.loads(sys.argv[1]); "
"""What the program of a process begins with, to import from where the one that starts it does: not
from the folder where it is started, in which another `morphosim` may lie."""


class ReaderDiedError(Exception):
    """The process that read a file has died of it."""


def process_beside(program: str) -> "subprocess.Popen[bytes]":
    """Start a Python process, with pipes to and from it, that imports from where this one does."""
    return subprocess.Popen(
        [sys.executable, "-c", FROM_HERE + program, json.dumps(list(map(str, sys.path)))],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
    )  # fmt: skip


def isolated(function: Callable[..., T], *arguments: Any) -> T:
    """Call a function of a module in the process beside.

    Parameters
    ----------
    function : Callable
        Found by its module and name; what it takes and gives can be pickled.
    *arguments
        Paths must be absolute: the process stays in the folder where it was started.

    Raises
    ------
    ReaderDiedError
        The process has died.
    Exception
        What the function raises.
    """
    with _LOCK:
        return _PROCESS.call(function, arguments)  # type: ignore[no-any-return]


class _Process:
    """The process beside; it starts when it is first asked, and anew when it has ended."""

    def __init__(self) -> None:
        self._child: subprocess.Popen[bytes] | None = None
        self._owner = 0

    def call(self, function: Callable[..., Any], arguments: tuple[Any, ...]) -> Any:
        child = self._running()
        assert child.stdin is not None
        assert child.stdout is not None
        try:
            _send(child.stdin, (function, arguments))
            value, error = _receive(child.stdout)
        except (EOFError, OSError) as end:
            child.wait(PATIENCE)
            code = self.close()
            message = f"its reader died of it ({f'signal {-code}' if code < 0 else f'code {code}'})"
            raise ReaderDiedError(message) from end
        except BaseException:  # interrupted: an answer may be on its way
            self.close()
            raise
        if error is not None:
            raise error
        return value

    def _running(self) -> "subprocess.Popen[bytes]":
        """The process, which is another one after a fork."""
        if self._child is not None and self._owner == os.getpid() and self._child.poll() is None:
            return self._child
        self.close()
        self._child = process_beside(SERVE)
        self._owner = os.getpid()
        return self._child

    def close(self) -> int:
        """End the process, unless it is another's; how it has ended."""
        child, self._child = self._child, None
        if child is None or self._owner != os.getpid():
            return 0
        child.kill()
        for pipe in (child.stdin, child.stdout):
            assert pipe is not None
            with contextlib.suppress(OSError):  # what could not be sent
                pipe.close()
        return child.wait()


_LOCK = threading.Lock()
_PROCESS = _Process()
atexit.register(_PROCESS.close)


def serve() -> None:
    """Answer what the process that started this one asks, until it ends."""
    _limit_memory()
    asked, answers = sys.stdin.buffer, os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what libraries print must not come between the answers
    while _is_asked(asked):
        try:
            function, arguments = _receive(asked)
        except EOFError:
            return
        _send(answers, _outcome(function, arguments))


def _is_asked(file: BinaryIO) -> bool:
    """Wait for a question, but not for ever."""
    if os.name == "nt":  # there only sockets can be waited for
        return True
    return bool(select.select([file], [], [], IDLE)[0])


def _outcome(function: Callable[..., Any], arguments: tuple[Any, ...]) -> tuple[Any, Any]:
    """What a function returns, or the error that it raises."""
    try:
        return function(*arguments), None
    except Exception as error:
        with contextlib.suppress(Exception):
            pickle.loads(pickle.dumps(error))
            return None, error
        return None, RuntimeError(f"{type(error).__name__}: {error}")


def _limit_memory() -> None:
    """Take no more memory than the machine has, and leave no image of it when it is too much."""
    with contextlib.suppress(ImportError, OSError, ValueError):
        import resource

        memory = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
        resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _send(file: BinaryIO | Any, message: Any) -> None:
    data = pickle.dumps(message, pickle.HIGHEST_PROTOCOL)
    file.write(LENGTH.pack(len(data)) + data)
    file.flush()


def _receive(file: BinaryIO | Any) -> Any:
    head = file.read(LENGTH.size)
    if len(head) < LENGTH.size:
        raise EOFError
    data = file.read(LENGTH.unpack(head)[0])
    return pickle.loads(data)
