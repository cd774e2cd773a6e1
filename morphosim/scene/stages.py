"""Stages of a protocol: what happens at a stage's start, and when it ends.

Speeds are those of Supplementary Note 1.2: centroids are looked at every FLOOR(10/δt) steps, and v̄
is the root mean square over cells of the mean speed in between.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

from morphosim import _validate
from morphosim.scene.events import Event
from morphosim.scene.target import Target

CHECK_TIME = 10.0
"""*In silico* time between two looks at the centroids."""


def check_interval(dt: float) -> int:
    """Steps between two looks at the centroids: FLOOR(10/δt), at least one."""
    return max(int(CHECK_TIME / dt + 1e-9), 1)


class End(Protocol):
    """When a stage ends.

    `looks_back` says that the state at the check before is what the stage ends with;
    `every_step` that `reached` is asked after every step and not at checks alone.
    """

    looks_back: bool
    every_step: bool

    def reached(self, speeds: Sequence[float], elapsed: float, simulation: Target) -> bool:
        """Whether the stage has ended; `speeds` are v̄ at all checks so far."""


@dataclass(frozen=True, slots=True)
class Duration:
    """The stage lasts for a time."""

    time: float
    looks_back = False
    every_step = True

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

    def reached(self, speeds: Sequence[float], elapsed: float, simulation: Target) -> bool:
        """See `End`."""
        return len(speeds) > 2 and speeds[-3] > speeds[-2] <= speeds[-1]


@dataclass(frozen=True, slots=True)
class When:
    """The stage ends when a condition of the simulation holds, looked at at every check."""

    condition: Callable[[Any], bool]
    looks_back = False
    every_step = False

    def reached(self, speeds: Sequence[float], elapsed: float, simulation: Target) -> bool:
        """See `End`."""
        return bool(self.condition(simulation))


@dataclass(frozen=True, slots=True, kw_only=True)
class Stage:
    """One stage of a protocol.

    Attributes
    ----------
    name : str
    end : End
        Duration, Steady, QuasiSteady, When, or an object of your own.
    limit : float, optional
        *In silico* time after which the stage ends in any case.
    physics : mapping
        Values of `Physics` that hold from the stage's start on.
    events : sequence of Event
        What happens at the start, in this order, before `physics` holds.
    rules : sequence of Event
        What is applied after `physics` holds, and again and again while the stage lasts: cells
        that differentiate by contact, for example.
    rules_every : float
        *In silico* time in between; rounded to steps.
    """

    name: str
    end: End
    limit: float | None = None
    physics: Mapping[str, Any] = field(default_factory=dict)
    events: Sequence[Event] = ()
    rules: Sequence[Event] = ()
    rules_every: float = 100.0

    def __post_init__(self) -> None:
        _validate.text("stage: name", self.name)
        if not callable(getattr(self.end, "reached", None)):
            message = f"stage {self.name!r}: end = {self.end!r} is no end; take Duration, Steady, "
            message += "QuasiSteady or When"
            raise TypeError(message)
        if self.limit is not None:
            _validate.number(f"stage {self.name!r}: limit", self.limit, above=0)
        _validate.number(f"stage {self.name!r}: rules_every", self.rules_every, above=0)
        for event in (*self.events, *self.rules):
            if not callable(getattr(event, "apply", None)):
                message = f"stage {self.name!r}: {event!r} is no event: it has no apply(simulation)"
                raise TypeError(message)
        object.__setattr__(self, "events", tuple(self.events))
        object.__setattr__(self, "rules", tuple(self.rules))

    @property
    def daughters(self) -> list[str]:
        """Names of cells that its events and rules may bring about."""
        return [
            name
            for event in (*self.events, *self.rules) for name in getattr(event, "daughters", ())
        ]  # fmt: skip

    @property
    def makes(self) -> set[str]:
        """Cell types that its events and rules may bring about."""
        return {
            kind for event in (*self.events, *self.rules) for kind in getattr(event, "makes", ())
        }
