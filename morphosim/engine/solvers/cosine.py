"""The implicit step by cosine transforms of each box, as products with dense matrices (BLAS)."""

import numpy as np
from numpy.typing import NDArray

from morphosim.engine.solvers.cosine_transforms import CosineTables, transform_cost
from morphosim.engine.solvers.solver import FixedSteps, MostOfAll, Solver, StepState
from morphosim.kernels.step import step_transform
from morphosim.numerics.parameters import Numerics
from morphosim.physics.parameters import Physics


def make(numerics: Numerics, dtype: np.dtype, threads: int) -> Solver:
    """Solver with the transforms that the numerics name; see `solver.make_solver`."""
    if numerics.transform == "matrix":
        return CosineSolver(numerics, dtype)
    from morphosim.engine.solvers.cosine_library import LibrarySolver

    return LibrarySolver(numerics, dtype, threads)


class CosineSolver(FixedSteps):
    """See `Solver`."""

    on_band = False
    nbytes = 0

    def __init__(self, numerics: Numerics, dtype: np.dtype) -> None:
        self.tables = CosineTables(numerics, dtype)

    def set_up(
        self, physics: Physics, tensions: NDArray[np.float64], present: NDArray[np.float64],
        explicit_rate: float,
    ) -> None:  # fmt: skip
        """See `Solver`."""

    def lay_out(self, shape: NDArray[np.int64]) -> None:
        """See `Solver`."""
        self.tables.require(shape)

    def cost(self, shape: NDArray[np.int64]) -> NDArray[np.float64]:
        """See `Solver`."""
        return transform_cost(shape)

    def advance(self, state: StepState, most_of_all: MostOfAll) -> None:
        """See `Solver`."""
        step_transform(
            *state.acting(), state.stencil, state.later, state.first, self.tables.arrays,
            state.limits, state.pool.surveys, *state.coupling.uses,
        )  # fmt: skip
