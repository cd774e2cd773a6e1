"""Ends of stages: when a stage is over.

Speeds are those of Supplementary Note 1.2: centroids are looked at every FLOOR(10/δt) steps, or
after FLOOR(10/tick) ticks where a tolerance chooses the steps, and v̄ is the root mean square over
cells of the mean speed in between. Another end is a class and a row of `ENDS`; scene files, errors
and fingerprints know it by that.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from morphosim import _validate
from morphosim.scene.target import Target


class End(Protocol):
    """When a stage ends.

    `looks_back` says that the state at the check before is what the stage ends with;
    `every_step` that `reached` is asked after every step and not at checks alone; `uses_speeds`
    that it looks at v̄, which is measured only then.
    """

    looks_back: bool
    every_step: bool
    uses_speeds: bool

    def reached(self, speeds: Sequence[float], elapsed: float, simulation: Target) -> bool:
        """Whether the stage has ended; `speeds` are v̄ at all checks so far."""


@dataclass(frozen=True, slots=True)
class Duration:
    """The stage lasts for a time."""

    time: float
    looks_back = False
    every_step = True
    uses_speeds = False

    def __post_init__(self) -> None:
        _validate.number("stage: duration", self.time, above=0)

    def reached(self, speeds: Sequence[float], elapsed: float, simulation: Target) -> bool:
        """See `End`."""
        return elapsed >= self.time - 1e-9


@dataclass(frozen=True, slots=True)
class Steady:
    """The stage ends when v̄ falls below a speed (Note 1.2: 1e-4 µm per time)."""

    speed: float = 1e-4
    looks_back = False
    every_step = False
    uses_speeds = True

    def __post_init__(self) -> None:
        _validate.number("stage: steady speed", self.speed, above=0)

    def reached(self, speeds: Sequence[float], elapsed: float, simulation: Target) -> bool:
        """See `End`."""
        return bool(speeds) and speeds[-1] < self.speed


@dataclass(frozen=True, slots=True)
class QuasiSteady:
    """The stage ends at the first local minimum of v̄ (Note 1.3 F, G), with the state there."""

    looks_back = True
    every_step = False
    uses_speeds = True

    def reached(self, speeds: Sequence[float], elapsed: float, simulation: Target) -> bool:
        """See `End`."""
        return len(speeds) > 2 and speeds[-3] > speeds[-2] <= speeds[-1]


@dataclass(frozen=True, slots=True)
class When:
    """The stage ends when a condition of the simulation holds, looked at at every check."""

    condition: Callable[[Any], bool]
    looks_back = False
    every_step = False
    uses_speeds = False

    def __post_init__(self) -> None:
        _validate.function("stage: condition", self.condition, 1)

    def reached(self, speeds: Sequence[float], elapsed: float, simulation: Target) -> bool:
        """See `End`."""
        return bool(self.condition(simulation))


@dataclass(frozen=True, slots=True)
class CellCount:
    """The stage ends as soon as there are so many cells."""

    cells: int
    looks_back = False
    every_step = True
    uses_speeds = False

    def __post_init__(self) -> None:
        _validate.integer("stage: cells", self.cells, least=1)

    def reached(self, speeds: Sequence[float], elapsed: float, simulation: Target) -> bool:
        """See `End`."""
        return len(simulation.cells) >= self.cells


ENDS: dict[str, type] = {
    "duration": Duration,
    "steady": Steady,
    "quasi-steady": QuasiSteady,
    "when": When,
    "cells": CellCount,
}
"""Classes by the `kind` that a scene file names them by."""
