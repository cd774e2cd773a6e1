"""Label images: which cell is where."""

from collections.abc import Iterable, Iterator, Sequence
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from morphosim.cell_field import CellField
from morphosim.period import Period
from morphosim.provenance import check_memory

INSIDE = 0.5
"""A point belongs to the cell of largest φ, if that (or the sum of all φ) exceeds this."""
MOST_POINTS = 1 << 31
POINT_BYTES = 8
"""Bytes that a point of an image takes while it is made."""


def label_image(
    fields: Sequence[CellField], *, filled: bool = False, period: Period | None = None
) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """Image of the lattice around all boxes: 0 outside, else 1 + the place of the cell in `fields`.

    Parameters
    ----------
    fields
        Cells, whose numbers are those of their places, from 1.
    filled
        Whether points between cells, where no φ exceeds 0.5 but the sum of all does, belong to the
        cell of largest φ too. Cells in contact then have no gap, as in a segmented image.
    period
        After which space repeats: the image is one period along these axes.

    Returns
    -------
    origin : (3,) int64, lattice position of the first point
    labels : (nx, ny, nz) int32

    Raises
    ------
    ValueError
        There are no fields, or the image would have more than 2³¹ points, or more than fit into
        memory.
    """
    if not fields:
        message = "there are no fields to make a label image of"
        raise ValueError(message)
    low = np.min([f.origin for f in fields], axis=0)
    shape = np.max([f.origin + f.phi.shape for f in fields], axis=0) - low
    if period is not None:
        low, shape = period.block(low, shape)
    return low, labels_within(fields, low, shape, filled=filled, period=period)


def labels_within(
    fields: Iterable[CellField],
    low: NDArray[np.int64],
    shape: NDArray[np.int64],
    *,
    filled: bool = False,
    period: Period | None = None,
) -> NDArray[np.int32]:
    """Label image of the block of this first point and shape, which holds all boxes or a period.

    Each field is looked at once, so that they need not all be in memory; see `label_image`.
    """
    check_size(shape, "make one of cells that are nearer to each other", POINT_BYTES + 4 * filled)
    labels = np.zeros(shape, np.int32)
    largest = np.full(shape, 0 if filled else INSIDE, np.float32)
    total = np.zeros(shape if filled else 0, np.float32)
    for label, field in enumerate(fields, 1):
        for place, part in _parts(field, low, period):
            mine = part > largest[place]
            labels[place][mine] = label
            np.maximum(largest[place], part, out=largest[place])
            if filled:
                total[place] += part
    if filled:
        labels[total <= INSIDE] = 0
    return labels


def _parts(
    field: CellField, low: NDArray[np.int64], period: Period | None
) -> Iterator[tuple[tuple[slice, ...], NDArray[Any]]]:
    """Where a field lies in a block, and its values; in parts, where it lies over faces."""
    first = field.origin - low
    if period is None:
        yield tuple(slice(a, a + n) for a, n in zip(first, field.phi.shape, strict=True)), field.phi
        return
    cuts = (period.cuts(axis, int(first[axis]), n) for axis, n in enumerate(field.phi.shape))
    for cut in product(*cuts):
        yield tuple(goal for goal, _ in cut), field.phi[tuple(source for _, source in cut)]


def check_size(shape: NDArray[np.int64], advice: str, point_bytes: int = POINT_BYTES) -> None:
    """Raise ValueError if an image of this shape is beyond `MOST_POINTS`, or the memory."""
    if np.prod(shape, dtype=float) > MOST_POINTS:
        size = " x ".join(map(str, shape))
        message = f"a label image of {size} points is too large; {advice}"
        raise ValueError(message)
    what = f"a label image of {' x '.join(map(str, shape))} points"
    check_memory(what, point_bytes * float(np.prod(shape, dtype=float)), advice)
