"""The linearly implicit step: Newton's method about an extrapolation, on the narrow band."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from morphosim.engine.box_pool import BoxPool
from morphosim.engine.scheduling import Schedule
from morphosim.engine.solvers.solver import Solver, StepState
from morphosim.engine.step_control import StepControl, Verdict
from morphosim.kernels.boxes import BAD, N_SURVEYED
from morphosim.kernels.layout import Linearisation
from morphosim.kernels.linearised import N_CHANGES, stretch, take_steps, try_steps
from morphosim.numerics.chebyshev import (
    MORE_WITHOUT_HISTORY,
    chebyshev_roots,
    largest_eigenvalue,
)
from morphosim.numerics.parameters import Numerics
from morphosim.numerics.schemes import stabilisation
from morphosim.physics.parameters import Physics

Floats = NDArray[np.float64]
WELL = 5.0
"""Largest W'' in terms of c: that at φ = -0.2 and 1.2."""
SHIFT = 0.4
"""k² / c of a shifted interface: ∫ φ''² / ∫ φ'² of the profile (1 + tanh(x √(c/2)))/ 2."""


def make(numerics: Numerics, dtype: np.dtype, threads: int) -> Solver:
    """See `solver.make_solver`."""
    return LinearisedSolver(numerics, dtype)


class LinearisedSolver:
    """See `Solver` and `kernels.linearised`."""

    on_band = True

    def __init__(self, numerics: Numerics, dtype: np.dtype) -> None:
        self._numerics, self._dtype = numerics, dtype
        self._control = None if numerics.tolerance is None else StepControl(numerics)
        self._before = self._laid = 1
        self._new = np.zeros(0, dtype)
        self._rows = np.zeros((0, 2), np.int32)
        self._surveys = np.zeros((0, N_SURVEYED))
        self._changes = np.zeros((0, N_CHANGES))

    @property
    def nbytes(self) -> int:
        """See `Solver`."""
        parts = (self._new, self._rows, self._surveys, self._changes)
        return sum(part.nbytes for part in parts)

    def set_up(
        self, physics: Physics, tensions: Floats, present: Floats, explicit_rate: float
    ) -> None:
        """See `Solver`."""
        self._rate = explicit_rate
        self._tau, self._c = physics.tau, physics.c
        self._stiffest = float(present.max()) if len(present) else 0.0
        self._lengths: dict[tuple[int, int], Any] = {}

    def lay_out(self, shape: NDArray[np.int64]) -> None:
        """See `Solver`."""

    def cost(self, shape: NDArray[np.int64]) -> Floats:
        """See `Solver`."""
        return np.asarray(shape.prod(axis=1), float)

    def fit(self, most: int, pool: BoxPool, schedule: Schedule) -> int:
        """See `Solver`."""
        if self._control is None:
            return 1
        if pool.cells["fresh"][schedule.order].any():
            self._control.begin()
        ticks = self._control.fitted(self._control.planned, most)
        self._lay(ticks, pool, schedule)
        return ticks

    def advance(self, state: StepState) -> int | None:
        """See `Solver`."""
        self._try(state)
        pool, order = state.pool, state.schedule.order
        verdict: Verdict | None = None
        growth = 1.0
        self._taken = state.ticks
        if self._control is not None:
            if not self._surveys[order, BAD].any():
                verdict = self._control.judge(
                    self._changes, state.ticks, self._before, self._damped(state.ticks),
                    pool.cells, order,
                )
            if shorter := self._control.shorter(state.ticks, verdict):
                self._control.planned = shorter
                self._lay(shorter, pool, state.schedule)
                return shorter
            if verdict is not None:
                pool.cells["acceleration"][order] = verdict.acceleration
                growth = self._control.plan(state.ticks, verdict) / state.ticks
        take_steps(
            state.schedule.bounds, order, self._target(pool), pool.phi, pool.history,
            self._dtype.type(growth), pool.boxes, self._rows, self._surveys, pool.surveys,
            pool.lost, pool.totals,
        )  # fmt: skip
        self._before = state.ticks
        self._laid = state.ticks if self._control is None else self._control.planned
        return None

    def _lay(self, ticks: int, pool: BoxPool, schedule: Schedule) -> None:
        """Lay φ* for a step of so many ticks."""
        if ticks != self._laid:
            stretch(
                schedule.bounds, schedule.order, pool.phi, pool.history,
                self._dtype.type(ticks / self._laid), pool.boxes, pool.totals,
            )  # fmt: skip
            self._laid = ticks

    def _target(self, pool: BoxPool) -> NDArray[np.floating]:
        """Pool for new fields; φ* gives its place where no step is tried again."""
        assert pool.history is not None
        return pool.history if self._control is None else self._new

    def _reserve(self, pool: BoxPool) -> None:
        if self._control is not None and len(self._new) != len(pool.phi):
            self._new = np.zeros(len(pool.phi), self._dtype)
        if len(self._rows) != len(pool.band):
            self._rows = np.zeros_like(pool.band)
        if len(self._changes) != len(pool):
            self._changes = np.zeros((len(pool), N_CHANGES))
            self._surveys = np.zeros((len(pool), N_SURVEYED))

    def _try(self, state: StepState) -> None:
        pool, real = state.pool, self._dtype.type
        self.tries = getattr(self, 'tries', 0) + 1
        self._reserve(pool)
        ratio = state.ticks / self._before
        rate = self._tau / (state.ticks * self._numerics.tick)
        later = rate * (1 + 2 * ratio) / (1 + ratio)
        counts, weights = self._iterations(len(pool), later, state)
        linear = Linearisation(
            lhs=np.where(state.terms.fresh, rate, later).astype(self._dtype),
            rate=real(rate),
            spread=real(self._spread(state.ticks)),
            stiffness=state.stiffness * self._numerics.spacing**3,
        )
        terms = state.terms._replace(n_iterations=counts, weights=weights)
        try_steps(
            *state._replace(terms=terms).acting(), state.workspace.found,
            state.workspace.measured, state.stencil, linear, state.limits, self._target(pool),
            self._rows, self._surveys, self._changes, *state.coupling.uses,
        )  # fmt: skip

    def _spread(self, ticks: int) -> float:
        """Stabilisation s of a step."""
        numerics, S = self._numerics, self._numerics.S
        if S is None or numerics.tolerance is not None:
            import os
            S = stabilisation(self._rate * float(os.environ.get("MM", "1.4")), ticks * numerics.tick, self._tau, numerics.scheme)
        return S / (2 * self._c)

    def _damped(self, ticks: int) -> float:
        return self._spread(ticks) * SHIFT * self._c / self._tau

    def _iterations(self, count: int, lhs: float, state: StepState) -> tuple[NDArray, NDArray]:
        damping = WELL * self._stiffest * self._c + state.coupling.strongest
        ticks = state.ticks
        key = count, ticks, lhs, damping
        if key not in self._lengths:
            numerics = self._numerics
            top = (self._stiffest + self._spread(ticks)) * largest_eigenvalue(
                numerics.order, numerics.spacing
            )
            roots = chebyshev_roots(
                lhs, 0.0, top + damping, numerics.sweeps + MORE_WITHOUT_HISTORY
            )
            weights = np.tile((1 / roots).astype(self._dtype), (count, 1))
            self._lengths[key] = np.full(count, len(roots)), weights
        return self._lengths[key]
