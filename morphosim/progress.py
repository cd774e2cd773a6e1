"""Progress of long work, on standard error: a bar on a terminal, else a line now and then."""

import sys
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeRemainingColumn

from morphosim import _validate

Tell = Callable[[int, int], None]
"""Told how much of something is done, and of how much."""
TellWhat = Callable[[str, int, int], None]
"""Told what is done, how much of it is done, and of how much."""
FIRST, LONGEST = 10.0, 600.0
"""Seconds before the first line, and most between two."""
GRAIN = 0.05
"""Of the time so far, between two marks by which the time left is told."""


def silent(*told: object) -> None:
    """Tell nobody; a `Tell` and a `TellWhat`."""


def tell_line(text: str) -> None:
    """Write a line to standard error; where that is closed or full, work goes on without it."""
    with suppress(OSError, ValueError):  # ValueError: it has been closed
        if sys.stderr is not None:
            print(printable(text), file=sys.stderr, flush=True)


def printable(text: str) -> str:
    """Text without characters that do things to a terminal; lines and tabs stay."""
    return "".join(
        c if c in "\n\t" or _validate.is_printable(c) else "\N{REPLACEMENT CHARACTER}" for c in text
    )


def duration_text(seconds: float) -> str:
    """Duration in words, to two digits or so."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"


class Pace:
    """When the next line is due: `FIRST` seconds from now, then after twice as long each time."""

    def __init__(self) -> None:
        self._wait = FIRST
        self._next = time.monotonic() + FIRST

    def due(self) -> bool:
        """Whether to tell now."""
        now = time.monotonic()
        if now < self._next:
            return False
        self._wait = min(2 * self._wait, LONGEST)
        self._next = now + self._wait
        return True


class Remaining:
    """Time left, by the pace of the latter half of the time so far: steps may grow.

    Parameters
    ----------
    done : float
        What is done when counting begins.
    """

    def __init__(self, done: float) -> None:
        self._marks = deque([(0.0, done)])
        self._now = 0.0, done

    def note(self, seconds: float, done: float) -> None:
        """Say how much is done so many seconds after the beginning."""
        marks = self._marks
        if seconds - marks[-1][0] > GRAIN * seconds:
            marks.append((seconds, done))
        while len(marks) > 1 and marks[1][0] <= seconds / 2:
            marks.popleft()
        self._now = seconds, done

    def seconds(self, total: float) -> float | None:
        """Seconds until `total` is done; None before anything is."""
        (since, done), (now, reached) = self._marks[0], self._now
        return (now - since) / (reached - done) * (total - reached) if reached > done else None


class Bar:
    """Bar of one thing at a time, where standard error is a terminal or a notebook.

    Parameters
    ----------
    columns : texts between the bar and the time left; fields of a task in braces
    """

    def __init__(self, *columns: str) -> None:
        console = Console(stderr=True)
        self.shown = console.is_terminal or console.is_jupyter
        texts = [TextColumn(column, markup=False) for column in columns]
        self._progress = Progress(
            TextColumn("{task.description}", markup=False), BarColumn(), *texts,
            TimeRemainingColumn(), console=console, transient=True,
        )  # fmt: skip
        self._task: TaskID | None = None

    def begin(self, what: str, total: float, completed: float = 0.0, **fields: Any) -> None:
        """Draw another thing."""
        if self._task is None:
            self._progress.start()
        else:
            self._progress.update(self._task, visible=False)
        self._task = self._progress.add_task(
            printable(what), total=total, completed=int(completed), **fields
        )

    def update(self, **values: Any) -> None:
        """Set `completed`, `total`, or a field."""
        assert self._task is not None
        self._progress.update(self._task, **values)

    def end(self) -> None:
        """Remove the bar."""
        if self._task is not None:
            with suppress(OSError):  # the terminal may be gone
                self._progress.stop()


@contextmanager
def progress_line() -> Iterator[TellWhat]:
    """What draws progress when it is first told something, and tidies up at the end."""
    bar, pace = Bar("{task.completed:.0f} of {task.total:.0f}"), Pace()
    now, start, remaining = "", 0.0, Remaining(0)

    def tell(what: str, done: int, of: int) -> None:
        nonlocal now, start, remaining
        if what != now:
            now, start, remaining = what, time.monotonic(), Remaining(done)
            if bar.shown:
                bar.begin(what, of)
        remaining.note(time.monotonic() - start, done)
        if bar.shown:
            bar.update(completed=done, total=of)
        elif pace.due():
            seconds = remaining.seconds(of)
            left = "" if seconds is None else f", {duration_text(seconds)} left"
            tell_line(f"{what}: {done} of {of}{left}")

    try:
        yield tell
    finally:
        bar.end()
