"""The engine: the state of all cells and the step that advances it."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from time import perf_counter
from typing import Any

import numpy as np
import scipy.linalg.cython_blas  # noqa: F401  (the BLAS that Numba calls; loaded to be limited)
from numba import get_num_threads, set_num_threads
from numpy.typing import ArrayLike, NDArray
from threadpoolctl import ThreadpoolController

from morphosim.cell_field import CellField
from morphosim.cell_table import CellTable, Column
from morphosim.engine import accuracy, box_pool, step_control
from morphosim.engine.accuracy import Accuracy
from morphosim.engine.box_pool import BoxPool
from morphosim.engine.cell_view import CellView
from morphosim.engine.coupling import Coupling
from morphosim.engine.scheduling import ThreadCount, share_out
from morphosim.engine.solvers.solver import StepState, make_solver
from morphosim.engine.stencil import make_stencil
from morphosim.engine.workspace import Workspace
from morphosim.errors import TermError
from morphosim.geometry.confinement import Confinement
from morphosim.kernels.boxes import BAD, CORE, EDGE
from morphosim.kernels.layout import CellTerms, Limits, Scheme
from morphosim.kernels.points import fill, records
from morphosim.measure.measurement import Measurement, measure
from morphosim.measure.surroundings import Surroundings
from morphosim.numerics.parameters import MOST_TICKS, Numerics
from morphosim.numerics.schemes import coefficients, used_S
from morphosim.numerics.threads import check_threads
from morphosim.period import Period
from morphosim.physics.parameters import Physics
from morphosim.physics.term import Environment, Forces, Step

RUNAWAY = 4.0
"""|φ| beyond this counts as divergence; sound fields stay between about -0.2 and 1.5."""
SHRINK_INTERVAL = 32
"""Steps between two looks for boxes that have become too large."""
DTYPES = {"single": np.float32, "double": np.float64}
COLUMNS = (
    Column("frozen", bool, shared=True),
    Column("target", default=np.nan, shared=True, aimed=True),
    Column("fresh", bool, default=True, inherits=False, shared=True),
    Column("face_peak", inherits=False),
    *step_control.COLUMNS,
    *box_pool.COLUMNS,
    *accuracy.COLUMNS,
)
"""What the engine keeps of each cell, besides what force terms do.

`frozen` cells act on others and are not stepped; `target` is the target volume V(t), µm³; a `fresh`
cell has no history, and makes a first-order start (Eq. 8); `face_peak` is its certificate.
"""
MEMORIES = {"bdf2": "history", "linearised": "extrapolation"}
"""What the pool keeps for each scheme, besides φⁿ."""
Fields = Iterable[tuple[NDArray[np.int64], NDArray[np.floating]]]


def check_columns(physics: Physics, further: Iterable[Column] = ()) -> None:
    """Raise ValueError if columns of its terms have names of others, or of the engine's."""
    CellTable((*COLUMNS, *further, *physics.columns))


class Engine(CellView):
    """StepState of a number of cells, and its advance in time. It begins with `start` or `restore`.

    Parameters
    ----------
    physics, numerics, confinement
        See `Scene`.
    columns : of the cell table, beside `COLUMNS` and those of force terms
        The state of rules; nothing here looks at it.

    Attributes
    ----------
    explicit_rate : float
        Rate of what a step takes explicitly, with a margin; where `numerics.S` is None, S follows
        from it (`schemes.stabilisation`). Set it before `set_physics` and `restore`, else by
        `stabilise`.
    cells : CellTable
        The N cells. Set values of columns in place; say `change` if others than those that are
        `aimed` change.
    pool : BoxPool
        The fields.
    solver : Solver
    steps : int
        Steps taken.
    ticks : int
        Ticks passed; see `Numerics.tick`.
    targets : function of time
        Sets V(t) in the column "target" of `everyone`, and what else is `aimed` there; called
        before forces are added up, with the *in silico* time at which they are taken.
    whole : bool
        Whether all cells are at the same step: false within a step, and for good if something
        breaks one off.
    moved : (n,) int64
        Cells whose boxes have moved at the end of the last step.

    Raises
    ------
    ValueError
        There are fewer threads than `numerics.threads`, or two terms have columns of one name.
    """

    _values: CellTerms
    _first: Scheme
    _later: Scheme

    def __init__(
        self, physics: Physics, numerics: Numerics, confinement: Confinement | None,
        columns: Iterable[Column] = (), period: Period | None = None,
    ) -> None:  # fmt: skip
        self.period = period
        self.physics, self.numerics, self.confinement = physics, numerics, confinement
        self.further = tuple(columns)
        self.explicit_rate = 0.0
        self.dtype = np.dtype(DTYPES[numerics.precision])
        check_threads("numerics.threads", numerics.worker_count)
        self.workers = numerics.worker_count
        self._threads = ThreadCount(self.workers)
        self.cells = CellTable(self.columns_with(physics))
        self.steps = self.ticks = 0
        self.targets: Callable[[float], None] = _as_they_are
        self.whole = True
        self.moved = np.zeros(0, np.int64)
        real = self.dtype.type
        self._limits = Limits(*(real(v) for v in (numerics.box_tolerance, RUNAWAY, 0.5)))
        self.solver = make_solver(numerics, self.dtype, self.workers)
        memory = MEMORIES.get(numerics.scheme, "none")
        self.pool = BoxPool(
            self.cells, self.dtype, self._limits, memory, self.solver.on_band, period
        )
        self._coupling = Coupling(self.dtype, self.workers, period)
        self._workspace = Workspace(self.workers, self.dtype)
        self._accuracy = Accuracy(numerics, self.dtype, self.workers)
        self._controller = ThreadpoolController()
        self._changed = self._displaced = True

    def columns_with(self, physics: Physics) -> tuple[Column, ...]:
        """Columns of the cell table under these physics, but those that say who a cell is."""
        turns = () if self.period is None else (box_pool.TURNS,)
        return (*COLUMNS, *turns, *self.further, *physics.columns)

    def expect(self, cells: int) -> None:
        """Say how many cells there will be at most, as far as is known."""
        self.pool.expected = cells

    def start(self, values: Mapping[str, Any], types: Sequence[str], fields: Fields) -> None:
        """Begin with these cells.

        Parameters
        ----------
        values : by column of the cell table, (N, …); "name" and "target" among them
        types : (N,) cell types
        fields : per cell, lattice origin and start field
        """
        self.cells.add(values, types)
        self._lay_start(fields)

    def _lay_start(self, fields: Fields) -> None:
        """Lay the start fields of all cells, and let terms set their columns."""
        rows = np.arange(len(self))
        self.pool.lay(rows, fields)
        self.pool.wrap(rows)
        self.pool.lost[:] = 0  # what is cut from start fields is no loss of the run
        self.face_peak[:] = self.pool.surveys[:, EDGE]
        for term in self.physics.active_terms:
            term.start(self.cells, self.numerics)
        self.change()

    def __len__(self) -> int:
        return len(self.cells)

    @property
    def everyone(self) -> CellTable:
        """All cells of the simulation: here, those of this engine."""
        return self.cells

    @property
    def time(self) -> float:
        """*In silico* time."""
        return self.ticks * self.numerics.tick

    @property
    def S(self) -> float:
        """The stabilisation at work."""
        return used_S(self.numerics, self.physics.tau, self.explicit_rate)

    @property
    def nbytes(self) -> int:
        """Bytes of all arrays that grow with the cells, but for short lists of columns."""
        parts = (self.cells, self.pool, self._coupling, self.solver, self._workspace)
        return sum(part.nbytes for part in parts)

    def measured(self) -> Measurement:
        """Shapes and contacts of all cells, measured on the engine's threads."""
        pool = self.pool
        with self.limited_threads():
            return measure(
                pool.phi, pool.stored, self.numerics.spacing, period=pool.period, path=pool.path
            )

    @contextmanager
    def limited_threads(self) -> Iterator[None]:
        """Numba on at most `workers` threads, BLAS on one per thread of ours."""
        before = get_num_threads()
        set_num_threads(self.workers)
        try:
            with self._controller.limit(limits=1, user_api="blas"):
                yield
        finally:
            set_num_threads(before)

    def step(self, most: int = MOST_TICKS) -> None:
        """Take a step, of at most so many ticks. Call it within `limited_threads`.

        Steps of δt are one tick each.
        """
        begin = perf_counter()
        set_num_threads(self._threads.now)
        self._take_step(most)
        set_num_threads(self.workers)
        self._threads.took(perf_counter() - begin)

    def _take_step(self, most: int) -> None:
        """Take a step, of at most so many ticks."""
        self.settle()
        ticks: int | None = self.solver.fit(most, bool(self.everyone["fresh"].any()))
        kept = self._states_of_terms()
        while ticks is not None:
            for name, values in kept.items():  # as they were before a try that is given up
                self.cells[name][:] = values
            state = self._made_ready(ticks)
            if self.whole:
                self._accuracy.before(state, self.cells, self.steps, self.time)
            self.whole = False
            ticks = self.solver.advance(state, self._most_of_all)
        self.cells["fresh"][:] = False
        self.ticks += state.ticks
        self.steps += 1
        length = state.ticks * self.numerics.tick
        self._accuracy.after(state.schedule, self.pool, self.cells, self.steps, self.time, length)
        np.maximum(self.face_peak, self.pool.surveys[:, EDGE], out=self.face_peak)
        self._refit()
        self.whole = True

    def _states_of_terms(self) -> dict[str, NDArray]:
        """Copies of what terms advance by a step, where a step may be tried again."""
        if self.numerics.tolerance is None:
            return {}
        return {c.name: self.cells[c.name].copy() for c in self.physics.columns if c.saved}

    def aim(self, time: float) -> None:
        """Set the columns that are `aimed`."""
        self.targets(time)

    def _forces_at(self, ticks: int) -> float:
        """Time at which a step of so many ticks takes forces."""
        return self.time + (ticks * self.numerics.tick if self.solver.looks_ahead else 0.0)

    def _share_fields(self) -> None:
        """Send the fields in which forces are taken to where else they are felt: here, nowhere."""

    def _most_of_all(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Largest values over all engines of the simulation, one by one: here, these."""
        return values

    def _made_ready(self, ticks: int) -> StepState:
        """What a step of so many ticks works on, with the sums over cells."""
        state = self.step_state(ticks)
        self._coupling.accumulate(self.pool, state.schedule)
        return state

    @property
    def overdue(self) -> bool:
        """Whether the shortest steps have missed the tolerance for so long that it is no use."""
        return self.solver.overdue

    def step_state(self, ticks: int = 1) -> StepState:
        """What a step of so many ticks works on: all set up, and forces of all terms added up."""
        self.settle()
        if self.solver.make_ready(ticks, self.pool, self._schedule):
            self._share_fields()
        self.aim(self._forces_at(ticks))
        self._add_up_forces(ticks)
        if self._values.fresh is not self.cells["fresh"]:  # ranks lay the table out anew
            self._values = self._values._replace(fresh=self.cells["fresh"])
        return StepState(
            self._schedule, self.pool, self._values, self._coupling, self._workspace,
            self._stencil, self._limits, self._later, self._first, ticks,
            self._forces.stiffness * self._mobility,
        )  # fmt: skip

    def contents(self, lasting: bool = True) -> dict[str, Any]:
        """All arrays that the next step depends on; see `restore`.

        They are copies; unless they are to be `lasting`, the fields are not, and valid until the
        next step.
        """
        fields = self.pool.contents() if lasting else self.pool.parts()
        return self.cells.saved() | fields | self.solver.contents()

    def restore(
        self, contents: Mapping[str, Any], physics: Physics, steps: int, ticks: int
    ) -> None:
        """Go on from what `contents` gave, of an engine of the same numerics.

        From there on all steps are the same to the last bit, on the same kind of machine.
        """
        self.physics, self.steps, self.ticks = physics, steps, ticks
        self.cells.require(self.columns_with(physics))
        self.cells.restore(contents)
        self.pool.restore(contents)
        self.solver.restore(contents)
        self.change()

    def diverged(self) -> NDArray[np.int64]:
        """Cells whose last step was refused: not finite, or beyond `RUNAWAY`."""
        return np.flatnonzero(self.pool.surveys[:, BAD] > 0)

    def vanished(self) -> NDArray[np.int64]:
        """Cells that are below 1/2 everywhere."""
        return np.flatnonzero(self.pool.surveys[:, CORE] == 0)

    def remove(self, rows: ArrayLike) -> None:
        """Take cells out; the others keep their history."""
        gone = np.atleast_1d(np.asarray(rows, np.int64))
        self.pool.release(gone)
        self.cells.remove(gone)
        self.change()

    def divide(
        self, rows: ArrayLike, values: Mapping[str, Any], types: Sequence[str],
        halves: Sequence[CellField],
    ) -> None:  # fmt: skip
        """Replace cells by two each, which come last and make a first-order start.

        Parameters
        ----------
        rows : (n,)
        values : by column, (2 n, …) of the daughters, those of one mother after the other, instead
            of what they inherit; "name" among them
        types : (2 n,) of the daughters
        halves : (2 n,) their fields
        """
        mothers = np.atleast_1d(np.asarray(rows, np.int64))
        born = self.cells.born(mothers, values, types)
        self.pool.release(mothers)
        self._lay_halves(self.cells.replace(mothers, born), halves)

    def _lay_halves(self, rows: NDArray[np.int64], halves: Sequence[CellField]) -> None:
        """Lay the fields of new daughters."""
        self.pool.lay(rows, ((half.origin, half.phi) for half in halves))
        self.pool.wrap(rows)
        self.face_peak[rows] = self.pool.surveys[rows, EDGE]
        self.change()

    def set_physics(self, physics: Physics) -> None:
        """Set other physics; all cells make a first-order start."""
        new = set(self.cells.require(self.columns_with(physics)))
        self.physics = physics
        for term in physics.active_terms:
            if any(column.name in new for column in term.columns):
                term.start(self.cells, self.numerics)
        self.restart()

    def stabilise(self, rate: float) -> None:
        """Set another `explicit_rate`; cells keep their history.

        In Eq. 9 the history has S φⁿ⁻¹, of which what is added now is taken to be φⁿ.
        """
        before = self.S
        self.explicit_rate = rate
        if self.pool.history is not None and self.numerics.scheme == "bdf2":
            for i in np.flatnonzero(~self.cells["fresh"]).tolist():
                where = self.pool.stretch(i)
                self.pool.history[where] -= (self.S - before) * self.pool.phi[where]
        self.change()

    def change(self) -> None:
        """Say that cells, types, tensions or parameters have changed; cells keep their history."""
        self._changed = True

    def restart(self, rows: ArrayLike | None = None) -> None:
        """Forget the history of cells, by default of all: they make a first-order start."""
        chosen = np.arange(len(self)) if rows is None else np.asarray(rows, np.int64)
        self.cells["fresh"][chosen] = True
        self.pool.forget(chosen.tolist())
        self.change()

    def settle(self) -> None:
        """Set up all that depends on cells, parameters and boxes that have changed."""
        if self._changed:
            self._set_up()
        if self._changed or self._displaced:
            self._lay_out()
        self._changed = self._displaced = False

    def _set_up(self) -> None:
        """Set up all that depends on which cells there are, and on parameters."""
        physics, numerics, cells = self.physics, self.numerics, self.cells
        all_tensions = physics.surface_tension.tensions(self.everyone)
        scale = physics.interface_scale
        environment = Environment(numerics, self.confinement, float(all_tensions.mean()), scale)
        self._terms = physics.active_terms
        for term in self._terms:
            term.prepare(cells, numerics)
            term.surround(environment)
        self._coupling.set_up(environment, cells, self.everyone)
        self._stencil = make_stencil(numerics.order, numerics.spacing, self.dtype, scale)
        self._mobility, mobilities = self._mobilities(cells), self._mobilities(self.everyone)
        self._coupling.fastest = float(mobilities.max(initial=0.0))
        all_tensions *= mobilities
        tensions = physics.surface_tension.tensions(cells)
        solved = tensions * self._mobility
        self.solver.set_up(physics, solved, np.unique(all_tensions), self.explicit_rate)
        n = len(cells)
        self._forces = Forces(np.zeros(n), np.zeros((n, 3)), np.zeros(n))
        self._values = self._cell_terms(tensions)
        self._accuracy.set_up(
            physics, tensions, self._mobility, float(all_tensions.max()), self.explicit_rate,
            self.confinement,
        )  # fmt: skip
        self._first, self._later = self._scheme(True), self._scheme(False)

    def _mobilities(self, cells: CellTable) -> NDArray[np.float64]:
        """(N,) `Physics.tau` over τ of each cell, by which its equation is multiplied."""
        return self.physics.tau / self.physics.viscosity.of_each(cells)

    def _cell_terms(self, tensions: NDArray[np.float64]) -> CellTerms:
        """Numbers of each cell for the kernels."""
        n = len(self)
        drifts = any(term.drifts for term in self._terms)
        differs = bool(self.physics.tau_by_type)
        points = [
            (term.point, term.point_values(self.cells))
            for term in self._terms if term.point is not None
        ]  # fmt: skip
        return CellTerms(
            gamma=(tensions * self._mobility).astype(self.dtype),
            well=(4 * tensions * self.physics.c).astype(self.dtype),
            pressure=np.zeros(n, self.dtype),
            drift=np.zeros((n, 3), self.dtype) if drifts else None,
            points=records(points, self.dtype, n),
            fresh=self.cells["fresh"],
            mobility=self._mobility[:, None].astype(self.dtype) if differs else None,
            n_iterations=np.zeros(n, np.int64),
            weights=np.zeros((n, 0), self.dtype),
        )

    def _surroundings(self) -> Surroundings:
        """What cells can feel of where they are."""
        pool, walls = self.pool, self.confinement
        return Surroundings(
            pool.acting, pool.stored, self.numerics.spacing,
            None if walls is None else walls.depth, pool.period, pool.path,
        )  # fmt: skip

    def _scheme(self, fresh: bool) -> Scheme:
        numbers = coefficients(self.numerics, self.physics.tau, self.S, fresh)
        return Scheme(**{name: self.dtype.type(value) for name, value in numbers.items()})

    def _lay_out(self) -> None:
        """Set up all that depends on where boxes are and how large."""
        shape = self.pool.shape
        self.solver.lay_out(shape)
        self._workspace.reserve(shape)
        self._coupling.lay_out(self.pool)
        stepped = np.flatnonzero(~self.cells["frozen"])
        cost = self.solver.cost(shape[stepped])
        self._schedule = share_out(stepped, cost, self.pool.origin[stepped], self.workers)

    def _add_up_forces(self, ticks: int) -> None:
        """Pressure and drift of this step, from all terms."""
        forces, values = self._forces, self._values
        volumes = self.pool.totals * self.numerics.spacing**3
        numerics, physics = self.numerics, self.physics
        tau = physics.tau / self._mobility[:, None] if physics.tau_by_type else physics.tau
        length = ticks * numerics.tick
        step = Step(
            self.ticks, self.time, self._forces_at(ticks), length, numerics.dt, numerics.seed,
            volumes, tau,
        )  # fmt: skip
        if any(term.senses(step) for term in self._terms):
            step = replace(step, surroundings=self._surroundings())
        forces.pressure[:] = forces.stiffness[:] = 0
        if values.drift is not None:
            forces.drift[:] = 0
        for term in self._terms:
            try:
                term.update(self.cells, step, forces)
            except Exception as error:  # a user's own code
                message = (
                    f"force term {term.name} failed at t = {step.time:g}: {type(error).__name__}: "
                    f"{error}"
                )
                raise TermError(message, time=step.time, cell="") from error
        if any(term.point_varies for term in self._terms):
            acting = (term for term in self._terms if term.point is not None)
            fill(values.points, [term.point_values(self.cells) for term in acting])
        values.pressure[:] = forces.pressure
        if values.drift is not None:
            values.drift[:] = forces.drift

    def _refit(self) -> None:
        """Move and resize boxes whose band has come to a face, and now and then too large ones."""
        if self.steps % SHRINK_INTERVAL == 0:
            cells = self._schedule.order
        else:
            cells = np.flatnonzero(self.pool.cramped() & ~self.cells["frozen"])
        self.moved = self.pool.refit(cells) if len(cells) else cells
        self.pool.wrap(self.moved)
        if len(self.moved):
            self._displaced = True


def _as_they_are(time: float) -> None:
    """Leave target volumes that are no functions of time."""
