"""The job: its ranks, what they agree on, and how many threads each may have."""

import os
import traceback
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeVar

from morphosim._extras import how_to_install
from morphosim.errors import TermError
from morphosim.numerics.threads import automatic_threads

if TYPE_CHECKING:
    from mpi4py.MPI import Comm

T = TypeVar("T")
AGREED = "agreed"
"""Mark of an error that all ranks know of."""


class StoppedError(RuntimeError):
    """Another rank cannot go on, and tells why; so no rank can.

    Attributes
    ----------
    trace : str
        Traceback of the error on the other rank; "" if it is not known here.
    """

    trace: str = ""


def world() -> "Comm":
    """Communicator of all ranks of the job.

    Raises
    ------
    ImportError
        mpi4py, or the MPI library under it, is not installed.
    """
    try:
        from mpi4py import MPI
    except (ImportError, RuntimeError) as error:
        message = (
            f"a run over MPI needs mpi4py and an MPI library ({error}); {how_to_install('mpi')}; "
            "and the library, for example: apt install openmpi-bin libopenmpi-dev"
        )
        raise ImportError(message) from error
    return MPI.COMM_WORLD


def agreed(comm: "Comm", action: Callable[[], T]) -> T:
    """Result of an action that every rank takes, if it succeeds on all.

    An action may have parts that are agreed on too; what has failed there is not asked again.

    Raises
    ------
    StoppedError
        The action has failed on other ranks only; the text is the error of the first of them.
    Exception
        What the action has raised here.
    """
    error: Exception | None = None
    try:
        result = action()
    except Exception as raised:
        if is_agreed(raised):
            raise
        error = raised
    raise_agreed(comm, error)
    return result


def raise_agreed(comm: "Comm", error: Exception | None) -> None:
    """Raise an error on all ranks if one of them has one; all ranks call this.

    Raises
    ------
    TermError
        A force term of any rank has failed.
    StoppedError
        Other ranks only have another error; the text is that of the first of them, and its `trace`
        says where in the code it was raised.
    Exception
        The error given here.
    """
    told = None
    if error is not None:
        trace = "".join(traceback.format_exception(error))
        time = error.time if isinstance(error, TermError) else None
        told = str(error) or type(error).__name__, trace, time
    failed = next((entry for entry in comm.allgather(told) if entry is not None), None)
    if failed is None:
        return
    text, trace, time = failed
    if error is None and time is not None:
        error = TermError(text, time=time, cell="")
    elif error is None:
        error = StoppedError(text)
        error.trace = trace
    error.__dict__[AGREED] = True
    raise error


def is_agreed(error: BaseException) -> bool:
    """Whether all ranks know of an error, so that all have stopped."""
    return AGREED in error.__dict__


def trace_of(error: BaseException) -> str:
    """Traceback of an error, on the rank that has raised it first."""
    if isinstance(error, StoppedError) and error.trace:
        return error.trace
    return "".join(traceback.format_exception(error))


def threads_per_rank(comm: "Comm") -> int:
    """Threads for each rank, so that all ranks of a machine share out its processors."""
    from mpi4py import MPI

    local = comm.Split_type(MPI.COMM_TYPE_SHARED)
    mine = _processors()
    sharing = sum(1 for other in local.allgather(mine) if other == mine)
    local.Free()
    return max(1, min(len(mine) // sharing, automatic_threads()))


def _processors() -> frozenset[Any]:
    """Processors that this process may run on; MPI may have bound it to some."""
    if hasattr(os, "sched_getaffinity"):
        return frozenset(os.sched_getaffinity(0))
    return frozenset(range(os.cpu_count() or 1))
