"""A cell at the start of a scene."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from morphosim import _validate
from morphosim._shown import short_repr
from morphosim.geometry.shapes import Field, Shape
from morphosim.physics.parameters import Physics

VolumeFunction = Callable[[float], float]
CHANGEABLE = ("type", "gamma", "volume", "frozen")
"""Values of a cell that may change while it lives."""
NEAR = 0.25
"""A target volume is near that of the shape if it differs by at most this share of it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class VolumeCourse:
    """Target volume that is linear between given times and constant beyond them.

    Attributes
    ----------
    times : increasing *in silico* times
    volumes : µm³ at these times
    """

    times: Sequence[float]
    volumes: Sequence[float]

    __repr__ = short_repr

    def __post_init__(self) -> None:
        times = _validate.array("volume.times", self.times, (None,))
        volumes = _validate.array("volume.volumes", self.volumes, (len(times),))
        if len(times) == 0 or not (np.diff(times) > 0).all():
            message = f"volume.times = {list(self.times)}: expected increasing times"
            raise ValueError(message)
        for value in volumes:
            _validate.number("volume.volumes", value, above=0)

    def __call__(self, time: float) -> float:
        """Target volume in µm³ at `time`."""
        return float(np.interp(time, self.times, self.volumes))


@dataclass(frozen=True, slots=True, kw_only=True)
class Cell:
    """One cell at the start of a scene.

    Attributes
    ----------
    name : str
    shape : Shape
        Sphere, Ellipsoid, Mask or Field (or a cell of a power partition).
    volume : float or function of time, optional
        Target volume V(t) in µm³; by default the volume of the shape. A cell that starts from a
        Sphere or an Ellipsoid has ∫ φ = V(0) from the first, unless V(0) is more than 25 % off the
        shape's volume: then, and from other shapes, it starts with the shape's and comes to V(t).
    type : str
        Cell type, for attraction by type.
    gamma : float, optional
        Surface tension of this cell; by default that of `Physics`.
    frozen : bool
        A frozen cell acts on others and is not stepped.
    parent : str
        Name of the mother cell, for the lineage; "" where it is not known.

    Raises
    ------
    ValueError
        The name is empty or has control characters, volume or gamma is not positive, or the cell is
        its own mother.
    """

    name: str
    shape: Shape | Field
    volume: float | VolumeFunction | None = None
    type: str = ""
    gamma: float | None = None
    frozen: bool = False
    parent: str = ""

    __repr__ = short_repr

    def __post_init__(self) -> None:
        _validate.label("cell name", self.name)
        missing = [part for part in shape_parts(self.shape) if not hasattr(self.shape, part)]
        if missing:
            message = f"cell {self.name!r}: shape = {_validate.brief(self.shape)} is not a shape: "
            raise TypeError(f"{message}it has no {missing[0]}")
        values = {name: getattr(self, name) for name in ("type", "parent", "frozen", "gamma")}
        check_values(self.name, values | ({} if self.volume is None else {"volume": self.volume}))
        if self.parent == self.name:
            message = f"cell {self.name!r}: parent = {self.parent!r} is the cell itself"
            raise ValueError(message)
        self.target_volume(0.0)

    def target_volume(self, time: float) -> float:
        """V(t) in µm³; raises ValueError if it is not positive and finite."""
        return volume_at(self.name, self.shape.volume if self.volume is None else self.volume, time)

    @property
    def start_volume(self) -> float:
        """∫ φ that the cell starts with, µm³: its target where that may be and is near."""
        own, target = self.shape.volume, self.target_volume(0.0)
        nominal = not (isinstance(self.shape, Field) or self.shape.exact)
        return target if nominal and abs(target - own) <= NEAR * own else own


def shape_parts(shape: Any) -> tuple[str, ...]:
    """What a shape has; a phase field as it is has its values in place of a depth."""
    own = ("values",) if isinstance(shape, Field) else ("depth", "exact")
    return ("bounds", "volume", *own)


def volume_at(name: str, volume: float | VolumeFunction, time: float) -> float:
    """Target volume of a cell at a time, µm³.

    Raises
    ------
    ValueError
        It is not positive and finite, or its function raises an error.
    """
    label = f"cell {name!r}: volume at t = {time:g}"
    try:
        value = volume(time) if callable(volume) else volume
    except Exception as error:  # of a user's function
        message = f"{label} cannot be computed: {type(error).__name__}: {error}"
        raise ValueError(message) from error
    return _validate.number(label, value, above=0)


def check_values(name: str, values: Mapping[str, Any]) -> None:
    """Raise ValueError or TypeError unless these values of a cell are allowed."""
    for key in ("type", "parent"):
        if key in values:
            _validate.label(f"cell {name!r}: {key}", values[key], empty=True)
    if "frozen" in values:
        _validate.flag(f"cell {name!r}: frozen", values["frozen"])
    if "volume" in values:
        _check_volume(name, values["volume"])
    if values.get("gamma") is not None:
        _validate.number(f"cell {name!r}: gamma", values["gamma"], above=0)


def _check_volume(name: str, volume: Any) -> None:
    """Raise unless a living cell can have this target volume, at times that are not yet known."""
    if volume is None:
        message = f"cell {name!r}: volume = None; a living cell takes a number or a function"
        raise ValueError(message)
    if callable(volume):
        _validate.function(f"cell {name!r}: volume", volume, 1)
    else:
        _validate.number(f"cell {name!r}: volume", volume, above=0)


def ancestors(name: str, mothers: Mapping[str, str]) -> Iterator[str]:
    """Mother of a cell, her mother, and so on; it ends where mothers go round in a circle."""
    seen = {name}
    while (name := mothers.get(name, "")) and name not in seen:
        seen.add(name)
        yield name


def tensions(cells: Iterable[Cell], physics: Physics) -> list[float]:
    """Surface tension γ of each cell: its own, or that of the physics."""
    return [physics.gamma if cell.gamma is None else cell.gamma for cell in cells]
