"""Cells change their type by contact."""

from dataclasses import dataclass

import numpy as np

from morphosim import _validate
from morphosim._shown import short_repr
from morphosim.scene.target import Foreseen, Target


@dataclass(frozen=True, slots=True, kw_only=True)
class Differentiation:
    """Cells of one type that touch a cell of another become a third.

    Attributes
    ----------
    of, touching, into : str
        Types.
    area : float
        Contact area in µm² that a cell must exceed, over all cells of type `touching`.
    """

    of: str
    touching: str
    into: str
    area: float = 0.0

    __repr__ = short_repr

    def __post_init__(self) -> None:
        for name in ("of", "touching", "into"):
            _validate.label(f"differentiation: {name}", getattr(self, name), empty=True)
        _validate.number("differentiation: area", self.area, least=0)

    @property
    def makes(self) -> tuple[str, ...]:
        """See `Event`."""
        return (self.into,)

    def rehearse(self, rehearsal: Foreseen) -> None:
        """See `Event`."""
        for name in ("of", "touching"):
            rehearsal.check_type(f"differentiation: {name}", getattr(self, name))

    def apply(self, simulation: Target) -> None:
        """Change the types."""
        shapes, types = simulation.measured(), np.array(simulation.types)
        of, touching = types == self.of, types == self.touching
        shared = np.zeros(len(types))
        for a, b in (shapes.contacts.T, shapes.contacts.T[::-1]):
            counts = of[a] & touching[b]
            np.add.at(shared, a[counts], shapes.contact_area[counts])
        names = simulation.names
        changed = [names[row] for row in np.flatnonzero(shared > self.area).tolist()]
        simulation.change_cells(changed, type=self.into)
