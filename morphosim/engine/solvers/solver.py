"""What a solver of the implicit step is."""

from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from morphosim.engine.box_pool import BoxPool
from morphosim.engine.coupling import Coupling
from morphosim.engine.scheduling import Schedule
from morphosim.engine.workspace import Workspace
from morphosim.kernels.layout import CellTerms, Limits, Scheme, Stencil
from morphosim.numerics.parameters import SOLVERS, Numerics
from morphosim.physics.parameters import Physics

Floats = NDArray[np.float64]
MostOfAll = Callable[[Floats], Floats]


class StepState(NamedTuple):
    """What a step works on."""

    schedule: Schedule
    pool: BoxPool
    terms: CellTerms
    """Numbers of each cell; `weights` and `n_iterations` are for the solver to fill in."""
    coupling: Coupling
    workspace: Workspace
    stencil: Stencil
    limits: Limits
    later: Scheme
    """The scheme of cells with history."""
    first: Scheme
    """The scheme of cells without."""
    ticks: int
    """Length of the step."""
    stiffness: NDArray[np.float64]
    """(N,) - ∂p/∂v: how the pressures fall as volumes rise, per µm³."""

    def acting(self) -> tuple[Any, ...]:
        """What all step kernels begin with: cells, fields, and what acts on them."""
        pool, coupling = self.pool, self.coupling
        return (
            self.schedule.shares, self.schedule.order, pool.phi, pool.history, pool.boxes,
            self.terms, coupling.interaction, coupling.columns, *coupling.pairs,
            self.workspace.room,
        )  # fmt: skip


class Solver(Protocol):
    """Advances the cells by one step: force, implicit solve, survey.

    Attributes
    ----------
    on_band : bool
        Whether it works on the narrow band alone, outside of which φ is 0.
    looks_ahead : bool
        Whether forces are taken at the end of the step, and not at its begin.
    overdue : bool
        Whether the shortest steps have missed the tolerance for so long that the run should end.
    """

    on_band: bool
    looks_ahead: bool

    @property
    def overdue(self) -> bool:
        """See above."""

    def set_up(
        self, physics: Physics, tensions: NDArray[np.float64], present: NDArray[np.float64],
        explicit_rate: float,
    ) -> None:  # fmt: skip
        """Take over parameters and the surface tensions (N,) of the cells.

        `present` has all different surface tensions of the simulation, ascending; for
        `explicit_rate` see `Engine`.
        """

    def lay_out(self, shape: NDArray[np.int64]) -> None:
        """Be ready for boxes of these shapes (N, 3)."""

    def cost(self, shape: NDArray[np.int64]) -> NDArray[np.float64]:
        """(N,) relative work of boxes of these shapes (N, 3)."""

    def fit(self, most: int, fresh: bool) -> int:
        """Length of the next step in ticks, at most `most`.

        `fresh` tells whether any cell of the simulation begins it without history.
        """

    def make_ready(self, ticks: int, pool: BoxPool, schedule: Schedule) -> bool:
        """Prepare for a step of so many ticks; tell if fields in which forces are taken changed."""

    def advance(self, state: StepState, most_of_all: MostOfAll) -> int | None:
        """Advance the cells of the schedule, and survey them.

        If it gives a number, all is as before, and a step of so many ticks is to be tried instead.
        `most_of_all` gives the largest of numbers over all ranks, one by one.
        """

    def contents(self) -> dict[str, NDArray[Any]]:
        """What the next step depends on, besides the state of the cells."""

    def restore(self, contents: Mapping[str, NDArray[Any]]) -> None:
        """Go on from what `contents` gave."""

    @property
    def nbytes(self) -> int:
        """Bytes of what grows with the cells."""


class FixedSteps:
    """What solvers have in common whose steps are all δt, and take forces at their begin."""

    looks_ahead = overdue = False

    def fit(self, most: int, fresh: bool) -> int:
        """See `Solver`."""
        return 1

    def make_ready(self, ticks: int, pool: BoxPool, schedule: Schedule) -> bool:
        """See `Solver`."""
        return False

    def contents(self) -> dict[str, NDArray[Any]]:
        """See `Solver`."""
        return {}

    def restore(self, contents: Mapping[str, NDArray[Any]]) -> None:
        """See `Solver`."""


def make_solver(numerics: Numerics, dtype: np.dtype, threads: int) -> Solver:
    """Solver that the numerics name; its module has a function `make` of the same parameters.

    Parameters
    ----------
    numerics : Numerics
    dtype : of the fields
    threads : int
    """
    module = import_module(f"morphosim.engine.solvers.{SOLVERS[numerics.active_solver]}")
    solver: Solver = module.make(numerics, dtype, threads)
    return solver
