"""What `mpirun -n 4 morphosim run SCENE -o DIR --mpi` does: a run over ranks, saved by rank 0."""

import signal
import sys
import traceback
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, cast

from morphosim.errors import SaveError, SimulationError
from morphosim.mpi.communicator import StoppedError, agreed, is_agreed, trace_of, world
from morphosim.mpi.distributed_simulation import RootObserver, on_root
from morphosim.progress import tell_line
from morphosim.runs.writer import RunWriter
from morphosim.simulation.ending import words_of_ending
from morphosim.simulation.interrupts import SIGNALS
from morphosim.simulation.observers import Observer
from morphosim.simulation.progress_bar import ProgressBar
from morphosim.simulation.simulation import Simulation

if TYPE_CHECKING:
    from mpi4py.MPI import Comm

DONE, FAILED, INTERRUPTED = 0, 1, 130
Summary = Callable[[Simulation, ProgressBar, Path], str]
Say = Callable[[str], None]


def go(
    make: Callable[[], Simulation],
    output: Path,
    say: Say,
    *,
    before: Callable[[], None] = lambda: None,
    summary: Summary | None = None,
    resume: bool = False,
    overwrite: bool = False,
    bar: Callable[[], ProgressBar] = ProgressBar,
) -> int:
    """Run a simulation to its end on all ranks; rank 0 saves it, draws progress and tells the end.

    Ctrl-C, or the signal by which a batch system ends a job, stops the run after the present step,
    saved. An error within a step, of a force term for example, stops all ranks and is told once;
    any other error of one rank alone ends the whole job.

    Parameters
    ----------
    make : function
        Makes the simulation, a `DistributedSimulation`; all ranks call it.
    output : path
        Directory of the run, which every rank may see and rank 0 writes.
    say : function of a text
        Tells the user how it ended; called on rank 0 only.
    before : function, optional
        Called on rank 0 once all ranks have their simulation.
    summary : function of the simulation, its progress bar and `output`, optional
        Makes what is told at the end.
    resume, overwrite : bool
        See `RunWriter`.
    bar : function
        Makes the progress bar.

    Returns
    -------
    int
        On rank 0: 0; 1 where it has ended by an error; 130 where it was interrupted.
        On others 0: mpirun kills ranks that are still busy when one of them ends otherwise.

    Raises
    ------
    ValueError, OSError
        The scene or the directory does not allow a run. Raised on rank 0; other ranks exit.
    """
    comm = world()
    if comm.rank:
        warnings.simplefilter("ignore")  # rank 0 gives the same
    with _signals(comm.rank) as interrupted:
        try:
            simulation = agreed(comm, make)
            drawn = bar()
            observers = RootObserver(
                lambda: _observers(simulation, output, resume, overwrite, drawn, before),
                lambda: bool(interrupted),
            )
        except Exception as error:
            _leave(comm, error)
            raise
        with _ends_all(comm):
            status = _advance(simulation, observers)
            if summary is not None and (status != FAILED or simulation.error):
                text = summary
                on_root(simulation, lambda: say(text(simulation, drawn, output)))
    return status if comm.rank == 0 else DONE


def _observers(
    simulation: Simulation, output: Path, resume: bool, overwrite: bool, bar: ProgressBar,
    before: Callable[[], None],
) -> list[Observer]:  # fmt: skip
    """What watches the run on rank 0."""
    writer = RunWriter.of(simulation.scene, output, resume, overwrite)
    before()
    return [writer, bar]


def _advance(simulation: Simulation, observers: RootObserver) -> int:
    """Run; tell what has ended the run before its end."""
    try:
        simulation.run(observers=[observers])
        return DONE
    except (KeyboardInterrupt, SaveError, SimulationError) as raised:
        error: BaseException = raised
    except Exception as raised:
        if not (isinstance(raised, StoppedError) or is_agreed(raised)):
            raise
        if world().rank == 0:
            tell_line(trace_of(raised))  # of a step; else rank 0 has it, and tells
        return FAILED
    if world().rank == 0:
        writer = cast(RunWriter, observers.observers[0])
        tell_line(words_of_ending(error, simulation, writer))
    return INTERRUPTED if isinstance(error, KeyboardInterrupt) else FAILED


@contextmanager
def _signals(rank: int) -> Iterator[list[int]]:
    """Signals that rank 0 has got to stop; the other ranks do not heed them, and wait for it."""
    got: list[int] = []
    heard = [kind for kind in SIGNALS if signal.getsignal(kind) is not signal.SIG_IGN]
    before = [
        signal.signal(kind, (lambda number, _: got.append(number)) if rank == 0 else signal.SIG_IGN)
        for kind in heard
    ]
    try:
        yield got
    finally:
        for kind, handler in zip(heard, before, strict=True):
            signal.signal(kind, handler)


def _leave(comm: "Comm", error: Exception) -> None:
    """After an error at the start: rank 0 tells it, or an error that only others have."""
    if comm.rank:
        sys.exit(DONE)
    if isinstance(error, StoppedError):
        message = str(error)
        raise ValueError(message) from error


@contextmanager
def _ends_all(comm: "Comm") -> Iterator[None]:
    """End the whole job after an error that the other ranks do not know of: they would wait."""
    try:
        yield
    except BaseException:
        with suppress(Exception):
            traceback.print_exc()
            sys.stderr.flush()
        comm.Abort(FAILED)
        raise
