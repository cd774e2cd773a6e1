"""Measuring and moving boxes, against plain NumPy."""

import numpy as np
import pytest

from morphosim.kernels.boxes import extents, move_box, survey

from .example_boxes import both_ways, box, make_boxes, taken

TOLERANCE, LIMIT = 0.2, 1.5


def surveyed(way: str, field: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sums and row spans of one box that lies inside a pool of NaN."""
    values = np.full(field.size + 14, np.nan)
    values[7:-7] = field.ravel()
    rows = field.shape[0] * field.shape[1]
    spans, out = np.full((rows + 6, 2), -1, np.int32), np.zeros(5)
    taken(survey, way)(
        values, np.int64(7), *np.array(field.shape), np.float64(TOLERANCE), np.float64(LIMIT),
        np.float64(0.5), spans, np.int64(3), out,
    )  # fmt: skip
    assert (spans[:3] == -1).all()
    assert (spans[-3:] == -1).all()
    return out, spans[3:-3]


@both_ways
def test_survey_sums_and_counts(way: str) -> None:
    field = np.random.default_rng(2).normal(0, 0.5, (5, 6, 7))
    out, _ = surveyed(way, field)
    faces = np.abs(field)
    faces[1:-1, 1:-1, 1:-1] = 0
    size = np.abs(field)
    expected = [
        field.sum(), (size > TOLERANCE).sum(), (field > 0.5).sum(), (size > LIMIT).sum(),
        faces.max(),
    ]  # fmt: skip
    np.testing.assert_allclose(out, expected, rtol=1e-13)


@both_ways
@pytest.mark.parametrize("face", range(6))
def test_survey_sees_each_face(face: int, way: str) -> None:
    field = np.zeros((5, 6, 7))
    point = [2, 3, 3]
    point[face // 2] = 0 if face % 2 == 0 else field.shape[face // 2] - 1
    field[2, 3, 3] = 1.0
    field[tuple(point)] = -0.3
    assert surveyed(way, field)[0][4] == 0.3


@both_ways
def test_survey_finds_the_band_of_each_row(way: str) -> None:
    field = np.zeros((2, 2, 8))
    field[0, 0, 3:5] = 1.0, -1.0
    field[0, 1, [1, 6]] = 0.3
    field[1, 0, 4] = TOLERANCE  # not beyond it
    field[1, 1, :] = 1.0
    _, spans = surveyed(way, field)
    np.testing.assert_array_equal(spans, [[3, 5], [1, 7], [8, 0], [0, 8]])


@both_ways
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 2.0])
def test_survey_counts_what_diverges(value: float, way: str) -> None:
    field = np.full((3, 4, 5), 0.4)
    field[1, 2, [0, 3]] = value
    assert surveyed(way, field)[0][3] == 2


@both_ways
def test_extents_bound_the_band(way: str) -> None:
    boxes, phi = make_boxes(seed=3)
    cells = np.array([2, 0])
    out = np.full((2, 3, 2), -7)
    taken(extents, way)(cells, boxes, out)
    for k, i in enumerate(cells):
        band = np.argwhere(box(phi, boxes, i) != 0)
        np.testing.assert_array_equal(out[k, :, 0], band.min(axis=0))
        np.testing.assert_array_equal(out[k, :, 1], band.max(axis=0) + 1)


@both_ways
def test_extents_of_an_empty_band_are_empty(way: str) -> None:
    boxes, _ = make_boxes(seed=3)
    boxes.spans[:] = 20, 0
    out = np.zeros((1, 3, 2), np.int64)
    taken(extents, way)(np.array([1]), boxes, out)
    assert (out[0, :, 0] >= out[0, :, 1]).all()


@both_ways
@pytest.mark.parametrize("shift", [(0, 0, 0), (2, -1, 3), (-3, -2, -1), (50, 0, 0)])
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
