"""How far a simulation is in its stages."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from morphosim.runs.checkpoint import Checkpoint
from morphosim.scene.stages import Stage, check_interval
from morphosim.scene.target import Target


class Staged(Target, Protocol):
    """A simulation, as seen by what takes it through its stages."""

    stage: str
    events: list[tuple[float, str]]

    @property
    def steps(self) -> int:
        """Steps taken."""

    @property
    def dt(self) -> float:
        """Time step δt."""

    def checkpoint(self, alone: bool = False) -> Checkpoint:
        """The whole present state; `alone`, without how far the stages are."""

    def go_back(self, state: Checkpoint) -> None:
        """Return to an earlier state."""


@dataclass(slots=True)
class Progress:
    """Where a simulation is in its stages, and what tells when the present one ends.

    Attributes
    ----------
    stages : sequence of Stage
    index : int
        Number of the present stage; that of stages when all have ended.
    begun : int
        Steps taken when it began; -1 before its start.
    speeds : v̄ at the checks so far
    names, centroids : of the cells at the last check
    back : Checkpoint or None
        State at the last check, where the stage may end with it.
    told : int
        Number of the simulation's events at that time.
    """

    stages: Sequence[Stage]
    index: int = 0
    begun: int = -1
    speeds: list[float] = field(default_factory=list)
    names: tuple[str, ...] = ()
    centroids: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 3)))
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
        for event in stage.events:
            event.apply(simulation)
        if stage.physics:
            simulation.change_physics(**stage.physics)
        self._apply_rules(simulation, stage)
        simulation.stage = stage.name
        self.begun, self.speeds, self.back = simulation.steps, [], None
        self._look(simulation, stage)

    def after_step(self, simulation: Staged) -> bool:
        """Whether the present stage ends with this step, which may take the simulation back."""
        stage, dt = self.stages[self.index], simulation.dt
        steps = simulation.steps - self.begun
        elapsed, interval = steps * dt, check_interval(dt)
        check = steps % interval == 0
        if check:
            self.speeds.append(self._speed(simulation, interval * dt))
        ended = (check or stage.end.every_step) and stage.end.reached(
            self.speeds, elapsed, simulation
        )
        if ended and stage.end.looks_back and self.back is not None:
            simulation.go_back(self.back)
            del simulation.events[self.told :]
        elif check:
            self._look(simulation, stage)
        if ended or (stage.limit is not None and elapsed >= stage.limit - 1e-9):
            self.index, self.begun, self.back = self.index + 1, -1, None
            return True
        if steps % max(round(stage.rules_every / dt), 1) == 0:
            self._apply_rules(simulation, stage)
        return False

    def _apply_rules(self, simulation: Staged, stage: Stage) -> None:
        for rule in stage.rules:
            rule.apply(simulation)

    def _look(self, simulation: Staged, stage: Stage) -> None:
        """Remember where the cells are, and the state if the stage may end with it."""
        self.names, self.centroids = tuple(simulation.names), simulation.centroids
        self.back = simulation.checkpoint(alone=True) if stage.end.looks_back else None
        self.told = len(simulation.events)

    def _speed(self, simulation: Staged, span: float) -> float:
        """v̄ of the cells that were there at the last check."""
        before = dict(zip(self.names, self.centroids, strict=True))
        moved = [
            np.linalg.norm(now - before[name])
            for name, now in zip(simulation.names, simulation.centroids, strict=True)
            if name in before
        ]
        return float(np.sqrt(np.mean(np.square(moved))) / span)

    def restore(self, state: Checkpoint) -> None:
        """Take over how far the stages were."""
        if state.progress is None:
            return
        self.index, self.begun = state.progress["index"], state.progress["begun"]
        self.speeds, self.names = list(state.progress["speeds"]), tuple(state.progress["names"])
        self.centroids, self.back = np.array(state.arrays["check"]), state.back

    def facts(self) -> dict[str, Any]:
        """What a file must say of it, besides `centroids` and `back`."""
        return {
            "index": self.index, "begun": self.begun, "speeds": self.speeds, "names": self.names,
        }  # fmt: skip
