"""Measuring and moving boxes, against plain NumPy."""

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
    clear_outside,
    extents,
    move_box,
    survey,
    widen,
)
from morphosim.kernels.layout import Limits

from .example_boxes import both_ways, box, expected_band, make_boxes, taken

TOLERANCE, RUNAWAY = np.float64(0.2), np.float64(1.5)
LIMITS = Limits(TOLERANCE, RUNAWAY, np.float64(0.5))
PAD = 2
"""The fields lie within larger arrays of NaN, as in a frame."""


def surveyed(
    way: str, field: NDArray, rows: NDArray | None = None
) -> tuple[NDArray[np.float64], NDArray]:
    """What the survey finds, and rows of each plane; of the given rows only, if any."""
    nx, ny, nz = field.shape
    wide = np.full((nx + 2 * PAD, ny + 2 * PAD, nz + 2 * PAD), np.nan)
    inner = wide[PAD:-PAD, PAD:-PAD, PAD:-PAD]
    inner[:] = field
    if rows is not None:
        inner[~within(rows, ny)] = np.nan
    found, out = np.full((nx + 2, 2), -1, np.int32), np.full(N_SURVEYED, 1e30)
    sx, sy, _ = (s // 8 for s in wide.strides)
    look = np.full((nx, 2), -99, np.int32) if rows is None else rows.astype(np.int32)
    taken(survey, way)(
        wide.ravel(), np.int64(PAD * (sx + sy + 1)), sx, sy, nx, ny, nz, look, rows is None,
        LIMITS, found, out,
    )  # fmt: skip
    assert (found[-2:] == -1).all()
    return out, found[:-2]


def within(rows: NDArray, ny: int) -> NDArray[np.bool_]:
    """Mask (x, y) of these rows of each plane."""
    y = np.arange(ny)
    return (y >= rows[:, :1]) & (y < rows[:, 1:])


def faces(shape: tuple) -> NDArray[np.bool_]:
    mask = np.ones(shape, bool)
    mask[1:-1, 1:-1, 1:-1] = False
    return mask


@both_ways
def test_survey_sums_and_counts(way: str) -> None:
    field = np.random.default_rng(2).normal(0, 0.5, (5, 6, 7))
    out, _ = surveyed(way, field)
    size = np.abs(field)
    peak = size[faces(field.shape)].max()
    expected = [
        field.sum(), (size > TOLERANCE).sum(), (field > 0.5).sum(), (size > RUNAWAY).sum(),
        peak, peak,
    ]  # fmt: skip
    np.testing.assert_allclose(out, expected, rtol=1e-13)


@both_ways
def test_what_is_a_limit_itself_is_not_beyond_it(way: str) -> None:
    field = np.zeros((3, 4, 5))
    field[1, 1, 1:4] = TOLERANCE, 0.5, -RUNAWAY
    out, _ = surveyed(way, field)
    assert [out[BAND], out[CORE], out[BAD]] == [2, 0, 0]


@both_ways
def test_survey_of_a_band_takes_the_rest_as_zero(way: str) -> None:
    rows = np.array([[6, 0], [1, 3], [2, 6], [0, 6], [3, 4]])
    field = np.random.default_rng(2).normal(0, 0.5, (5, 6, 7)) * within(rows, 6)[..., None]
    out, found = surveyed(way, field, rows)
    whole, found_whole = surveyed(way, field)
    np.testing.assert_allclose(out[:EDGE], whole[:EDGE], rtol=1e-13)
    np.testing.assert_array_equal(found, found_whole)


@both_ways
@pytest.mark.parametrize(("row", "edge"), [((2, 2), True), ((2, 4), True), ((2, 3), False)])
def test_survey_sees_the_edge_of_the_rows(row: tuple, edge: bool, way: str) -> None:
    rows = np.array([[6, 0], [2, 5], [2, 5], [2, 5], [6, 0]])
    field = np.zeros((5, 6, 7))
    field[2, 3, 3] = 1.0
    field[(*row, 4)] = -0.3
    out, _ = surveyed(way, field, rows)
    assert out[EDGE] == (0.3 if edge else 0)
    assert out[FACE] == 0


@both_ways
@pytest.mark.parametrize("beside", [1, 3])
@pytest.mark.parametrize(("narrow", "y"), [((3, 5), 2), ((2, 4), 4)])
def test_rows_are_an_edge_where_the_plane_beside_ends(
    narrow: tuple, y: int, beside: int, way: str
) -> None:
    """Whether its band begins later or ends earlier, and on either side."""
    rows = np.array([[7, 0], [1, 6], [1, 6], [1, 6], [7, 0]])
    rows[beside] = narrow
    field = np.zeros((5, 7, 7))
    field[2, y, 4] = -0.3
    assert surveyed(way, field, rows)[0][EDGE] == 0.3
    rows[beside] = 1, 6
    assert surveyed(way, field, rows)[0][EDGE] == 0


@both_ways
@pytest.mark.parametrize("face", range(6))
def test_survey_sees_each_face(face: int, way: str) -> None:
    field = np.zeros((5, 6, 7))
    point = [2, 3, 3]
    point[face // 2] = 0 if face % 2 == 0 else field.shape[face // 2] - 1
    field[2, 3, 3] = 1.0
    field[tuple(point)] = -0.3
    out, _ = surveyed(way, field)
    assert out[FACE] == 0.3
    assert out[EDGE] == 0.3


@both_ways
def test_survey_finds_the_rows_of_each_plane(way: str) -> None:
    field = np.zeros((4, 5, 8))
    field[0, 2, 3:5] = 1.0, -1.0
    field[1, [0, 3], 6] = 0.3, -0.3
    field[2, 4, 4] = TOLERANCE  # not beyond it
    field[3, :, 0] = 1.0
    _, found = surveyed(way, field)
    np.testing.assert_array_equal(found, [[2, 3], [0, 4], [5, 0], [0, 5]])


@both_ways
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 2.0])
def test_survey_counts_what_diverges(value: float, way: str) -> None:
    field = np.full((3, 4, 5), 0.4)
    field[1, 2, [0, 3]] = value
    assert surveyed(way, field)[0][BAD] == 2


@both_ways
@pytest.mark.parametrize("guard", [0, 1, 2])
def test_widen_takes_in_the_rows_and_planes_beside(guard: int, way: str) -> None:
    rng = np.random.default_rng(16)
    for trial in range(30):
        nx, ny = rng.integers(1, 9, 2)
        field = (rng.random((nx, ny, 1)) < rng.choice([0.1, 0.3])).astype(float)
        found = np.full((nx + 1, 2), -1, np.int32)
        found[:nx] = expected_band(field, 0.5, guard=0)
        taken(widen, way)(found, guard, nx, ny)
        expected = expected_band(field, 0.5, guard)
        np.testing.assert_array_equal(found[:nx], expected, err_msg=str(trial))
        assert (found[nx] == -1).all()


@both_ways
def test_widen_by_hand(way: str) -> None:
    found = np.array([[6, 0], [6, 0], [2, 4], [6, 0], [5, 6], [0, 1]], np.int32)
    taken(widen, way)(found, 1, 6, 6)
    np.testing.assert_array_equal(found, [[6, 0], [2, 4], [1, 5], [2, 6], [0, 6], [0, 6]])


@both_ways
def test_outside_of_the_rows_a_box_is_cleared(way: str) -> None:
    field = np.random.default_rng(17).normal(size=(4, 5, 6))
    rows = np.array([[1, 3], [5, 0], [0, 5], [4, 5]], np.int32)
    pool = np.concatenate([[np.nan] * 3, field.ravel(), [np.nan] * 3])
    lost = taken(clear_outside, way)(pool, 3, rows, 4, 5, 6)
    expected = field * within(rows, 5)[..., None]
    np.testing.assert_array_equal(pool[3:-3].reshape(field.shape), expected)
    assert np.isnan(pool[[0, 1, 2, -3, -2, -1]]).all()
    assert lost == pytest.approx((field - expected).sum(), rel=1e-12)


@both_ways
def test_extents_bound_what_exceeds_the_tolerance(way: str) -> None:
    boxes, phi = make_boxes(seed=3)
    phi[::3] *= -1
    cells = np.array([2, 0])
    for tolerance in (0.0, 0.99):
        out = np.full((2, 3, 2), -7)
        taken(extents, way)(cells, phi, boxes, tolerance, out)
        for k, i in enumerate(cells):
            band = np.argwhere(np.abs(box(phi, boxes, i)) > tolerance)
            np.testing.assert_array_equal(out[k, :, 0], band.min(axis=0))
            np.testing.assert_array_equal(out[k, :, 1], band.max(axis=0) + 1)
    assert (out[0] != [[0, n] for n in boxes.shape[2]]).any()


@both_ways
def test_extents_of_an_empty_field_are_empty(way: str) -> None:
    boxes, phi = make_boxes(seed=3)
    out = np.zeros((1, 3, 2), np.int64)
    taken(extents, way)(np.array([1]), phi, boxes, 1.0, out)
    assert (out[0, :, 0] >= out[0, :, 1]).all()


@both_ways
@pytest.mark.parametrize("shift", [(0, 0, 0), (2, -1, 3), (-3, -2, -1), (50, 0, 0), (0, 0, 50)])
def test_move_box_keeps_the_lattice_and_tells_what_is_lost(shift: tuple, way: str) -> None:
    old = np.random.default_rng(4).random((4, 5, 6))
    source = np.concatenate([[np.nan] * 3, old.ravel(), [np.nan] * 3])
    new_shape = np.array([5, 4, 6])
    target = np.full(new_shape.prod() + 9, 9.0)
    lost = taken(move_box, way)(
        source, 3, np.array(old.shape), target, np.int64(5), new_shape, np.array(shift)
    )
    expected = np.zeros(new_shape)
    for point, value in np.ndenumerate(old):
        goal = np.array(point) - shift
        if (goal >= 0).all() and (goal < new_shape).all():
            expected[tuple(goal)] = value
    np.testing.assert_array_equal(target[5:-4].reshape(new_shape), expected)
    assert (target[:5] == 9).all()
    assert (target[-4:] == 9).all()
    assert lost == pytest.approx(old.sum() - expected.sum(), abs=1e-12)
