"""Parameters of cells, or the physics of all, change."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from morphosim import _validate
from morphosim.physics.parameters import Physics
from morphosim.scene.target import PhysicsValues, Target

CHANGEABLE = ("type", "gamma", "volume", "frozen")
"""Values of a cell that may change while it lives."""


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

    def __post_init__(self) -> None:
        _validate.keys("change of cells", self.values, CHANGEABLE)

    @property
    def makes(self) -> tuple[str, ...]:
        """See `Event`."""
        return (self.values["type"],) if "type" in self.values else ()

    def apply(self, simulation: Target) -> None:
        """Change the cells."""
        simulation.change_cells(self.cells, **self.values)


@dataclass(frozen=True, slots=True, kw_only=True)
class PhysicsChange:
    """Values of `Physics` change.

    Attributes
    ----------
    values : mapping
        Fields of `Physics`.
    """

    values: PhysicsValues

    def __post_init__(self) -> None:
        _validate.keys("change of physics", self.values, _validate.names_of(Physics))

    def apply(self, simulation: Target) -> None:
        """Change the physics."""
        simulation.change_physics(**self.values)
