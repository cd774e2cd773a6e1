"""How accurate a run is: each cell's error in time and in space, carried along as it goes.

A cell's place is its centroid and its shape (second moments without their trace). Every scheme
makes a known error per step. In Eq. 9, S acts as inertia: velocities v follow forces with the lag
L = S δt²/τ, so that an error e of the place obeys e' = J e - L v', J the motion linearised, and
begins with -L v after a stabilised first step. Eq. 8 slows time by 1 + S δt/τ, e' = J e - S δt/τ v,
and explicit Euler has L = δt/2. To S adds what the double well makes explicitly, `SHIFT` γ c;
"linearised" has that implicit, and of S what its diffusion s makes of the interface. Backward
differences add δt²/3 v'', which is taken as δt²/3 |v'|/|v| v'. With a tolerance L is the mean over
the steps from one look at the cell to the next, and what steps miss besides the cell's place is
added (`step_control.swept`).

Velocities obey v' = J v, so J is taken as the rate at which the cell's own velocity changes, all
its nine components together. Before S lets a velocity follow its force, that rate is not known;
there two errors are carried on, one with J = 0 and one with the rate of the force, and their root
mean square is stated: where one of them changes its sign, the other does not.

In space, the force is looked at by two stencils now and then. That part of it which gradients make
moves the centroid with another velocity by each; the difference, times what is known of its share
for an interface of this width, is the source of e. A wall that the lattice resolves, of
strength g', lets a cell out by 0.8 (p - 0.2 γ) / g' more than a hard one does, p its pressure: from
solutions in one dimension. A stepped wall is off by h/4. That displaces the cell by as much if
walls press it from one side, by nothing if from all sides.

`benchmarks/stated.py` compares all this with true errors (docs/accuracy.md).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from morphosim._shown import short_repr
from morphosim.cell_table import CellTable, Column
from morphosim.engine.box_pool import BoxPool
from morphosim.engine.scheduling import Schedule
from morphosim.engine.solvers.solver import StepState
from morphosim.geometry.confinement import Confinement
from morphosim.kernels.defects import (
    BORN,
    DECAY,
    MEASURED,
    N_CLOCK,
    PLACE,
    STEP,
    TIME,
    WALL,
    WAY,
    begin,
    interval,
    look,
    measure_defects,
)
from morphosim.numerics.parameters import FITTED, Numerics
from morphosim.numerics.schemes import SHIFT, diffusion, used_S
from morphosim.numerics.stencils import stencil_weights
from morphosim.physics.confinement_repulsion import is_resolved, wall_strength
from morphosim.physics.parameters import Physics

Floats = NDArray[np.float64]
SHARE = 0.3
"""Error of the sixth-order gradient at √(c/2) h = 0.5, over its difference from the fourth-order
one, as it acts on centroids; it grows as h². Measured with tenth order: 0.17 to 0.38."""
FITTED_SHARE = 0.6
"""Of that error, with fitted weights."""
BEYOND_SIXTH = 1.1
"""Error of a lower order over its difference from the sixth."""
OUT, MATCHED = 0.8, 0.2
"""Of a wall that the lattice resolves: how far it lets a cell out, in p / g', less for the pressure
at which it is matched, in γ per µm."""
STEPPED = 0.25
"""Of a wall that it does not, in h."""
AGES, LONGEST = (2, 16, 128), 256
"""Ages in steps at which a cell's defects are looked at, and how often they are beyond."""
FLOOR_TIME, FLOOR_SPACE = 0.05, 400.0
"""Least errors stated, nm, that in space per `box_tolerance`: rounding, tails that boxes cut."""
COARSE, OF_THE_WAY = 0.16, 0.01
"""Error in space from which on the lattice is called too coarse, in spacings, and as a share of the
way that the cells have gone."""
_NEVER = 1 << 62
COLUMNS = (
    Column("error_place", shape=(PLACE,), inherits=False, optional=True),
    Column("error_speed", shape=(PLACE,), inherits=False, optional=True),
    Column("error_time", shape=(2, PLACE), optional=True),
    Column("error_space", shape=(3,), optional=True),
    Column("error_defect", shape=(3,), inherits=False, optional=True),
    Column("error_clock", shape=(N_CLOCK,), inherits=False, optional=True),
    Column("error_lags", shape=(2,), inherits=False, optional=True),
)


@dataclass(frozen=True, kw_only=True, eq=False)
class Errors:
    """Errors of N cells at one time, as the run states them.

    Attributes
    ----------
    time : (N,) float64
        Of centroids, against a run of much shorter steps, nm.
    shape : (N,) float64
        Of semi-axes, root mean square, against the same, nm.
    space : (N,) float64
        Of centroids, against a run on a much finer lattice, nm.
    boxes : (N,) float64
        Largest |φ| so far on the faces of a cell's box, or the edge of its band.
    way : (N,) float64
        Way that centroids have gone, µm.
    """

    time: Floats
    shape: Floats
    space: Floats
    boxes: Floats
    way: Floats

    __repr__ = short_repr

    @classmethod
    def of(cls, column: Callable[[str], NDArray], numerics: Numerics, time: float) -> "Errors":
        """Errors that the columns of a cell table tell, at an *in silico* time."""
        clock, in_time = column("error_clock"), column("error_time")
        lapse, decay = (time - clock[:, MEASURED])[:, None], clock[:, DECAY][:, None]
        drift = column("error_space") * decay + column("error_defect") * lapse
        parts = [(drift**2).sum(axis=1), clock[:, WALL] ** 2]
        swept = column("swept")
        return cls(
            time=FLOOR_TIME + 1e3 * np.hypot(_lengths(in_time[:, :, :3]), swept),
            shape=FLOOR_TIME + 1e3 * np.hypot(_lengths(in_time[:, :, 3:]), swept),
            space=FLOOR_SPACE * numerics.box_tolerance + 1e3 * np.sqrt(sum(parts)),
            boxes=column("face_peak").copy(),
            way=clock[:, WAY].copy(),
        )

    def too_coarse(self, spacing: float) -> str:
        """Why the lattice is too coarse for what has happened, and what to take; or ""."""
        error, way = _rms(self.space), 1e3 * _rms(self.way)
        most = 1e3 * COARSE * spacing
        if error <= most or error <= OF_THE_WAY * way or way == 0:
            return ""
        finer = spacing * (0.5 * most / error) ** (1 / 4)
        return (
            f"numerics.spacing = {spacing:g} µm does not resolve this scene: it has put centroids "
            f"off by about {_nm(error)} nm so far, {_nm(100 * error / way)} % of the way that they "
            f"have gone. Take spacing = {finer:.2g}"
        )

    def __str__(self) -> str:
        return error_text(self.time, self.space, self.boxes)


def error_text(time: Floats, space: Floats, boxes: Floats) -> str:
    """Errors of cells in one line: root mean squares in nm, and the largest |φ| of `boxes`."""
    return (
        f"{_nm(_rms(time))} nm in time, {_nm(_rms(space))} nm in space, "
        f"boxes {boxes.max(initial=0.0):.1g}"
    )


class Accuracy:
    """Looks at cells as they go, and carries their errors on in columns of the cell table.

    Parameters
    ----------
    numerics : Numerics
    dtype : of the fields
    threads : int
    """

    def __init__(self, numerics: Numerics, dtype: np.dtype, threads: int) -> None:
        self._numerics = numerics
        weights, self._share = _weights(numerics)
        self._weights = weights.astype(dtype)
        self._places, self._sums = np.zeros((threads, PLACE)), np.zeros((threads, 12))

    def set_up(
        self,
        physics: Physics,
        tensions: Floats,
        mobility: Floats,
        largest: float,
        rate: float,
        confinement: Confinement | None,
    ) -> None:
        """Take over parameters.

        Parameters
        ----------
        physics : Physics
        tensions : (N,) surface tensions γ
        mobility : (N,) see `CellTerms`
        largest : float
            γ times mobility, of all cells of the simulation.
        rate : float
            Of what is explicit.
        confinement : Confinement, optional
        """
        numerics, count = self._numerics, len(tensions)
        self._c, self._tau, self._rate, self._largest = physics.c, physics.tau, rate, largest
        self._stiffening = sum(term.stiffening for term in physics.active_terms)
        self._well = SHIFT * tensions * mobility * physics.c
        self._tensions = tensions.astype(self._weights.dtype)
        sharpness = (2 * physics.interface_scale * numerics.spacing) ** 2
        share = self._share * (1.0 if numerics.order in (2, 4) else sharpness)
        self._rates = share * numerics.spacing / physics.tau * mobility
        self._lags, self._due = np.zeros((count, 4)), np.zeros(count, bool)
        self._hard = confinement is not None and getattr(confinement, "width", None) == 0
        self._wall_errors, self._strength = np.full(count, STEPPED * numerics.spacing), 0.0
        if confinement is not None and is_resolved(confinement, numerics):
            mean = float(tensions.mean()) if count else physics.gamma
            self._strength = wall_strength(confinement, physics.g_e, mean, numerics)
            self._matched = MATCHED * mean
        self._changed = True

    def before(self, state: StepState, cells: CellTable, step: int, time: float) -> None:
        """Begin with new cells, and look at defects, when all that acts has been added up."""
        pool, schedule = state.pool, state.schedule
        if self._changed:
            self._begin(pool, schedule, cells, step, time)
        if step >= self._next_defects:
            self._find_due(cells["error_clock"], step)
            clock = cells["error_clock"]
            lapse, first = time - clock[:, MEASURED], clock[:, MEASURED] == clock[:, BORN]
            self._measure(state, cells, time)
            self._limit(cells, np.where(first, lapse, 0.5 * lapse))
            self._plan_defects(step)

    def _begin(
        self, pool: BoxPool, schedule: Schedule, cells: CellTable, step: int, time: float
    ) -> None:
        """Begin with cells that have no history, and note when cells have begun."""
        begin(
            schedule.shares, schedule.order, cells["fresh"], pool.phi, pool.path_boxes,
            self._numerics.spacing, step, time, cells["error_place"], cells["error_speed"],
            cells["error_clock"],
        )  # fmt: skip
        stepped = cells["error_clock"][schedule.order]
        cells["error_lags"][cells["fresh"]] = 0
        self._born = np.unique(stepped[:, STEP]).astype(np.int64).tolist()
        self._next_look = step + 1
        self._plan_defects(step - 1)
        self._changed = False

    def _plan_defects(self, step: int) -> None:
        """Find the next step before which defects are to be looked at, after this one."""
        ages = (born + age for born in self._born for age in AGES)
        later = (other for other in ages if other > step)
        self._next_defects = min((step // LONGEST + 1) * LONGEST, *later, _NEVER)

    def _find_due(self, clock: Floats, step: int) -> None:
        """Cells whose defects are to be looked at now."""
        age = step - clock[:, STEP]
        self._due[:] = np.isin(age, AGES) | ((age > 0) & (step % LONGEST == 0))

    def _limit(self, cells: CellTable, lapse: Floats) -> None:
        """Have errors in space grow no faster than cells move: at rest, so is the true cell."""
        defect, speeds = cells["error_defect"], cells["error_speed"][:, :3]
        size, speed = np.linalg.norm(defect, axis=1), np.linalg.norm(speeds, axis=1)
        excess = np.where(self._due, 1 - np.minimum(speed / np.maximum(size, 1e-30), 1), 0)
        too_much = defect * excess[:, None]
        cells["error_space"][:] -= too_much * lapse[:, None]
        defect -= too_much

    def _measure(self, state: StepState, cells: CellTable, time: float) -> None:
        coupling, terms = state.coupling, state.terms
        _, attracts = coupling.uses
        walls = coupling.walls if self._hard else None
        if self._strength:
            self._wall_errors[:] = OUT / self._strength * np.abs(terms.pressure - self._matched)
        measure_defects(
            state.schedule.order, self._due, state.pool.acting,
            state.pool.boxes, not state.pool.band_only, self._tensions, terms.pressure, terms.drift,
            coupling.interaction, coupling.columns, *coupling.pairs, state.workspace.room,
            self._weights, self._rates, self._wall_errors, time, self._sums,
            cells["error_defect"], cells["error_space"], cells["error_clock"], attracts, walls,
        )  # fmt: skip

    def after(
        self, schedule: Schedule, pool: BoxPool, cells: CellTable, step: int, time: float, dt: float
    ) -> None:
        """Look at where cells are after a step of δt."""
        varied, lags = self._numerics.tolerance is not None, cells["error_lags"]
        if varied:
            self._find_lags(dt)
            lags += dt * self._lags[:, [0, 3]]
        if step < self._next_look or not self._born:
            return
        steps = interval.py_func(step - self._born[-1])
        self._next_look = (step // steps + 1) * steps
        if varied:
            gap = np.maximum(time - cells["error_clock"][:, TIME], dt)
            self._lags[:, [0, 1, 3]] = lags[:, [0, 0, 1]] / gap[:, None]
        else:
            self._find_lags(dt)
        look(
            schedule.shares, schedule.order, pool.phi, pool.path_boxes, self._numerics.spacing,
            step, time, self._lags, self._places, cells["error_place"], cells["error_speed"],
            cells["error_time"], cells["error_clock"],
        )  # fmt: skip
        lags[cells["error_clock"][:, TIME] == time] = 0

    def _find_lags(self, dt: float) -> None:
        """Lags of velocities; see `kernels.defects.look`."""
        numerics, lags = self._numerics, self._lags
        S = used_S(numerics, self._tau, self._rate, dt)
        if numerics.scheme == "euler":
            lags[:, 0] = dt / 2
        elif numerics.scheme == "imex1":
            lags[:, 2] = (S + self._well) * dt / self._tau
        else:
            inertia: Floats | float = S + self._well
            start_S = numerics.start_S
            if numerics.scheme == "linearised":
                s = diffusion(
                    numerics, self._c, self._tau, self._rate, dt, self._largest, self._stiffening
                )
                inertia, start_S = SHIFT * self._c * s, None
            lags[:, 0] = inertia * dt**2 / self._tau
            lags[:, 1] = lags[:, 0] if start_S is None else start_S * dt**2 / self._tau
            lags[:, 3] = dt**2 / 3


def _weights(numerics: Numerics) -> tuple[Floats, float]:
    """Weights for `measure_defects`, and what share of their difference the error is."""
    order, spacing, stencil = numerics.order, numerics.spacing, numerics.laplacian == "stencil"
    coarser, share = (order, BEYOND_SIXTH) if order in (2, 4) else (4, SHARE)
    if order == FITTED:
        share *= FITTED_SHARE
    weights = np.zeros((3, 4))
    for row, other in enumerate((6, coarser)):
        first, second = stencil_weights(other, 1.0)
        weights[row, 1 : 1 + len(first)] = np.array(first) / spacing
        if stencil or numerics.active_solver != "dct":
            weights[2, : len(second)] += (1 - 2 * row) * np.array(second) / spacing**2
    return weights, share


def _lengths(errors: NDArray) -> Floats:
    """(N,) root mean squares of two vectors' lengths, (N, 2, k)."""
    return np.asarray(np.sqrt((errors**2).sum(axis=(1, 2)) / 2))


def _nm(value: float) -> str:
    """Two digits."""
    return f"{float(f'{value:.2g}'):g}"


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0
