"""How threads share work: all of it is done, once, whatever their number."""

import numpy as np
import pytest
from numba import get_num_threads, prange

from morphosim.kernels._jit import parallel_kernel
from morphosim.kernels.layout import Shares
from morphosim.kernels.sharing import PIECES, equal_shares, offer, shares_of, turns
from morphosim.numerics.threads import available_processors

from .example_boxes import taken


@parallel_kernel()
def mark(shares, times, by):
    """Count how often each place has had its turn, and by which worker."""
    offer(shares)
    for worker in prange(shares.threads):
        for k in turns(shares):
            times[k] += 1
            by[k] = worker


@pytest.mark.parametrize("way", ["python", "compiled"])
@pytest.mark.parametrize(
    "shares",
    [
        shares_of([0, 7], threads=1),
        shares_of([0, 1, 1, 4, 7], threads=2),
        shares_of(range(8), threads=5),
        shares_of([0, 7, 7], threads=3),
    ],
)
def test_each_place_has_its_turn_once_each_time(shares: Shares, way: str) -> None:
    times, by = np.zeros(7, np.int64), np.full(7, -1)
    for again in (1, 2, 3):
        taken(mark, way)(shares, times, by)
        assert (times == again).all()
    assert ((by >= 0) & (by < shares.threads)).all()


def test_many_pieces_are_taken_by_more_than_one_thread() -> None:
    if min(get_num_threads(), available_processors()) < 2:
        pytest.skip("there is one thread, or one processor")
    times, by = np.zeros(2_000_000, np.int64), np.zeros(2_000_000, np.int64)
    workers: set[int] = set()
    for _ in range(100):
        mark(equal_shares(np.ones(len(times)), threads=2), times, by)
        workers |= set(np.unique(by).tolist())
        if len(workers) > 1:
            return
    raise AssertionError("one thread has done everything, a hundred times")


def test_pieces_cost_about_the_same() -> None:
    cost = np.random.default_rng(3).uniform(1, 3, 1000)
    shares = equal_shares(cost, threads=4)
    assert shares.threads == 4
    assert (shares.bounds[0], shares.bounds[-1]) == (0, 1000)
    pieces = np.add.reduceat(cost, shares.bounds[:-1])
    assert len(pieces) == 4 * PIECES
    assert pieces.max() - pieces.min() < 2 * cost.max()


@pytest.mark.parametrize("threads", [1, 3])
@pytest.mark.parametrize("cost", [[], [5], [0, 0], [3, 0, 0]])
def test_little_work_is_shared_out_as_well(cost: list[int], threads: int) -> None:
    shares = equal_shares(np.array(cost, np.int64), threads)
    assert (np.diff(shares.bounds) >= 0).all()
    assert (shares.bounds[0], shares.bounds[-1]) == (0, len(cost))
