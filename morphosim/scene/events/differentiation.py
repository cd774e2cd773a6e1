"""Cells change their type by contact."""

from dataclasses import dataclass

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
        from morphosim.measure.contacts import contact_areas

        types = {cell.name: cell.type for cell in simulation.cells}
        shared: dict[str, float] = {}
        areas = contact_areas(simulation.fields, simulation.spacing)
        for (a, b), area in areas.items():
            for name, other in ((a, b), (b, a)):
                if types[name] == self.of and types[other] == self.touching:
                    shared[name] = shared.get(name, 0.0) + area
        changed = [name for name, area in shared.items() if area > self.area]
        simulation.change_cells(changed, type=self.into)
