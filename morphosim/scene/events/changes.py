"""Parameters of cells, or the physics of all, change."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from morphosim import _validate
from morphosim._shown import short_repr
from morphosim.scene.cell import CHANGEABLE, check_values
from morphosim.scene.target import Changeable, Foreseen, PhysicsValues, check_physics


@dataclass(frozen=True, slots=True, kw_only=True)
class CellChange:
    """Type, surface tension, target volume or frozen of some cells change.

    Attributes
    ----------
    cells : names
    values : mapping
        Fields of `Cell`: type, gamma, volume, frozen.
    """

    cells: Sequence[str]
    values: Mapping[str, Any] = field(default_factory=dict)

    __repr__ = short_repr

    def __post_init__(self) -> None:
        names = _validate.labels("change of cells: cells", self.cells)
        object.__setattr__(self, "cells", names)
        _validate.keys("change of cells", self.values, CHANGEABLE)
        check_values(", ".join(names), self.values)

    @property
    def makes(self) -> tuple[str, ...]:
        """See `Event`."""
        return (self.values["type"],) if "type" in self.values else ()

    def apply(self, simulation: Changeable) -> None:
        """Change the cells."""
        simulation.change_cells(self.cells, **self.values)

    def rehearse(self, rehearsal: Foreseen) -> None:
        """See `Event`."""
        self.apply(rehearsal)


@dataclass(frozen=True, slots=True, kw_only=True)
class PhysicsChange:
    """Values of `Physics` change.

    Attributes
    ----------
    values : mapping
        Fields of `Physics`.
    """

    values: PhysicsValues

    __repr__ = short_repr

    def __post_init__(self) -> None:
        check_physics("change of physics", self.values)

    def apply(self, simulation: Changeable) -> None:
        """Change the physics."""
        simulation.change_physics(**self.values)

    def rehearse(self, rehearsal: Foreseen) -> None:
        """See `Event`."""
        self.apply(rehearsal)
