"""A cell divides."""

from dataclasses import dataclass

from numpy.typing import ArrayLike

from morphosim import _validate
from morphosim.scene.target import Target


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
    """

    cell: str
    daughters: tuple[str, str]
    axis: ArrayLike
    fraction: float = 0.5
    types: tuple[str, str] | None = None
    volumes: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        where = f"division of {self.cell!r}"
        if len(tuple(self.daughters)) != 2:
            message = f"{where}: daughters = {self.daughters!r}; expected two names"
            raise ValueError(message)
        object.__setattr__(self, "daughters", tuple(self.daughters))
        _validate.unique(f"{where}: name", (self.cell, *self.daughters))
        _validate.number(f"{where}: fraction", self.fraction, above=0, most=0.999)
        if not _validate.vector(f"{where}: axis", self.axis).any():
            message = f"{where}: axis = {self.axis!r} has no direction"
            raise ValueError(message)
        for name, values in (("types", self.types), ("volumes", self.volumes)):
            if values is not None and (isinstance(values, str) or len(values) != 2):
                message = f"{where}: {name} = {values!r}; expected one for each of two daughters"
                raise ValueError(message)
        for volume in self.volumes or ():
            _validate.number(f"{where}: volumes", volume, above=0)

    @property
    def makes(self) -> tuple[str, ...]:
        """See `Event`."""
        return self.types or ()

    def apply(self, simulation: Target) -> None:
        """Divide the cell."""
        simulation.divide(
            self.cell, self.daughters, axis=self.axis, fraction=self.fraction, types=self.types,
            volumes=self.volumes,
        )  # fmt: skip
