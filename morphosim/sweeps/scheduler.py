"""Members handed to Dask: processes of this machine, or any cluster."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from morphosim import _validate
from morphosim._extras import need
from morphosim.numerics.threads import available_processors, check_threads, most_threads
from morphosim.sweeps.axes import Member

if TYPE_CHECKING:
    from distributed import Client

WAIT = 600.0
"""Seconds that a cluster has for its first worker."""
ANY_PORT = "127.0.0.1:0"
"""Where Dask tells its state: None would be a fixed port, which two scans cannot share."""
DEATHS_ALLOWED = 1
"""How many processes a member may take with it, for want of memory perhaps, before it is lost."""


def need_dask() -> Any:
    """Import Dask's scheduler, or raise ImportError with what to install."""
    return need("distributed", "a scan", "sweep")


def shares(members: int, workers: int | None, threads: int | None) -> tuple[int, int]:
    """Number of processes, and of threads per member, that keep all cores busy.

    Raises
    ------
    ValueError
        They would be more than there are cores, or a member would have more threads than Numba.
    """
    cores = available_processors()
    if workers is not None:
        _validate.integer("workers", workers, least=1)
    if threads is None:
        threads = max(cores // min(cores, workers or max(members, 1)), 1)
        threads = min(threads, most_threads())
    _validate.integer("threads_per_member", threads, least=1)
    check_threads("threads_per_member", threads)
    wanted = max(cores // threads, 1) if workers is None else workers
    if wanted * threads > cores:
        message = (
            f"{wanted} workers of {threads} threads each are more than the {cores} cores of this "
            f"machine; take at most {max(cores // threads, 1)} workers, or fewer threads_per_member"
        )
        raise ValueError(message)
    return min(wanted, max(members, 1)), threads


@contextmanager
def local_client(workers: int) -> "Iterator[Client]":
    """Client of as many processes of this machine."""
    distributed = need_dask()
    with ExitStack() as stack:
        folder = stack.enter_context(TemporaryDirectory(prefix="morphosim-"))
        cluster = stack.enter_context(_local_cluster(workers, folder))
        yield stack.enter_context(distributed.Client(cluster))


def _local_cluster(workers: int, folder: str) -> Any:
    """Processes that have their scratch space in a folder of this user.

    Dask imports from there before all else, and takes one that anyone can make if it is not told.
    """
    import dask

    settings = {
        "distributed.scheduler.allowed-failures": DEATHS_ALLOWED, "temporary-directory": folder
    }  # fmt: skip
    try:
        with dask.config.set(settings):
            return need_dask().LocalCluster(
                n_workers=workers, threads_per_worker=1, processes=True, memory_limit=0,
                dashboard_address=ANY_PORT, silence_logs=50, preload=["morphosim.sweeps.worker"],
            )  # fmt: skip
    except RuntimeError as error:
        message = (
            "the scan's processes could not be started. In a script, call sweep below "
            "if __name__ == '__main__': every process imports the script"
        )
        raise OSError(message) from error


@contextmanager
def cluster_client(address: str) -> "Iterator[Client]":
    """Client of a running cluster.

    Raises
    ------
    OSError
        There is no scheduler at the address, or no worker comes.
    ValueError
        A worker takes several members at a time.
    """
    distributed = need_dask()
    try:
        client = distributed.Client(address, timeout=10)
    except (OSError, TimeoutError) as error:
        message = f"there is no Dask scheduler at {address} ({error})"
        raise OSError(message) from error
    with client:
        try:
            client.wait_for_workers(1, timeout=WAIT)
        except TimeoutError as error:
            message = f"the cluster at {address} has had no worker for {WAIT:g} s"
            raise OSError(message) from error
        _check_workers(client)
        yield client


def _check_workers(client: "Client") -> None:
    """Raise ValueError if a worker would take members that have to wait for each other."""
    for worker, threads in client.nthreads().items():
        if threads != 1:
            message = (
                f"worker {worker} takes {threads} tasks at a time; a member has the threads of its "
                "process to itself. Start workers by --nthreads 1, with --nworkers for their "
                "number; threads_per_member sets the threads of a member"
            )
            raise ValueError(message)


def results(
    client: "Client", task: Callable[[Member], str], members: Sequence[Member]
) -> Iterator[tuple[Member, str]]:
    """Each member with "" or its error, as they end."""
    distributed = need_dask()
    futures = {client.submit(task, member, pure=False): member for member in members}
    for future in distributed.as_completed(list(futures)):
        error = future.exception()
        yield futures[future], future.result() if error is None else _lost(error)
        future.release()


def _lost(error: BaseException) -> str:
    """Text of an error of Dask's own: a worker that died, a result that never came."""
    return f"{type(error).__name__}: {' '.join(str(error).split())}"
