"""Boxes with random fields for the kernel tests.

Between the boxes the pools hold NaN, so that a read outside of a box shows.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from morphosim.kernels.layout import Boxes

GAP = 5
SHAPES = ((10, 12, 16), (8, 10, 14), (14, 8, 12), (8, 8, 8))
ORIGINS = ((-9, -3, -20), (-5, 2, -12), (-12, -8, -25), (40, 40, 40))
"""Three boxes that overlap, at negative lattice positions, and one far away."""

both_ways = pytest.mark.parametrize("way", ["compiled", "python"])


def taken(kernel: Any, way: str) -> Callable:
    """The kernel itself, or its Python function."""
    return kernel if way == "compiled" else kernel.py_func


def make_boxes(
    seed: int, origins: tuple = ORIGINS, shapes: tuple = SHAPES
) -> tuple[Boxes, NDArray[np.float64]]:
    """Boxes and a pool of fields that vanish outside of random row spans."""
    rng = np.random.default_rng(seed)
    size = np.array(shapes).prod(axis=1)
    rows = np.array(shapes)[:, :2].prod(axis=1)
    start = np.cumsum([GAP, *(size + GAP)])[:-1]
    row_start = np.cumsum([GAP, *(rows + GAP)])[:-1]
    spans = np.zeros((row_start[-1] + rows[-1] + GAP, 2), np.int32)
    phi = np.full(start[-1] + size[-1] + GAP, np.nan)
    for i, (nx, ny, nz) in enumerate(shapes):
        field = np.zeros((nx * ny, nz))
        for line, row in enumerate(field):
            low, high = random_span(rng, nz)
            spans[row_start[i] + line] = low, high
            row[low:high] = rng.uniform(0.1, 1, max(high - low, 0))
        phi[start[i] : start[i] + size[i]] = field.ravel()
    return Boxes(np.array(origins), np.array(shapes), start, row_start, spans), phi


def random_span(rng: np.random.Generator, nz: int) -> tuple[int, int]:
    """A band [low, high) away from the ends of a row; (nz, 0), an empty one, now and then."""
    if rng.random() < 0.2:
        return nz, 0
    low = int(rng.integers(0, nz - 2))
    return low, int(rng.integers(low + 1, nz + 1))


def empty_pool(phi: NDArray) -> NDArray:
    """A pool of the same layout with nothing sensible in it."""
    return np.full(len(phi), 1e30)


def box(pool: NDArray, boxes: Boxes, i: int) -> NDArray:
    """Cell i's part of a pool, as a 3-D view."""
    shape = tuple(boxes.shape[i])
    return pool[boxes.start[i] : boxes.start[i] + np.prod(shape)].reshape(shape)


def positions(boxes: Boxes, i: int) -> list[NDArray]:
    """Lattice positions of cell i's points, as an open grid."""
    axes = [np.arange(o, o + n) for o, n in zip(boxes.origin[i], boxes.shape[i], strict=True)]
    return list(np.meshgrid(*axes, indexing="ij", sparse=True))


def seen_from(boxes: Boxes, pool: NDArray, j: int, i: int) -> NDArray[np.float64]:
    """Cell j's field at the points of cell i's box, 0 outside of cell j's box."""
    result = np.zeros(boxes.shape[i])
    low = np.maximum(boxes.origin[i], boxes.origin[j])
    high = np.minimum(boxes.origin[i] + boxes.shape[i], boxes.origin[j] + boxes.shape[j])
    if (low < high).all():
        here, there = (
            tuple(slice(a - o, b - o) for a, b, o in zip(low, high, boxes.origin[k], strict=True))
            for k in (i, j)
        )
        result[here] = box(pool, boxes, j)[there]
    return result
