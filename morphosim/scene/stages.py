"""Stages of a protocol: what happens at a stage's start, and when it ends."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from morphosim import _validate
from morphosim._shown import short_repr
from morphosim.cell_table import Column
from morphosim.scene.ends import ENDS, Duration, End
from morphosim.scene.events import Event
from morphosim.scene.target import PhysicsValues, check_physics

CHECK_TIME = 10.0
"""*In silico* time between two looks at the centroids."""


def check_interval(tick: float) -> int:
    """Ticks between two looks at the centroids: FLOOR(10/δt) where a tick is δt, at least one."""
    return max(int(CHECK_TIME / tick + 1e-9), 1)


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
        What is applied after `physics` holds, and again and again while the stage lasts, in this
        order: cells that divide, grow or differentiate, for example.
    rules_every : float
        *In silico* time in between; rounded to steps, where these are all δt.
    """

    name: str
    end: End
    limit: float | None = None
    physics: PhysicsValues = field(default_factory=dict)
    events: Sequence[Event] = ()
    rules: Sequence[Event] = ()
    rules_every: float = 100.0

    __repr__ = short_repr

    def __post_init__(self) -> None:
        _validate.label("stage: name", self.name)
        where = f"stage {self.name!r}"
        self._check_end(where)
        if self.limit is not None:
            _validate.number(f"{where}: limit", self.limit, above=0)
        with _validate.told_of(where):
            check_physics("physics", self.physics)
        _validate.number(f"{where}: rules_every", self.rules_every, above=0)
        for key in ("events", "rules"):
            events = _validate.several(f"{where}: {key}", getattr(self, key), "events")
            for k, event in enumerate(events):
                _check_event(f"{where}: {key}[{k}]", event)
            object.__setattr__(self, key, events)

    def _check_end(self, where: str) -> None:
        """Raise TypeError unless its end can say when it is reached."""
        parts = ("reached", "looks_back", "every_step")
        missing = [part for part in parts if not hasattr(self.end, part)]
        if missing:
            known = ", ".join(kind.__name__ for kind in ENDS.values())
            message = f"{where}: end = {_validate.brief(self.end)} is no end; take one of {known}"
            raise TypeError(f"{message}, or an object of your own with {', '.join(parts)}")
        _validate.function(f"{where}: end.reached", self.end.reached, 3)

    @property
    def longest(self) -> float:
        """*In silico* time after which it is over at the latest; infinite where nothing says so."""
        lasts = self.end.time if isinstance(self.end, Duration) else math.inf
        return lasts if self.limit is None else min(lasts, self.limit)

    def rules_interval(self, tick: float) -> int:
        """Ticks between two times that its rules are applied: at least one."""
        return max(round(self.rules_every / tick), 1)

    @property
    def daughters(self) -> list[str]:
        """Names of cells that its events and rules may bring about."""
        return [
            name
            for event in (*self.events, *self.rules) for name in getattr(event, "daughters", ())
        ]  # fmt: skip

    @property
    def columns(self) -> list[Column]:
        """State per cell that its events and rules keep."""
        return [
            column
            for event in (*self.events, *self.rules) for column in getattr(event, "columns", ())
        ]  # fmt: skip

    @property
    def divides(self) -> bool:
        """Whether cells may divide that nobody names."""
        return any(getattr(event, "divides", False) for event in (*self.events, *self.rules))

    @property
    def makes(self) -> set[str]:
        """Cell types that its events and rules may bring about."""
        return {
            kind for event in (*self.events, *self.rules) for kind in getattr(event, "makes", ())
        }


def _check_event(where: str, event: Any) -> None:
    """Raise TypeError or ValueError unless something is an event, and what it tells is right."""
    if not hasattr(event, "apply"):
        message = f"{where} = {_validate.brief(event)} is no event: it has no apply(simulation)"
        raise TypeError(message)
    _validate.function(f"{where}.apply", event.apply, 1)
    if hasattr(event, "rehearse"):
        _validate.function(f"{where}.rehearse", event.rehearse, 1)
    for column in getattr(event, "columns", ()):
        _validate.instance(f"{where}.columns", column, Column)
        if not column.shared:
            message = (
                f"{where}: column {column.name!r} of a rule must be known to all ranks: shared"
            )
            raise ValueError(f"{message}=True")
    for key in ("daughters", "makes"):
        if hasattr(event, key):
            _validate.labels(f"{where}.{key}", getattr(event, key), empty=key == "makes")
