"""Progress of a run, on standard error: a bar on a terminal, else a line now and then."""

import time

from morphosim.progress import Bar, Pace, Remaining, duration_text, tell_line
from morphosim.simulation.simulation import Simulation


class ProgressBar:
    """Observer that shows *in silico* time, steps per second and time left.

    Where standard error is no terminal, as in a batch job, it writes a line after 10 seconds, and
    then ever more rarely: at least every 10 minutes.

    Parameters
    ----------
    until : float, optional
        *In silico* time at which the run ends; by default what `Simulation.run` is given.
    interval : float
        Seconds between two updates of the bar.
    events : bool
        Whether to write a line for each event too.
    quiet : bool
        Whether to show nothing, and only count.

    Attributes
    ----------
    first_step, seconds : float
        Wall time of the first step, which holds compilation, and of all others.
    steps : int
        Steps after the first.
    """

    def __init__(
        self,
        until: float | None = None,
        interval: float = 0.25,
        *,
        events: bool = False,
        quiet: bool = False,
    ) -> None:
        self.until, self.interval, self.events, self.quiet = until, interval, events, quiet
        self.first_step = self.seconds = 0.0
        self.steps = 0
        self._bar = Bar("t = {task.completed:.0f} of {task.total:.0f}", "{task.fields[speed]}")

    def start(self, simulation: Simulation) -> None:
        """Begin to draw."""
        self._end = simulation.until if self.until is None else self.until
        self._draws = self._bar.shown and not self.quiet
        if self._draws:
            what = f"{simulation.scene.name}, {_count(len(simulation.cells))}"
            self._bar.begin(what, self._end, simulation.time, speed="first step")
        self._told = len(simulation.events)
        self._pace = Pace()
        self._begin = self._shown = time.perf_counter()
        self._remaining = Remaining(simulation.time)

    def after_step(self, simulation: Simulation) -> None:
        """Count; draw if the last drawing is old enough."""
        now = time.perf_counter()
        if self.first_step:
            self.steps += 1
            self.seconds = now - self._begin
            self._remaining.note(self.seconds, simulation.time)
        else:
            self.first_step, self._begin = now - self._begin, now
            self._remaining = Remaining(simulation.time)
        if self.quiet:
            return
        if self.events:
            self._tell_events(simulation)
        if self._draws and now - self._shown > self.interval and self.steps:
            self._shown = now
            speed = f"{self.steps / self.seconds:.1f} steps/s"
            self._bar.update(completed=simulation.time, speed=speed)
        elif not self._draws and self._pace.due():
            tell_line(self._line(simulation))

    def finish(self, simulation: Simulation) -> None:
        """Remove the bar."""
        self._bar.end()

    def _tell_events(self, simulation: Simulation) -> None:
        for at, text in simulation.events[self._told :]:
            tell_line(f"t = {at:g}: {text}")
        self._told = len(simulation.events)

    def _line(self, simulation: Simulation) -> str:
        """Time, cells, speed and time left."""
        scene, words = simulation.scene, [f"t = {simulation.time:g}"]
        if scene.stages:  # may end before `until`
            number = min(simulation.stages_ended + 1, len(scene.stages))
            words.append(f"stage {simulation.stage!r} ({number} of {len(scene.stages)})")
        else:
            words[0] += f" of {self._end:g}"
        words.append(_count(len(simulation.names)))
        left = self._remaining.seconds(self._end)
        if left is not None:
            words.append(f"{self.steps / self.seconds:.3g} steps/s")
            if not scene.stages:
                words.append(f"{duration_text(left)} left")
        return ", ".join(words)


def _count(cells: int) -> str:
    return "1 cell" if cells == 1 else f"{cells} cells"
