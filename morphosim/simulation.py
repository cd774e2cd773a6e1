"""A simulation: a scene on its way through time."""

from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import InitVar, dataclass, field
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from morphosim import _validate, stability
from morphosim.engine import RUNAWAY, Engine
from morphosim.errors import CellVanishedError, DivergenceError, SimulationError
from morphosim.fields import CellField
from morphosim.initial import lattice_field
from morphosim.interrupts import deferred_interrupts
from morphosim.measure import centroids
from morphosim.scene import Cell, Scene
from morphosim.scenefile import settings
from morphosim.snapshot import Snapshot

OUTSIDE_ALLOWED = 0.5
"""A cell may start with at most this share of its volume beyond the confinement."""


class Observer(Protocol):
    """Something that watches a run: a writer, a progress bar, a user's own function."""

    def start(self, simulation: "Simulation") -> None:
        """Before the first step of a run."""

    def after_step(self, simulation: "Simulation") -> None:
        """After every step; return quickly where there is nothing to do."""

    def finish(self, simulation: "Simulation") -> None:
        """After the last step, also when the run ends by an error or by Ctrl-C."""


@dataclass
class Simulation:
    """State of a scene at one time.

    Parameters
    ----------
    scene : Scene
    state : Snapshot, optional
        State to go on from, of a simulation of the same scene; see `from_run`.

    Attributes
    ----------
    cells : list of Cell
        The cells that are alive, in the order of the engine.
    engine : Engine
    removed : list of (time, name)
        Cells that vanished and were taken out (`Scene.on_vanish = "remove"`).
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
    state: InitVar[Snapshot | None] = None
    cells: list[Cell] = field(init=False)
    engine: Engine = field(init=False)
    removed: list[tuple[float, str]] = field(init=False, default_factory=list)
    stage: str = field(init=False, default="")
    error: str = field(init=False, default="")

    def __post_init__(self, state: Snapshot | None) -> None:
        scene = self.scene
        self.cells = list(scene.cells) if state is None else _alive(scene, state)
        gamma = dict(zip(scene.names, scene.tensions, strict=True))
        self.engine = Engine(
            scene.physics, scene.numerics, scene.confinement, self.names,
            [c.type for c in self.cells], np.array([gamma[c.name] for c in self.cells]),
            np.array([c.frozen for c in self.cells]),
            _start_fields(scene) if state is None else _saved_fields(state),
        )  # fmt: skip
        if state is not None:
            self.engine.restore(state.arrays, state.steps, state.fresh)
            self.stage, self.removed = state.stage, list(state.removed)
        stability.check(scene)
        self._set_targets()

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

    def snapshot(self) -> Snapshot:
        """The whole present state."""
        return Snapshot(
            names=tuple(self.names),
            steps=self.engine.steps,
            fresh=self.engine.fresh,
            stage=self.stage,
            removed=tuple(self.removed),
            settings=settings(self.scene),
            arrays=self.engine.contents(),
        )

    @property
    def time(self) -> float:
        """*In silico* time: steps times δt."""
        return self.engine.steps * self.scene.numerics.dt

    @property
    def names(self) -> list[str]:
        """Names of the cells that are alive."""
        return [cell.name for cell in self.cells]

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

    def run(self, until: float | None = None, observers: Sequence[Observer] = ()) -> None:
        """Advance to a time, by default the scene's duration.

        Parameters
        ----------
        until : float, optional
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
        last = int(np.ceil(end / self.scene.numerics.dt - 1e-9))
        started: list[Observer] = []
        try:
            for observer in observers:
                observer.start(self)
                started.append(observer)
            with self.engine.limited_threads(), deferred_interrupts() as check_interrupt:
                while self.engine.steps < last:
                    self._step()
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
            self.removed.append((self.time, self.names[i]))
            self.engine.remove(i)
            del self.cells[i]
        self._set_targets()


def _alive(scene: Scene, snapshot: Snapshot) -> list[Cell]:
    """Cells of a snapshot, in its order."""
    cells = {cell.name: cell for cell in scene.cells}
    for name in snapshot.names:
        _validate.choice("cell of the snapshot", name, cells)
    return [cells[name] for name in snapshot.names]


def _saved_fields(snapshot: Snapshot) -> Iterator[tuple[NDArray[np.int64], NDArray[np.floating]]]:
    """Origin and field of each cell of a snapshot."""
    shapes = snapshot.arrays["shape"]
    parts = np.split(snapshot.arrays["phi"], np.cumsum(shapes.prod(axis=1))[:-1])
    for origin, shape, phi in zip(snapshot.arrays["origin"], shapes, parts, strict=True):
        yield origin, phi.reshape(shape)


def _start_fields(scene: Scene) -> Iterator[tuple[NDArray[np.int64], NDArray[np.floating]]]:
    """Origin and field of each cell, one after the other."""
    scale, spacing = scene.physics.interface_scale, scene.numerics.spacing
    for cell in scene.cells:
        origin, phi = lattice_field(cell, scale, spacing)
        if scene.confinement is not None:
            _check_inside(scene, cell, origin, phi)
        yield origin, phi


def _check_inside(
    scene: Scene, cell: Cell, origin: NDArray[np.int64], phi: NDArray[np.floating]
) -> None:
    """Raise ValueError if most of a cell lies beyond the confinement."""
    assert scene.confinement is not None
    axes = [
        (o + np.arange(n)) * scene.numerics.spacing for o, n in zip(origin, phi.shape, strict=True)
    ]
    walls = scene.confinement.field(*np.meshgrid(*axes, indexing="ij", sparse=True))
    outside = float((phi * (walls > 0.5)).sum() / phi.sum())
    if outside > OUTSIDE_ALLOWED:
        message = (
            f"cell {cell.name!r} starts with {100 * outside:.0f} % of its volume outside of the "
            f"confinement; at most {100 * OUTSIDE_ALLOWED:.0f} % is allowed. Move the cell, or "
            "enlarge the confinement"
        )
        raise ValueError(message)
