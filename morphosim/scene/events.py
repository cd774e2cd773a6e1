"""Events: what changes a simulation between two steps.

An event is any object with `apply(simulation)`. Those here act through `Simulation.divide`,
`remove`, `change_cells` and `change_physics`, as events of your own do.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

from numpy.typing import ArrayLike

from morphosim import _validate
from morphosim.physics.parameters import Physics
from morphosim.scene.target import Target

AXES = ("x", "y", "z")
CHANGEABLE = ("type", "gamma", "volume", "frozen")
"""Values of a cell that may change while it lives."""


class Event(Protocol):
    """Something that happens between two steps.

    Where it has `makes`, these are cell types that it may bring about; attraction and motility by
    type may name them. Where it has `daughters`, these are names of cells that it may bring about;
    attraction by pair may name them.
    """

    def apply(self, simulation: Target) -> None:
        """Change the simulation."""


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


@dataclass(frozen=True, slots=True, kw_only=True)
class Removal:
    """Cells are taken out: those named, and those that rules pick; first by place, then by contact.

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

    def __post_init__(self) -> None:
        for side in (self.below, self.above):
            _validate.keys("removal: axis", side, AXES)
            for axis, place in side.items():
                _validate.number(f"removal: {axis}", place)
        _validate.flag("removal: isolated", self.isolated)

    def apply(self, simulation: Target) -> None:
        """Take the cells out."""
        picked = () if self.rule is None else self.rule(simulation)
        simulation.remove(dict.fromkeys([*self.cells, *picked, *self._beyond(simulation)]))
        if self.isolated:
            simulation.remove(_apart(simulation))

    def _beyond(self, simulation: Target) -> list[str]:
        places = simulation.centroids
        sides = [(1, self.below), (-1, self.above)]
        return [
            name
            for name, place in zip(simulation.names, places, strict=True)
            if any(
                sign * place[AXES.index(axis)] < sign * limit
                for sign, side in sides for axis, limit in side.items()
            )
        ]  # fmt: skip


def _apart(simulation: Target) -> list[str]:
    """Cells that are not in the largest aggregate of cells in contact."""
    import networkx as nx

    from morphosim.measure.contacts import contact_areas

    graph = nx.Graph()
    graph.add_nodes_from(simulation.names)
    graph.add_edges_from(contact_areas(simulation.fields, simulation.spacing))
    largest = max(nx.connected_components(graph), key=len)
    return [name for name in simulation.names if name not in largest]


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

    def __post_init__(self) -> None:
        _validate.number("differentiation: area", self.area, least=0)

    @property
    def makes(self) -> tuple[str, ...]:
        """See `Event`."""
        return (self.into,)

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

    values: Mapping[str, Any]

    def __post_init__(self) -> None:
        _validate.keys("change of physics", self.values, _validate.names_of(Physics))

    def apply(self, simulation: Target) -> None:
        """Change the physics."""
        simulation.change_physics(**self.values)
