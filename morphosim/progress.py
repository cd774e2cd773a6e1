"""Progress of long work, drawn on standard error."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeRemainingColumn

if TYPE_CHECKING:
    from morphosim.simulation import Simulation

Tell = Callable[[int, int], None]
"""Told how much of something is done, and of how much."""
TellWhat = Callable[[str, int, int], None]
"""Told what is done, how much of it is done, and of how much."""


def silent(*told: object) -> None:
    """Tell nobody; a `Tell` and a `TellWhat`."""


@contextmanager
def progress_line() -> Iterator[TellWhat]:
    """Bar that appears when it is first told something, and is removed at the end."""
    bar = Progress(
        TextColumn("{task.description}"), BarColumn(),
        TextColumn("{task.completed:.0f} of {task.total:.0f}"), TimeRemainingColumn(),
        console=Console(stderr=True), transient=True,
    )  # fmt: skip
    tasks: dict[str, TaskID] = {}

    def tell(what: str, done: int, of: int) -> None:
        if what not in tasks:
            bar.start()
            for task in tasks.values():
                bar.update(task, visible=False)
            tasks[what] = bar.add_task(what, total=of)
        bar.update(tasks[what], completed=done, total=of)

    try:
        yield tell
    finally:
        if tasks:
            bar.stop()


class ProgressBar:
    """Observer that shows *in silico* time, steps per second and time left.

    Parameters
    ----------
    until : float
        *In silico* time at which the run ends.
    interval : float
        Seconds between two updates.

    Attributes
    ----------
    first_step, seconds : float
        Wall time of the first step, which holds compilation, and of all others.
    steps : int
        Steps after the first.
    """

    def __init__(self, until: float, interval: float = 0.25) -> None:
        self.until, self.interval = until, interval
        self.first_step = self.seconds = 0.0
        self.steps = 0
        self._bar = Progress(
            TextColumn("{task.description}"), BarColumn(),
            TextColumn("t = {task.completed:.0f} of {task.total:.0f}"),
            TextColumn("{task.fields[speed]}"), TimeRemainingColumn(),
            console=Console(stderr=True), transient=True,
        )  # fmt: skip

    def start(self, simulation: "Simulation") -> None:
        """Begin to draw."""
        self._bar.start()
        self._task = self._bar.add_task(
            f"{simulation.scene.name}, {len(simulation.cells)} cells", total=self.until,
            completed=int(simulation.time), speed="compiling",
        )  # fmt: skip
        self._begin = self._shown = time.perf_counter()

    def after_step(self, simulation: "Simulation") -> None:
        """Count; draw if the last drawing is old enough."""
        now = time.perf_counter()
        if not self.first_step:
            self.first_step, self._begin = now - self._begin, now
            return
        self.steps += 1
        self.seconds = now - self._begin
        if now - self._shown > self.interval:
            self._shown = now
            speed = f"{self.steps / self.seconds:.1f} steps/s"
            self._bar.update(self._task, completed=simulation.time, speed=speed)

    def finish(self, simulation: "Simulation") -> None:
        """Remove the bar."""
        self._bar.stop()
