"""A simulation over ranks: the same scene, the same steps, each rank with its share."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack
from typing import Any, cast, overload

import numpy as np
from numpy.typing import NDArray

from morphosim.cell_field import CellField
from morphosim.engine.engine import Engine
from morphosim.mpi.communicator import StoppedError, agreed, world
from morphosim.mpi.distributed_engine import DistributedEngine
from morphosim.physics.parameters import Physics
from morphosim.runs.checkpoint import Checkpoint
from morphosim.simulation.observers import Observer
from morphosim.simulation.simulation import Simulation
from morphosim.simulation.start import start_fields


class DistributedSimulation(Simulation):
    """`Simulation` whose cells are shared out over all ranks of the MPI job.

    All ranks make it of the same scene and make the same calls in the same order. Steps, events,
    stages and errors are the same as on one rank, fields to rounding. Figures of all cells, such
    as `centroids`, are gathered on all ranks. See `RootObserver` for output.

    Raises
    ------
    ImportError
        mpi4py is not installed.
    ValueError
        There are fewer cells than ranks.
    StoppedError
        Cells of another rank cannot start; the text tells why.

    Examples
    --------
    >>> simulation = DistributedSimulation(scene)  # doctest: +SKIP
    """

    @property
    def shares(self) -> DistributedEngine:
        """The engine."""
        return cast(DistributedEngine, self.engine)

    @property
    def centroids(self) -> NDArray[np.float64]:
        """(N, 3) centroids ∫ r φ / ∫ φ, µm."""
        return self.shares.centroids

    @property
    def fields(self) -> list[CellField]:
        """Copies of the cells' fields, fetched from their ranks when they are looked at."""
        return cast(list[CellField], _Fields(self.shares))

    def _make_engine(self, physics: Physics, state: Checkpoint | None) -> Engine:
        """Engine of which this rank has a share; it has all that a simulation asks for."""
        comm, scene = world(), self.scene
        if len(self.cells) < comm.size:
            message = (
                f"{len(self.cells)} cells on {comm.size} ranks: every rank needs a cell; start at "
                f"most {len(self.cells)} ranks"
            )
            raise ValueError(message)
        rows = np.arange(comm.rank, len(self.cells), comm.size)

        def make() -> Any:
            return list(start_fields(scene, [self.cells[i] for i in rows]))

        fields = agreed(comm, make) if state is None else _saved(state, rows)
        engine = DistributedEngine(
            comm, physics, scene.numerics, scene.confinement, self.names,
            *self._described(physics), [cell.parent for cell in self.cells], rows, fields,
        )  # fmt: skip
        return cast(Engine, engine)


class _Fields(Sequence[CellField]):
    """Fields of all cells: one is fetched alone, to look at all gathers all."""

    def __init__(self, engine: DistributedEngine) -> None:
        self._engine = engine

    def __len__(self) -> int:
        return len(self._engine)

    @overload
    def __getitem__(self, i: int) -> CellField: ...
    @overload
    def __getitem__(self, i: slice) -> Sequence[CellField]: ...
    def __getitem__(self, i: int | slice) -> CellField | Sequence[CellField]:
        if isinstance(i, slice):
            return list(self)[i]
        return self._engine.field(range(len(self))[i])

    def __iter__(self) -> Iterator[CellField]:
        pool, names = self._engine.pool, self._engine.names
        return (CellField(name, pool.origin[i], pool.box(i)) for i, name in enumerate(names))


class RootObserver:
    """Observer that has others watch the run on rank 0 only, as if it had all cells.

    Whatever they ask the simulation for is gathered from the other ranks. If one of them raises
    an error, or if the run is to be interrupted, all ranks stop after the same step.

    Parameters
    ----------
    make : function
        Makes the observers; called on rank 0 only.
    interrupted : function, optional
        Tells, on rank 0, whether to stop.

    Examples
    --------
    >>> output = RootObserver(lambda: [RunWriter("runs/large", every=100)])  # doctest: +SKIP
    """

    def __init__(
        self,
        make: Callable[[], Iterable[Observer]],
        interrupted: Callable[[], bool] = lambda: False,
    ) -> None:
        comm = world()
        self._interrupted = interrupted
        self.observers: list[Observer] = agreed(comm, lambda: [] if comm.rank else list(make()))
        self._started: list[Observer] = []

    def start(self, simulation: Simulation) -> None:
        """See `Observer`."""

        def begin() -> None:
            for observer in self.observers:
                observer.start(simulation)
                self._started.append(observer)

        try:
            on_root(simulation, begin)
        except BaseException:
            self.finish(simulation)
            raise

    def after_step(self, simulation: Simulation) -> None:
        """See `Observer`."""

        def tell() -> None:
            for observer in self.observers:
                observer.after_step(simulation)
            self._check()

        on_root(simulation, tell)

    def stage_ended(self, simulation: Simulation) -> None:
        """See `Observer`."""

        def tell() -> None:
            for observer in self.observers:
                getattr(observer, "stage_ended", observer.after_step)(simulation)
            self._check()

        on_root(simulation, tell)

    def finish(self, simulation: Simulation) -> None:
        """See `Observer`."""

        def end() -> None:
            with ExitStack() as stack:  # calls all of them, even if one raises
                for observer in self._started:
                    stack.callback(observer.finish, simulation)
                self._started = []

        on_root(simulation, end)

    def _check(self) -> None:
        if self._interrupted():
            raise KeyboardInterrupt


def on_root(simulation: Simulation, action: Callable[[], None]) -> None:
    """Take an action on rank 0; all that it asks the simulation for is gathered.

    Raises
    ------
    BaseException
        On rank 0, what the action has raised.
    KeyboardInterrupt, StoppedError
        On the others, if it has raised that, or anything else.
    """
    engine = cast(DistributedEngine, simulation.engine)
    error: BaseException | None = None
    if engine.comm.rank == 0:
        with engine.alone():
            try:
                action()
            except BaseException as raised:
                error = raised
    else:
        engine.serve()
    told = engine.comm.bcast(None if error is None else (type(error).__name__, str(error)))
    if error is not None:
        raise error
    if told is not None:
        if told[0] == "KeyboardInterrupt":
            raise KeyboardInterrupt
        raise StoppedError(told[1])


def _saved(
    state: Checkpoint, rows: NDArray[np.int64]
) -> Iterator[tuple[NDArray[np.int64], NDArray[np.floating]]]:
    """Origin and field of some cells of a snapshot."""
    shapes, origin = state.arrays["shape"], state.arrays["origin"]
    ends = np.cumsum(shapes.prod(axis=1))
    for i in rows.tolist():
        phi = state.arrays["phi"][ends[i] - shapes[i].prod() : ends[i]]
        yield origin[i], phi.reshape(shapes[i])
