"""A simulation: a scene on its way through time."""

from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import InitVar, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from morphosim import _validate
from morphosim.cell_field import CellField
from morphosim.engine.engine import RUNAWAY, Engine
from morphosim.errors import CellVanishedError, DivergenceError, SimulationError
from morphosim.geometry.shapes import Field, Sphere
from morphosim.measure.measurement import Measurement, centroids, measure
from morphosim.physics.parameters import Physics
from morphosim.runs.checkpoint import Checkpoint
from morphosim.scene import stability
from morphosim.scene.cell import Cell, VolumeCourse, tensions
from morphosim.scene.events import CHANGEABLE
from morphosim.scene.fingerprint import settings
from morphosim.scene.scene import Scene
from morphosim.scene.tables import cell_of, cell_values, physics_of, physics_table
from morphosim.simulation.division import divided
from morphosim.simulation.interrupts import deferred_interrupts
from morphosim.simulation.observers import Observer
from morphosim.simulation.stage_runner import Progress
from morphosim.simulation.start import start_fields


@dataclass
class Simulation:
    """State of a scene at one time.

    Parameters
    ----------
    scene : Scene
    state : Checkpoint, optional
        State to go on from, of a simulation of the same scene; see `from_run`.

    Attributes
    ----------
    cells : list of Cell
        The cells that are alive, in the order of the engine.
    engine : Engine
    removed : list of (time, name)
        Cells that were taken out, or vanished where `Scene.on_vanish` is "remove".
    events : list of (time, text)
        What has changed the simulation between steps: divisions, removals, changes.
    stage : str
        Name of what the simulation is doing; free for the user to set, and saved.
    error : str
        Why the simulation cannot go on; "" while it can.

    Raises
    ------
    ValueError
        A cell starts outside of the confinement, or is too small for the lattice; or the lattice
        does not resolve the interface (`stability.check`).

    Warns
    -----
    StabilityWarning
        Physics and numerics are expected to diverge; the message says what to change.

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
    cells: list[Cell] = field(init=False)
    engine: Engine = field(init=False)
    removed: list[tuple[float, str]] = field(init=False, default_factory=list)
    events: list[tuple[float, str]] = field(init=False, default_factory=list)
    stage: str = field(init=False, default="")
    error: str = field(init=False, default="")
    _progress: Progress = field(init=False)
    _settings: dict[str, Any] = field(init=False)

    def __post_init__(self, state: Checkpoint | None) -> None:
        scene = self.scene
        scene.check_stages()
        self.cells = list(scene.cells) if state is None else _alive(scene, state)
        physics = scene.physics if state is None else physics_of(state.physics, self.names)
        self.engine = self._make_engine(physics, state)
        self._progress = Progress(scene.stages)
        self._settings = settings(scene)
        if state is not None:
            self._take_over(state)
            self._progress.restore(state)
        stability.check(scene)
        self._set_targets()

    def _make_engine(self, physics: Physics, state: Checkpoint | None) -> Engine:
        """Engine of all cells, with their fields at the start or in a saved state."""
        scene = self.scene
        return Engine(
            physics, scene.numerics, scene.confinement, self.names, *self._described(physics),
            start_fields(scene, self.cells) if state is None else _saved_fields(state),
            [c.parent for c in self.cells],
        )  # fmt: skip

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
            *In silico* time of the save to start from, the nearest one; by default the last.

        Raises
        ------
        FileNotFoundError
            There is no run, or it has no fields or no scene.
        ValueError
            The run has ended by an error, or lacks a cell of the scene.

        Examples
        --------
        >>> simulation = Simulation.from_run("runs/embryo")  # doctest: +SKIP
        """
        from morphosim.runs import resume

        if scene is None and time is None:
            return cls(*resume.saved_state(Path(directory)))
        return cls(resume.branched_scene(Path(directory), scene, time))

    def checkpoint(self, alone: bool = False) -> Checkpoint:
        """The whole present state; `alone`, without how far the stages are."""
        progress = None if alone or not self.scene.stages else self._progress
        arrays = self.engine.contents()
        return Checkpoint(
            cells=tuple(_values(cell) for cell in self.cells),
            physics=physics_table(self.physics),
            steps=self.engine.steps,
            fresh=self.engine.fresh,
            stage=self.stage,
            removed=tuple(self.removed),
            settings=self._settings,
            arrays=arrays if progress is None else arrays | {"check": progress.centroids},
            progress=None if progress is None else progress.facts(),
            back=None if progress is None else progress.back,
        )

    def go_back(self, state: Checkpoint) -> None:
        """Return to an earlier state of this simulation."""
        self.cells = _alive(self.scene, state, self.cells)
        physics = physics_of(state.physics, self.names)
        self.engine.names, self.engine.parents = self.names, [c.parent for c in self.cells]
        self.engine.describe(physics, *self._described(physics))
        self._take_over(state)
        self._set_targets()

    def _take_over(self, state: Checkpoint) -> None:
        self.engine.restore(state.arrays, state.steps, state.fresh)
        self.stage, self.removed = state.stage, list(state.removed)

    @property
    def time(self) -> float:
        """*In silico* time: steps times δt."""
        return self.engine.steps * self.scene.numerics.dt

    @property
    def steps(self) -> int:
        """Steps taken."""
        return self.engine.steps

    @property
    def whole(self) -> bool:
        """Whether all cells are at the same step; false if a step has been broken off."""
        return self.engine.whole

    @property
    def dt(self) -> float:
        """Time step δt, *in silico* time."""
        return self.scene.numerics.dt

    @property
    def threads(self) -> int:
        """Number of threads."""
        return self.engine.workers

    @property
    def spacing(self) -> float:
        """Lattice spacing, µm."""
        return self.scene.numerics.spacing

    @property
    def stages_ended(self) -> int:
        """Number of the scene's stages that have ended."""
        return self._progress.index

    @property
    def finished(self) -> bool:
        """Whether the scene's duration, or the last of its stages, is over."""
        over = self.engine.steps >= self.scene.numerics.steps_to(self.scene.duration)
        return over or (bool(self.scene.stages) and self._progress.done)

    @property
    def names(self) -> list[str]:
        """Names of the cells that are alive."""
        return [cell.name for cell in self.cells]

    @property
    def types(self) -> list[str]:
        """Types of the cells that are alive."""
        return [cell.type for cell in self.cells]

    @property
    def parents(self) -> list[str]:
        """Names of their mothers; "" where they are not known."""
        return [cell.parent for cell in self.cells]

    @property
    def core_volumes(self) -> NDArray[np.float64]:
        """Volume where φ exceeds 1/2, of each cell, µm³."""
        return self.engine.core_volumes

    @property
    def face_peak(self) -> NDArray[np.float64]:
        """Certificate: largest |φ| so far at the faces of each cell's box, or edge of its band."""
        return self.engine.face_peak

    @property
    def lost_volume(self) -> NDArray[np.float64]:
        """Certificate: ∫ φ that boxes and bands have cut off each cell since the start, µm³."""
        return self.engine.lost_volume

    def measured(self) -> Measurement:
        """Shapes and contacts of all cells, measured on the simulation's threads."""
        with self.engine.limited_threads():
            pool = self.engine.pool
            return measure(pool.phi, pool.origin, pool.shape, pool.start, self.spacing)

    @property
    def volumes(self) -> NDArray[np.float64]:
        """∫ φ of each cell, µm³."""
        return self.engine.volumes

    @property
    def targets(self) -> NDArray[np.float64]:
        """Target volumes V(t), µm³."""
        return np.array([cell.target_volume(self.time) for cell in self.cells])

    @property
    def fields(self) -> list[CellField]:
        """The cells' fields: views, valid until the next step."""
        pool = self.engine.pool
        return [CellField(name, pool.origin[i], pool.box(i)) for i, name in enumerate(self.names)]

    @property
    def centroids(self) -> NDArray[np.float64]:
        """(N, 3) centroids ∫ r φ / ∫ φ, µm."""
        pool = self.engine.pool
        return centroids(pool.phi, pool.origin, pool.shape, pool.start, self.scene.numerics.spacing)

    @property
    def physics(self) -> Physics:
        """The physics that hold now: those of the scene, as events have changed them."""
        return self.engine.physics

    def divide(
        self,
        cell: str,
        daughters: tuple[str, str],
        *,
        axis: ArrayLike,
        fraction: float = 0.5,
        types: tuple[str, str] | None = None,
        volumes: tuple[float, float] | None = None,
    ) -> None:
        """Divide a cell in its box; the next step is of first order.

        Parameters
        ----------
        cell : str
        daughters : names of the daughters
        axis : (3,) from the second daughter to the first
        fraction : float
            Share of ∫ φ that the first daughter gets.
        types : optional
            By default the mother's.
        volumes : optional
            Target volumes in µm³; by default shares of what the mother's is now.

        Raises
        ------
        ValueError
            There is no such cell, or a cell has or had a daughter's name.
        """
        i = self._place(cell)
        known = {*self.names, *(c.parent for c in self.cells), *(name for _, name in self.removed)}
        for name in daughters:
            if name in known:
                message = f"daughter {name!r} of {cell!r}: a cell has or had this name already"
                raise ValueError(message)
        mother, spacing = self.cells[i], self.scene.numerics.spacing
        scale = self.physics.interface_scale
        halves = divided(self.fields[i], spacing, axis, fraction, daughters, scale)
        target = mother.target_volume(self.time)
        shares = (fraction * target, (1 - fraction) * target) if volumes is None else volumes
        kinds = (mother.type, mother.type) if types is None else types
        born = []
        for half, kind, share in zip(halves, kinds, shares, strict=True):
            shape = Field(phi=half.phi, origin=half.origin * spacing, spacing=spacing)
            born.append(
                replace(
                    mother, name=half.name, parent=cell, type=kind, volume=share, shape=shape
                )
            )  # fmt: skip
        self.engine.divide(i, daughters, kinds, halves)
        self._tell(f"division of {cell} into {daughters[0]} and {daughters[1]}")
        self.cells[i : i + 1] = []
        self.cells += born
        self._set_targets()

    def remove(self, cells: Iterable[str]) -> None:
        """Take cells out; the others keep their history. They are listed in `removed`.

        Raises
        ------
        ValueError
            There is no such cell, or none would be left.
        """
        names = list(dict.fromkeys(cells))
        if len(names) == len(self.cells):
            message = f"all {len(names)} cells would be removed; at least one must stay"
            raise ValueError(message)
        for i in sorted((self._place(name) for name in names), reverse=True):
            self._take_out(i)
        self._set_targets()

    def change_cells(self, cells: Iterable[str], **values: Any) -> None:
        """Give cells other values of `Cell`: type, gamma, volume or frozen.

        If a cell is frozen or thawed, the next step is of first order for all.

        Raises
        ------
        ValueError
            There is no such cell or value.
        """
        _validate.keys("change of cells", values, CHANGEABLE)
        changed = {i: replace(self.cells[i], **values) for i in map(self._place, cells)}
        changed = {i: cell for i, cell in changed.items() if _differs(cell, self.cells[i], values)}
        if changed:
            for i, cell in changed.items():
                self.cells[i] = cell
            names = ", ".join(self.names[i] for i in changed)
            self._tell(f"change of {', '.join(values)} of {names}")
            self._apply_change(self.physics, restart="frozen" in values)

    def change_physics(self, **values: Any) -> None:
        """Give the physics other values, from the next step on, which is of first order.

        Raises
        ------
        ValueError
            A value is not allowed.
        """
        _validate.keys("change of physics", values, _validate.names_of(Physics))
        physics = replace(self.physics, **values)
        if physics != self.physics:
            self._tell(f"change of {', '.join(values)}")
            self._apply_change(physics, restart=True)

    def restart(self) -> None:
        """Forget the history: the next step is of first order (Eq. 8)."""
        self.engine.restart()

    def _apply_change(self, physics: Physics, restart: bool) -> None:
        self.engine.describe(physics, *self._described(physics))
        if restart:
            self.engine.restart()
        else:
            self.engine.refresh()
        self._set_targets()

    def _described(self, physics: Physics) -> tuple[list[str], NDArray, NDArray]:
        """Types, surface tensions and which cells are frozen."""
        frozen = np.array([cell.frozen for cell in self.cells])
        return [cell.type for cell in self.cells], np.array(tensions(self.cells, physics)), frozen

    def _place(self, cell: str) -> int:
        """Place of a cell."""
        _validate.choice("cell", cell, self.names)
        return self.names.index(cell)

    def _tell(self, text: str) -> None:
        self.events.append((self.time, text))

    def _take_out(self, i: int) -> None:
        self._tell(f"removal of {self.names[i]}")
        self.removed.append((self.time, self.names[i]))
        self.engine.remove(i)
        del self.cells[i]

    def step(self, steps: int = 1) -> None:
        """Advance by a number of steps of δt.

        Raises
        ------
        DivergenceError
            A field is not finite or runs away. The offending cell keeps the field from before
            the step.
        CellVanishedError
            A cell is below 1/2 everywhere and `Scene.on_vanish` is "stop", or it was the last.
        """
        with self.engine.limited_threads():
            for _ in range(steps):
                self._step()

    def run(
        self, until: float | None = None, observers: Sequence[Observer["Simulation"]] = ()
    ) -> None:
        """Advance to a time, by default the scene's duration.

        Parameters
        ----------
        until : float, optional
            By default the scene's stages end the run, or its duration.
        observers : sequence of Observer
            Each is told of the start, of every step and of the end, however the run ends.

        Raises
        ------
        DivergenceError, CellVanishedError
            See `step`.
        KeyboardInterrupt
            By Ctrl-C, after the step under way; a second one breaks the step off, and this
            simulation with it.
        """
        end = self.scene.duration if until is None else _validate.number("until", until)
        last = self.scene.numerics.steps_to(end)
        started: list[Observer[Simulation]] = []
        staged = bool(self.scene.stages)
        try:
            for observer in observers:
                observer.start(self)
                started.append(observer)
            with self.engine.limited_threads(), deferred_interrupts() as check_interrupt:
                while self.engine.steps < last and not (staged and self._progress.done):
                    self._progress.begin(self)
                    self._step()
                    if staged and self._progress.after_step(self):
                        for observer in observers:
                            getattr(observer, "stage_ended", observer.after_step)(self)
                    else:
                        for observer in observers:
                            observer.after_step(self)
                    check_interrupt()
        except SimulationError as error:
            self.error = str(error)
            raise
        finally:
            with ExitStack() as stack:  # calls all of them, even if one raises
                for observer in reversed(started):
                    stack.callback(observer.finish, self)

    def _step(self) -> None:
        if self._volumes_change:
            self._set_targets()
        self.engine.step(self._targets)
        if (diverged := self.engine.diverged()).size:
            self._raise_divergence(int(diverged[0]))
        if (vanished := self.engine.vanished()).size and self.scene.on_vanish != "ignore":
            self._handle_vanished(vanished)

    def _set_targets(self) -> None:
        self._targets = self.targets
        self._volumes_change = any(callable(cell.volume) for cell in self.cells)

    def _raise_divergence(self, i: int) -> None:
        numerics = self.scene.numerics
        message = (
            f"cell {self.names[i]!r} diverged at t = {self.time:g} (step {self.engine.steps}): "
            f"its field is not finite or exceeds {RUNAWAY:g} in magnitude. It keeps the field of "
            f"t = {self.time - numerics.dt:g}. Try a smaller numerics.dt (now {numerics.dt:g}), a "
            f"larger numerics.S (now {numerics.S:g}), scheme = 'imex1', or weaker forces"
        )
        raise DivergenceError(message, time=self.time, cell=self.names[i])

    def _handle_vanished(self, vanished: NDArray[np.int64]) -> None:
        if self.scene.on_vanish == "stop" or len(vanished) == len(self.cells):
            name = self.names[int(vanished[0])]
            message = (
                f"cell {name!r} vanished at t = {self.time:g}: φ < 0.5 everywhere. Try the "
                "relative volume constraint, a larger physics.c or M, a finer numerics.spacing, "
                "or scene.on_vanish = 'remove'"
            )
            raise CellVanishedError(message, time=self.time, cell=name)
        for i in vanished[::-1].tolist():
            self._take_out(i)
        self._set_targets()


def _values(cell: Cell) -> dict[str, Any]:
    """What a snapshot says of a cell; a volume function is the scene's to say."""
    if callable(cell.volume) and not isinstance(cell.volume, VolumeCourse):
        values = cell_values(replace(cell, volume=None))
        del values["volume"]
        return values
    return cell_values(cell)


def _alive(scene: Scene, state: Checkpoint, present: Sequence[Cell] = ()) -> list[Cell]:
    """Cells of a snapshot, in its order; volume functions are those of `present`, or the scene."""
    known = {c.name: c for c in (*scene.cells, *present) if callable(c.volume)}
    cells = []
    for row, (origin, phi) in zip(state.cells, _saved_fields(state), strict=True):
        name, spacing = row["name"], scene.numerics.spacing
        shape: Field | Sphere = Sphere(center=origin * spacing, radius=spacing)
        if (phi > 0.5).any():  # or else the cell has vanished
            shape = Field(phi=phi, origin=origin * spacing, spacing=spacing)
        if "volume" in row:
            cells.append(cell_of(row, shape))
        else:
            _validate.choice("cell of the snapshot, whose volume is a function,", name, known)
            cells.append(replace(cell_of(row, shape), volume=known[name].volume))
    return cells


def _differs(cell: Cell, before: Cell, values: Iterable[str]) -> bool:
    """Whether one of these values is another than before; two functions always differ."""
    pairs = [(getattr(cell, name), getattr(before, name)) for name in values]
    return any(new is not old and (callable(new) or new != old) for new, old in pairs)


def _saved_fields(snapshot: Checkpoint) -> Iterator[tuple[NDArray[np.int64], NDArray[np.floating]]]:
    """Origin and field of each cell of a snapshot."""
    shapes = snapshot.arrays["shape"]
    parts = np.split(snapshot.arrays["phi"], np.cumsum(shapes.prod(axis=1))[:-1])
    for origin, shape, phi in zip(snapshot.arrays["origin"], shapes, parts, strict=True):
        yield origin, phi.reshape(shape)
