"""Measuring, laying and moving boxes, against plain NumPy."""

import numpy as np
import pytest
from numpy.typing import NDArray

from morphosim.kernels.boxes import (
    BAD,
    BAND,
    CORE,
    EDGE,
    FACE,
    N_SURVEYED,
    PART,
    TOTAL,
    WANTED,
    close_ranks,
    extents,
    find_bands,
    get_boxes,
    put_boxes,
    relay,
    settle_planes,
    stretch_length,
    stretch_totals,
    survey,
    survey_bands,
    widen_planes,
)
from morphosim.kernels.layout import Limits
from morphosim.kernels.rows import BLOCK, NEW_HIGH, NEW_LOW, listed

from .example_boxes import (
    ORIGINS,
    band_of,
    both_precisions,
    both_ways,
    box,
    empty_spans,
    expected_band,
    held,
    lay_out,
    make_boxes,
    mask_of,
    put,
    rows_of,
    set_band,
    stretch,
    taken,
)

TOLERANCE, RUNAWAY = np.float64(0.2), np.float64(1.5)
LIMITS = Limits(TOLERANCE, RUNAWAY, np.float64(0.5))
whole_or_band = pytest.mark.parametrize("whole", [True, False])


def surveyed(way: str, field: NDArray, spans: NDArray | None = None) -> NDArray[np.float64]:
    """What the survey finds of a box that is held whole, or of these spans of its rows alone."""
    whole, boxes_of = (
        spans is None,
        [np.zeros((*field.shape[:2], 2), int) if spans is None else spans],
    )
    boxes, phi = lay_out([(3, -2, 1)], [field.shape], boxes_of, whole)
    put(phi, boxes, 0, field)
    if not whole:
        surveys = np.full((1, N_SURVEYED), 1e30)
        taken(survey_bands, way)(np.array([0]), boxes, phi, LIMITS, surveys)
        assert surveys[0, WANTED] == mask_of(spans, field.shape[2]).sum()
        return surveys[0]
    return survey_of_whole(way, phi[boxes.start[0] :], field.shape)[0]


def survey_of_whole(way: str, values: NDArray, shape: tuple) -> tuple[NDArray, NDArray]:
    """What the survey finds, and rows of each plane."""
    found, out = np.full((shape[0] + 2, 2), -1, np.int32), np.full(N_SURVEYED, 1e30)
    taken(survey, way)(values, *shape, LIMITS, found, out)
    assert (found[-2:] == -1).all()
    assert out[WANTED] == np.prod(shape)
    return out, found[:-2]


def some_spans(shape: tuple = (5, 6, 24)) -> NDArray[np.int64]:
    """Spans of rows, some of which touch faces, and rows without."""
    rng = np.random.default_rng(3)
    length = rng.integers(BLOCK, shape[2] + 1, shape[:2])
    low = rng.integers(0, shape[2] - length + 1)
    spans = np.stack([low, low + length], axis=-1)
    spans[rng.random(shape[:2]) < 0.2] = 0
    return np.asarray(spans)


def faces(shape: tuple) -> NDArray[np.bool_]:
    mask = np.ones(shape, bool)
    mask[1:-1, 1:-1, 1:-1] = False
    return mask


def edge_of(mask: NDArray) -> NDArray[np.bool_]:
    """Points of a band that have a neighbour along x, y or z outside of it."""
    wide = np.pad(mask, 1)
    around = [np.roll(wide, m, axis)[1:-1, 1:-1, 1:-1] for axis in range(3) for m in (-1, 1)]
    return np.asarray(mask & ~np.logical_and.reduce(around))


def closeness(dtype: type, way: str) -> float:
    """Of sums in double precision; NumPy adds to a number of Python in that of the array."""
    return 1e-4 if way == "python" and dtype is np.float32 else 1e-12


# --- surveys -------------------------------------------------------------------------------------


@both_ways
@whole_or_band
def test_survey_sums_and_counts(whole: bool, way: str) -> None:
    field = np.random.default_rng(2).normal(0, 0.5, (5, 6, 24))
    spans = None if whole else some_spans()
    band = np.ones(field.shape, bool) if whole else mask_of(some_spans(), 24)
    field = np.where(band, field, 0)
    out = surveyed(way, field, spans)
    size = np.abs(field)
    peak = size[faces(field.shape)].max()
    edge = peak if whole else size[edge_of(band)].max()
    expected = [
        field.sum(), (size > TOLERANCE).sum(), (field > 0.5).sum(), (size > RUNAWAY).sum(),
        peak, edge, field.size if whole else band.sum(),
    ]  # fmt: skip
    np.testing.assert_allclose(out, expected, rtol=1e-13)


@both_ways
def test_survey_of_a_long_stretch(way: str) -> None:
    """Longer than what is summed at once."""
    shape = (8, 9, 40)
    field = np.random.default_rng(4).normal(0, 0.5, shape)
    spans = np.broadcast_to([1, 39], (*shape[:2], 2))
    band = mask_of(spans, 40)
    assert band.sum() > 2 * PART
    out, inside = surveyed(way, field, spans), field[band]
    expected = [inside.sum(), (np.abs(inside) > TOLERANCE).sum(), (inside > 0.5).sum()]
    np.testing.assert_allclose(out[[TOTAL, BAND, CORE]], expected, rtol=1e-12)
    assert out[BAD] == (np.abs(inside) > RUNAWAY).sum() > 0


@both_ways
@whole_or_band
def test_what_is_a_limit_itself_is_not_beyond_it(whole: bool, way: str) -> None:
    field = np.zeros((3, 4, 20))
    field[1, 1, 1:4] = TOLERANCE, 0.5, -RUNAWAY
    out = surveyed(way, field, None if whole else np.broadcast_to([0, 20], (3, 4, 2)))
    assert [out[BAND], out[CORE], out[BAD]] == [2, 0, 0]


@both_ways
@pytest.mark.parametrize(
    ("point", "edge"),
    [((2, 2, 12), True), ((2, 4, 12), True), ((2, 3, 4), True), ((2, 3, 21), True),
     ((1, 3, 12), True), ((3, 3, 12), True), ((2, 3, 12), False), ((2, 3, 5), False),
     ((2, 3, 20), False)],
)  # fmt: skip
def test_survey_sees_the_edge_of_the_band(point: tuple, edge: bool, way: str) -> None:
    spans = np.zeros((5, 6, 2), int)
    spans[1:4, 2:5] = 4, 22
    field = np.zeros((5, 6, 26))
    field[2, 3, 13] = 1.0
    field[point] = -0.3
    out = surveyed(way, field, spans)
    assert out[EDGE] == (0.3 if edge else 0)
    assert out[FACE] == 0


@both_ways
@pytest.mark.parametrize("beside", [(1, 3), (3, 3), (2, 2), (2, 4)])
@pytest.mark.parametrize(("narrow", "z"), [((6, 25), 5), ((3, 20), 20)])
def test_a_span_has_an_edge_where_the_one_beside_ends(
    narrow: tuple, z: int, beside: tuple, way: str
) -> None:
    """Whether that begins later or ends earlier, and on any side."""
    spans = np.zeros((5, 7, 2), int)
    spans[1:4, 1:6] = 3, 25
    spans[beside] = narrow
    field = np.zeros((5, 7, 28))
    field[2, 3, z] = -0.3
    assert surveyed(way, field, spans)[EDGE] == 0.3
    spans[beside] = 3, 25
    assert surveyed(way, field, spans)[EDGE] == 0


@both_ways
@whole_or_band
@pytest.mark.parametrize("face", range(6))
def test_survey_sees_each_face(face: int, whole: bool, way: str) -> None:
    field = np.zeros((5, 6, 20))
    point = [2, 3, 3]
    point[face // 2] = 0 if face % 2 == 0 else field.shape[face // 2] - 1
    field[2, 3, 3] = 1.0
    field[tuple(point)] = -0.3
    out = surveyed(way, field, None if whole else np.broadcast_to([0, 20], (5, 6, 2)))
    assert out[FACE] == 0.3
    assert out[EDGE] == 0.3


@both_ways
def test_ends_of_spans_within_the_box_are_no_faces(way: str) -> None:
    field = np.zeros((5, 6, 22))
    field[2, 3, [1, 20]] = 0.3, -0.4
    out = surveyed(way, field, np.broadcast_to([1, 21], (5, 6, 2)))
    assert (out[FACE], out[EDGE]) == (0, 0.4)


@both_ways
def test_survey_finds_the_rows_of_each_plane(way: str) -> None:
    field = np.zeros((4, 5, 8))
    field[0, 2, 3:5] = 1.0, -1.0
    field[1, [0, 3], 6] = 0.3, -0.3
    field[2, 4, 4] = TOLERANCE  # not beyond it
    field[3, :, 0] = 1.0
    _, found = survey_of_whole(way, field.ravel(), field.shape)
    np.testing.assert_array_equal(found, [[2, 3], [0, 4], [5, 0], [0, 5]])


@both_ways
@whole_or_band
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 2.0])
def test_survey_counts_what_diverges(value: float, whole: bool, way: str) -> None:
    field = np.full((3, 4, 20), 0.4)
    field[1, 2, [0, 3]] = value
    out = surveyed(way, field, None if whole else np.broadcast_to([0, 20], (3, 4, 2)))
    assert out[BAD] == 2


# --- bands ---------------------------------------------------------------------------------------


@both_ways
@pytest.mark.parametrize("guard", [0, 1, 2])
def test_planes_widen_over_the_rows_and_planes_beside(guard: int, way: str) -> None:
    rng = np.random.default_rng(16)
    for trial in range(30):
        nx, ny = rng.integers(1, 9, 2)
        field = (rng.random((nx, ny, 1)) < rng.choice([0.1, 0.3])).astype(float)
        found = np.full((nx + 1, 2), -1, np.int32)
        found[:nx] = rows_of_planes(expected_band(field, 0.5, True, guard=0))
        taken(widen_planes, way)(found, guard, nx, ny)
        expected = rows_of_planes(expected_band(field, 0.5, True, guard))
        np.testing.assert_array_equal(found[:nx], expected, err_msg=str(trial))
        assert (found[nx] == -1).all()


def rows_of_planes(spans: NDArray) -> NDArray[np.int64]:
    """First and last but one row of each plane of a band of whole rows; (ny, 0) for none."""
    nx, ny = spans.shape[:2]
    result = np.full((nx, 2), (ny, 0))
    for x, rows in enumerate(spans[..., 1] > 0):
        if rows.any():
            result[x] = np.flatnonzero(rows)[[0, -1]] + (0, 1)
    return result


@both_ways
def test_widen_planes_by_hand(way: str) -> None:
    found = np.array([[6, 0], [6, 0], [2, 4], [6, 0], [5, 6], [0, 1]], np.int32)
    taken(widen_planes, way)(found, 1, 6, 6)
    np.testing.assert_array_equal(found, [[6, 0], [2, 4], [1, 5], [2, 6], [0, 6], [0, 6]])


@both_ways
def test_rows_of_planes_become_the_band_of_a_box_that_is_held_whole(way: str) -> None:
    boxes, _ = make_boxes(seed=3, whole=True)
    before = [values.copy() for values in (boxes.low, boxes.high, boxes.place)]
    band = expected_band(np.random.default_rng(5).random(boxes.shape[1]), 0.99, True)
    rows_of(boxes.place, boxes, 1)[:] = -3
    taken(settle_planes, way)(1, boxes, rows_of_planes(band).astype(np.int32))
    np.testing.assert_array_equal(band_of(boxes, 1), band)
    for values, then in zip((boxes.low, boxes.high), before, strict=False):
        rows_of(then, boxes, 1)[:] = rows_of(values, boxes, 1)
        np.testing.assert_array_equal(values, then)
    np.testing.assert_array_equal(boxes.place, before[2])


@both_ways
@whole_or_band
@both_precisions
def test_bands_are_found_and_boxes_put_into_pools(dtype: type, whole: bool, way: str) -> None:
    """What the band leaves out is told, where the band is all that is held."""
    rng = np.random.default_rng(6)
    boxes, _ = make_boxes(seed=3, whole=whole)
    cells, fields = np.array([2, 0, 1, 4]), {}
    for i in cells:
        beyond = rng.random(boxes.shape[i]) < (0.01 if i != 4 else 0)
        faint = rng.uniform(-0.2, 0.2, boxes.shape[i])
        fields[i] = np.where(beyond, -rng.uniform(0.3, 1, boxes.shape[i]), faint).astype(dtype)
    values = np.concatenate([[7, 7], *(fields[i].ravel() for i in cells), [7]]).astype(dtype)
    starts = 2 + np.cumsum([0, *(fields[i].size for i in cells)])[:-1]
    surveys, lost = np.full((5, N_SURVEYED), -1.0), np.full(5, 0.25)
    limits = Limits(*map(dtype, LIMITS))
    untouched = band_of(boxes, 3)
    taken(find_bands, way)(cells, boxes, not whole, starts, values, limits, surveys)
    pool = np.full(boxes.start[-1] + boxes.shape[-1].prod() + 5, 9, dtype)
    taken(put_boxes, way)(cells, boxes, not whole, starts, values, pool, lost)
    expected = np.full_like(pool, 9)
    for i in cells:
        band = expected_band(fields[i], TOLERANCE, whole)
        np.testing.assert_array_equal(band_of(boxes, i), band)
        kept = np.ones(boxes.shape[i], bool) if whole else mask_of(band, boxes.shape[i, 2])
        np.testing.assert_array_equal(held(boxes, i), kept)
        assert surveys[i, WANTED] == kept.sum()
        expected[boxes.start[i] : boxes.start[i] + kept.sum()] = fields[i][kept]
        cut = fields[i][~kept].sum(dtype=float)
        assert lost[i] == pytest.approx(0.25 + cut, rel=closeness(dtype, way))
    np.testing.assert_array_equal(pool, expected)
    np.testing.assert_array_equal(band_of(boxes, 3), untouched)
    assert (surveys[3] == -1).all()
    assert lost[3] == 0.25


@both_ways
@both_precisions
def test_a_stretch_is_laid_anew_for_another_band(dtype: type, way: str) -> None:
    """What is new is 0, and what is cut off is told: spans stay, widen, shrink, come and go."""
    rng = np.random.default_rng(17)
    boxes, phi = make_boxes(seed=3)
    for i in range(3):
        old, other = band_of(boxes, i), make_boxes(seed=18)[0]
        new = np.where(rng.random(old.shape[:2])[..., None] < 0.3, old, band_of(other, i))
        assert all(
            found.any()
            for found in (
                (old == new).all(axis=2) & (old[..., 1] > 0),
                (old[..., 1] > 0) & (new[..., 1] == 0),
                (old[..., 1] == 0) & (new[..., 1] > 0),
                (old[..., 0] < new[..., 0]) & (new[..., 1] > 0),
                (old[..., 1] > new[..., 1]) & (new[..., 1] > 0),
            )
        )
        field = (box(phi, boxes, i) * rng.choice([-1, 1], boxes.shape[i])).astype(dtype)
        spans = empty_spans(boxes, i)
        for x, y in np.ndindex(*new.shape[:2]):
            k = listed(x, y, new.shape[1])
            spans[NEW_LOW, k], spans[NEW_HIGH, k] = new[x, y]
        pool = np.full(phi.size, 9, dtype)
        lost = taken(relay, way)(i, boxes, spans, stretch(field, boxes, i), pool)
        set_band(boxes, i, new)
        kept = mask_of(new, boxes.shape[i, 2])
        expected = np.full_like(pool, 9)
        put(expected, boxes, i, field)
        np.testing.assert_array_equal(pool, expected)
        total = field[~kept].sum(dtype=float)
        assert lost == pytest.approx(total, rel=closeness(dtype, way), abs=closeness(dtype, way))


@both_ways
@whole_or_band
def test_a_stretch_is_as_long_as_what_is_held(whole: bool, way: str) -> None:
    boxes, _ = make_boxes(seed=3, whole=whole)
    set_band(boxes, 2, 0, whole)
    for i in range(len(ORIGINS)):
        found = taken(stretch_length, way)(i, boxes, whole)
        assert found == held(boxes, i).sum()


@both_ways
@whole_or_band
def test_totals_of_stretches(whole: bool, way: str) -> None:
    boxes, phi = make_boxes(seed=3, whole=whole)
    totals = np.full(5, 77.0)
    taken(stretch_totals, way)(np.array([1, 4, 0]), boxes, not whole, phi, totals)
    expected = [box(phi, boxes, i).sum() if i in (0, 1, 4) else 77 for i in range(5)]
    np.testing.assert_allclose(totals, expected, rtol=1e-13)
    assert held(boxes, 0).sum() > 2 * PART


@both_ways
@whole_or_band
def test_extents_bound_what_exceeds_the_tolerance(whole: bool, way: str) -> None:
    boxes, phi = make_boxes(seed=3, whole=whole)
    phi[::3] *= -1
    cells = np.array([2, 0])
    for tolerance in (0.0, 0.99):
        out = np.full((2, 3, 2), -7)
        taken(extents, way)(cells, boxes, not whole, phi, tolerance, out)
        for k, i in enumerate(cells):
            band = np.argwhere(np.abs(box(phi, boxes, i)) > tolerance)
            np.testing.assert_array_equal(out[k, :, 0], band.min(axis=0))
            np.testing.assert_array_equal(out[k, :, 1], band.max(axis=0) + 1)
    assert (out[0] != [[0, n] for n in boxes.shape[2]]).any()


@both_ways
@whole_or_band
def test_extents_of_an_empty_field_are_empty(whole: bool, way: str) -> None:
    boxes, phi = make_boxes(seed=3, whole=whole)
    out = np.zeros((1, 3, 2), np.int64)
    taken(extents, way)(np.array([1]), boxes, not whole, phi, 1.0, out)
    assert (out[0, :, 0] >= out[0, :, 1]).all()


@both_ways
@whole_or_band
@pytest.mark.parametrize("shift", [(0, 0, 0), (2, -1, 3), (-3, -2, -1), (50, 0, 0), (0, 0, 50)])
def test_moved_boxes_keep_the_lattice_and_tell_what_is_lost(
    shift: tuple, whole: bool, way: str
) -> None:
    boxes, phi = make_boxes(seed=4, whole=whole)
    cells, shapes = np.array([2, 1]), np.array([(12, 7, 24), (5, 9, 16)])
    shifts = np.array([shift, (0, 1, 2)])
    starts, size = np.array([4, 4 + shapes[0].prod()]), shapes.prod(axis=1).sum()
    target, lost = np.full(size + 9, 9.0), np.full(5, 0.25)
    call = taken(get_boxes, way)
    call(cells, boxes, not whole, phi, shifts, shapes, starts, target, lost)
    for k, i in enumerate(cells):
        old, expected = box(phi, boxes, i), np.zeros(shapes[k])
        for point, value in np.ndenumerate(old):
            goal = np.array(point) - shifts[k]
            if (goal >= 0).all() and (goal < shapes[k]).all():
                expected[tuple(goal)] = value
        found = target[starts[k] :][: expected.size].reshape(shapes[k])
        np.testing.assert_array_equal(found, expected)
        assert lost[i] == pytest.approx(0.25 + old.sum() - expected.sum(), abs=1e-11)
    assert (target[:4] == 9).all()
    assert (target[-5:] == 9).all()
    assert (lost[[0, 3, 4]] == 0.25).all()


@both_ways
def test_stretches_close_ranks(way: str) -> None:
    """One after the other, also over places that they have had themselves."""
    values = np.arange(30.0)
    expected = values.copy()
    starts, goals, sizes = np.array([2, 8, 20]), np.array([2, 6, 16]), np.array([4, 10, 8])
    for start, goal, size in zip(starts, goals, sizes, strict=True):
        expected[goal : goal + size] = values[start : start + size]
    taken(close_ranks, way)(starts, goals, sizes, values)
    np.testing.assert_array_equal(values, expected)
