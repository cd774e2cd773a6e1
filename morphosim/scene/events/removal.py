"""Cells are taken out."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from morphosim import _validate
from morphosim._shown import short_repr
from morphosim.measure.aggregates import Aggregates
from morphosim.scene.target import Foreseen, Target

AXES = ("x", "y", "z")


@dataclass(frozen=True, slots=True, kw_only=True)
class Removal:
    """Cells are taken out: those named, and those that rules pick; first by place, then by contact.

    As a rule of a stage it extrudes what leaves a tissue.

    Attributes
    ----------
    cells : names
    below, above : mapping from axis to position, optional
        Cells whose centroid is beyond it, as {"z": 15.0} in µm.
    isolated : bool
        Cells without contact to the largest aggregate of those that are left.
    rule : function of a simulation, optional
        Gives names of cells.
    """

    cells: Sequence[str] = ()
    below: Mapping[str, float] = field(default_factory=dict)
    above: Mapping[str, float] = field(default_factory=dict)
    isolated: bool = False
    rule: Callable[[Any], Sequence[str]] | None = None

    __repr__ = short_repr

    def __post_init__(self) -> None:
        object.__setattr__(self, "cells", _validate.labels("removal: cells", self.cells))
        for name in ("below", "above"):
            side = getattr(self, name)
            _validate.keys(f"removal: {name}", side, AXES)
            for axis, place in side.items():
                _validate.number(f"removal: {name}: {axis}", place)
        _validate.flag("removal: isolated", self.isolated)
        if self.rule is not None:
            _validate.function("removal: rule", self.rule, 1)

    def rehearse(self, rehearsal: Foreseen) -> None:
        """See `Event`; which cells are picked by place, by contact or by rule is not known."""
        rehearsal.remove(self.cells)

    def apply(self, simulation: Target) -> None:
        """Take the cells out."""
        picked: Sequence[str] = ()
        if self.rule is not None:
            picked = _validate.labels("removal: names that the rule gives", self.rule(simulation))
        simulation.remove(dict.fromkeys([*self.cells, *picked, *self._beyond(simulation)]))
        if self.isolated:
            simulation.remove(_apart(simulation))

    def _beyond(self, simulation: Target) -> list[str]:
        if not (self.below or self.above):
            return []
        places = simulation.centroids
        beyond = np.zeros(len(places), bool)
        for sign, side in ((1, self.below), (-1, self.above)):
            for axis, limit in side.items():
                beyond |= sign * places[:, AXES.index(axis)] < sign * limit
        names = simulation.names
        return [names[row] for row in np.flatnonzero(beyond).tolist()]


def _apart(simulation: Target) -> list[str]:
    """Cells that are not in the largest aggregate of cells in contact."""
    aggregate = Aggregates(simulation.measured(), simulation.types).aggregate
    names = simulation.names
    return [names[row] for row in np.flatnonzero(aggregate > 0).tolist()]
