"""The implicit step by Chebyshev iterations on the narrow band, or the explicit one of Euler."""

import numpy as np
from numpy.typing import NDArray

from morphosim.engine.solvers.solver import FixedSteps, MostOfAll, Solver, StepState
from morphosim.kernels.layout import CellTerms
from morphosim.kernels.step import step_band
from morphosim.numerics.chebyshev import (
    MORE_WITHOUT_HISTORY,
    chebyshev_roots,
    largest_eigenvalue,
)
from morphosim.numerics.parameters import Numerics
from morphosim.numerics.schemes import coefficients, used_S
from morphosim.physics.parameters import Physics

Floats = NDArray[np.float64]


def make(numerics: Numerics, dtype: np.dtype, threads: int) -> Solver:
    """See `solver.make_solver`."""
    return BandSolver(numerics, dtype)


class BandSolver(FixedSteps):
    """See `Solver`; cells without history take more iterations than others."""

    on_band = True
    nbytes = 0

    def __init__(self, numerics: Numerics, dtype: np.dtype) -> None:
        self._numerics, self._dtype = numerics, dtype

    def set_up(
        self, physics: Physics, tensions: Floats, present: Floats, explicit_rate: float
    ) -> None:
        """See `Solver`."""
        index = np.searchsorted(present, tensions)
        S = used_S(self._numerics, physics.tau, explicit_rate)
        later, first = (self._weights(physics, present, S, fresh)[index] for fresh in (False, True))
        self._counts = np.array([later.shape[1], first.shape[1]])
        self._later_counts = np.full(len(tensions), later.shape[1])
        self._weights_of = np.zeros((2, len(tensions), self._counts.max()), self._dtype)
        self._weights_of[0, :, : later.shape[1]] = later
        self._weights_of[1, :, : first.shape[1]] = first

    def lay_out(self, shape: NDArray[np.int64]) -> None:
        """See `Solver`."""

    def cost(self, shape: NDArray[np.int64]) -> Floats:
        """See `Solver`."""
        return np.asarray(shape.prod(axis=1), float)

    def advance(self, state: StepState, most_of_all: MostOfAll) -> None:
        """See `Solver`."""
        step_band(
            *state._replace(terms=self.with_weights(state.terms)).acting(), state.pool.room,
            state.stencil, state.later, state.first, state.limits, state.pool.surveys,
            state.pool.lost, *state.coupling.uses,
        )  # fmt: skip

    def with_weights(self, terms: CellTerms) -> CellTerms:
        """Numbers of each cell, with the iterations of this step."""
        if not terms.fresh.any():
            return terms._replace(n_iterations=self._later_counts, weights=self._weights_of[0])
        fresh = terms.fresh.astype(np.int64)
        weights = self._weights_of[fresh, np.arange(len(fresh))]
        return terms._replace(n_iterations=self._counts[fresh], weights=weights)

    def _weights(self, physics: Physics, present: Floats, S: float, fresh: bool) -> Floats:
        """(tensions, iterations) weights of the iterations for these surface tensions."""
        numerics = self._numerics
        if numerics.scheme == "euler":
            return np.full((len(present), 1), numerics.dt / physics.tau)
        lhs = coefficients(numerics, physics.tau, S, fresh)["lhs"]
        extrapolates = numerics.scheme == "bdf2" and not fresh
        top = largest_eigenvalue(numerics.order, numerics.spacing, physics.interface_scale)
        least = numerics.sweeps + (0 if extrapolates else MORE_WITHOUT_HISTORY)
        while True:
            roots = [
                chebyshev_roots(lhs, gamma * physics.c, gamma * top, least)
                for gamma in present.tolist()
            ]
            if max(map(len, roots)) == least:
                return 1 / np.array(roots)
            least = max(map(len, roots))
