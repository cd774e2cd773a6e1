"""A simulation at the time of a save, and what is measured of it."""

from collections.abc import Callable, Iterator, Sequence
from functools import cached_property
from operator import attrgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from morphosim import _validate
from morphosim.cell_field import CellField
from morphosim.cell_table import Column
from morphosim.errors import warn
from morphosim.measure.aggregates import Aggregates
from morphosim.measure.measurement import Measurement
from morphosim.measure.motion import Positions, root_mean_square
from morphosim.measure.variable import (
    MEASURED,
    PER_CELL,
    PER_TIME,
    Measured,
    Variable,
    VariableError,
    measured,
    reserve,
)
from morphosim.runs.observed import Observed
from morphosim.runs.schema import names_in_files
from morphosim.scene.scene import Scene

Real = NDArray[np.float64]
Integers = NDArray[np.int64]

reserve(names_in_files())


class MeasuredState:
    """N living cells at one time: what a function with the decorator `measured` is given.

    `state["volume"]` is the value of any variable, without the axis of time; it is computed when it
    is first asked for, and kept.

    Parameters
    ----------
    simulation : Observed
        It must stay at this time.
    before : Positions, optional
        Where cells were, from which their speed is measured.
    events : str
        What has changed the simulation since the save before.
    """

    def __init__(
        self, simulation: Observed, before: Positions | None = None, events: str = ""
    ) -> None:
        self.simulation = simulation
        self._before, self._events = before, events
        self._values: dict[str, NDArray[Any]] = {}

    def __getitem__(self, name: str) -> NDArray[Any]:
        if name not in self._values:
            _validate.choice("variable", name, MEASURED)
            self._values[name] = self._measure(MEASURED[name])
        return self._values[name]

    @property
    def table(self) -> dict[str, NDArray[Any]]:
        """Values of all variables that the scene has by name, in the order of a file.

        Raises
        ------
        VariableError
            A variable cannot be measured.
        """
        return {name: self[name] for name in variables(self.simulation.scene)}

    @cached_property
    def names(self) -> Sequence[str]:
        """Names of the cells."""
        return self.simulation.names

    @cached_property
    def fields(self) -> list[CellField]:
        """Fields of the cells."""
        return list(self.simulation.fields)

    @cached_property
    def shapes(self) -> Measurement:
        """Shapes and contacts of the cells."""
        return self.simulation.measured()

    @cached_property
    def aggregates(self) -> Aggregates:
        """Aggregates of the cells."""
        return Aggregates(self.shapes, self.simulation.types)

    @cached_property
    def positions(self) -> Positions:
        """Where the cells are."""
        return Positions(self.simulation.time, self.names, self.shapes.centroid)

    @cached_property
    def boxes(self) -> tuple[Integers, Integers]:
        """Origin and shape of each cell's box, (N, 3) both, lattice points."""
        origin, shape = [f.origin for f in self.fields], [f.phi.shape for f in self.fields]
        return np.array(origin), np.array(shape)

    @measured(dims=PER_TIME, units="1", text="in silico time", extra={"axis": "T"})
    def time(self) -> float:
        """*In silico* time."""
        return self.simulation.time

    @measured(dims=PER_TIME, units="1", text="number of steps taken", kind="i8")
    def step(self) -> int:
        """Number of steps taken."""
        return self.simulation.steps

    @measured(dims=PER_TIME, units="um", text="root mean square of the cells' speed, per time")
    def rms_speed(self) -> float:
        """Root mean square of those speeds that are known; NaN if none is."""
        return root_mean_square(self.speed)

    @measured(dims=PER_CELL, units="um3", text="volume, integral of phi")
    def volume(self) -> Real:
        """(N,) ∫ φ, µm³."""
        return self.simulation.volumes

    @measured(dims=PER_CELL, units="um3", text="target volume V(t)")
    def target_volume(self) -> Real:
        """(N,) target volumes; NaN where a volume function fails, which has then ended the run."""
        try:
            return self.simulation.targets
        except (TypeError, ValueError):
            return np.full(len(self.names), np.nan)

    @measured(dims=PER_CELL, units="um3", text="volume of the lattice points with phi > 1/2")
    def core_volume(self) -> Real:
        """(N,) volume of the lattice points with φ > 1/2, µm³."""
        return self.simulation.core_volumes

    @measured(dims=(*PER_CELL, "axis"), units="um", text="centroid")
    def centroid(self) -> Real:
        """(N, 3) ∫ r φ / ∫ φ, µm."""
        return self.positions.centroids

    @measured(
        dims=PER_CELL, units="um",
        text="mean speed of the centroid, per time, over the last 10 time units or since the save "
        "before",
    )  # fmt: skip
    def speed(self) -> Real:
        """(N,) mean speed since `before`, µm per time; NaN where a cell was not there."""
        if self._before is None:
            return np.full(len(self.names), np.nan)
        return self.positions.speed(self._before)

    @measured(dims=(*PER_CELL, "axis"), units="um", text="first lattice point of the cell's box")
    def box_low(self) -> Real:
        """(N, 3) first lattice point of each box, µm."""
        return np.asarray(self.boxes[0] * self.simulation.scene.numerics.spacing)

    @measured(dims=(*PER_CELL, "axis"), units="um", text="last lattice point of the cell's box")
    def box_high(self) -> Real:
        """(N, 3) last lattice point of each box, µm."""
        return np.asarray(
            self.box_low + (self.boxes[1] - 1) * self.simulation.scene.numerics.spacing
        )

    @measured(
        dims=PER_CELL, units="1", text="largest |phi| so far at the faces of the cell's box or band"
    )
    def face_peak(self) -> Real:
        """(N,) certificate: largest |φ| so far at the faces of each box, or edge of its band."""
        return self.simulation.face_peak

    @measured(
        dims=PER_CELL, units="um3",
        text="integral of phi cut off by moving the box or band so far",
    )  # fmt: skip
    def lost_volume(self) -> Real:
        """(N,) certificate: ∫ φ that boxes and bands have cut off so far, µm³."""
        return self.simulation.lost_volume

    @measured(
        dims=PER_CELL, units="nm",
        text="error of the centroid by the time step so far, estimated as the run went",
    )  # fmt: skip
    def time_error(self) -> Real:
        """(N,) estimated error of the centroid in time, nm; see `Errors`."""
        return self.simulation.errors.time

    @measured(
        dims=PER_CELL, units="nm",
        text="error of the semi-axes (root mean square) by the time step so far, likewise",
    )  # fmt: skip
    def shape_error(self) -> Real:
        """(N,) estimated error of the semi-axes in time, nm."""
        return self.simulation.errors.shape

    @measured(
        dims=PER_CELL, units="nm",
        text="error of the centroid by the lattice so far, estimated as the run went",
    )  # fmt: skip
    def space_error(self) -> Real:
        """(N,) estimated error of the centroid in space, nm."""
        return self.simulation.errors.space

    @measured(dims=PER_CELL, units="1", text="in silico time since the cell's birth", column="born")
    def age(self) -> Real:
        """(N,) *in silico* time since birth, or since the start."""
        return self.simulation.time - self.simulation.column("born")

    @measured(
        dims=PER_CELL, units="1", text="divisions between a cell of the start and this one",
        column="generation",
    )  # fmt: skip
    def generation(self) -> Real:
        """(N,) divisions that have led to the cell."""
        return np.asarray(self.simulation.column("generation"), float)

    @measured(
        dims=PER_CELL, units="1", text="pressure 1 - v/V, volume over target volume",
        column="grown_from",
    )  # fmt: skip
    def pressure(self) -> Real:
        """(N,) pressures p = 1 - v/V of Eq. 10, over M'."""
        return np.asarray(1 - self.volume / self.target_volume)

    @measured(
        dims=(*PER_CELL, "axis"), units="1", text="direction in which the cell moves by itself",
        column="polarity",
    )  # fmt: skip
    def polarity(self) -> Real:
        """(N, 3) unit vectors p; NaN in stages without polarity."""
        if "polarity" not in {column.name for column in self.simulation.physics.columns}:
            return np.full((len(self.names), 3), np.nan)
        return self.simulation.column("polarity").copy()

    @measured(dims=PER_TIME, text="stage of the protocol", kind=str)
    def stage(self) -> str:
        """Name of the present stage."""
        return self.simulation.stage

    @measured(dims=PER_TIME, text="divisions, removals, changes since the save before", kind=str)
    def events(self) -> str:
        """What has changed the simulation since the save before."""
        return self._events

    @measured(dims=PER_CELL, text="type of the cell", kind=str)
    def type(self) -> Sequence[str]:
        """(N,) types."""
        return self.simulation.types

    def _measure(self, declared: Measured[Any]) -> NDArray[Any]:
        """Value of a variable, checked; of a run that an error has ended, absent if it fails."""
        part, variable = _PARTS.get(declared.owner), declared.variable
        try:
            value = self._call(declared) if part is None else getattr(part(self), declared.name)
            return variable.fitted(declared.name, value, len(self.names))
        except Exception as error:
            if not self.simulation.error:
                raise
            warn(f"the last save is without {declared.name}: {error}")
            return variable.absent(len(self.names))

    def _call(self, function: Measured[Any]) -> Any:
        """Value of a user's function."""
        try:
            return function(self)
        except VariableError:  # of another variable that it has asked for
            raise
        except Exception as error:
            message = (
                f"variable {function.name!r} cannot be computed at t = {self.simulation.time:g}: "
                f"{type(error).__name__}: {error}"
            )
            raise VariableError(message) from error


_PARTS: dict[Any, Callable[[MeasuredState], Any]] = {
    MeasuredState: lambda state: state,
    Measurement: attrgetter("shapes"),
    Aggregates: attrgetter("aggregates"),
}
"""Classes whose properties are variables, and where a state has them; all others are functions."""


def variables(scene: Scene | None = None) -> dict[str, Variable]:
    """Measured variables in the order of a file: numbers, then texts; users' after ours.

    Parameters
    ----------
    scene : Scene, optional
        Of whose runs; by default all that there are.
    """
    rank = {owner: k for k, owner in enumerate(_PARTS)}
    ordered = sorted(
        MEASURED.values(),
        key=lambda each: (each.variable.kind is str, rank.get(each.owner, len(rank))),
    )
    state = None if scene is None else {"", *map(attrgetter("name"), _state_of(scene))}
    return {each.name: each.variable for each in ordered if state is None or each.column in state}


def _state_of(scene: Scene) -> Iterator[Column]:
    """Columns that rules and force terms keep, at some time."""
    yield from scene.columns
    for term in scene.terms:
        yield from term.columns


def built_in_variables() -> dict[str, Variable]:
    """Those that every run has."""
    return {
        name: each for name, each in variables().items()
        if MEASURED[name].owner in _PARTS and not MEASURED[name].column
    }  # fmt: skip
