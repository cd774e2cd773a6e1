"""The job: its ranks, what they agree on, and how many threads each may have."""

import os
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    from mpi4py.MPI import Comm

T = TypeVar("T")
AGREED = "agreed"
"""Mark of an error that all ranks know of."""


class StoppedError(RuntimeError):
    """Another rank cannot go on, and tells why; so no rank can."""


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
            f"a run over MPI needs mpi4py and an MPI library ({error}); install both: pip install "
            "'morphosim[mpi]', and for example apt install openmpi-bin libopenmpi-dev"
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
        if AGREED in raised.__dict__:
            raise
        error = raised
    texts = comm.allgather(None if error is None else str(error))
    failed = next((text for text in texts if text is not None), None)
    if failed is None:
        return result
    error = error or StoppedError(failed)
    error.__dict__[AGREED] = True
    raise error


def threads_per_rank(comm: "Comm") -> int:
    """Threads for each rank, so that all ranks of a machine share out its processors."""
    from mpi4py import MPI

    local = comm.Split_type(MPI.COMM_TYPE_SHARED)
    mine = _processors()
    sharing = sum(1 for other in local.allgather(mine) if other == mine)
    local.Free()
    return max(1, len(mine) // sharing)


def _processors() -> frozenset[Any]:
    """Processors that this process may run on; MPI may have bound it to some."""
    if hasattr(os, "sched_getaffinity"):
        return frozenset(os.sched_getaffinity(0))
    return frozenset(range(os.cpu_count() or 1))
