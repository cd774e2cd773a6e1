"""The linearly implicit step: Newton's method about an extrapolation, on the narrow band."""

import numpy as np
from numpy.typing import NDArray

from morphosim.engine.solvers.solver import Solver, StepState
from morphosim.kernels.layout import Linearisation
from morphosim.kernels.linearised import step_linearised
from morphosim.numerics.chebyshev import chebyshev_roots, largest_eigenvalue
from morphosim.numerics.parameters import Numerics
from morphosim.numerics.schemes import coefficients
from morphosim.physics.parameters import Physics

Floats = NDArray[np.float64]


def make(numerics: Numerics, dtype: np.dtype, threads: int) -> Solver:
    """See `solver.make_solver`."""
    return LinearisedSolver(numerics, dtype)


class LinearisedSolver:
    """See `Solver` and `kernels.linearised`."""

    on_band = True
    nbytes = 0

    def __init__(self, numerics: Numerics, dtype: np.dtype) -> None:
        self._numerics, self._dtype = numerics, dtype

    def set_up(self, physics: Physics, tensions: Floats, present: Floats) -> None:
        """See `Solver`."""
        numerics, real = self._numerics, self._dtype.type
        self._first, self._later = (
            coefficients(numerics, physics.tau, fresh)["lhs"] for fresh in (True, False)
        )
        spread = numerics.S / (2 * physics.c)
        self._scheme = {
            "rate": real(physics.tau / numerics.dt), "growth": real(1), "spread": real(spread),
        }  # fmt: skip
        stiffest = float(present.max()) if len(present) else 0.0
        top = (stiffest + spread) * largest_eigenvalue(numerics.order, numerics.spacing)
        roots = chebyshev_roots(self._later, 0.0, top + self._damping, numerics.sweeps)
        self._weights = np.tile((1 / roots).astype(self._dtype), (len(tensions), 1))
        self._counts = np.full(len(tensions), len(roots))

    _damping = 8.0

    def lay_out(self, shape: NDArray[np.int64]) -> None:
        """See `Solver`."""

    def cost(self, shape: NDArray[np.int64]) -> Floats:
        """See `Solver`."""
        return np.asarray(shape.prod(axis=1), float)

    def advance(self, state: StepState) -> None:
        """See `Solver`."""
        terms = state.terms._replace(n_iterations=self._counts, weights=self._weights)
        lhs = np.where(terms.fresh, self._first, self._later).astype(self._dtype)
        spacing = self._numerics.spacing
        linear = Linearisation(lhs=lhs, stiffness=state.stiffness * spacing**3, **self._scheme)
        pool = state.pool
        step_linearised(
            *state._replace(terms=terms).acting(), state.workspace.found,
            state.workspace.measured, state.stencil, linear, state.limits, pool.surveys, pool.lost,
            pool.totals, *state.coupling.uses,
        )  # fmt: skip
