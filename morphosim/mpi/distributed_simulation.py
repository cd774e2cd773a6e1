"""A simulation over ranks: the same scene, the same steps, each rank with its share."""

from collections.abc import Callable, Iterable
from typing import cast

import numpy as np

from morphosim._shown import html_of
from morphosim.engine.engine import Engine
from morphosim.mpi.communicator import StoppedError, agreed, world
from morphosim.mpi.distributed_engine import DistributedEngine
from morphosim.runs.checkpoint import Checkpoint
from morphosim.scene import stability
from morphosim.simulation.changes import used_names
from morphosim.simulation.observers import (
    Observer,
    as_observers,
    finish_all,
    next_time,
    tell_step,
)
from morphosim.simulation.simulation import Simulation
from morphosim.simulation.start import StartFields, cell_columns


class DistributedSimulation(Simulation):
    """`Simulation` whose cells are shared out over all ranks of the MPI job.

    All ranks make it of the same scene and make the same calls in the same order. Steps, events,
    stages, errors and fields are the same as on one rank, to the last bit. Figures of all cells,
    such as `centroids`, are gathered on all ranks. See `RootObserver` for output.

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

    def _repr_html_(self) -> str:  # without figures of cells, which all ranks would have to gather
        return html_of(self._title(), self._facts())

    def _make_engine(self) -> Engine:
        """Engine of which this rank has a share; it has all that a simulation asks for."""
        scene = self.scene
        if any(scene.period):
            message = (
                "scene.period: periodic space is not shared out among MPI ranks; run the scene in "
                "one process, with threads"
            )
            raise ValueError(message)
        agreed(world(), lambda: None)  # a rank that cannot get here tells the others by this
        engine = DistributedEngine(
            world(), scene.physics, scene.numerics, scene.confinement, scene.columns
        )
        return cast(Engine, engine)

    def _start(self) -> None:
        """Begin with the cells of the scene, of which each rank makes some."""
        comm, cells = world(), self.scene.cells
        self._check_shares(len(cells))
        rows = np.arange(comm.rank, len(cells), comm.size)
        own = StartFields(self.scene, [cells[i] for i in rows.tolist()])
        fields = agreed(comm, lambda: list(own))
        engine = cast(DistributedEngine, self.engine)
        engine.start(cell_columns(cells), self.scene.types, rows, fields)
        engine.explicit_rate = stability.start_rate(self.scene, max(comm.allgather(own.outside)))
        self._used = used_names(engine.everyone)

    def _take_over(self, state: Checkpoint) -> None:
        """See `Simulation`."""
        self._check_shares(len(state.names))
        super()._take_over(state)

    def _is_stopped(self) -> bool:
        """Whether any rank has asked the run to end; then all do, for the reason of the first."""
        reason = next((why for why in world().allgather(self.stopped) if why), "")
        if reason:  # without, what a thread has asked for meanwhile stays for the next step
            self.stopped = reason
        return bool(reason)

    def _check_shares(self, count: int) -> None:
        """Raise ValueError if there are fewer cells than ranks."""
        if count < world().size:
            message = (
                f"{count} cells on {world().size} ranks: every rank needs a cell; start at most "
                f"{count} ranks"
            )
            raise ValueError(message)


class RootObserver:
    """Observer that has others watch the run on rank 0 only, as if it had all cells.

    Whatever they ask the simulation for is gathered from the other ranks. If one of them raises
    an error, or if the run is to be interrupted, all ranks stop after the same step.

    Parameters
    ----------
    make : function
        Makes the observers, of which some may be functions; called on rank 0 only.
    interrupted : function, optional
        Tells, on rank 0, whether to stop.

    Examples
    --------
    >>> output = RootObserver(lambda: [RunWriter("runs/large", every=100)])  # doctest: +SKIP
    """

    def __init__(
        self,
        make: Callable[[], Iterable[Observer[Simulation] | Callable[[Simulation], object]]],
        interrupted: Callable[[], bool] = lambda: False,
    ) -> None:
        comm = world()
        self._interrupted = interrupted
        self.observers: list[Observer[Simulation]] = agreed(
            comm, lambda: [] if comm.rank else as_observers(list(make()))
        )
        self._started: list[Observer[Simulation]] = []

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
            tell_step(self.observers, simulation, stage_ended=False)
            self._check()

        on_root(simulation, tell)

    def next_time(self, simulation: Simulation) -> float | None:
        """See `Observer`."""
        said: list[float | None] = [None]

        def ask() -> None:
            said[0] = next_time(self.observers, simulation)

        on_root(simulation, ask)
        return cast("float | None", world().bcast(said[0]))

    def stage_ended(self, simulation: Simulation) -> None:
        """See `Observer`."""

        def tell() -> None:
            tell_step(self.observers, simulation, stage_ended=True)
            self._check()

        on_root(simulation, tell)

    def finish(self, simulation: Simulation) -> None:
        """See `Observer`."""

        def end() -> None:
            started, self._started = self._started, []
            finish_all(started, simulation)

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
