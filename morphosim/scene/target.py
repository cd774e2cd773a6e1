"""What events, stages and rules may ask of a simulation, and do to it."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Annotated, Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from morphosim import _validate
from morphosim.cell_field import CellField
from morphosim.measure.measurement import Measurement
from morphosim.physics.parameters import Physics

PhysicsValues = Annotated[Mapping[str, Any], Physics]
"""Values of `Physics` by name; a field of this type is said in scene files as their physics is."""


def check_physics(where: str, values: Any) -> None:
    """Raise ValueError or TypeError unless these are values of `Physics`."""
    _validate.keys(where, values, _validate.names_of(Physics))
    Physics(**values)


class LivingCell(Protocol):
    """A cell that is alive: a row of `Target.cells`."""

    @property
    def name(self) -> str:
        """Name, unique among all cells of the run."""

    @property
    def type(self) -> str:
        """Cell type."""

    @property
    def parent(self) -> str:
        """Name of the mother; "" where it is not known."""


class Changeable(Protocol):
    """What can be changed: a simulation, or what is foreseen of it."""

    @property
    def names(self) -> Sequence[str]:
        """Names of the N living cells."""

    @property
    def physics(self) -> Physics:
        """The physics that hold now."""

    def divide(
        self,
        cell: str,
        daughters: tuple[str, str],
        *,
        axis: ArrayLike,
        fraction: float = 0.5,
        types: tuple[str, str] | None = None,
        volumes: Any = None,
        over: float = 0.0,
    ) -> None:
        """Divide a cell; see `Simulation.divide`."""

    def divide_cells(
        self,
        cells: Sequence[str],
        daughters: Sequence[tuple[str, str]] | None = None,
        *,
        axes: ArrayLike,
        fractions: ArrayLike = 0.5,
        types: Sequence[tuple[str, str]] | None = None,
        volumes: Any = None,
        over: float = 0.0,
    ) -> None:
        """Divide several cells at once; see `Simulation.divide_cells`."""

    def die(self, cells: Iterable[str], over: float) -> None:
        """Let cells shrink and be gone; see `Simulation.die`."""

    def finish_divisions(self) -> None:
        """Cut the cells that are dividing; see `Simulation.finish_divisions`."""

    def remove(self, cells: Iterable[str]) -> None:
        """Take cells out."""

    def change_cells(self, cells: Iterable[str], **values: Any) -> None:
        """Give cells another type, surface tension, target volume, or freeze or thaw them."""

    def change_physics(self, **values: Any) -> None:
        """Give the physics other values."""

    def stop(self, why: str) -> None:
        """End the run after the present step; see `Simulation.stop`."""


class Foreseen(Changeable, Protocol):
    """What is known of a simulation before its first step; see `scene.rehearsal`."""

    def check_type(self, name: str, kind: str) -> None:
        """Raise ValueError if no cell can ever have this type."""

    def surprise(self, event: Any) -> None:
        """Take into account that an event may bring about cells that are not known."""


class Target(Changeable, Protocol):
    """A simulation, as seen by what changes it between two steps.

    Attributes
    ----------
    since_rules : float
        *In silico* time since the rules of the stage were last applied; 0 at its start.
    rule : int
        Number of the rule that is being applied, among those of its stage.
    """

    since_rules: float
    rule: int

    @property
    def time(self) -> float:
        """*In silico* time."""

    @property
    def spacing(self) -> float:
        """Lattice spacing, µm."""

    @property
    def cells(self) -> Sequence[LivingCell]:
        """The living cells."""

    @property
    def types(self) -> Sequence[str]:
        """Their types."""

    @property
    def fields(self) -> Sequence[CellField]:
        """Their fields."""

    @property
    def centroids(self) -> NDArray[np.float64]:
        """(N, 3) centroids, µm."""

    @property
    def volumes(self) -> NDArray[np.float64]:
        """(N,) volumes ∫ φ, µm³."""

    @property
    def targets(self) -> NDArray[np.float64]:
        """(N,) target volumes V(t), µm³."""

    @property
    def pressures(self) -> NDArray[np.float64]:
        """(N,) pressures p = 1 - v/V."""

    def column(self, name: str) -> NDArray[Any]:
        """(N, …) values of a column of the cell table."""

    def ready(self, types: Sequence[str] = ()) -> NDArray[np.bool_]:
        """(N,) which cells rules may act on: of these types, and not frozen, dying or dividing."""

    def chance(self, purpose: str, again: bool = False) -> NDArray[np.float64]:
        """(N, 3) standard normal numbers of each cell; see `Simulation.chance`."""

    def field(self, cell: str) -> CellField:
        """Field of one cell."""

    def measured(self) -> Measurement:
        """Shapes and contacts of all cells."""

    def grow(
        self, cells: NDArray[np.bool_], rates: ArrayLike, *, law: str = "exponential",
        limit: float = np.inf,
    ) -> None:  # fmt: skip
        """Let target volumes grow; see `Simulation.grow`."""
