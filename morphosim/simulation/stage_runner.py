"""How far a simulation is in its stages."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from morphosim.measure.motion import Positions, root_mean_square
from morphosim.numerics.parameters import MOST_TICKS, Numerics
from morphosim.runs.checkpoint import Checkpoint
from morphosim.scene.stages import Stage, check_interval
from morphosim.scene.target import Target


class Staged(Target, Protocol):
    """A simulation, as seen by what takes it through its stages."""

    stage: str
    events: list[tuple[float, str]]

    def stop_growth(self) -> None:
        """Let target volumes grow no more."""

    @property
    def ticks(self) -> int:
        """Ticks passed; see `Numerics.tick`."""

    @property
    def tick(self) -> float:
        """*In silico* time of a tick."""

    @property
    def dividing(self) -> Sequence[str]:
        """Names of the cells that are dividing."""

    def checkpoint(self, alone: bool = False) -> Checkpoint:
        """The whole present state; `alone`, without how far the stages are."""

    def go_back(self, state: Checkpoint) -> None:
        """Return to an earlier state."""


@dataclass(slots=True)
class StageRunner:
    """Where a simulation is in its stages, and what tells when the present one ends.

    Attributes
    ----------
    stages : sequence of Stage
    index : int
        Number of the present stage; that of stages when all have ended.
    begun : int
        Ticks passed when it began; -1 before its start.
    speeds : v̄ at the checks so far
    last : Positions or None
        Where the cells were at the last check, if the stage's end looks at speeds.
    back : Checkpoint or None
        State at the last check, where the stage may end with it.
    told : int
        Number of the simulation's events at that time.
    """

    stages: Sequence[Stage]
    index: int = 0
    begun: int = -1
    speeds: list[float] = field(default_factory=list)
    last: Positions | None = None
    back: Checkpoint | None = None
    told: int = 0

    @property
    def done(self) -> bool:
        """Whether all stages have ended."""
        return self.index >= len(self.stages)

    def begin(self, simulation: Staged) -> None:
        """Begin the present stage if it has not begun."""
        if self.done or self.begun >= 0:
            return
        stage = self.stages[self.index]
        simulation.stop_growth()
        simulation.since_rules = 0.0
        for event in stage.events:
            event.apply(simulation)
        if stage.physics:
            simulation.change_physics(**stage.physics)
        self._apply_rules(simulation, stage, 0.0)
        simulation.stage = stage.name
        self.begun, self.speeds = simulation.ticks, []
        self._look(simulation, stage)

    def next_tick(self, numerics: Numerics, ticks: int) -> int:
        """The first tick after `ticks` at which a step must end: a check, rules, or the end."""
        stage, passed = self.stages[self.index], ticks - self.begun
        intervals = []
        if not stage.end.every_step or self.last is not None or self.back is not None:
            intervals.append(check_interval(numerics.tick))
        if stage.rules:
            intervals.append(stage.rules_interval(numerics.tick))
        due = [(passed // interval + 1) * interval for interval in intervals]
        if math.isfinite(stage.longest):
            due.append(numerics.ticks_to(stage.longest))
        return self.begun + min(due, default=MOST_TICKS)

    def after_step(self, simulation: Staged) -> bool:
        """Whether the present stage ends with this step, which may take the simulation back."""
        stage, tick = self.stages[self.index], simulation.tick
        ticks = simulation.ticks - self.begun
        elapsed = ticks * tick
        check = ticks % check_interval(tick) == 0
        if check and self.last is not None and not simulation.dividing:
            moved = _positions(simulation).distance(self.last)
            self.speeds.append(root_mean_square(moved) / (simulation.time - self.last.time))
        ended = (check or stage.end.every_step) and stage.end.reached(
            self.speeds, elapsed, simulation
        )
        if ended and stage.end.looks_back and self.back is not None:
            simulation.go_back(self.back)
            del simulation.events[self.told :]
        elif check:
            self._look(simulation, stage)
        if ended or (stage.limit is not None and elapsed >= stage.limit - 1e-9):
            simulation.finish_divisions()
            self.index, self.begun, self.last, self.back = self.index + 1, -1, None, None
            return True
        interval = stage.rules_interval(tick)
        if ticks % interval == 0:
            self._apply_rules(simulation, stage, interval * tick)
        return False

    def _apply_rules(self, simulation: Staged, stage: Stage, since: float) -> None:
        """Apply the rules of a stage, a time after they last were."""
        simulation.since_rules = since
        for k, rule in enumerate(stage.rules):
            simulation.rule = k
            rule.apply(simulation)

    def _look(self, simulation: Staged, stage: Stage) -> None:
        """Remember where the cells are, and the state, as far as the stage's end needs them."""
        uses_speeds = getattr(stage.end, "uses_speeds", True)  # ends of users' own may not say
        self.last = _positions(simulation) if uses_speeds else None
        self.back = simulation.checkpoint(alone=True) if stage.end.looks_back else None
        self.told = len(simulation.events)

    def restore(self, state: Checkpoint) -> None:
        """Take over how far the stages were."""
        if state.progress is None:
            return
        facts, centroids = state.progress, state.arrays["check"]
        self.index, self.begun = facts["index"], facts["begun"]
        self.speeds, self.back = list(facts["speeds"]), state.back
        if len(centroids):
            self.last = Positions(facts["time"], facts["names"], np.array(centroids))

    def facts(self) -> dict[str, Any]:
        """What a file must say of it, besides `centroids` and `back`."""
        names, time = ([], 0.0) if self.last is None else (list(self.last.cells), self.last.time)
        return {
            "index": self.index, "begun": self.begun, "speeds": self.speeds, "names": names,
            "time": time,
        }  # fmt: skip

    @property
    def centroids(self) -> NDArray[np.float64]:
        """(N, 3) centroids at the last check; none where they were not looked at."""
        return np.zeros((0, 3)) if self.last is None else self.last.centroids


def _positions(simulation: Staged) -> Positions:
    return Positions(simulation.time, simulation.names, simulation.centroids)
