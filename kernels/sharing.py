"""How threads share work: pieces, which each takes as it comes free.

So a thread that the system puts aside, for another program, leaves its share to the others. Who
takes which piece changes from run to run; what is done there must not depend on it.
"""

import numpy as np
from numba.core import types
from numba.extending import intrinsic, overload

from morphosim.kernels._jit import kernel
from morphosim.kernels.layout import Shares

PIECES = 16
"""Pieces per thread: few enough that neighbours meet in one cache."""


def shares_of(bounds, threads):
    """Shares of pieces with these bounds (pieces + 1,); not a kernel."""
    return Shares(threads, np.asarray(bounds, np.int64), np.zeros(1, np.int64))


def equal_shares(cost, threads):
    """Shares of a list of work of these costs (n,), in pieces of about equal cost; not a kernel."""
    load, pieces = np.cumsum(np.append(0, cost)), PIECES * threads if threads > 1 else 1
    inner = np.searchsorted(load[1:], load[-1] * np.arange(1, pieces) / pieces)
    return shares_of([0, *inner, len(cost)], threads)


@intrinsic
def _atomic_take(typing_context, taken):
    """Add 1 to the first of an array of int64; give what it was. No two threads get the same."""

    def generate(context, builder, signature, arguments):
        array = context.make_array(signature.args[0])(context, builder, arguments[0])
        one = context.get_constant(types.int64, 1)
        return builder.atomic_rmw("add", array.data, one, "monotonic")

    return types.int64(taken), generate


def take(taken):
    """Number of the next piece."""
    taken[0] += 1
    return taken[0] - 1


@overload(take)
def _take_in_turn(taken):
    return lambda taken: _atomic_take(taken)


@kernel()
def offer(shares):
    """Offer all pieces: none is taken."""
    shares.taken[0] = 0


@kernel(kept=False)
def turns(shares):
    """Places in the list of work whose turn it is for this thread; other threads get others."""
    pieces = shares.bounds.shape[0] - 1
    piece = take(shares.taken)
    while piece < pieces:
        for k in range(shares.bounds[piece], shares.bounds[piece + 1]):  # noqa: UP028
            yield k
        piece = take(shares.taken)
