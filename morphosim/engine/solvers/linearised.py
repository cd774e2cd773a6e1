"""The linearly implicit step: Newton's method about an extrapolation, on the narrow band."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from morphosim.engine.box_pool import BoxPool
from morphosim.engine.coupling import Coupling
from morphosim.engine.scheduling import Schedule
from morphosim.engine.solvers.solver import MostOfAll, Solver, StepState
from morphosim.engine.stencil import make_stencil
from morphosim.engine.step_control import PATIENCE, StepControl, make_whole, swept
from morphosim.kernels.boxes import BAD, N_SURVEYED
from morphosim.kernels.layout import Linearisation
from morphosim.kernels.linearised import N_CHANGES, stretch, take_steps, try_steps
from morphosim.numerics.chebyshev import (
    MORE_WITHOUT_HISTORY,
    chebyshev_roots,
    largest_eigenvalue,
)
from morphosim.numerics.parameters import Numerics
from morphosim.numerics.schemes import LEFT, SHIFT, SOLVED_ORDER, diffusion
from morphosim.physics.parameters import Physics

Floats = NDArray[np.float64]
MORE_AT_FIRST = 8
"""More iterations of a cell without history: u is all its motion then, and not what an
extrapolation has left."""
LOOK = 16
"""Steps between two looks at how many cells overlap; one more wherever cells have no history."""
WELL = 5.0
"""Largest W'' that fields come to, in c: that at φ = -0.2 and 1.2."""


def make(numerics: Numerics, dtype: np.dtype, threads: int) -> Solver:
    """See `solver.make_solver`."""
    return LinearisedSolver(numerics, dtype)


class LinearisedSolver:
    """See `Solver` and `kernels.linearised`.

    Attributes
    ----------
    before, laid : int
        Ticks of the last step, and of the step for which φ* is laid.
    """

    on_band = looks_ahead = True

    def __init__(self, numerics: Numerics, dtype: np.dtype) -> None:
        self._numerics, self._dtype = numerics, dtype
        self._inner = make_stencil(SOLVED_ORDER, numerics.spacing, dtype)
        self._control = StepControl(numerics) if numerics.tolerance else None
        self.before = self.laid = 1 if self._control is None else self._control.first
        self._taken, self._looks, self._crowding = 0, True, 0.0
        self._new = np.zeros(0, dtype)
        self._low = self._high = np.zeros(0, np.int16)
        self._surveys = np.zeros((0, N_SURVEYED))
        self._changes = np.zeros((0, N_CHANGES))

    @property
    def nbytes(self) -> int:
        """See `Solver`."""
        parts = (self._new, self._low, self._high, self._surveys, self._changes)
        return sum(part.nbytes for part in parts)

    @property
    def overdue(self) -> bool:
        """See `Solver`."""
        return self._control is not None and self._control.missed > PATIENCE

    def set_up(
        self, physics: Physics, tensions: Floats, present: Floats, explicit_rate: float
    ) -> None:
        """See `Solver`."""
        self._tau, self._c, self._rate = physics.tau, physics.c, explicit_rate
        self._random = any(term.random for term in physics.active_terms)
        self._stiffening = sum(term.stiffening for term in physics.active_terms)
        if self._control is not None:
            self._control.hold(self._random)
        self._stiffest = float(present.max()) if len(present) else 0.0
        self._iterations: dict[Any, tuple[NDArray, NDArray]] = {}

    def lay_out(self, shape: NDArray[np.int64]) -> None:
        """See `Solver`."""

    def cost(self, shape: NDArray[np.int64]) -> Floats:
        """See `Solver`."""
        return np.asarray(shape.prod(axis=1), float)

    def contents(self) -> dict[str, NDArray]:
        """See `Solver`."""
        planned, missed = (
            (1, 0) if self._control is None else (self._control.planned, self._control.missed)
        )
        steps = [self.before, self.laid, planned, missed, self._taken]
        return {"stepping": np.array(steps), "crowding": np.array([self._crowding])}

    def restore(self, contents: Mapping[str, NDArray]) -> None:
        """See `Solver`."""
        self.before, self.laid, planned, missed, *taken = np.asarray(contents["stepping"]).tolist()
        self._taken, self._crowding = 0, 0.0  # with which the next step looks
        if taken:  # not in states of earlier versions
            (self._taken,), self._crowding = taken, float(contents["crowding"][0])
        if self._control is not None:
            self._control.planned, self._control.missed = planned, missed

    def fit(self, most: int, fresh: bool) -> int:
        """See `Solver`."""
        self._looks = fresh or self._taken % LOOK == 0
        return 1 if self._control is None else self._control.fit(most, fresh)

    def make_ready(self, ticks: int, pool: BoxPool, schedule: Schedule) -> bool:
        """See `Solver`: lay φ* for a step of so many ticks."""
        if ticks == self.laid:
            return False
        stretch(
            schedule.shares, schedule.order, pool.phi, pool.acting,
            self._dtype.type(ticks / self.laid), pool.boxes, pool.totals,
        )  # fmt: skip
        self.laid = ticks
        return True

    def advance(self, state: StepState, most_of_all: MostOfAll) -> int | None:
        """See `Solver`."""
        self._try(state, self._strongest(state.coupling, most_of_all))
        if self._control is None:
            self._take(state, 1)
            return None
        shorter = self._settle(state, self._control, most_of_all)
        if shorter is None:
            self._take(state, self._control.planned)
        return shorter

    def _strongest(self, coupling: Coupling, most_of_all: MostOfAll) -> float:
        """About the largest R that any cell of the simulation may feel."""
        now = coupling.largest if self._looks else 0.0
        usual, now = most_of_all(np.array([coupling.strongest, now])).tolist()
        if self._looks:
            self._crowding = now
        return float(max(usual, self._crowding))

    def _settle(self, state: StepState, control: StepControl, most_of_all: MostOfAll) -> int | None:
        """Length to try instead of the step that was tried; None, and a plan, if it is taken."""
        cells, rows, ticks = state.pool.cells, state.schedule.order, state.ticks
        damped = self._spread(ticks) * SHIFT * self._c / self._tau
        verdict = control.judge(self._changes, ticks, self.before, damped, cells, rows)
        bad = np.inf if self._surveys[rows, BAD].any() else 0.0
        worst = np.array([max(verdict.excess, bad), control.reach(verdict, ticks)])
        excess, reach = most_of_all(np.nan_to_num(worst, nan=np.inf, posinf=np.inf)).tolist()
        if self._random and np.isfinite(excess):
            excess = reach = 0.0
        shorter = control.shorter(ticks, excess, reach)
        if shorter is None:
            control.plan(ticks, excess, reach)
            cells["acceleration"][rows] = verdict.acceleration
            cells["step_error"][rows] = verdict.shares
            if not self._random:  # noise itself is what is missed there
                speeds = np.linalg.norm(cells["error_speed"][rows, :3], axis=1)
                lost = swept(verdict.missed, ticks * self._numerics.tick, damped, speeds)
                cells["swept"][rows] += np.where(cells["fresh"][rows], 0.0, lost)
        return shorter

    def _take(self, state: StepState, planned: int) -> None:
        """Take the step that was tried, and lay φ* for one of `planned` ticks."""
        pool, schedule = state.pool, state.schedule
        take_steps(
            schedule.shares, schedule.order, self._target(pool), pool.phi, pool.acting,
            self._dtype.type(planned / state.ticks), pool.boxes, self._low, self._high,
            self._surveys, pool.surveys, pool.lost, pool.totals, state.workspace.room,
        )  # fmt: skip
        refused = schedule.order[self._surveys[schedule.order, BAD] > 0]
        pool.forget(refused.tolist())  # where φ* and the new field share a pool, φ* is gone
        self.before, self.laid = state.ticks, planned
        self._taken += 1

    def _target(self, pool: BoxPool) -> NDArray[np.floating]:
        """Pool for new fields; φ* gives its place where no step is tried again."""
        return pool.acting if self._control is None else self._new

    def _reserve(self, pool: BoxPool) -> None:
        if self._control is not None and len(self._new) != len(pool.phi):
            self._new = np.zeros(len(pool.phi), self._dtype)
        if len(self._low) != len(pool.low):
            self._low, self._high = np.zeros_like(pool.low), np.zeros_like(pool.high)
        if len(self._changes) != len(pool):
            self._changes = np.zeros((len(pool), N_CHANGES))
            self._surveys = np.zeros((len(pool), N_SURVEYED))

    def _try(self, state: StepState, strongest: float) -> None:
        """Solve for the new fields of a step, where R is at most about `strongest`."""
        pool, ticks, real = state.pool, state.ticks, self._dtype.type
        self._reserve(pool)
        rate = self._tau / (ticks * self._numerics.tick)
        growth = ticks / self.before
        later = rate * (1 + 2 * growth) / (1 + growth)
        fresh = state.terms.fresh
        spread = self._spread(ticks)
        counts, weights = self._weights(fresh, rate, later, strongest, spread)
        linear = Linearisation(
            lhs=np.where(fresh, rate, later).astype(self._dtype),
            rate=real(rate),
            spread=real(spread),
            stiffness=state.stiffness * self._numerics.spacing**3,
        )
        terms = state.terms._replace(n_iterations=counts, weights=weights)
        try_steps(
            *state._replace(terms=terms).acting(), pool.room, state.stencil, self._inner, linear,
            state.limits, self._target(pool), self._low, self._high, self._surveys, self._changes,
            *state.coupling.uses,
        )  # fmt: skip
        steepness = np.sqrt(self._c / 2) / 3 / self._numerics.spacing**3  # ∫ φ'² of the profile
        make_whole(self._changes, steepness, pool.cells["target"])

    def _spread(self, ticks: int) -> float:
        """The stabilisation s of a step, -s Δ."""
        length = ticks * self._numerics.tick
        return diffusion(
            self._numerics, self._c, self._tau, self._rate, length, self._stiffest,
            self._stiffening,
        )  # fmt: skip

    def _weights(
        self, fresh: NDArray[np.bool_], rate: float, later: float, strongest: float, spread: float
    ) -> tuple[NDArray, NDArray]:
        """Numbers and weights of the iterations of each cell."""
        damping = WELL * self._stiffest * self._c + strongest
        stiffness = self._stiffest + spread
        key = fresh.tobytes(), rate, later, stiffness, damping
        if key not in self._iterations:
            numerics = self._numerics
            top = stiffness * largest_eigenvalue(SOLVED_ORDER, numerics.spacing) + damping
            least = numerics.sweeps + MORE_WITHOUT_HISTORY
            roots = [
                chebyshev_roots(later, 0.0, top, least, LEFT),
                chebyshev_roots(rate, 0.0, top, least + MORE_AT_FIRST, LEFT),
            ]
            counts = np.array([len(values) for values in roots])
            weights = np.zeros((2, counts.max()), self._dtype)
            for row, values in zip(weights, roots, strict=True):
                row[: len(values)] = 1 / values
            which = fresh.astype(np.int64)
            self._iterations = {key: (counts[which], weights[which])}
        return self._iterations[key]
