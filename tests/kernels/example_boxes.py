"""Boxes with random fields for the kernel tests, and their frames, stretches and lists of rows.

Boxes are held as solvers on the band hold them, or whole. Each cell has room in the pools for its
whole box; where it keeps nothing the pools hold NaN, so that a read outside of what is held shows.
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
from morphosim.kernels.boxes import N_SURVEYED
from morphosim.kernels.frames import HALO, LEAD, frame_size, strides
from morphosim.kernels.helmholtz import COLUMNS
from morphosim.kernels.layout import Boxes, Room, Stencil
from morphosim.kernels.rows import BLOCK, N_SPANS, list_blocks, n_listed
from morphosim.kernels.stencils import COEFFICIENTS, LAPLACIAN_COEFFICIENTS
from morphosim.kernels.step import N_FRAMES, N_STRETCHES

H = 0.5
GAP = 5
SHAPES = ((10, 12, 38), (8, 10, 30), (14, 8, 22), (8, 8, 16), (8, 10, 20))
ORIGINS = ((-9, -3, -20), (-5, 2, -12), (-12, -8, -25), (40, 40, 40), (-6, 1, 55))
"""Three boxes that overlap, at negative lattice positions, one far away, one far above them."""

both_ways = pytest.mark.parametrize("way", ["compiled", "python"])
both_precisions = pytest.mark.parametrize("dtype", [np.float32, np.float64])


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


# --- boxes and pools -----------------------------------------------------------------------------


def lay_out(
    origins: Any, shapes: Any, spans: Any = None, whole: bool = False
) -> tuple[Boxes, NDArray[np.float64]]:
    """Boxes, and a pool with 0 in what they hold and NaN elsewhere.

    Parameters
    ----------
    spans : of each cell, (nx, ny, 2) points [low, high) of its rows in the band; all empty if None
    whole : whether the whole boxes are held, not only the band
    """
    shape = np.array(shapes)
    size, rows = shape.prod(axis=1), shape[:, :2].prod(axis=1)
    start = np.cumsum([GAP, *(size + GAP)])[:-1]
    row_start = np.cumsum([GAP, *(rows + GAP)])[:-1]
    end = row_start[-1] + rows[-1] + GAP
    low, high = np.full((2, end), -77, np.int16)
    place = np.full(end, -77, np.int32)
    boxes = Boxes(np.array(origins), shape, start, row_start, low, high, place)
    phi = np.full(start[-1] + size[-1] + GAP, np.nan)
    for i, (nx, ny, nz) in enumerate(shape):
        if whole:
            rows_of(boxes.place, boxes, i)[:] = np.arange(nx * ny).reshape(nx, ny) * nz
        set_band(boxes, i, np.zeros((nx, ny, 2), int) if spans is None else spans[i], whole)
        put(phi, boxes, i, np.zeros((nx, ny, nz)))
    return boxes, phi


def set_band(boxes: Boxes, i: int, spans: Any, whole: bool = False) -> None:
    """Give cell i this band, (nx, ny, 2), or what is as large."""
    low, high = rows_of(boxes.low, boxes, i), rows_of(boxes.high, boxes, i)
    low[:], high[:] = np.moveaxis(np.broadcast_to(spans, (*low.shape, 2)), -1, 0)
    if not whole:
        length = np.maximum(high - low, 0).ravel().astype(int)
        begins = np.cumsum(length) - length - low.ravel()
        rows_of(boxes.place, boxes, i)[:] = begins.reshape(low.shape)


def make_boxes(
    seed: int, origins: tuple = ORIGINS, shapes: tuple = SHAPES, whole: bool = False
) -> tuple[Boxes, NDArray[np.float64]]:
    """Boxes and a pool of fields that vanish outside of random bands."""
    rng = np.random.default_rng(seed)
    make = whole_rows_of_planes if whole else random_spans
    boxes, phi = lay_out(origins, shapes, [make(rng, *shape) for shape in shapes], whole)
    for i, shape in enumerate(shapes):
        put(phi, boxes, i, np.where(in_band(boxes, i), rng.uniform(0.1, 1, shape), 0))
    return boxes, phi


def random_spans(rng: np.random.Generator, nx: int, ny: int, nz: int) -> NDArray[np.int64]:
    """Points [low, high) of rows, at least a block or, now and then, none."""
    length = rng.integers(BLOCK, nz + 1, (nx, ny))
    low = rng.integers(0, nz - length + 1)
    spans = np.stack([low, low + length], axis=-1)
    spans[rng.random((nx, ny)) < 0.25] = 0
    return np.asarray(spans)


def whole_rows_of_planes(rng: np.random.Generator, nx: int, ny: int, nz: int) -> NDArray[np.int64]:
    """All points of rows that follow one another in each plane; none of some planes."""
    spans = np.zeros((nx, ny, 2), int)
    for plane in spans:
        if rng.random() > 0.2:
            low = int(rng.integers(0, ny - 2))
            plane[low : int(rng.integers(low + 1, ny + 1))] = 0, nz
    return spans


def empty_pool(phi: NDArray) -> NDArray:
    """A pool of the same layout with nothing sensible in it."""
    return np.full(len(phi), 1e30)


def rows_of(values: NDArray, boxes: Boxes, i: int) -> NDArray:
    """Cell i's part of a list of rows, (nx, ny), as a view."""
    nx, ny = boxes.shape[i, :2]
    return values[boxes.row_start[i] :][: nx * ny].reshape(nx, ny)


def band_of(boxes: Boxes, i: int) -> NDArray[np.int64]:
    """Points [low, high) of the rows of cell i in the band, (nx, ny, 2): a copy."""
    low, high = rows_of(boxes.low, boxes, i), rows_of(boxes.high, boxes, i)
    return np.stack([low, high], axis=-1).astype(np.int64)


def mask_of(spans: NDArray, nz: int) -> NDArray[np.bool_]:
    """Which points of a box are in these spans of its rows."""
    z = np.arange(nz)
    return (z >= spans[..., :1]) & (z < spans[..., 1:])


def in_band(boxes: Boxes, i: int, whole: bool = False) -> NDArray[np.bool_]:
    """Which points of cell i's box are in its band, or worked on if `whole`."""
    return mask_of(band_of(boxes, i), boxes.shape[i, 2]) | whole


def held(boxes: Boxes, i: int) -> NDArray[np.bool_]:
    """Which points of cell i's box are in the pools: the band, or all."""
    nx, ny, nz = boxes.shape[i]
    place = rows_of(boxes.place, boxes, i)
    return in_band(boxes, i, bool((place.ravel() == np.arange(nx * ny) * nz).all()))


def number(boxes: Boxes, i: int) -> NDArray[np.int64]:
    """Where each point of cell i's box lies in the pools, if it is held."""
    place = rows_of(boxes.place, boxes, i)[..., None].astype(np.int64)
    return boxes.start[i] + place + np.arange(boxes.shape[i, 2])


def box(pool: NDArray, boxes: Boxes, i: int) -> NDArray:
    """Cell i's field in a pool, as a 3-D copy; 0 where nothing is held."""
    there, values = held(boxes, i), np.zeros(boxes.shape[i], pool.dtype)
    values[there] = pool[number(boxes, i)[there]]
    return values


def put(pool: NDArray, boxes: Boxes, i: int, values: Any) -> None:
    """Write cell i's field into a pool, what of it is held."""
    there = held(boxes, i)
    pool[number(boxes, i)[there]] = np.broadcast_to(values, there.shape)[there]


def room_of(boxes: Boxes, i: int) -> slice:
    """The whole of what cell i has in the pools."""
    return slice(boxes.start[i], boxes.start[i] + boxes.shape[i].prod())


def positions(boxes: Boxes, i: int) -> list[NDArray]:
    """Lattice positions of cell i's points, as an open grid."""
    axes = [np.arange(o, o + n) for o, n in zip(boxes.origin[i], boxes.shape[i], strict=True)]
    return list(np.meshgrid(*axes, indexing="ij", sparse=True))


def seen_from(boxes: Boxes, pool: NDArray, j: int, i: int, halo: int = HALO) -> NDArray[np.float64]:
    """Cell j's field on its band around cell i's box, with a halo; 0 elsewhere."""
    start, shape = boxes.origin[i] - halo, boxes.shape[i] + 2 * halo
    result = np.zeros(shape)
    low = np.maximum(start, boxes.origin[j])
    high = np.minimum(start + shape, boxes.origin[j] + boxes.shape[j])
    if (low < high).all():
        here, there = (
            tuple(slice(a - o, b - o) for a, b, o in zip(low, high, corner, strict=True))
            for corner in (start, boxes.origin[j])
        )
        result[here] = np.where(in_band(boxes, j), box(pool, boxes, j), 0)[there]
    return result


# --- frames --------------------------------------------------------------------------------------


def empty_frame(boxes: Boxes, i: int, value: float = np.nan, more: int = 0) -> NDArray[np.float64]:
    """A frame of cell i with this value everywhere, and `more` of it behind."""
    return np.full(frame_size(i, boxes) + more, value)


def loaded(boxes: Boxes, i: int, pool: NDArray, whole: bool = False) -> NDArray:
    """Cell i's frame of its field in a pool; NaN where no stencil on the band reads."""
    frame = empty_frame(boxes, i).astype(pool.dtype)
    with_halo(frame, boxes, i)[read_by(in_band(boxes, i, whole))] = 0
    worked = in_band(boxes, i, whole)
    inside(frame, boxes, i)[worked] = box(pool, boxes, i)[worked]
    return frame


def read_by(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Points of a box and its halo that stencils on these points of the box read."""
    wide, shifts = np.pad(mask, HALO), range(-HALO, HALO + 1)
    return np.logical_or.reduce([np.roll(wide, m, axis) for axis in range(3) for m in shifts])


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


def band_in_frame(boxes: Boxes, i: int, whole: bool = False) -> NDArray[np.bool_]:
    """Which points of cell i's flat frame are in its band, or in its box if `whole`."""
    flat = np.zeros(frame_size(i, boxes), bool)
    inside(flat, boxes, i)[:] = in_band(boxes, i, whole)
    return flat


def flat_laplacian(frame: NDArray, boxes: Boxes, i: int, order: int) -> NDArray:
    """Δ of a flat frame; at the end of a row its neighbour is what comes next in the frame."""
    centre, *sides = LAPLACIAN_COEFFICIENTS[order]
    result = 3 * centre * frame
    for stride in (*strides(i, boxes), 1):
        for m, w in enumerate(sides, 1):
            result = result + w * (np.roll(frame, m * stride) + np.roll(frame, -m * stride))
    return result / H**2


# --- stretches, blocks and lists of rows ---------------------------------------------------------


def stretch(values: NDArray, boxes: Boxes, i: int) -> NDArray:
    """Values in cell i's box in the order of the pools: those that are held."""
    return values[held(boxes, i)]


def spread_out(values: NDArray, boxes: Boxes, i: int) -> NDArray:
    """Cell i's box of the values in a stretch; 0 where nothing is held."""
    result = np.zeros(boxes.shape[i], values.dtype)
    there = held(boxes, i)
    result[there] = values[: there.sum()]
    return result


def blocks_of(boxes: Boxes, i: int, whole: bool = False) -> tuple[NDArray[np.int32], int]:
    """Blocks of cell i, and their number."""
    nx, ny, nz = boxes.shape[i]
    blocks = np.full((2, nx * ny * -(-nz // BLOCK)), -5, np.int32)
    return blocks, list_blocks(i, boxes, whole, blocks)


def empty_spans(boxes: Boxes, i: int) -> NDArray[np.int16]:
    """A thread's `spans` for cell i, with nothing sensible in it."""
    return np.full((N_SPANS, n_listed(*boxes.shape[i, :2])), -99, np.int16)


def room_for(boxes: Boxes, cells: Any, threads: int, whole: bool, dtype: type) -> Room:
    """Work arrays as large as they must be and no larger, with nothing sensible in them.

    Only the frames of the field and of iterations are 0, for solvers on the band.
    """
    shape = boxes.shape[np.asarray(cells)]
    size = max(frame_size(i, boxes) for i in cells)
    size = max(size, COLUMNS * int(shape.max())) if whole else size
    frames = np.full((threads, N_FRAMES, size), np.nan, dtype)
    if not whole:
        frames[:, [0, 2, 3]] = 0
    stretches = max(stretch(in_band(boxes, i), boxes, i).size for i in cells)
    spans = max(n_listed(nx, ny) for nx, ny, _ in shape)
    blocks = (shape[:, 0] * shape[:, 1] * -(-shape[:, 2] // BLOCK)).max()
    return Room(
        frames=frames,
        stretches=np.full((threads, N_STRETCHES, stretches), np.nan, dtype),
        blocks=np.full((threads, 2, blocks), -5, np.int32),
        spans=np.full((threads, N_SPANS, spans), -99, np.int16),
        found=np.full((threads, shape[:, 0].max(), 2), -5, np.int32),
        measured=np.full((threads, N_SURVEYED), np.nan),
    )


# --- what bands should be ------------------------------------------------------------------------


def expected_band(
    field: NDArray, tolerance: float, whole: bool = False, guard: int | None = None
) -> NDArray[np.int64]:
    """Points [low, high) of each row that are to be in the band of a field, (nx, ny, 2).

    All up to `guard` lattice steps from those beyond the tolerance, and what lies between; at least
    a block. Of boxes that are held `whole`, all points of the rows from the first to the last of
    each plane.
    """
    nz = field.shape[2]
    if guard is None:
        guard = 1 if whole else 2
    beyond = np.abs(field) > tolerance
    if whole:
        rows = hull(widened(beyond.any(axis=2)[..., None], guard, axis=1)[..., 0], axis=1)
        return np.stack([np.zeros_like(rows, int), np.where(rows, nz, 0)], axis=-1)
    points = widened(beyond, guard, axis=2)
    spans = np.zeros((*field.shape[:2], 2), int)
    for row in np.argwhere(points.any(axis=2)):
        low, high = np.flatnonzero(points[tuple(row)])[[0, -1]] + (0, 1)
        length = max(high - low, BLOCK)
        low = min(max(low - (length - (high - low)) // 2, 0), nz - length)
        spans[tuple(row)] = low, low + length
    return spans


def widened(points: NDArray, guard: int, axis: int) -> NDArray[np.bool_]:
    """Hulls along an axis of all points up to `guard` lattice steps from these."""
    for _ in range(guard):
        wide = np.pad(hull(points, axis), 1)
        points = np.logical_or.reduce(
            [np.roll(wide, m, a)[1:-1, 1:-1, 1:-1] for a in range(3) for m in (-1, 0, 1)]
        )
    return hull(points, axis)


def hull(points: NDArray, axis: int) -> NDArray[np.bool_]:
    """All points between the first and the last of these along an axis."""
    before = np.logical_or.accumulate(points, axis)
    after = np.flip(np.logical_or.accumulate(np.flip(points, axis), axis), axis)
    return np.asarray(before & after)
