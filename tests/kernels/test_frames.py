"""Frames: copying boxes in and out, and the runs along which kernels work."""

import numpy as np
import pytest
from numpy.typing import NDArray

from morphosim.kernels._jit import choose, kernel
from morphosim.kernels.frames import (
    HALO,
    LEAD,
    band_rows,
    clear,
    clear_row,
    copy_row,
    frame_index,
    frame_shapes,
    frame_size,
    frame_sizes,
    load,
    mirror,
    reach,
    run,
    strides,
    unload,
)
from morphosim.kernels.layout import Boxes

from .example_boxes import (
    ORIGINS,
    band_of,
    both_ways,
    box,
    empty_frame,
    grid,
    in_band,
    in_runs,
    inside,
    make_boxes,
    taken,
    with_halo,
)

CELLS = range(len(ORIGINS))
whole_or_band = pytest.mark.parametrize("whole", [True, False])


@both_ways
def test_a_frame_holds_the_box_and_its_halo(way: str) -> None:
    boxes, _ = make_boxes(seed=20)
    for i in CELLS:
        nx, ny, nz = boxes.shape[i]
        sx, sy = taken(strides, way)(i, boxes)
        assert sy >= nz + 2 * HALO
        assert sx >= (ny + 2 * HALO) * sy
        first = taken(frame_index, way)(-HALO, -HALO, -HALO, sx, sy)
        last = taken(frame_index, way)(nx + HALO - 1, ny + HALO - 1, nz + HALO - 1, sx, sy)
        assert first == LEAD - HALO
        assert last < taken(frame_size, way)(i, boxes)
        assert sy % LEAD == 0, "rows do not begin where vectors do"


@both_ways
def test_neighbours_in_the_frame_are_a_stride_apart(way: str) -> None:
    boxes, _ = make_boxes(seed=20)
    sx, sy = strides(0, boxes)
    here = taken(frame_index, way)(3, 4, 5, sx, sy)
    there = [taken(frame_index, way)(*point, sx, sy) for point in ((4, 4, 5), (3, 5, 5), (3, 4, 6))]
    assert [p - here for p in there] == [sx, sy, 1]
    number = inside(np.arange(frame_size(0, boxes)), boxes, 0)
    assert number[3, 4, 5] == here


def near_band(boxes: Boxes, i: int, whole: bool) -> NDArray[np.bool_]:
    """Rows (x, y) of the frame that stencils along x, y or z on the band read."""
    rows = np.pad(in_band(boxes, i, whole), HALO)
    return np.logical_or.reduce(
        [np.roll(rows, m, axis) for axis in (0, 1) for m in range(-HALO, HALO + 1)]
    )


@both_ways
@whole_or_band
def test_a_cleared_and_loaded_frame_has_all_that_stencils_on_the_band_read(
    whole: bool, way: str
) -> None:
    boxes, _ = make_boxes(seed=20)
    pool = np.full(boxes.start[-1] + 9999, np.nan)
    rng = np.random.default_rng(21)
    for i in CELLS:
        rows = in_band(boxes, i, whole)[..., None]
        values = rng.random(boxes.shape[i])
        box(pool, boxes, i)[:] = np.where(rows, values, np.nan)
        frame = empty_frame(boxes, i, more=4)
        taken(clear, way)(i, boxes, whole, frame)
        taken(load, way)(i, pool, boxes, whole, frame)
        expected = np.zeros(frame_size(i, boxes))
        inside(expected, boxes, i)[:] = np.where(rows, values, 0)
        known = near_band(boxes, i, whole)
        np.testing.assert_array_equal(grid(frame, boxes, i)[known], grid(expected, boxes, i)[known])
        assert np.isnan(frame[-4:]).all()
        assert not np.nan_to_num(frame[:-4][expected == 0]).any()


@both_ways
def test_beyond_its_faces_a_whole_field_is_mirrored(way: str) -> None:
    boxes, _ = make_boxes(seed=20)
    pool = np.full(boxes.start[-1] + 9999, np.nan)
    for i in CELLS:
        box(pool, boxes, i)[:] = np.random.default_rng(23).random(boxes.shape[i])
        frame = empty_frame(boxes, i, more=4)
        taken(load, way)(i, pool, boxes, True, frame)
        taken(mirror, way)(i, boxes, frame)
        expected = np.pad(box(pool, boxes, i), HALO, mode="symmetric")
        np.testing.assert_array_equal(with_halo(frame, boxes, i), expected)
        assert np.isnan(frame[-4:]).all()


@both_ways
@whole_or_band
def test_loading_defines_whole_runs(whole: bool, way: str) -> None:
    """Also without clearing first: the halos between the rows are 0, and nothing else changes."""
    boxes, phi = make_boxes(seed=20)
    for i in CELLS:
        frame = empty_frame(boxes, i)
        taken(load, way)(i, phi, boxes, whole, frame)
        expected = np.zeros(len(frame))
        inside(expected, boxes, i)[:] = box(phi, boxes, i)
        runs = in_runs(boxes, i, whole)
        np.testing.assert_array_equal(frame[runs], expected[runs])
        others = inside(frame, boxes, i)[~in_band(boxes, i, whole)]
        assert np.isnan(others).all()


@both_ways
def test_reach_is_the_hull_of_what_stencils_read(way: str) -> None:
    boxes, _ = make_boxes(seed=20)
    gap = boxes.shape[1, 1], 0
    band_of(boxes, 1)[:] = [gap, gap, gap, gap, (2, 3), (7, 9), gap, gap]
    expected = [(0, 0)] * 4 + [(-1, 6)] + [(-1, 12)] * 6 + [(4, 12)] + [(0, 0)] * 2
    found = [taken(reach, way)(x, 1, boxes, False) for x in range(-HALO, 8 + HALO)]
    assert found == expected
    assert taken(reach, way)(-HALO, 1, boxes, True) == (-HALO, 10 + HALO)


def test_frame_shapes_are_those_of_the_frames() -> None:
    boxes, _ = make_boxes(seed=20)
    before = boxes.shape.copy()
    sizes = frame_sizes(boxes.shape)
    assert sizes.tolist() == [frame_size(i, boxes) for i in CELLS]
    rows = frame_shapes(boxes.shape)[:, 1:]
    assert rows.tolist() == [[sx // sy, sy] for sx, sy in (strides(i, boxes) for i in CELLS)]
    np.testing.assert_array_equal(boxes.shape, before)


@both_ways
def test_unload_gives_the_box_back(way: str) -> None:
    boxes, _ = make_boxes(seed=20)
    for i in CELLS:
        frame = empty_frame(boxes, i)
        values = np.random.default_rng(22).random(boxes.shape[i])
        inside(frame, boxes, i)[:] = values
        out = np.full(values.size + 3, 1e30)
        taken(unload, way)(i, frame, boxes, out)
        np.testing.assert_array_equal(out[:-3], values.ravel())
        assert (out[-3:] == 1e30).all()


@both_ways
@whole_or_band
def test_runs_span_the_rows_to_work_on(whole: bool, way: str) -> None:
    boxes, _ = make_boxes(seed=20)
    for i in CELLS:
        sx, sy = strides(i, boxes)
        rows, found = in_band(boxes, i, whole), np.zeros(frame_size(i, boxes), bool)
        number = inside(np.arange(len(found)), boxes, i)
        for x in range(boxes.shape[i, 0]):
            y0, y1 = taken(band_rows, way)(x, i, boxes, whole)
            np.testing.assert_array_equal(np.arange(y0, y1), np.flatnonzero(rows[x]))
            low, high = taken(run, way)(x, i, boxes, whole, sx, sy)
            found[int(low) : int(high)] = True
            if rows[x].any():
                assert low == number[x, y0, 0]
                assert high == number[x, y1 - 1, -1] + 1
            else:
                assert low >= high
        np.testing.assert_array_equal(found, in_runs(boxes, i, whole))
        covered = inside(found, boxes, i)
        np.testing.assert_array_equal(covered, np.broadcast_to(rows[..., None], covered.shape))


def test_what_a_run_adds_to_its_rows_is_halo() -> None:
    boxes, _ = make_boxes(seed=20)
    for i in CELLS:
        more = in_runs(boxes, i)
        inside(more, boxes, i)[:] = False
        assert more.any()
        nz = boxes.shape[i, 2]
        assert not grid(more, boxes, i)[..., HALO : HALO + nz].any()


@both_ways
def test_stretches_are_copied_and_cleared(way: str) -> None:
    source, target = np.arange(9.0), np.full(9, -1.0)
    taken(copy_row, way)(source, np.uint64(2), target, np.uint64(4), 3)
    np.testing.assert_array_equal(target, [-1, -1, -1, -1, 2, 3, 4, -1, -1])
    taken(clear_row, way)(target, np.uint64(5), 2)
    np.testing.assert_array_equal(target, [-1, -1, -1, -1, 2, 0, 0, -1, -1])
    taken(clear_row, way)(target, np.uint64(0), 0)
    assert target[0] == -1


@kernel()
def length(array):
    """Length, or -1 without an array."""
    if array is None:
        return -1
    return len(array)


@kernel()
def length_if_used(array, use):
    """Length of the chosen array, or -1."""
    return length(choose(array, use))


def test_choose_gives_the_array_or_none() -> None:
    array = np.zeros(3)
    assert choose(array, None) is None
    assert choose(array, True) is array
    assert length_if_used(array, None) == -1
    assert length_if_used(array, True) == 3
    assert length_if_used(array, array) == 3
