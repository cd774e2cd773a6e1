"""Long work in a process of its own, so that the page stays alive.

The processes do one job at a time and talk by messages. They are started afresh ("spawn") and stay
for the next job, so that it begins at once.
"""

import asyncio
import contextlib
import logging
import multiprocessing
import signal
import sys
import threading
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import Any

from morphosim import _import_path
from morphosim.errors import SimulationError, told

_log = logging.getLogger(__name__)
EXPECTED = (ValueError, TypeError, OSError, ImportError, SimulationError)
"""Errors whose text says all there is to say."""
STOP = "stop"
ENDS = ("done", "stopped", "failed")
"""Kinds of a job's last message."""
Heard = Callable[[str, Any], None]
"""Told what kind of message it is, and its content."""


class Stopped(Exception):  # noqa: N818  (a request, no error)
    """Somebody has asked for a job to end."""


class Channel:
    """What a job talks through: messages out, commands in."""

    def __init__(self, pipe: Connection) -> None:
        self._pipe = pipe

    def tell(self, kind: str, content: Any = None) -> None:
        """Send a message; raise Stopped if nobody is there any more."""
        try:
            self._pipe.send((kind, content))
        except OSError as error:
            raise Stopped from error

    def asked(self) -> str:
        """Next command, or "" if there is none."""
        return self.wait() if self._pipe.poll() else ""

    def wait(self) -> str:
        """Next command, once there is one; "stop" if nobody is there any more."""
        try:
            command = self._pipe.recv()
        except (EOFError, OSError):
            return STOP
        return command if isinstance(command, str) else STOP


Job = Callable[..., Any]
"""Function of a module, of a channel and keywords; what it returns is told as "done"."""


class Child:
    """A process that does jobs.

    Parameters
    ----------
    heard : callable
        Told of every message, in a thread of this process. A job's last one is "done" with what it
        returned, "stopped", or "failed" with a text.
    """

    def __init__(self, heard: Heard) -> None:
        self._heard = heard
        self._start()

    @property
    def alive(self) -> bool:
        """Whether the process is there."""
        return self._process.is_alive()

    def do(self, job: Job, **arguments: Any) -> None:
        """Begin a job; the one before must have ended."""
        if not self.alive:
            self._start()
        self._busy = True
        self._pipe.send((job, arguments))

    def ask(self, command: str) -> None:
        """Send a command to the job."""
        with contextlib.suppress(OSError):
            self._pipe.send(command)

    def restart(self) -> None:
        """End the process, whatever it does, and take another."""
        self._busy = False
        self._process.terminate()
        self._process.join()
        self._start()

    def close(self, patience: float = 30.0) -> None:
        """End the process; a simulation saves its state first, for which it has `patience` (s)."""
        self._heard = _nobody
        self.ask(STOP)
        self._pipe.close()
        self._process.join(patience if self._busy else 1.0)
        if self.alive:
            self._process.terminate()
            self._process.join()

    def _start(self) -> None:
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        work = (theirs, _import_path.refusal())
        self._process = context.Process(target=_work, args=work, daemon=True)
        self._process.start()
        theirs.close()
        self._busy = False
        threading.Thread(target=self._listen, args=(self._pipe,), daemon=True).start()

    def _listen(self, pipe: Connection) -> None:
        while True:
            try:
                kind, content = pipe.recv()
            except (EOFError, OSError, TypeError):  # TypeError: closed here while waiting
                break
            if kind in ENDS:
                self._busy = False
            if pipe is self._pipe:
                self._heard(kind, content)
        if pipe is self._pipe and self._busy:
            self._busy = False
            message = "the process that did this has ended; it may have been short of memory"
            self._heard("failed", message)


class JobError(RuntimeError):
    """A job has failed; the text says why."""


class Desk:
    """Jobs of one child, as coroutines of the loop that runs when this is made."""

    def __init__(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._turn = asyncio.Lock()
        self._end: asyncio.Future[Any] | None = None
        self._told: Heard = _nobody
        self._child = Child(self._pass_on)

    async def do(self, job: Job, told: Heard | None = None, **arguments: Any) -> Any:
        """Do a job once those before have ended; return what it returns.

        Parameters
        ----------
        job : function of a module
        told : callable, optional
            Told, in the loop, of the job's messages.
        **arguments
            Keywords of the job.

        Raises
        ------
        JobError
            The job has failed.
        Stopped
            The job was broken off.
        """
        async with self._turn:
            self._end = self._loop.create_future()
            self._told = told or _nobody
            self._child.do(job, **arguments)
            return await self._end

    def ask(self, command: str) -> None:
        """Send a command to the job that is done now."""
        self._child.ask(command)

    def break_off(self) -> None:
        """Break off the job that is done now, if any."""
        if self._end is not None and not self._end.done():
            self._child.restart()
            self._end.set_exception(Stopped())

    def close(self) -> None:
        """End the process; a simulation saves its state first."""
        self._child.close()

    def _pass_on(self, kind: str, content: Any) -> None:
        """From the thread that listens to the loop."""
        with contextlib.suppress(RuntimeError):  # the loop has ended
            self._loop.call_soon_threadsafe(self._heard, kind, content)

    def _heard(self, kind: str, content: Any) -> None:
        if self._end is None or self._end.done():
            return
        if kind == "done":
            self._end.set_result(content)
        elif kind == "stopped":
            self._end.set_exception(Stopped())
        elif kind == "failed":
            self._end.set_exception(JobError(content))
        else:
            self._told(kind, content)


def _nobody(kind: str, content: Any) -> None:
    """Listen to nothing."""


def _work(pipe: Connection, refusal: str) -> None:
    """Do jobs until the other side is gone; no code that files name, if that is refused there."""
    for name in ("SIGINT", "SIGHUP"):  # they reach the server, which asks us to end, or is gone
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    with _import_path.refusing(refusal) if refusal else contextlib.nullcontext():
        _do_jobs(pipe)


def _do_jobs(pipe: Connection) -> None:
    channel = Channel(pipe)
    while True:
        try:
            order = pipe.recv()
        except (EOFError, OSError):
            sys.exit()
        if not isinstance(order, str):  # a command comes too late if its job has ended
            with contextlib.suppress(Stopped):
                channel.tell(*_result(channel, *order))


def _result(channel: Channel, job: Job, arguments: dict[str, Any]) -> tuple[str, Any]:
    """Last message of a job."""
    try:
        return "done", job(channel, **arguments)
    except Stopped:
        return "stopped", None
    except Exception as error:
        return "failed", words_of(error)


def words_of(error: Exception) -> str:
    """What to say of an error; a fault of this program is said in full in the log."""
    if isinstance(error, (*EXPECTED, JobError)):
        return told(error)
    _log.error("fault of the application", exc_info=error)
    return f"{type(error).__name__}: {error}"
