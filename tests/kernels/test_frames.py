"""Frames: where a box and its halo lie in them, clearing, and mirroring beyond the faces."""

import numpy as np

from morphosim.kernels._jit import choose, kernel
from morphosim.kernels.frames import (
    HALO,
    LEAD,
    clear,
    clear_row,
    copy_row,
    frame_index,
    frame_shapes,
    frame_size,
    frame_sizes,
    mirror,
    strides,
)

from .example_boxes import (
    ORIGINS,
    both_ways,
    empty_frame,
    inside,
    make_boxes,
    taken,
    with_halo,
)

CELLS = range(len(ORIGINS))


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


@both_ways
def test_a_cleared_frame_is_0(way: str) -> None:
    boxes, _ = make_boxes(seed=20)
    for i in CELLS:
        frame = empty_frame(boxes, i, more=4)
        taken(clear, way)(i, boxes, frame)
        assert not frame[:-4].any()
        assert np.isnan(frame[-4:]).all()


@both_ways
def test_beyond_its_faces_a_whole_field_is_mirrored(way: str) -> None:
    boxes, _ = make_boxes(seed=20)
    for i in CELLS:
        frame = empty_frame(boxes, i, more=4)
        field = np.random.default_rng(23).random(boxes.shape[i])
        inside(frame, boxes, i)[:] = field
        taken(mirror, way)(i, boxes, frame)
        expected = np.pad(field, HALO, mode="symmetric")
        np.testing.assert_array_equal(with_halo(frame, boxes, i), expected)
        assert np.isnan(frame[-4:]).all()


def test_frame_shapes_are_those_of_the_frames() -> None:
    boxes, _ = make_boxes(seed=20)
    before = boxes.shape.copy()
    sizes = frame_sizes(boxes.shape)
    assert sizes.tolist() == [frame_size(i, boxes) for i in CELLS]
    rows = frame_shapes(boxes.shape)[:, 1:]
    assert rows.tolist() == [[sx // sy, sy] for sx, sy in (strides(i, boxes) for i in CELLS)]
    np.testing.assert_array_equal(boxes.shape, before)


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
