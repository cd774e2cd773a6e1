"""Which rank owns which cell: recursive bisection of space."""

import numpy as np
from numpy.typing import NDArray

Integers = NDArray[np.int64]
FROZEN = 0.1
"""Work of a frozen cell, which is summed and not stepped, in parts of a stepped one."""


def owners(points: NDArray[np.float64], weight: NDArray[np.float64], ranks: int) -> Integers:
    """Rank of each cell, of about equal weight per rank and with few neighbours across.

    Space is cut along its longest axis, again and again. All ranks find the same.

    Parameters
    ----------
    points : (N, 3)
        Where the cells are.
    weight : (N,)
        Work of each cell, positive.
    ranks : int
        Each gets one cell at least.

    Raises
    ------
    ValueError
        There are fewer cells than ranks.
    """
    if len(points) < ranks:
        message = (
            f"{len(points)} cells on {ranks} ranks: every rank needs a cell; start at most "
            f"{len(points)} ranks"
        )
        raise ValueError(message)
    result = np.zeros(len(points), np.int64)
    todo = [(np.arange(len(points)), 0, ranks)]
    while todo:
        cells, first, count = todo.pop()
        if count == 1:
            result[cells] = first
            continue
        left, right = _halves(cells, points, weight, count)
        todo += [(left, first, count // 2), (right, first + count // 2, count - count // 2)]
    return result


def _halves(
    cells: Integers, points: NDArray[np.float64], weight: NDArray[np.float64], count: int
) -> tuple[Integers, Integers]:
    """Cells for count // 2 ranks, and cells for the others."""
    here = points[cells]
    axis = int(np.argmax(here.max(axis=0) - here.min(axis=0)))
    along = cells[np.argsort(here[:, axis], kind="stable")]
    load = np.cumsum(weight[along])
    share = count // 2 / count
    cut = int(np.searchsorted(load, share * load[-1])) + 1
    cut = min(max(cut, count // 2), len(cells) - (count - count // 2))
    return along[:cut], along[cut:]


def work(shape: Integers, frozen: NDArray[np.bool_]) -> NDArray[np.float64]:
    """(N,) work of cells with boxes of these shapes (N, 3)."""
    return np.asarray(np.where(frozen, FROZEN, 1.0) * shape.prod(axis=1))
