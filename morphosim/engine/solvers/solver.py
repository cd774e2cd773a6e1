"""What a solver of the implicit step is."""

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
            self.schedule.bounds, self.schedule.order, pool.phi, pool.history, pool.boxes,
            self.terms, coupling.interaction, coupling.columns, *coupling.pairs,
            self.workspace.frames,
        )  # fmt: skip


class Solver(Protocol):
    """Advances the cells by one step: force, implicit solve, survey.

    Attributes
    ----------
    on_band : bool
        Whether it works on the narrow band alone, outside of which φ is 0.
    """

    on_band: bool

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

    def fit(self, most: int, pool: BoxPool, schedule: Schedule) -> int:
        """Length of the next step in ticks, at most `most`; fields are made ready for it."""

    def advance(self, state: StepState) -> int | None:
        """Advance the cells of the schedule, and survey them.

        If it gives a number, all is as before, and a step of so many ticks is to be tried instead.
        """

    @property
    def nbytes(self) -> int:
        """Bytes of what grows with the cells."""


class FixedSteps:
    """What solvers have in common whose steps are all of one tick."""

    def fit(self, most: int, pool: BoxPool, schedule: Schedule) -> int:
        """See `Solver`."""
        return 1


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
