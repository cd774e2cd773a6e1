"""Label images: which cell is where."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from morphosim.cell_field import CellField

INSIDE = 0.5
"""A point belongs to the cell of largest φ, if that exceeds this."""
MOST_POINTS = 1 << 31


def label_image(fields: Sequence[CellField]) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """Image of the lattice around all boxes: 0 outside, else 1 + the place of the cell in `fields`.

    Returns
    -------
    origin : (3,) int64, lattice position of the first point
    labels : (nx, ny, nz) int32

    Raises
    ------
    ValueError
        There are no fields, or the image would have more than 2³¹ points.
    """
    if not fields:
        message = "there are no fields to make a label image of"
        raise ValueError(message)
    low = np.min([f.origin for f in fields], axis=0)
    shape = np.max([f.origin + f.phi.shape for f in fields], axis=0) - low
    if np.prod(shape, dtype=float) > MOST_POINTS:
        message = (
            f"a label image of {' x '.join(map(str, shape))} points is too large; make one of "
            "cells that are nearer to each other"
        )
        raise ValueError(message)
    labels = np.zeros(shape, np.int32)
    largest = np.full(shape, INSIDE, np.float32)
    for label, field in enumerate(fields, 1):
        place = tuple(
            slice(a, a + n) for a, n in zip(field.origin - low, field.phi.shape, strict=True)
        )
        mine = field.phi > largest[place]
        labels[place][mine] = label
        np.maximum(largest[place], field.phi, out=largest[place])
    return low, labels
