"""Which thread steps which cells."""

import heapq
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from morphosim.engine.box_pool import morton_order

Integers = NDArray[np.int64]
MANY = 32
"""From so many cells per thread on, each thread takes a region of space: what neighbours share
stays in its cache. With fewer, balance counts more."""


class Schedule(NamedTuple):
    """The cells that are stepped, one list per thread."""

    bounds: Integers
    """(threads + 1,) ranges of `order`."""
    order: Integers
    """Cells, grouped by thread."""

    def lists(self) -> list[Integers]:
        """Cells of each thread."""
        return [self.order[a:b] for a, b in zip(self.bounds, self.bounds[1:], strict=False)]


def share_out(
    cells: Integers, cost: NDArray[np.float64], origin: Integers, threads: int
) -> Schedule:
    """Give each thread a list of cells of about the same work.

    Parameters
    ----------
    cells : (n,) rows of the cells that are stepped
    cost : (n,) work of each, relative
    origin : (n, 3) lattice positions of their boxes
    threads : int
    """
    if len(cells) < MANY * threads:
        lists = _largest_first(cost, threads)
    else:
        along = morton_order(origin)
        load = np.cumsum(cost[along])
        ends = np.searchsorted(load, load[-1] * np.arange(1, threads) / threads)
        lists = np.split(along, ends)
    bounds = np.cumsum([0] + [len(part) for part in lists]).astype(np.int64)
    return Schedule(bounds, cells[np.concatenate(lists)])


def _largest_first(cost: NDArray[np.float64], threads: int) -> list[Integers]:
    """Items shared out, the largest first, each to whom has least."""
    lists: list[list[int]] = [[] for _ in range(threads)]
    loads = [(0.0, w) for w in range(threads)]
    for i in np.argsort(-cost, kind="stable").tolist():
        load, worker = heapq.heappop(loads)
        lists[worker].append(i)
        heapq.heappush(loads, (load + cost[i], worker))
    return [np.array(items, np.int64) for items in lists]
