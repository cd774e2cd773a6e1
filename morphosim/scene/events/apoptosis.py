"""Cells die by rule."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from morphosim import _validate
from morphosim._shown import short_repr
from morphosim.scene.events.living import (
    BORN,
    COURSE,
    DYING,
    check_conditions,
    check_types,
    picked,
    rehearse_types,
)
from morphosim.scene.target import Foreseen, Target


@dataclass(frozen=True, slots=True, kw_only=True)
class Apoptosis:
    """Cells shrink and are gone; see `Simulation.die`. They neither grow nor divide meanwhile.

    A cell dies if it meets all conditions that are given, of which there is at least one.

    Attributes
    ----------
    rate : float, optional
        Chance per unit of time that a cell dies.
    age : float, optional
        *In silico* time since its birth at which it does.
    when : function of a simulation, optional
        Gives (N,) bool, one for each cell.
    spread : float
        Standard deviation of the ages, in their mean; each cell draws its own once, from a
        lognormal distribution.
    over : float
        *In silico* time in which the target volume falls, steadily, to almost nothing.
    types : types of the cells that may die; () are all.
    """

    rate: float | None = None
    age: float | None = None
    when: Callable[[Any], ArrayLike] | None = None
    spread: float = 0.0
    over: float = 100.0
    types: Sequence[str] = ()

    columns = (BORN, *COURSE, DYING)

    __repr__ = short_repr

    def __post_init__(self) -> None:
        check_conditions("apoptosis", self.rate, self.age, self.spread, self.when)
        if self.rate is None and self.age is None and self.when is None:
            message = "apoptosis: nothing says who dies; give rate, age or when"
            raise ValueError(message)
        _validate.number("apoptosis: over", self.over, above=0)
        object.__setattr__(self, "types", check_types("apoptosis", self.types))

    def rehearse(self, rehearsal: Foreseen) -> None:
        """See `Event`; who dies is not known."""
        rehearse_types("apoptosis", self.types, rehearsal)

    def apply(self, simulation: Target) -> None:
        """Let cells die."""
        found = picked(
            simulation, "apoptosis", simulation.ready(self.types),
            rate=self.rate, age=self.age, spread=self.spread, when=self.when,
        )  # fmt: skip
        if found.any():
            rows = np.flatnonzero(found)
            simulation.die(simulation.column("name")[rows].tolist(), over=self.over)
