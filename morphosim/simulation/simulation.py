"""A simulation: a scene on its way through time."""

from collections.abc import Callable, Sequence
from dataclasses import InitVar, dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from morphosim import _shown, _validate
from morphosim.engine.engine import RUNAWAY, Engine, check_columns
from morphosim.errors import (
    CellVanishedError,
    DivergenceError,
    ResolutionWarning,
    SimulationError,
    ToleranceError,
    warn,
)
from morphosim.numerics.parameters import MOST_STEPS, MOST_TICKS, PARTS
from morphosim.period import Period
from morphosim.progress import Tell, silent
from morphosim.runs.checkpoint import Checkpoint
from morphosim.runs.identity import Identity
from morphosim.scene import stability
from morphosim.scene.fingerprint import settings
from morphosim.scene.scene import Scene
from morphosim.scene.size import check_size
from morphosim.scene.tables import physics_of, physics_table, relocated
from morphosim.simulation.changes import used_names
from morphosim.simulation.furrows import Furrow
from morphosim.simulation.growth import has_courses
from morphosim.simulation.interrupts import deferred_interrupts
from morphosim.simulation.lineage_names import stated
from morphosim.simulation.observers import (
    Observer,
    as_observers,
    finish_all,
    next_time,
    tell_step,
)
from morphosim.simulation.stage_runner import StageRunner
from morphosim.simulation.start import StartFields, cell_columns
from morphosim.simulation.state import State
from morphosim.simulation.volumes import VolumeFunctions
from morphosim.simulation.warming import warm_first

LOOK_AT_TARGETS = 32
"""Steps between two looks at whether target volumes that are functions of time need another S."""
RESOLUTION_CHECK = 256
"""Steps between two looks at whether the lattice resolves the scene."""


@dataclass
class Simulation(State):
    """State of a scene at one time.

    Parameters
    ----------
    scene : Scene
    state : Checkpoint, optional
        State to go on from, of a simulation of the same scene; see `from_run`.

    Attributes
    ----------
    engine : Engine
    removed : list of (time, name)
        Cells that were taken out, or vanished where `Scene.on_vanish` is "remove".
    events : list of (time, text)
        What has changed the simulation between steps: divisions, removals, changes.
    stage : str
        Name of what the simulation is doing; free for the user to set, and saved.
    error : str
        Why the simulation cannot go on; "" while it can.
    stopped : str
        Why the present run is to end, or the last one has ended, before its end; see `stop`.
    until : float
        *In silico* time to which the present, or the last, run goes.
    identity : Identity
        Which run this is, and which it has started from.

    Raises
    ------
    ValueError
        A cell starts outside of the confinement, or is too small for the lattice; or the lattice
        does not resolve the interface, or steps are too long for the run's duration
        (`stability.check`).

    Warns
    -----
    StabilityWarning
        Physics and numerics are expected to diverge, or to be late; it says what to change.
    ResolutionWarning
        In a run: the lattice turns out to be too coarse for what happens.

    Examples
    --------
    >>> from morphosim import Cell, Scene, Simulation, Sphere
    >>> ball = Cell(name="a", shape=Sphere(center=(0, 0, 0), radius=5))
    >>> simulation = Simulation(Scene(cells=[ball]))
    >>> simulation.run(until=100)
    >>> round(float(simulation.volumes[0]))  # of 524: the surface tension presses
    517
    """

    scene: Scene
    state: InitVar[Checkpoint | None] = None
    engine: Engine = field(init=False)
    removed: list[tuple[float, str]] = field(init=False, default_factory=list)
    events: list[tuple[float, str]] = field(init=False, default_factory=list)
    stage: str = field(init=False, default="")
    error: str = field(init=False, default="")
    stopped: str = field(init=False, default="")
    until: float = field(init=False)
    identity: Identity = field(init=False, default_factory=Identity)
    _stages: StageRunner = field(init=False)
    _coarse: bool = field(init=False, default=False)
    """Whether it has been told that the lattice is too coarse."""

    def __post_init__(self, state: Checkpoint | None) -> None:
        _validate.instance("scene", self.scene, Scene)
        scene = self.scene
        self.until = scene.duration
        for physics in scene.courses:  # what stages do is rehearsed by that
            check_columns(physics, scene.columns)
        self._stages = StageRunner(scene.stages)
        self._volumes = VolumeFunctions(
            {cell.name: cell.volume for cell in scene.cells if callable(cell.volume)}
        )
        self._furrows = {}
        warm_first(scene)
        self.engine = self._make_engine()
        self.engine.targets = self._set_targets
        self.engine.expect(scene.most_cells)
        if state is None:
            self._start()
        else:
            self._take_over(state)
            self._stages.restore(state)
        stability.check(scene, self.S)
        self.engine.settle()

    def __repr__(self) -> str:
        return _shown.text_of(self._title(), self._facts())

    def _repr_html_(self) -> str:
        targets = self.engine.everyone["target"]  # of the last step; functions are not asked
        rows = (
            (cell.name, cell.type, cell.parent, f"{volume:.4g}", f"{target:.4g}")
            for cell, volume, target in zip(self.cells, self.volumes, targets, strict=True)
        )
        head = ("cell", "type", "mother", "volume, µm³", "target, µm³")
        return _shown.html_of(self._title(), self._facts(), head, rows, len(targets))

    def _title(self) -> str:
        return f"Simulation of {_shown.short(self.scene.name)} at t = {self.time:g}"

    def _facts(self) -> dict[str, str]:
        """What the simulation is, by name; all of it is known to every MPI rank."""
        removed = [name for _, name in self.removed]
        return {
            "cells": f"{len(self.names)}: {_shown.listed(self.names)}",
            "steps": f"{self.steps} of {self.scene.numerics.step_text}",
            "S": self._S_text(),
            "stage": self.stage,
            "removed": _shown.listed(removed),
            "last event": self.events[-1][1] if self.events else "",
            "error": self.error,
        }

    def _S_text(self) -> str:
        """S, and whether it is chosen; "" where it follows from the length of each step."""
        numerics = self.scene.numerics
        if numerics.S is None and numerics.tolerance is not None:
            return ""
        return f"{self.S:.3g}{' (chosen)' if numerics.S is None else ''}"

    def _make_engine(self) -> Engine:
        """Engine without cells."""
        scene = self.scene
        period = Period.of(scene.period, scene.numerics.spacing)
        return Engine(scene.physics, scene.numerics, scene.confinement, scene.columns, period)

    def _start(self) -> None:
        """Begin with the cells of the scene."""
        check_size(self.scene)
        cells, fields = self.scene.cells, StartFields(self.scene, self.scene.cells)
        self.engine.start(cell_columns(cells), self.scene.types, fields)
        self.engine.explicit_rate = stability.start_rate(self.scene, fields.outside)
        self._used = used_names(self.engine.everyone)

    @classmethod
    def from_run(
        cls, directory: str | Path, *, scene: Scene | None = None, time: float | None = None
    ) -> "Simulation":
        """Simulation that starts from a saved run.

        By default the run itself goes on from its last save, to the same result, bit for bit, as
        if it had never stopped (on the same machine). With another scene, or another time, a new
        simulation begins at t = 0 from the fields saved then; its first step is of first order.

        Parameters
        ----------
        directory : path of a run
        scene : Scene, optional
            Whose physics, numerics, confinement and duration hold from now on. Its cells are
            looked up in the run by name and start from their saved fields; cells of the run that
            it does not have are left out. By default the run's own scene.
        time : float, optional
            *In silico* time of the save to start from, or a time near it; by default the last.

        Raises
        ------
        FileNotFoundError
            There is no run, or it has no fields or no scene.
        ValueError
            The run has ended by an error, lacks a cell of the scene, or has no save near the time.

        Examples
        --------
        >>> simulation = Simulation.from_run("runs/embryo")  # doctest: +SKIP
        """
        from morphosim.runs import resume  # with xarray, which a simulation alone does not need

        if scene is not None:
            _validate.instance("scene", scene, Scene)
        if scene is None and time is None:
            return cls(*resume.saved_state(Path(directory)))
        chosen, identity = resume.branched_scene(Path(directory), scene, time)
        simulation = cls(chosen)
        simulation.identity = identity
        return simulation

    def checkpoint(self, alone: bool = False, lasting: bool = True) -> Checkpoint:
        """The whole present state.

        Parameters
        ----------
        alone : bool
            Whether to leave out how far the stages are.
        lasting : bool
            Whether it stays as it is when the simulation goes on. If not it takes no memory for
            the fields, and must be written before the next step.
        """
        stages = None if alone or not self.scene.stages else self._stages
        arrays = self.engine.contents(lasting)
        return Checkpoint(
            physics=physics_table(self.physics),
            steps=self.engine.steps,
            ticks=self.engine.ticks,
            stage=self.stage,
            removed=tuple(self.removed),
            settings=self._settings,
            arrays=arrays if stages is None else arrays | {"check": stages.centroids},
            volumes=self._volumes.said(),
            dividing={name: furrow.table for name, furrow in self._furrows.items()},
            used=tuple(sorted(self._used.difference(self.names))),
            progress=None if stages is None else stages.facts(),
            back=None if stages is None else stages.back,
            identity=self.identity,
            error=self.error,
            explicit_rate=self.engine.explicit_rate,
        )

    @cached_property
    def _settings(self) -> dict[str, Any]:
        """What the scene says that must stay the same where the run goes on."""
        return settings(self.scene)

    def go_back(self, state: Checkpoint) -> None:
        """Return to an earlier state of this simulation."""
        self._take_over(state)
        self.engine.settle()

    def _take_over(self, state: Checkpoint) -> None:
        """Hold the state that `checkpoint` gave."""
        known = {cell.name: cell.volume for cell in self.scene.cells if callable(cell.volume)}
        self._volumes = VolumeFunctions.of(state.volumes, known | self._volumes.functions)
        self._furrows = {name: Furrow.of(table) for name, table in state.dividing.items()}
        physics = physics_of(relocated(state.physics, self.scene.courses), state.names)
        self.engine.explicit_rate = state.explicit_rate
        self.engine.restore(state.arrays, physics, state.steps, state.ticks)
        self.stage, self.removed = state.stage, list(state.removed)
        self.identity = state.identity
        generations = state.arrays.get("generation", np.zeros(len(state.names), int))
        self._used = {*state.used, *stated(state.names, generations.tolist())}

    @property
    def stages_ended(self) -> int:
        """Number of the scene's stages that have ended."""
        return self._stages.index

    @property
    def finished(self) -> bool:
        """Whether the scene's duration, or the last of its stages, is over."""
        over = self.ticks >= self.scene.numerics.ticks_to(self.scene.duration)
        return over or (bool(self.scene.stages) and self._stages.done)

    def step(self, steps: int = 1) -> None:
        """Advance by a number of steps: of δt, or as long as the tolerance allows.

        Raises
        ------
        DivergenceError
            A field is not finite or runs away. The offending cell keeps the field from before
            the step.
        CellVanishedError
            A cell is below 1/2 everywhere and `Scene.on_vanish` is "stop", or it was the last.
        """
        _validate.integer("steps", steps, least=0, most=MOST_STEPS)
        with self.engine.limited_threads():
            for _ in range(steps):
                self._step(MOST_TICKS)

    def step_to(self, tick: int, tell: Tell = silent) -> None:
        """Take steps until so many ticks have passed, without stages, events and observers.

        Parameters
        ----------
        tick : int
            See `Numerics.ticks_to`.
        tell : callable
            Told after each step how many ticks have passed, and how many are to pass.

        Raises
        ------
        DivergenceError, CellVanishedError
            See `step`.
        """
        with self.engine.limited_threads():
            while self.ticks < tick:
                self._step(tick - self.ticks)
                tell(self.ticks, tick)

    def stop(self, why: str) -> None:
        """End the run after the present step, as if its end were there; it can go on later.

        For observers, events, rules and conditions, and for other threads. All observers
        finish, so that a `RunWriter` saves the state, with the reason. Where no run is under way
        nothing comes of it: the next begins with `stopped` empty.

        Parameters
        ----------
        why : str
            Told in one line by the save, by `morphosim info` and at the end of `morphosim run`;
            of several reasons the first counts.

        Raises
        ------
        TypeError, ValueError
            It is no text, or is empty.

        Examples
        --------
        >>> from morphosim import built_in_scene
        >>> def guard(simulation):
        ...     if simulation.time >= 10:
        ...         simulation.stop("long enough")
        >>> simulation = Simulation(built_in_scene("single-cell"))
        >>> simulation.run(until=1000, observers=[guard])
        >>> simulation.time, simulation.stopped
        (10.0, 'long enough')
        """
        words = _validate.words("why", why)
        self.stopped = self.stopped or words

    def run(
        self,
        until: float | None = None,
        observers: Sequence[Observer["Simulation"] | Callable[["Simulation"], object]] = (),
    ) -> None:
        """Advance to a time, by default the scene's duration.

        Parameters
        ----------
        until : float, optional
            By default the scene's stages end the run, or its duration.
        observers : sequence of Observer or function of the simulation
            Functions are called after every step, that which ends a stage included, and not at
            the start. An `Observer` is told of the start and of the end too, however the run ends.
            What one raises at the end does not replace the error that has ended the run: it
            becomes a note of that (`BaseException.add_note`). `stop` ends the run without an
            error.

        Raises
        ------
        TypeError
            What is given is no observer.
        ValueError
            The time takes more steps than any computer; or what an observer finds before the first.
        DivergenceError, CellVanishedError
            See `step`.
        KeyboardInterrupt
            By Ctrl-C, after the step under way; a second one breaks the step off, and this
            simulation with it.
        """
        end = self.scene.duration if until is None else _validate.number("until", until)
        self.scene.numerics.ticks_to(end, "until")
        watching = as_observers(observers)
        self.until, self.stopped = end, ""
        started: list[Observer[Simulation]] = []
        ended: BaseException | None = None
        try:
            for observer in watching:
                observer.start(self)
                started.append(observer)
            self._advance(watching)
            self._check_resolution()
        except BaseException as error:
            ended = error
            if isinstance(error, SimulationError):
                self.error = str(error)
            if isinstance(error, StopIteration):
                error.add_note('to end a run, call simulation.stop("why")')
            raise
        finally:
            finish_all(started, self, ended)

    def _advance(self, observers: Sequence[Observer["Simulation"]]) -> None:
        """Take steps until the end of the run, or until somebody stops it."""
        last, staged = self.scene.numerics.ticks_to(self.until), bool(self.scene.stages)
        with self.engine.limited_threads(), deferred_interrupts() as check_interrupt:
            while not self._is_stopped():
                if self.ticks >= last or (staged and self._stages.done):
                    return
                self._stages.begin(self)
                self._step(self._due(last, observers) - self.ticks)
                ends = staged and self._stages.after_step(self)
                tell_step(observers, self, ends)
                if self.steps % RESOLUTION_CHECK == 0:
                    self._check_resolution()
                check_interrupt()
        self._tell(f"stop: {self.stopped}")

    def _check_resolution(self) -> None:
        """Warn, once, if the lattice has turned out to be too coarse."""
        if not self._coarse and (why := self.errors.too_coarse(self.spacing)):
            self._coarse = True
            warn(why, ResolutionWarning)

    def _is_stopped(self) -> bool:
        """Whether somebody has asked the run to end."""
        return bool(self.stopped)

    def _due(self, last: int, observers: Sequence[Observer["Simulation"]]) -> int:
        """Tick that the next step must not pass: the end, or what stages or observers wait for."""
        numerics = self.scene.numerics
        if numerics.tolerance is None:  # steps are of one tick
            return self.ticks + 1
        due = [last]
        due += [furrow.until for furrow in self._furrows.values()]
        if self.scene.stages:
            due.append(self._stages.next_tick(numerics, self.ticks))
        if (time := next_time(observers, self)) is not None:
            due.append(numerics.ticks_to(time))
        return max(min(due), self.ticks + 1)

    def _set_targets(self, time: float) -> None:
        """Set what is to be known before forces are added up: target volumes, rings."""
        self._fill_targets(self.engine.everyone["target"], time)
        self._set_rings()

    def _step(self, most: int) -> None:
        """Take a step of at most so many ticks."""
        before, begin = self.time, self.ticks
        changing = self._volumes.functions or has_courses(self.engine.everyone)
        if changing and self.steps % LOOK_AT_TARGETS == 0:
            self._stay_stable()
        self.engine.step(most)
        if (diverged := self.engine.diverged()).size:
            self._raise_divergence(int(diverged[0]), before)
        if self.engine.overdue:
            self._raise_overdue()
        self._take_out_lost(self.engine.vanished())
        if self._furrows:
            self._go_on_dividing(begin)

    def _raise_divergence(self, i: int, before: float) -> None:
        name = self.names[i]
        message = (
            f"cell {name!r} diverged at t = {self.time:g} (step {self.engine.steps}): "
            f"its field is not finite or exceeds {RUNAWAY:g} in magnitude. It keeps the field of "
            f"t = {before:g}. Try {self._cures()}"
        )
        raise DivergenceError(message, time=self.time, cell=name)

    def _cures(self) -> str:
        """What to try where fields diverge."""
        numerics = self.scene.numerics
        shortest = f", of which the shortest step is 1/{PARTS}" if numerics.tolerance else ""
        cures = [f"a smaller numerics.dt (now {numerics.dt:g}{shortest})"]
        if numerics.scheme != "euler":
            cures.append(f"a larger numerics.S (now {self.S:.3g})")
        if numerics.scheme == "bdf2":
            cures.append("scheme = 'imex1'")
        own = ", ".join(term.name for term in self.physics.terms)
        terms = f"; or look at your own force terms: {own}" if own else ""
        return f"{', '.join(cures)}, or weaker forces{terms}"

    def _raise_overdue(self) -> None:
        """Tell that the shortest steps miss the tolerance, and of which cell most."""
        numerics = self.scene.numerics
        errors = self.engine.column("step_error")
        name, most = self.names[int(np.argmax(errors))], float(errors.max())
        message = (
            f"numerics.tolerance = {numerics.tolerance:g} is not met at t = {self.time:g} even by "
            f"steps of {numerics.tick:g}, the shortest: cell {name!r} misses it most, by a factor "
            f"of {most:.2g}. Try a larger tolerance, a smaller numerics.dt (now {numerics.dt:g}), "
            "or weaker forces"
        )
        raise ToleranceError(message, time=self.time, cell=name)

    def _take_out_lost(self, vanished: NDArray[np.int64]) -> None:
        """Take out cells that are below 1/2 everywhere, and those that have died."""
        dead = self._dead(vanished)
        lost = np.setdiff1d(vanished, dead) if self.scene.on_vanish != "ignore" else vanished[:0]
        if lost.size and (self.scene.on_vanish == "stop" or len(lost) == len(self.engine)):
            name = self.names[int(lost[0])]
            message = (
                f"cell {name!r} vanished at t = {self.time:g}: φ < 0.5 everywhere. Try the "
                "relative volume constraint, a larger physics.c or M, a finer numerics.spacing, "
                "or scene.on_vanish = 'remove'"
            )
            raise CellVanishedError(message, time=self.time, cell=name)
        gone = np.union1d(lost, dead)
        if gone.size and len(gone) == len(self.engine):
            name = self.names[int(gone[0])]
            message = f"the last cells have died at t = {self.time:g}: {_shown.listed(self.names)}"
            raise CellVanishedError(message, time=self.time, cell=name)
        self._take_out(gone[::-1].tolist())

    def _dead(self, vanished: NDArray[np.int64]) -> NDArray[np.int64]:
        """Cells that die and are gone: their time is over, or they have vanished."""
        table = self.engine.everyone
        if "dying" not in table:
            return vanished[:0]
        over = self.time >= table["grown_until"]
        over[vanished] = True
        return np.flatnonzero(table["dying"] & over)
