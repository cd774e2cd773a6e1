"""What is modelled: cells, their physics and confinement, and how they are solved."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from typing import Any

from numpy.typing import ArrayLike

from morphosim import _shown, _validate
from morphosim.cell_field import CellField
from morphosim.cell_table import Column
from morphosim.geometry.confinement import Confinement
from morphosim.geometry.shapes import Field, PowerCell
from morphosim.numerics.parameters import Numerics
from morphosim.physics.parameters import Physics
from morphosim.physics.term import Term
from morphosim.scene.cell import Cell, tensions
from morphosim.scene.ends import CellCount, Duration
from morphosim.scene.rehearsal import Rehearsal, rehearse
from morphosim.scene.stages import Stage

ON_VANISH = ("stop", "remove", "ignore")
SHORTEST = 8
"""Least length of a period, in lattice steps."""
SAVE_FIELDS = ("packed", "exact", "none")


@dataclass(frozen=True, slots=True, kw_only=True)
class Scene:
    """Everything a simulation starts from.

    Attributes
    ----------
    cells : sequence of Cell
    physics : Physics
    numerics : Numerics
    confinement : Confinement or None
        None is open space.
    period : (3,)
        Lengths in µm after which space repeats along x, y and z, from 0 on; 0 where it does not.
        Each is a multiple of the spacing.
    duration : float
        *In silico* time at which a run ends.
    save_every : float
        *In silico* time between two saves, which are made after steps: at most one for each.
    save_fields : {"packed", "exact", "none"}
        Fields in each save: to 6e-5 in two bytes per value, as they are (about six times as
        large), or none. Going on with a run needs none of them.
    save_labels : bool
        Whether each save also has a label image: which cell is where.
    on_vanish : {"stop", "remove", "ignore"}
        What happens when a cell is below 1/2 everywhere.
    stages : sequence of Stage
        A protocol: the run ends with the last stage, or at `duration`.
    name, description : str

    Raises
    ------
    ValueError
        No cells, duplicate names, or attraction between cells or types that do not exist.
    """

    cells: Sequence[Cell]
    physics: Physics = field(default_factory=Physics)
    numerics: Numerics = field(default_factory=Numerics)
    confinement: Confinement | None = None
    period: Sequence[float] = (0.0, 0.0, 0.0)
    duration: float = 100.0
    save_every: float = 100.0
    save_fields: str = "packed"
    save_labels: bool = False
    on_vanish: str = "stop"
    stages: Sequence[Stage] = ()
    name: str = "scene"
    description: str = ""

    def __post_init__(self) -> None:
        for name, kind in (("cells", Cell), ("stages", Stage)):
            parts = _validate.several(f"scene.{name}", getattr(self, name), name)
            for k, part in enumerate(parts):
                _validate.instance(f"scene.{name}[{k}]", part, kind)
            object.__setattr__(self, name, parts)
        if not self.cells:
            message = "scene.cells is empty; a scene needs at least one cell"
            raise ValueError(message)
        _validate.instance("scene.physics", self.physics, Physics)
        _validate.instance("scene.numerics", self.numerics, Numerics)
        _check_confinement("scene.confinement", self.confinement)
        object.__setattr__(self, "period", _checked_period(self.period, self.numerics.spacing))
        _validate.label("scene.name", self.name, empty=True)
        _validate.text("scene.description", self.description)
        _validate.unique("cell name", self.names)
        _validate.number("scene.duration", self.duration, least=0)
        _validate.number("scene.save_every", self.save_every, above=0)
        self.numerics.ticks_to(self.duration, "scene.duration")
        _validate.choice("scene.save_fields", self.save_fields, SAVE_FIELDS)
        _validate.flag("scene.save_labels", self.save_labels)
        _validate.choice("scene.on_vanish", self.on_vanish, ON_VANISH)
        self.physics.check(self.possible_names, self.possible_types)

    def __repr__(self) -> str:
        return _shown.text_of(self._title(), self._facts())

    def _repr_html_(self) -> str:
        head = ("cell", "type", "starts from", "V(0), µm³")
        rows = (
            (cell.name, cell.type, type(cell.shape).__name__, f"{cell.target_volume(0.0):.4g}")
            for cell in self.cells
        )
        return _shown.html_of(self._title(), self._facts(), head, rows, len(self.cells))

    def _title(self) -> str:
        return f"Scene {_shown.short(self.name)}"

    def _facts(self) -> dict[str, str]:
        """What the scene is, by name."""
        numerics = self.numerics
        S = "S chosen by the run" if numerics.S is None else f"S = {numerics.S:g}"
        return {
            "cells": f"{len(self.cells)}: {_shown.listed(self.names)}",
            "types": _shown.listed(sorted({kind for kind in self.types if kind})),
            "physics": self.physics.summary,
            "numerics": f"{numerics.step_text}, spacing {numerics.spacing:g} µm, {S}"
            f", {', '.join(dict.fromkeys((numerics.scheme, numerics.active_solver)))}",
            "confinement": type(self.confinement).__name__ if self.confinement else "open space",
            "period": " x ".join(f"{v:g}" if v else "-" for v in self.period) + " µm"
            if any(self.period)
            else "",
            "duration": f"{self.duration:g}, a save every {self.save_every:g}",
            "stages": _shown.listed([stage.name for stage in self.stages]),
        }

    def rehearsed(self) -> Rehearsal:
        """What will be at the end of the stages, as far as can be told before the first step.

        Raises
        ------
        ValueError, TypeError
            An event or the physics of a stage is not allowed at its time, or names cells or types
            that are not there then. A scene that begins with a later stage (`from_stage`) may do
            so until it has its cells.
        """
        rehearsal = Rehearsal(
            cells={cell.name: cell.shape.volume if cell.volume is None else cell.volume
                   for cell in self.cells},
            physics=self.physics, numerics=self.numerics, possible_names=self.possible_names,
            possible_types=self.possible_types, used={*self.names, *self.parents} - {""},
        )  # fmt: skip
        rehearse(rehearsal, self.stages, self.duration)
        return rehearsal

    @property
    def names(self) -> list[str]:
        """Names of the cells, in order."""
        return [cell.name for cell in self.cells]

    @property
    def types(self) -> list[str]:
        """Types of the cells, in order."""
        return [cell.type for cell in self.cells]

    @property
    def end(self) -> float | None:
        """*In silico* time at which a run ends; None if the state of the cells says so."""
        if not self.stages:
            return self.duration
        times = [s.end.time for s in self.stages if isinstance(s.end, Duration)]
        return min(sum(times), self.duration) if len(times) == len(self.stages) else None

    @property
    def latest_end(self) -> float:
        """*In silico* time at which a run ends at the latest."""
        times = [stage.longest for stage in self.stages]
        return min(sum(times), self.duration) if times else self.duration

    @property
    def courses(self) -> list[Physics]:
        """The physics at the start, and from each stage or event on that changes them."""
        return self.rehearsed().courses

    @property
    def possible_types(self) -> list[str]:
        """Types that cells have, or may get by events, in alphabetical order."""
        return sorted(set(self.types).union(*(stage.makes for stage in self.stages)))

    @property
    def columns(self) -> list[Column]:
        """State per cell that events and rules of its stages keep."""
        return list(dict.fromkeys(c for stage in self.stages for c in stage.columns))

    @property
    def terms(self) -> list[Term]:
        """Force terms that it states, at the start or in a stage, besides those of `Physics`."""
        staged = (stage.physics.get("terms", ()) for stage in self.stages)
        return [*self.physics.terms, *chain.from_iterable(staged)]

    @property
    def may_be_several(self) -> bool:
        """Whether there may ever be more than one cell, as far as events tell."""
        divides = any(stage.divides for stage in self.stages)
        return len(self.cells) > 1 or divides or len(self.possible_names) > 1

    @property
    def most_cells(self) -> int:
        """Number of cells that it starts with, or to which a stage is said to go on."""
        ends = [stage.end.cells for stage in self.stages if isinstance(stage.end, CellCount)]
        return max([len(self.cells), *ends])

    @property
    def possible_names(self) -> list[str]:
        """Names of the cells, and of those that divisions may bring about."""
        born = (name for stage in self.stages for name in stage.daughters)
        return list(dict.fromkeys([*self.names, *born]))

    @property
    def parents(self) -> list[str]:
        """Names of the cells' mothers, in order; "" where they are not known."""
        return [cell.parent for cell in self.cells]

    @property
    def tensions(self) -> list[float]:
        """Surface tension γ of each cell, in order."""
        return tensions(self.cells, self.physics)

    @classmethod
    def from_points(
        cls,
        names: Sequence[str],
        positions: ArrayLike,
        volumes: ArrayLike,
        confinement: Confinement | None = None,
        **options: Any,
    ) -> "Scene":
        """Scene whose cells fill the confinement as its power partition at the given volumes.

        Parameters
        ----------
        names : N names
        positions : (N, 3) µm, for example of nuclei
        volumes : (N,) µm³
        confinement : Confinement or None
        **options
            Other fields of `Scene`.

        Raises
        ------
        ValueError
            A position lies outside the confinement, or the volumes do not fit into it.
        """
        cells = [
            Cell(name=name, shape=shape)
            for name, shape in zip(
                names, power_cells(names, positions, volumes, confinement), strict=True
            )
        ]
        return cls(cells=cells, confinement=confinement, **options)

    def with_fields(self, fields: Iterable[CellField], spacing: float) -> "Scene":
        """Copy of the scene whose cells start from fields, at the target volumes that they have.

        Parameters
        ----------
        fields : of all cells, in any order
        spacing : float
            Lattice spacing of the fields, µm.

        Raises
        ------
        ValueError
            A cell has no field.
        """
        known = {field.name: field for field in fields}
        cells = []
        for cell in self.cells:
            _validate.choice(f"field of a cell of scene {self.name!r}", cell.name, known)
            field = known[cell.name]
            shape = Field(phi=field.phi.copy(), origin=field.origin * spacing, spacing=spacing)
            volume = cell.shape.volume if cell.volume is None else cell.volume
            cells.append(replace(cell, shape=shape, volume=volume))
        return replace(self, cells=cells)

    def from_stage(self, name: str) -> "Scene":
        """Copy of the scene that begins with a later stage, for a start from a saved run.

        Its duration is shorter by the stages left out that last for a set time.

        Raises
        ------
        ValueError
            There is no stage of this name.
        """
        names = [stage.name for stage in self.stages]
        _validate.choice(f"stage of scene {self.name!r}", name, names)
        first = names.index(name)
        lapse = sum(s.end.time for s in self.stages[:first] if isinstance(s.end, Duration))
        return replace(self, stages=self.stages[first:], duration=max(self.duration - lapse, 0.0))

    def with_numerics(self, **changes: Any) -> "Scene":
        """Copy of the scene with some numerical parameters changed."""
        return replace(self, numerics=replace(self.numerics, **changes))

    def with_physics(self, **changes: Any) -> "Scene":
        """Copy of the scene with some physical parameters changed."""
        return replace(self, physics=replace(self.physics, **changes))


def _check_confinement(name: str, value: Any) -> None:
    """Raise TypeError unless a value is a confinement, or None for open space."""
    if value is not None and not all(hasattr(value, part) for part in ("field", "depth", "bounds")):
        message = f"{name} = {_validate.brief(value)} is not a confinement (with field, depth and "
        message += "bounds), nor None"
        raise TypeError(message)


def _checked_period(period: ArrayLike, spacing: float) -> tuple[float, ...]:
    """The lengths as numbers; ValueError unless each is 0 or a multiple of the spacing."""
    lengths = _validate.vector("scene.period", period)
    for axis, length in zip("xyz", lengths.tolist(), strict=True):
        steps = length / spacing
        if length < 0 or (length and (steps < SHORTEST or abs(steps - round(steps)) > 1e-6)):
            near = max(round(steps), SHORTEST) * spacing
            message = (
                f"scene.period = {length:g} along {axis} is not allowed: it must be 0, or at least "
                f"{SHORTEST * spacing:g} and a multiple of numerics.spacing = {spacing:g}; "
                f"{near:.6g} is one"
            )
            raise ValueError(message)
    return tuple(lengths.tolist())


def power_cells(
    names: Sequence[str],
    positions: ArrayLike,
    volumes: ArrayLike,
    confinement: Confinement | None,
) -> list[PowerCell]:
    """Shapes of the cells of a power partition; see `Scene.from_points`."""
    from morphosim.geometry.power_partition import power_partition

    names = _validate.labels("names", names)
    _check_confinement("confinement", confinement)
    points = _validate.array("positions", positions, (len(names), 3))
    wanted = _validate.array("volumes", volumes, (len(names),))
    partition = power_partition(points, wanted, confinement)
    return [
        PowerCell(partition=partition, cell=i, volume=float(v), confinement=confinement)
        for i, v in enumerate(wanted)
    ]
