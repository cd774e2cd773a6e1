"""How threads share the cells: in pieces, which each takes as it comes free; and how many do.

What a step computes does not depend on the number of threads, so that it may change at any time.
"""

from collections import deque
from statistics import mean
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
SHORTEST, LONGEST = 12, 1536
"""Steps between two tries of another number of threads: the more often that was no better, the
more."""
USUAL, UNCOUNTED, LONG_ENOUGH = 12, 1, 0.01
"""How many steps are compared with; how many of those that are tried do not count, since caches
are cold; and how many seconds either must last."""
CLEARLY = 0.95
"""What is tried stays if it takes less than this share of the time."""


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


class ThreadCount:
    """How many threads take part in a step: fewer where more do not pay.

    Where other programs keep processors busy, a step waits for the thread that was put aside; and
    where processors fall asleep between steps, threads come late. Both is seen in the time alone.
    So a few steps are tried now and then with one thread more or fewer than before, and what was
    faster stays.

    Parameters
    ----------
    most : int
        How many there are.

    Attributes
    ----------
    now : int
        How many take part in the next step.
    """

    def __init__(self, most: int) -> None:
        self.now = self._settled = self._most = most
        self._usual: deque[float] = deque(maxlen=USUAL)
        self._tried: list[float] = []
        self._pause, self._left, self._upwards = SHORTEST, USUAL + SHORTEST, False

    def took(self, seconds: float) -> None:
        """How long the step has taken."""
        if self._most == 1:
            return
        if self.now != self._settled:
            self._tried.append(seconds)
            if len(self._tried) > UNCOUNTED and sum(self._tried) >= LONG_ENOUGH:
                self._decide()
            return
        self._usual.append(seconds)
        self._left -= 1
        if self._left <= 0 and sum(self._usual) >= LONG_ENOUGH:
            self._try_other()

    def _try_other(self) -> None:
        """Go on with one thread more or fewer, in turn where both are possible."""
        self._upwards = self._settled == 1 or (self._settled < self._most and not self._upwards)
        self.now = self._settled + (1 if self._upwards else -1)

    def _decide(self) -> None:
        """Stay with the number that is tried if it is clearly faster, or go back."""
        tried, usual = mean(self._tried[UNCOUNTED:]), mean(self._usual)
        if tried < CLEARLY * usual:
            self._settled, self._pause = self.now, SHORTEST
            self._usual.clear()
        else:
            self._pause = min(4 * self._pause, LONGEST)
        self.now, self._left = self._settled, self._pause
        self._tried.clear()
