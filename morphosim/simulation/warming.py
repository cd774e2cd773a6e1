"""Compiling all kernels that scenes call, before they are called, in as many processes as can be.

Each process finds what there is to compile by itself (`compiler`), and is given what costs most
first. Compiled kernels meet in Numba's cache on disk, where a simulation finds them. A file there
says for which stand-ins all has been compiled.
"""

import json
import pickle
import subprocess
import sys
import threading
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from hashlib import sha256
from pathlib import Path
from queue import SimpleQueue

import numba
from filelock import FileLock
from numba.core.registry import cpu_target

from morphosim._files import write_text
from morphosim._isolated import process_beside
from morphosim.kernels._jit import CACHE, NEEDED
from morphosim.numerics.threads import available_processors
from morphosim.progress import TellWhat
from morphosim.scene.scene import Scene
from morphosim.scene.stand_in import StandIn, stand_in
from morphosim.simulation.compilation import progress_of_compilation

SERVE = "from morphosim.simulation.compiler import serve; serve()"
WHAT = "compiling kernels, once per installation"
MOST = 8
"""Processes at most: there are no more kernels that take long."""


_AHEAD = ContextVar("ahead", default=True)


@contextmanager
def not_ahead() -> Iterator[None]:
    """Within, simulations compile nothing ahead: other processes have all processors at work."""
    before = _AHEAD.set(False)
    try:
        yield
    finally:
        _AHEAD.reset(before)


def warm_first(scene: Scene) -> None:
    """Compile what a scene needs if nothing has ever been compiled, and that pays.

    What cannot be compiled ahead is compiled when it is called.
    """
    place = _done_file()
    if place is None or place.exists() or not _AHEAD.get() or available_processors() < 2:
        return
    with suppress(OSError, NotFoundHereError), _locked(place):
        if not place.exists():  # another process may have done so meanwhile
            with progress_of_compilation() as tell, suppress(OSError):  # it would fail again
                _compile([stand_in(scene)], tell)
            _note(place, [])


def warm(scenes: Iterable[Scene], tell: TellWhat) -> int:
    """Compile what scenes need.

    Parameters
    ----------
    scenes : iterable of Scene
    tell : callable
        Told what is compiled, how many kernels have been, and of how many.

    Returns
    -------
    int
        Number of kernels that have been compiled, or found in the cache; 0 where it is known
        without a look that all are there.

    Raises
    ------
    ValueError
        Compiled kernels cannot be kept, or a scene has what another process does not find.
    OSError
        A process has died.
    """
    place = _done_file()
    if place is None:
        message = f"nothing is compiled that cannot be kept: {NEEDED}. Name one by NUMBA_CACHE_DIR"
        raise ValueError(message)
    with _locked(place):
        done = place.read_text(encoding="utf-8").split() if place.exists() else []
        stand_ins = {s.digest or str(k): s for k, s in enumerate(map(stand_in, scenes))}
        todo = [s for digest, s in stand_ins.items() if digest not in done]
        count = _compile(todo, tell) if todo else 0
        _note(place, [*done, *(s.digest for s in todo if s.digest)])
    return count


def _done_file() -> Path | None:
    """File that says what has been compiled for this processor; None if nothing can be kept."""
    if CACHE.folder is None or not CACHE.kept or numba.config.DISABLE_JIT:
        return None
    facts = (numba.__version__, sys.version, cpu_target.target_context.codegen().magic_tuple())
    return Path(CACHE.folder, f"compiled-{sha256(repr(facts).encode()).hexdigest()[:16]}")


def _note(place: Path, digests: Iterable[str]) -> None:
    write_text(place, "".join(f"{digest}\n" for digest in sorted(set(digests))))


@contextmanager
def _locked(place: Path) -> Iterator[None]:
    """One process at a time, of all that start at once."""
    with FileLock(place.with_suffix(".lock")):
        yield


def _compile(stand_ins: Sequence[StandIn], tell: TellWhat) -> int:
    """Have processes compile what stand-ins call; how many kernels that are."""
    tell(WHAT, 0, 1)
    board, asked = _Board(), _pickled(stand_ins)
    children = [process_beside(SERVE) for _ in range(min(available_processors(), MOST))]
    threads = [threading.Thread(target=_hand_out, args=(c, asked, board)) for c in children]
    try:
        for thread in threads:
            thread.start()
        for _ in threads:
            while board.told.get():
                tell(WHAT, board.done, board.total)
    finally:
        for child in children:
            child.kill()
        for thread, child in zip(threads, children, strict=True):
            thread.join()
            _close(child)
    if board.done < board.total or not board.total:
        message = "a process that compiles kernels has died; runs compile what is left themselves"
        raise OSError(message)
    return board.total


def _pickled(stand_ins: Sequence[StandIn]) -> bytes:
    try:
        data = pickle.dumps(stand_ins)
    except (pickle.PicklingError, AttributeError, TypeError) as error:
        message = f"another process does not find what a scene has ({error}); run the scene instead"
        raise NotFoundHereError(message) from error
    if b"__main__" in data:
        message = "another process does not find what a scene has of this script; run it instead"
        raise NotFoundHereError(message)
    return data


def _close(child: "subprocess.Popen[bytes]") -> None:
    """Give back what a process that is being killed has held."""
    for pipe in (child.stdin, child.stdout):
        assert pipe is not None
        with suppress(OSError):  # what could not be sent
            pipe.close()
    child.wait()


class NotFoundHereError(ValueError):
    """A scene has what only the process knows that has made it, such as a class of its script."""


class _Board:
    """What is left to compile, for several threads."""

    def __init__(self) -> None:
        self.told: SimpleQueue[bool] = SimpleQueue()
        self.total = self.done = 0
        self._left: list[str] | None = None
        self._lock = threading.Lock()

    def offer(self, found: Sequence[tuple[str, float]]) -> None:
        """What a process has found; all find the same."""
        with self._lock:
            if self._left is None:
                found = sorted(found, key=lambda entry: entry[1])
                self._left, self.total = [key for key, _ in found], len(found)

    def take(self) -> str | None:
        """What costs most of what is left."""
        with self._lock:
            return self._left.pop() if self._left else None

    def finish(self) -> None:
        """One more is compiled."""
        with self._lock:
            self.done += 1
        self.told.put(True)


def _hand_out(child: "subprocess.Popen[bytes]", asked: bytes, board: _Board) -> None:
    """Give a process one kernel after the other; one that dies gets no more."""
    assert child.stdout is not None
    try:
        _write(child, asked)
        board.offer(json.loads(child.stdout.readline()))
        while (key := board.take()) is not None:
            _write(child, json.dumps(key).encode() + b"\n")
            if not child.stdout.readline():
                return
            board.finish()
    except (OSError, ValueError):  # ValueError: it has died before it has said what there is
        return
    finally:
        board.told.put(False)


def _write(child: "subprocess.Popen[bytes]", data: bytes) -> None:
    assert child.stdin is not None
    child.stdin.write(data)
    child.stdin.flush()
