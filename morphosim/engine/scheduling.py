"""How threads share the cells: in pieces, which each takes as it comes free."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from morphosim.engine.box_pool import morton_order
from morphosim.kernels.layout import Shares
from morphosim.kernels.sharing import equal_shares, shares_of

Integers = NDArray[np.int64]
MANY = 32
"""From so many cells per thread on, a piece is a region of space: what neighbours share stays in
the cache. With fewer, balance counts more, and a piece is a cell."""


class Schedule(NamedTuple):
    """The cells that are stepped, and how threads share them."""

    shares: Shares
    order: Integers
    """Cells, piece after piece."""

    def lists(self) -> list[Integers]:
        """Cells for each thread, where they are not taken in turn."""
        pieces = np.split(self.order, self.shares.bounds[1:-1])
        threads = self.shares.threads
        return [np.concatenate([self.order[:0], *pieces[k::threads]]) for k in range(threads)]


def share_out(
    cells: Integers, cost: NDArray[np.float64], origin: Integers, threads: int
) -> Schedule:
    """Cut the work into pieces: cells, of which the largest come first, or regions of equal work.

    Parameters
    ----------
    cells : (n,) rows of the cells that are stepped
    cost : (n,) work of each, relative
    origin : (n, 3) lattice positions of their boxes
    threads : int
    """
    if len(cells) < MANY * threads:
        largest_first = np.argsort(-cost, kind="stable")
        each = np.arange(len(cells) + 1)
        return Schedule(shares_of(each, threads), cells[largest_first])
    along = morton_order(origin)
    return Schedule(equal_shares(cost[along], threads), cells[along])
