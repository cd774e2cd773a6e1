"""Progress of a run, drawn on standard error."""

import time

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from morphosim.simulation.simulation import Simulation


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

    def start(self, simulation: Simulation) -> None:
        """Begin to draw."""
        self._bar.start()
        self._task = self._bar.add_task(
            f"{simulation.scene.name}, {len(simulation.cells)} cells", total=self.until,
            completed=int(simulation.time), speed="compiling",
        )  # fmt: skip
        self._begin = self._shown = time.perf_counter()

    def after_step(self, simulation: Simulation) -> None:
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

    def finish(self, simulation: Simulation) -> None:
        """Remove the bar."""
        self._bar.stop()
