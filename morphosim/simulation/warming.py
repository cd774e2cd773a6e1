"""Compiling all kernels that scenes call, before they are called, in as many processes as can be.

Each process finds what there is to compile by itself (`compiler`), and is given what costs most
first. Compiled kernels meet in Numba's cache on disk, where a simulation finds them. A file there
says for which stand-ins all has been compiled.
"""

import atexit
import json
import pickle
import subprocess
import sys
import threading
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager, suppress
from contextvars import ContextVar
from hashlib import sha256
from pathlib import Path
from queue import SimpleQueue
from typing import Any, NamedTuple

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
PATIENCE = 600.0
"""Seconds to wait for another process that compiles; it may have been stopped."""
_AHEAD = ContextVar("ahead", default=True)
_UNDER_WAY: set[Path] = set()
"""Files that will say what has been compiled, when that which this process runs beside it is."""


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

    A run can begin when what a step calls is there: the rest is compiled beside it. A kernel that
    is called before it is there is waited for, or compiled when it is called, as is all that cannot
    be compiled ahead.
    """
    place = _done_file()
    if place is None or place.exists() or not _AHEAD.get() or available_processors() < 2:
        return
    if place in _UNDER_WAY:
        return
    with suppress(OSError, NotFoundHereError), ExitStack() as stack:
        stack.enter_context(_locked(place))
        if place.exists():  # another process has done so meanwhile
            return
        crew = stack.enter_context(closing(_Crew([stand_in(scene)])))
        with progress_of_compilation() as tell:
            crew.wait(tell, soon=True)
        rest = stack.pop_all()
        _UNDER_WAY.add(place)
        atexit.register(rest.close)
        threading.Thread(target=_finish, args=(crew, place, rest), daemon=True).start()


def _finish(crew: "_Crew", place: Path, rest: ExitStack) -> None:
    """Wait for what a run does not wait for."""
    crew.wait(lambda *_: None)
    atexit.unregister(rest.close)
    with rest, suppress(OSError):
        if not crew.closed:  # one that has died would do so again
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
        A process has died, or another one that compiles does not come to an end.
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


def _compile(stand_ins: Sequence[StandIn], tell: TellWhat) -> int:
    """Have processes compile what stand-ins call; how many kernels that are."""
    with closing(_Crew(stand_ins)) as crew:
        crew.wait(tell)
        if not crew.finished:
            message = "a process that compiles kernels has died; runs compile what is left"
            raise OSError(f"{message} themselves")
        return crew.total


def _done_file() -> Path | None:
    """File that says what has been compiled for this processor; None if nothing can be kept."""
    if CACHE.folder is None or not CACHE.kept or numba.config.DISABLE_JIT:
        return None
    facts = (numba.__version__, sys.version, cpu_target.target_context.codegen().magic_tuple())
    return Path(CACHE.folder, f"compiled-{sha256(repr(facts).encode()).hexdigest()[:16]}")


def _note(place: Path, digests: Iterable[str]) -> None:
    write_text(place, "".join(f"{digest}\n" for digest in sorted(set(digests))))


def _locked(place: Path) -> FileLock:
    """One process at a time, of all that start at once; a thread may end what another began."""
    return FileLock(place.with_suffix(".lock"), timeout=PATIENCE, thread_local=False)


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


class NotFoundHereError(ValueError):
    """A scene has what only the process knows that has made it, such as a class of its script."""


class _Crew:
    """Processes that compile, what costs most first, and what they have left to do.

    Parameters
    ----------
    stand_ins : sequence of StandIn
        What they call is compiled.
    """

    def __init__(self, stand_ins: Sequence[StandIn]) -> None:
        self.total = self._done = self._soon_left = 0
        self.closed = False
        self._left: list[_Found] | None = None
        self._lock, self._told = threading.Lock(), SimpleQueue[None]()
        asked = _pickled(stand_ins)
        self._children = [process_beside(SERVE) for _ in range(min(available_processors(), MOST))]
        self._at_work = len(self._children)
        self._threads = [
            threading.Thread(target=self._hand_out, args=(child, asked), daemon=True)
            for child in self._children
        ]
        for thread in self._threads:
            thread.start()

    @property
    def finished(self) -> bool:
        """Whether all is compiled."""
        return 0 < self.total == self._done

    def wait(self, tell: TellWhat, soon: bool = False) -> None:
        """Wait until all is compiled, or what a step calls, or all processes have died."""
        tell(WHAT, self._done, self.total or 1)
        while self._at_work and not (soon and self._left is not None and not self._soon_left):
            self._told.get()
            tell(WHAT, self._done, self.total or 1)

    def close(self) -> None:
        """End all processes."""
        self.closed = self.closed or not self.finished
        for child in self._children:
            child.kill()
        for child, thread in zip(self._children, self._threads, strict=True):
            thread.join()
            _give_back(child)

    def _hand_out(self, child: "subprocess.Popen[bytes]", asked: bytes) -> None:
        """Give a process one kernel after the other; one that dies gets no more."""
        assert child.stdout is not None
        try:
            _write(child, asked)
            self._offer(json.loads(child.stdout.readline()))
            while (found := self._take()) is not None:
                _write(child, json.dumps(found.key).encode() + b"\n")
                if not child.stdout.readline():
                    return
                self._note_done(found)
        except (OSError, ValueError):  # ValueError: it has died before it has said what there is
            return
        finally:
            with self._lock:
                self._at_work -= 1
            self._told.put(None)

    def _offer(self, found: Sequence[Sequence[Any]]) -> None:
        """What a process has found; all find the same."""
        with self._lock:
            if self._left is None:
                self._left = sorted((_Found(*entry) for entry in found), key=_Found.urgency)
                self.total = len(self._left)
                self._soon_left = sum(entry.soon for entry in self._left)

    def _take(self) -> "_Found | None":
        """What is to be compiled next."""
        with self._lock:
            return self._left.pop() if self._left else None

    def _note_done(self, found: "_Found") -> None:
        with self._lock:
            self._done += 1
            self._soon_left -= found.soon
        self._told.put(None)


class _Found(NamedTuple):
    """A kernel to compile: its key, what that costs, and whether the first step calls it."""

    key: str
    cost: float
    soon: bool

    def urgency(self) -> tuple[bool, float]:
        """What is larger is compiled before."""
        return self.soon, self.cost


def _give_back(child: "subprocess.Popen[bytes]") -> None:
    """What a process that is being killed has held."""
    for pipe in (child.stdin, child.stdout):
        assert pipe is not None
        with suppress(OSError):  # what could not be sent
            pipe.close()
    child.wait()


def _write(child: "subprocess.Popen[bytes]", data: bytes) -> None:
    assert child.stdin is not None
    child.stdin.write(data)
    child.stdin.flush()
