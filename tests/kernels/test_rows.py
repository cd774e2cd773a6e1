"""Rows and their spans: where they lie, the blocks they are worked on in, and how bands change."""

import numpy as np
import pytest
from numpy.typing import NDArray

from morphosim.kernels._jit import kernel
from morphosim.kernels.frames import HALO
from morphosim.kernels.layout import Boxes
from morphosim.kernels.rows import (
    BLOCK,
    FRAME,
    HIGH,
    LOW,
    MARGIN,
    NEW_HIGH,
    NEW_LOW,
    OLD_HIGH,
    OLD_LOW,
    STRETCH,
    add_ends,
    beyond,
    block,
    copy_span,
    covered,
    fetch,
    list_blocks,
    list_spans,
    listed,
    load,
    n_blocks,
    n_listed,
    reach,
    row_place,
    row_span,
    settle_rows,
    stay,
    whole_rows,
    widen,
    wipe,
    write_block,
)

from .example_boxes import (
    ORIGINS,
    band_of,
    both_precisions,
    both_ways,
    box,
    empty_frame,
    empty_spans,
    expected_band,
    in_band,
    inside,
    lay_out,
    make_boxes,
    mask_of,
    number,
    read_by,
    rows_of,
    set_band,
    stretch,
    taken,
)

CELLS = range(len(ORIGINS))
whole_or_band = pytest.mark.parametrize("whole", [True, False])


# --- where rows lie ------------------------------------------------------------------------------


@both_ways
@whole_or_band
def test_rows_know_their_spans_and_places(whole: bool, way: str) -> None:
    boxes, _ = make_boxes(seed=40, whole=whole)
    for i in CELLS:
        spans, where = band_of(boxes, i), number(boxes, i)
        for x, y in np.ndindex(*spans.shape[:2]):
            assert taken(row_span, way)(x, y, i, boxes) == tuple(spans[x, y])
            assert taken(row_place, way)(x, y, i, boxes) == where[x, y, 0]


def test_the_example_has_spans_of_all_lengths_and_rows_without() -> None:
    spans = band_of(make_boxes(seed=40)[0], 0)
    length = spans[..., 1] - spans[..., 0]
    for found in (length == 0, length == BLOCK, length > 2 * BLOCK):
        assert found.any()


def test_whole_rows_follow_one_another() -> None:
    shape = np.array([(2, 3, 16), (4, 1, 20)])
    row_start, low, high, place = whole_rows(shape)
    np.testing.assert_array_equal(row_start, [0, 6])
    np.testing.assert_array_equal(low, np.zeros(10))
    np.testing.assert_array_equal(high, [16] * 6 + [20] * 4)
    np.testing.assert_array_equal(place, [*range(0, 96, 16), *range(0, 80, 20)])
    boxes, _ = lay_out(np.zeros_like(shape), shape, whole=True)
    assert [a.dtype for a in (low, high, place)] == [boxes.low.dtype] * 2 + [boxes.place.dtype]


# --- blocks --------------------------------------------------------------------------------------


@both_ways
@pytest.mark.parametrize("low", [0, 3])
@pytest.mark.parametrize("length", [0, 16, 17, 31, 32, 33, 48, 55])
def test_blocks_cover_a_span_and_nothing_else(length: int, low: int, way: str) -> None:
    count = taken(n_blocks, way)(low, low + length)
    assert count == -(-length // BLOCK)
    points = [taken(block, way)(k, low, low + length) + np.arange(BLOCK) for k in range(count)]
    assert {int(z) for found in points for z in found} == set(range(low, low + length))


@both_ways
@whole_or_band
def test_listed_blocks_are_those_of_the_band_or_of_the_box(whole: bool, way: str) -> None:
    """Of a band that is held alone, or of a box that is held whole, whatever its band."""
    boxes, _ = make_boxes(seed=40, whole=whole)
    for i in CELLS:
        worked = in_band(boxes, i, whole)
        expected = -(-worked.sum(axis=2) // BLOCK)
        blocks = np.full((2, -(-worked.shape[2] // BLOCK) * worked[..., 0].size + 2), -5, np.int32)
        n = taken(list_blocks, way)(i, boxes, whole, blocks[:, :-2])
        assert n == expected.sum()
        assert (blocks[:, -2:] == -5).all()
        frame = inside(np.arange(len(empty_frame(boxes, i))), boxes, i)
        for kind, place in ((FRAME, frame), (STRETCH, number(boxes, i) - boxes.start[i])):
            found = blocks[kind, :n, None] + np.arange(BLOCK)
            np.testing.assert_array_equal(np.unique(found), np.unique(place[worked]))
        points = dict(zip(frame[worked], (number(boxes, i) - boxes.start[i])[worked], strict=True))
        assert [points[at] for at in blocks[FRAME, :n]] == blocks[STRETCH, :n].tolist()


@both_ways
@whole_or_band
@both_precisions
def test_a_stretch_goes_into_its_frame_and_the_frame_is_wiped(
    dtype: type, whole: bool, way: str
) -> None:
    boxes, phi = make_boxes(seed=40, whole=whole)
    phi = phi.astype(dtype)
    for i in CELLS:
        blocks = np.zeros((2, boxes.shape[i].prod()), np.int32)
        n = list_blocks(i, boxes, whole, blocks)
        frame = np.append(empty_frame(boxes, i, 0.0), [np.nan] * BLOCK).astype(dtype)
        taken(load, way)(phi, boxes.start[i], blocks, n, frame)
        expected = empty_frame(boxes, i, 0.0).astype(dtype)
        inside(expected, boxes, i)[:] = box(phi, boxes, i)
        np.testing.assert_array_equal(frame[:-BLOCK], expected)
        assert expected.any()
        taken(wipe, way)(blocks, n, frame)
        assert not frame[:-BLOCK].any()
        assert np.isnan(frame[-BLOCK:]).all()


@both_ways
@both_precisions
@pytest.mark.parametrize("count", [16, 17, 31, 32, 33, 49, 64, 70])
def test_a_span_is_copied(count: int, dtype: type, way: str) -> None:
    source, target = np.arange(90).astype(dtype), np.full(90, -1, dtype)
    taken(copy_span, way)(source, 7, target, 3, count)
    expected = np.full(90, -1, dtype)
    expected[3 : 3 + count] = source[7 : 7 + count]
    np.testing.assert_array_equal(target, expected)


# --- blocks as vectors ---------------------------------------------------------------------------


@kernel()
def look_beyond(values, first, level):
    """Call `beyond` in compiled code."""
    return beyond(values, first, level)


@kernel(overlapping=True)
def write(target, goal, a, x, at_x, b, y, at_y, power):
    """Call `write_block` in compiled code."""
    write_block(target, goal, a, x, at_x, b, y, at_y, power)


@kernel()
def add(target, goal, last, b, y, at_y, power):
    """Call `add_ends` in compiled code."""
    add_ends(target, goal, last, b, y, at_y, power)


@kernel()
def ask_for(values, first):
    """Call `fetch` in compiled code."""
    fetch(values, first)


def one_of(compiled: object, plain: object, way: str) -> object:
    """The function in compiled code, or as it is without compilation."""
    return compiled if way == "compiled" else plain


@both_ways
@both_precisions
def test_the_first_and_the_last_point_beyond_a_level(dtype: type, way: str) -> None:
    """Of either sign; the level itself is not beyond it."""
    look = one_of(look_beyond, beyond, way)
    level = dtype(0.25)
    for first in (0, 5, 16):
        for a in range(BLOCK):
            for b in range(a, BLOCK):
                values = np.full(40, 9, dtype)  # beyond the block it must not look
                part = values[first : first + BLOCK]
                part[:] = np.resize([level, -level, 0], BLOCK)
                part[a], part[b] = np.nextafter(level, dtype(1)), -1
                assert look(values, np.uint64(first), level) == (a, b + 1)
        part[:] = np.resize([level, -level], BLOCK)
        assert look(values, np.uint64(first), level) == (BLOCK, 0)


@both_ways
@both_precisions
def test_nan_is_beyond_no_level_and_infinity_is(dtype: type, way: str) -> None:
    look, values = one_of(look_beyond, beyond, way), np.zeros(BLOCK, dtype)
    values[3] = np.nan
    assert look(values, np.uint64(0), dtype(0.1)) == (BLOCK, 0)
    values[[5, 9]] = np.inf, -np.inf
    assert look(values, np.uint64(0), dtype(0.1)) == (5, 10)


@both_ways
@pytest.mark.parametrize("first", [0, 99, 100, 10**9, -(10**6)])
def test_what_is_asked_for_may_lie_beyond_the_array(first: int, way: str) -> None:
    values = np.arange(100.0)
    one_of(ask_for, fetch, way)(values, first)
    np.testing.assert_array_equal(values, np.arange(100))


def random_numbers(dtype: type, seed: int = 41) -> list[NDArray]:
    rng = np.random.default_rng(seed)
    return [rng.normal(size=100).astype(dtype) for _ in range(3)]


@both_ways
@both_precisions
@pytest.mark.parametrize("power", [1, 2])
def test_a_block_is_a_weighted_sum(power: int, dtype: type, way: str) -> None:
    target, x, y = random_numbers(dtype)
    expected = target.astype(float)
    a, b = dtype(1.7), dtype(-0.6)
    expected[20:36] = a * x[33:49].astype(float) + b * y[50:66].astype(float) ** power
    call = one_of(write, write_block, way)
    call(target, 20, a, x, 33, b, y, 50, power)
    tolerance = 1e-6 if dtype is np.float32 else 1e-15
    np.testing.assert_allclose(target, expected, rtol=tolerance, atol=tolerance)


@both_ways
@pytest.mark.parametrize("power", [1, 2])
def test_a_block_may_be_written_where_it_is_read(power: int, way: str) -> None:
    target, _, y = random_numbers(np.float64)
    expected = target.copy()
    expected[20:36] = 3 * target[20:36] + 0.5 * y[10:26] ** power
    one_of(write, write_block, way)(target, 20, 3.0, target, 20, 0.5, y, 10, power)
    np.testing.assert_allclose(target, expected, rtol=1e-14)


@both_ways
@both_precisions
@pytest.mark.parametrize("power", [1, 2])
@pytest.mark.parametrize("last", [0, 1, 7, 15, 16, 17, 32, 40])
def test_to_both_ends_of_a_span_is_added_once(last: int, power: int, dtype: type, way: str) -> None:
    """Also where they overlap; between them nothing changes."""
    target, _, y = random_numbers(dtype)
    expected, b = target.astype(float), dtype(0.8)
    for k in range(last + BLOCK):
        if k < BLOCK or k >= last:
            expected[9 + k] += b * float(y[31 + k]) ** power
    one_of(add, add_ends, way)(target, 9, last, b, y, 31, power)
    tolerance = 1e-6 if dtype is np.float32 else 1e-15
    np.testing.assert_allclose(target, expected, rtol=tolerance, atol=tolerance)


# --- lists of spans ------------------------------------------------------------------------------


def in_list(values: NDArray, boxes: Boxes, i: int, halo: int = 0) -> NDArray[np.int64]:
    """Rows of cell i's box, and of a halo around it, in a list of a thread."""
    nx, ny = boxes.shape[i, :2]
    planes = values[: n_listed(nx, ny)].reshape(nx + 2 * MARGIN, ny + 2 * HALO)
    x, y = slice(MARGIN - halo, MARGIN + nx + halo), slice(HALO - halo, HALO + ny + halo)
    return planes[x, y].astype(np.int64)


def pairs(spans: NDArray, low: int, boxes: Boxes, i: int, halo: int = 0) -> NDArray[np.int64]:
    """Two lists of a thread, the second of which follows the first, as (…, 2); 0, 0 for none."""
    found = np.stack([in_list(spans[low + k], boxes, i, halo) for k in (0, 1)], axis=-1)
    return np.where(found[..., :1] < found[..., 1:], found, 0)


def ends_of(mask: NDArray, first: int = 0) -> NDArray[np.int64]:
    """From the first to behind the last of each row's points, counted from `first`; 0, 0: none."""
    low = mask.argmax(axis=-1)
    high = mask.shape[-1] - mask[..., ::-1].argmax(axis=-1)
    ends = np.stack([low, high], axis=-1) + first
    return np.where(mask.any(axis=-1)[..., None], ends, 0)


def guarded(boxes: Boxes, i: int) -> NDArray[np.int16]:
    """A thread's lists, in an array of which they must not touch the rest."""
    return np.hstack([empty_spans(boxes, i), np.full((6, 3), 555, np.int16)])


@both_ways
@pytest.mark.parametrize("widened", [True, False])
def test_the_band_is_listed_with_empty_rows_around(widened: bool, way: str) -> None:
    boxes, _ = make_boxes(seed=40)
    for i in CELLS:
        spans = guarded(boxes, i)
        taken(list_spans, way)(i, boxes, widened, spans)
        nx, ny, nz = boxes.shape[i]
        for x, y in np.ndindex(nx, ny):
            k = taken(listed, way)(x, y, ny)
            assert k == (x + MARGIN) * (ny + 2 * HALO) + y + HALO
        band = band_of(boxes, i)
        np.testing.assert_array_equal(pairs(spans, OLD_LOW, boxes, i), band)
        all_rows = spans[:, :-3]
        assert (all_rows[OLD_LOW] < all_rows[OLD_HIGH]).sum() == (band[..., 1] > 0).sum()
        none = all_rows[OLD_LOW] >= all_rows[OLD_HIGH]
        assert (all_rows[OLD_LOW, none] == nz).all(), "a smallest value would see it"
        assert (all_rows[OLD_HIGH, none] == 0).all()
        if widened:
            wide = np.where(band[..., 1:] > 0, band + np.array([-HALO, HALO]), 0)
            np.testing.assert_array_equal(pairs(spans, LOW, boxes, i), wide)
            assert (all_rows[LOW, none] == nz).all()
            assert (all_rows[HIGH, none] == 0).all()
        assert (spans[:, -3:] == 555).all()


@both_ways
def test_reach_is_the_hull_of_what_stencils_read(way: str) -> None:
    boxes, _ = make_boxes(seed=40)
    set_band(boxes, 1, 0)
    thin = np.zeros((8, 10, 2), int)
    thin[3, 4], thin[3, 9], thin[7, 0] = (2, 18), (9, 30), (14, 30)
    set_band(boxes, 1, thin)
    for i in CELLS:
        spans = guarded(boxes, i)
        list_spans(i, boxes, True, spans)
        taken(reach, way)(i, boxes, spans)
        expected = ends_of(read_by(in_band(boxes, i)), -HALO)
        np.testing.assert_array_equal(pairs(spans, NEW_LOW, boxes, i, HALO), expected)
        assert (spans[:, -3:] == 555).all()


@both_ways
def test_covered_points_have_all_their_neighbours_in_the_band(way: str) -> None:
    boxes, _ = make_boxes(seed=40)
    rows = np.zeros((8, 10, 2), int)
    rows[2:6, 3:9] = 3, 25
    rows[3, 5], rows[4, 7] = (6, 29), (1, 20)
    set_band(boxes, 1, rows)
    some = 0
    for i in CELLS:
        spans = guarded(boxes, i)
        list_spans(i, boxes, False, spans)
        taken(covered, way)(i, boxes, spans)
        band = np.pad(in_band(boxes, i), 1)
        mask = np.logical_and.reduce(
            [np.roll(band, m, axis)[1:-1, 1:-1, 1:-1] for axis in range(3) for m in (-1, 0, 1)]
        )
        np.testing.assert_array_equal(pairs(spans, NEW_LOW, boxes, i), ends_of(mask))
        some += mask.sum()
        assert (spans[:, -3:] == 555).all()
    assert some > 0


@both_ways
def test_bands_widen_over_the_points_and_rows_beside(way: str) -> None:
    """By two lattice steps in all, within the box, and to no less than a block."""
    rng = np.random.default_rng(42)
    for trial in range(25):
        nx, ny, nz = rng.integers([1, 1, BLOCK], [8, 8, 40])
        boxes, _ = lay_out([(0, 0, 0)], [(nx, ny, nz)])
        field = (rng.random((nx, ny, nz)) < rng.choice([0.003, 0.05, 0.5])).astype(float)
        field[rng.random((nx, ny)) < 0.5] = 0
        spans = found_in(boxes, ends_of(field > 0))
        count = taken(widen, way)(0, boxes, spans)
        expected = expected_band(field, 0.5)
        np.testing.assert_array_equal(new_band(spans, boxes), expected, err_msg=str(trial))
        assert count == mask_of(expected, nz).sum()
        assert (spans[:, -3:] == 555).all()


def found_in(boxes: Boxes, ends: NDArray) -> NDArray[np.int16]:
    """A thread's lists in which LOW and HIGH are these, and nothing else is sensible."""
    spans = guarded(boxes, 0)
    spans[LOW, :-3], spans[HIGH, :-3] = boxes.shape[0, 2], 0
    for x, y in np.argwhere(ends[..., 1]):
        spans[[LOW, HIGH], listed(x, y, boxes.shape[0, 1])] = ends[x, y]
    return spans


def new_band(spans: NDArray, boxes: Boxes, i: int = 0) -> NDArray[np.int64]:
    """NEW_LOW and NEW_HIGH of the rows of the box."""
    return np.stack([in_list(spans[k], boxes, i) for k in (NEW_LOW, NEW_HIGH)], axis=-1)


@both_ways
def test_widen_by_hand(way: str) -> None:
    boxes, _ = lay_out([(0, 0, 0)], [(2, 5, 40)])
    ends = np.zeros((2, 5, 2), int)
    ends[0, 0], ends[1, 4] = (10, 30), (39, 40)
    spans = found_in(boxes, ends)
    count = taken(widen, way)(0, boxes, spans)
    top = (24, 40)
    expected = [
        [(8, 32), (9, 31), (10, 30), top, top],
        [(9, 31), (10, 30), top, top, top],
    ]
    np.testing.assert_array_equal(new_band(spans, boxes), expected)
    assert count == 24 + 22 + 20 + 16 + 16 + 22 + 20 + 3 * 16


@both_ways
def test_short_spans_are_filled_up_on_both_sides(way: str) -> None:
    boxes, _ = lay_out([(0, 0, 0)], [(1, 1, 40)])
    for (low, high), expected in (
        ((20, 21), (13, 29)), ((20, 22), (13, 29)), ((3, 4), (0, 16)), ((36, 37), (24, 40)),
        ((20, 32), (18, 34)),
    ):  # fmt: skip
        spans = found_in(boxes, np.array([[[low, high]]]))
        assert taken(widen, way)(0, boxes, spans) == BLOCK
        np.testing.assert_array_equal(new_band(spans, boxes), [[expected]])


@both_ways
def test_a_band_may_stay(way: str) -> None:
    boxes, _ = make_boxes(seed=40)
    for i in CELLS:
        spans = guarded(boxes, i)
        list_spans(i, boxes, False, spans)
        taken(stay, way)(i, boxes, spans)
        np.testing.assert_array_equal(new_band(spans, boxes, i), band_of(boxes, i))
        assert (spans[:, -3:] == 555).all()


@both_ways
def test_settled_rows_follow_one_another(way: str) -> None:
    boxes, _ = make_boxes(seed=40)
    other, _ = make_boxes(seed=43)
    before = [values.copy() for values in (boxes.low, boxes.high, boxes.place)]
    for i in (1, 3):
        spans = guarded(boxes, i)
        list_spans(i, other, False, spans)
        spans[NEW_LOW], spans[NEW_HIGH] = spans[OLD_LOW], spans[OLD_HIGH]
        none = spans[NEW_LOW] >= spans[NEW_HIGH]
        spans[NEW_LOW, none] = spans[NEW_HIGH, none] = 0
        taken(settle_rows, way)(i, boxes, spans)
        np.testing.assert_array_equal(band_of(boxes, i), band_of(other, i))
        np.testing.assert_array_equal(number(boxes, i), number(other, i))
        values = np.arange(boxes.shape[i].prod()).reshape(boxes.shape[i])
        ordered = number(boxes, i)[in_band(boxes, i)] - boxes.start[i]
        np.testing.assert_array_equal(ordered, np.arange(len(stretch(values, boxes, i))))
        for values, then in zip((boxes.low, boxes.high, boxes.place), before, strict=True):
            rows_of(then, boxes, i)[:] = rows_of(values, boxes, i)
    for values, then in zip((boxes.low, boxes.high, boxes.place), before, strict=True):
        np.testing.assert_array_equal(values, then)
