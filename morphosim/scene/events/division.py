"""A cell divides."""

from dataclasses import dataclass

from numpy.typing import ArrayLike

from morphosim import _validate
from morphosim._shown import short_repr
from morphosim.scene.target import Changeable, Foreseen


@dataclass(frozen=True, slots=True, kw_only=True)
class Division:
    """A cell divides; see `Simulation.divide`.

    Attributes
    ----------
    cell : str
    daughters : (str, str)
    axis : (3,) from the second daughter to the first
    fraction : float
        Share of the volume that the first daughter gets.
    types : (str, str), optional
        Types of the daughters; by default the mother's.
    volumes : (float, float), optional
        Target volumes in µm³; by default shares of the mother's.
    over : float
        *In silico* time within which a contractile ring draws in the furrow. By default the cell
        is cut at once.
    """

    cell: str
    daughters: tuple[str, str]
    axis: ArrayLike
    fraction: float = 0.5
    types: tuple[str, str] | None = None
    volumes: tuple[float, float] | None = None
    over: float = 0.0

    __repr__ = short_repr

    def __post_init__(self) -> None:
        _validate.label("division: cell", self.cell)
        where = f"division of {self.cell!r}"
        names = _validate.labels(f"{where}: daughters", self.daughters, 2)
        object.__setattr__(self, "daughters", names)
        _validate.unique(f"{where}: name", (self.cell, *names))
        _validate.number(f"{where}: fraction", self.fraction, above=0, most=0.999)
        _validate.direction(f"{where}: axis", self.axis)
        if self.types is not None:
            kinds = _validate.labels(f"{where}: types", self.types, 2, empty=True)
            object.__setattr__(self, "types", kinds)
        if self.volumes is not None:
            volumes = _validate.several(f"{where}: volumes", self.volumes, "numbers", 2)
            for volume in volumes:
                _validate.number(f"{where}: volumes", volume, above=0)
            object.__setattr__(self, "volumes", volumes)
        _validate.number(f"{where}: over", self.over, least=0)

    @property
    def makes(self) -> tuple[str, ...]:
        """See `Event`."""
        return self.types or ()

    def rehearse(self, rehearsal: Foreseen) -> None:
        """See `Event`."""
        self.apply(rehearsal)

    def apply(self, simulation: Changeable) -> None:
        """Divide the cell."""
        simulation.divide(
            self.cell, self.daughters, axis=self.axis, fraction=self.fraction, types=self.types,
            volumes=self.volumes, over=self.over,
        )  # fmt: skip
