"""Boxes with random fields for the kernel tests, and their frames.

Between the boxes the pools hold NaN, so that a read outside of a box shows.
"""

import importlib
import pkgutil
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
from numba.core.registry import CPUDispatcher
from numpy.typing import NDArray

from morphosim import kernels
from morphosim.kernels.frames import HALO, LEAD, clear, frame_size, load, strides
from morphosim.kernels.layout import Boxes, Stencil
from morphosim.kernels.stencils import COEFFICIENTS, LAPLACIAN_COEFFICIENTS

H = 0.5
GAP = 5
SHAPES = ((10, 12, 16), (8, 10, 14), (14, 8, 12), (8, 8, 8), (8, 10, 10))
ORIGINS = ((-9, -3, -20), (-5, 2, -12), (-12, -8, -25), (40, 40, 40), (-6, 1, 55))
"""Three boxes that overlap, at negative lattice positions, one far away, one far above them."""

both_ways = pytest.mark.parametrize("way", ["compiled", "python"])


def taken(kernel: Any, way: str) -> Callable:
    """The kernel itself, or its Python function, which then calls only such."""
    if way == "compiled":
        return kernel

    def interpreted(*arguments: Any) -> Any:
        with ExitStack() as stack, np.errstate(all="ignore"):
            for module, name, function in _dispatchers():
                stack.enter_context(patch.object(module, name, function.py_func))
            return getattr(kernel, "py_func", kernel)(*arguments)

    return interpreted


def _dispatchers() -> Iterator[tuple[Any, str, Any]]:
    for found in pkgutil.iter_modules(kernels.__path__):
        module = importlib.import_module(f"{kernels.__name__}.{found.name}")
        for name, value in list(vars(module).items()):
            if isinstance(value, CPUDispatcher):
                yield module, name, value


def make_stencil(order: int, dtype: type = np.float64) -> Stencil:
    first = [dtype(w / H) for w in COEFFICIENTS[order]]
    second = [dtype(w / H**2) for w in LAPLACIAN_COEFFICIENTS[order]]
    return Stencil(*(*first, None, None)[:3], *(*second, None, None)[:4])


def lay_out(origins: Any, shapes: Any) -> tuple[Boxes, NDArray[np.float64]]:
    """Boxes with bands that are empty, and a pool with 0 in the boxes and NaN between them."""
    shape = np.array(shapes)
    size, planes = shape.prod(axis=1), shape[:, 0]
    start = np.cumsum([GAP, *(size + GAP)])[:-1]
    plane_start = np.cumsum([GAP, *(planes + GAP)])[:-1]
    band = np.full((plane_start[-1] + planes[-1] + GAP, 2), -77, np.int32)
    phi = np.full(start[-1] + size[-1] + GAP, np.nan)
    for i in range(len(shape)):
        phi[start[i] : start[i] + size[i]] = 0
        band[plane_start[i] : plane_start[i] + planes[i]] = shape[i, 1], 0
    return Boxes(np.array(origins), shape, start, plane_start, band), phi


def make_boxes(
    seed: int, origins: tuple = ORIGINS, shapes: tuple = SHAPES
) -> tuple[Boxes, NDArray[np.float64]]:
    """Boxes and a pool of fields that vanish outside of random bands."""
    rng = np.random.default_rng(seed)
    boxes, phi = lay_out(origins, shapes)
    for i, (nx, ny, _) in enumerate(shapes):
        rows = band_of(boxes, i)
        rows[:] = [random_rows(rng, ny) for _ in range(nx)]
        field = box(phi, boxes, i)
        field[:] = np.where(in_band(boxes, i)[..., None], rng.uniform(0.1, 1, field.shape), 0)
    return boxes, phi


def random_rows(rng: np.random.Generator, ny: int) -> tuple[int, int]:
    """Rows [low, high) of one plane; (ny, 0), an empty band, now and then."""
    if rng.random() < 0.2:
        return ny, 0
    low = int(rng.integers(0, ny - 2))
    return low, int(rng.integers(low + 1, ny + 1))


def empty_pool(phi: NDArray) -> NDArray:
    """A pool of the same layout with nothing sensible in it."""
    return np.full(len(phi), 1e30)


def box(pool: NDArray, boxes: Boxes, i: int) -> NDArray:
    """Cell i's part of a pool, as a 3-D view."""
    shape = tuple(boxes.shape[i])
    return pool[boxes.start[i] : boxes.start[i] + np.prod(shape)].reshape(shape)


def band_of(boxes: Boxes, i: int) -> NDArray:
    """Rows of each plane of cell i's band, (nx, 2), as a view."""
    return boxes.band[boxes.plane_start[i] : boxes.plane_start[i] + boxes.shape[i, 0]]


def in_band(boxes: Boxes, i: int, whole: bool = False) -> NDArray[np.bool_]:
    """Which rows (x, y) of cell i's box are in its band, or worked on if `whole`."""
    y, rows = np.arange(boxes.shape[i, 1]), band_of(boxes, i)
    return ((y >= rows[:, :1]) & (y < rows[:, 1:])) | whole


def positions(boxes: Boxes, i: int) -> list[NDArray]:
    """Lattice positions of cell i's points, as an open grid."""
    axes = [np.arange(o, o + n) for o, n in zip(boxes.origin[i], boxes.shape[i], strict=True)]
    return list(np.meshgrid(*axes, indexing="ij", sparse=True))


def seen_from(boxes: Boxes, pool: NDArray, j: int, i: int, halo: int = HALO) -> NDArray[np.float64]:
    """Cell j's field around cell i's box, with a halo; 0 outside of cell j's box."""
    start, shape = boxes.origin[i] - halo, boxes.shape[i] + 2 * halo
    result = np.zeros(shape)
    low = np.maximum(start, boxes.origin[j])
    high = np.minimum(start + shape, boxes.origin[j] + boxes.shape[j])
    if (low < high).all():
        here, there = (
            tuple(slice(a - o, b - o) for a, b, o in zip(low, high, corner, strict=True))
            for corner in (start, boxes.origin[j])
        )
        result[here] = box(pool, boxes, j)[there]
    return result


def empty_frame(boxes: Boxes, i: int, value: float = np.nan, more: int = 0) -> NDArray[np.float64]:
    """A frame of cell i with this value everywhere, and `more` of it behind."""
    return np.full(frame_size(i, boxes) + more, value)


def loaded(boxes: Boxes, i: int, pool: NDArray, whole: bool = False) -> NDArray:
    """Cell i's frame of its field in a pool; NaN where no stencil on the band reads."""
    frame = empty_frame(boxes, i).astype(pool.dtype)
    clear(i, boxes, whole, frame)
    load(i, pool, boxes, whole, frame)
    return frame


def mirrored(boxes: Boxes, i: int, pool: NDArray) -> NDArray:
    """Cell i's frame of its field in a pool, continued beyond its faces as cosine series are."""
    frame = empty_frame(boxes, i).astype(pool.dtype)
    with_halo(frame, boxes, i)[:] = np.pad(box(pool, boxes, i), HALO, mode="symmetric")
    return frame


def grid(frame: NDArray, boxes: Boxes, i: int) -> NDArray:
    """A frame of cell i as a 3-D view, with the halo and what its rows are rounded up by."""
    sx, sy = strides(i, boxes)
    first, planes = LEAD - HALO, boxes.shape[i, 0] + 2 * HALO
    return frame[first : first + planes * sx].reshape(planes, sx // sy, sy)


def with_halo(frame: NDArray, boxes: Boxes, i: int) -> NDArray:
    """A frame of cell i as a 3-D view of the box with HALO points around it."""
    return grid(frame, boxes, i)[..., : boxes.shape[i, 2] + 2 * HALO]


def inside(frame: NDArray, boxes: Boxes, i: int) -> NDArray:
    """The box in a frame of cell i, as a 3-D view."""
    return with_halo(frame, boxes, i)[HALO:-HALO, HALO:-HALO, HALO:-HALO]


def in_runs(boxes: Boxes, i: int, whole: bool = False) -> NDArray[np.bool_]:
    """Which points of cell i's flat frame lie between the first and the last of a plane's band."""
    flat = np.zeros(frame_size(i, boxes), bool)
    number = inside(np.arange(len(flat)), boxes, i)
    for plane, rows in zip(number, in_band(boxes, i, whole), strict=True):
        if rows.any():
            flat[plane[rows].min() : plane[rows].max() + 1] = True
    return flat


def flat_laplacian(frame: NDArray, boxes: Boxes, i: int, order: int) -> NDArray:
    """Δ of a flat frame; at the end of a row its neighbour is what comes next in the frame."""
    centre, *sides = LAPLACIAN_COEFFICIENTS[order]
    result = 3 * centre * frame
    for stride in (*strides(i, boxes), 1):
        for m, w in enumerate(sides, 1):
            result = result + w * (np.roll(frame, m * stride) + np.roll(frame, -m * stride))
    return result / H**2


def expected_band(field: NDArray, tolerance: float, guard: int = 1) -> NDArray:
    """Rows of each plane beyond the tolerance, `guard` more on each side; (ny, 0) for none."""
    nx, ny, _ = field.shape
    rows = (np.abs(field) > tolerance).any(axis=2)
    for _ in range(guard):
        wider = np.zeros_like(rows)
        for x in range(nx):
            wider[x] = hull(rows[x])
            wider[x, 1:] |= wider[x, :-1].copy()
            wider[x, :-1] |= hull(rows[x])[1:]
            for beside in (x - 1, x + 1):
                if 0 <= beside < nx:
                    wider[x] |= hull(rows[beside])
        rows = wider
    result = np.full((nx, 2), (ny, 0))
    for x in range(nx):
        if rows[x].any():
            result[x] = np.flatnonzero(rows[x])[[0, -1]] + (0, 1)
    return result


def hull(rows: NDArray) -> NDArray[np.bool_]:
    """All rows between the first and the last of these."""
    return np.asarray(np.logical_or.accumulate(rows) & np.logical_or.accumulate(rows[::-1])[::-1])
