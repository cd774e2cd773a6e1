"""Trials side by side, in processes of this machine or of a cluster (Dask)."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, TypeVar

from morphosim.progress import TellWhat
from morphosim.simulation.warming import not_ahead
from morphosim.sweeps.scheduler import cluster_client, local_client, need_dask, shares

T = TypeVar("T")


class Pool:
    """Workers, and how much they have done.

    Attributes
    ----------
    runs : int
        Number of tasks so far.
    expected : int
        Number of tasks that there will be, as far as is known.
    """

    def __init__(self, client: Any, tell: TellWhat, runs: int) -> None:
        self._client, self._tell = client, tell
        self.runs = self.expected = runs

    def map(self, function: Callable[..., T], shared: Any, items: Sequence[Any]) -> list[T]:
        """Call function(shared, item) for each item; the results, in their order."""
        distributed = need_dask()
        at = self._client.scatter(shared, broadcast=True, hash=False)
        futures = [self._client.submit(_called, function, at, item, pure=False) for item in items]
        for _ in distributed.as_completed(futures):
            self.runs += 1
            self.expected = max(self.expected, self.runs)
            self._tell("runs", self.runs, self.expected)
        return list(self._client.gather(futures))


def _called(function: Callable[..., T], shared: Any, item: Any) -> T:
    with not_ahead():
        return function(shared, item)


@contextmanager
def pool(workers: int | None, address: str | None, tell: TellWhat, runs: int) -> Iterator[Pool]:
    """Pool of as many processes of this machine, or of those of a cluster."""
    client = cluster_client(address) if address else local_client(shares(64, workers, 1)[0])
    with client as running:
        yield Pool(running, tell, runs)
