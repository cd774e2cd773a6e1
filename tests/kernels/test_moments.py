"""Moments, extents and overlapping boxes, against plain NumPy."""

import numpy as np
import pytest

from morphosim.kernels.moments import N_MOMENTS, find_extents, moments, overlapping_pairs
from morphosim.kernels.sharing import shares_of

from .example_boxes import both_precisions, both_ways, box, put, taken
from .example_fields import LOW_LEVEL, SHAPES, random_fields

SHARES = shares_of([0, 3, 3, 4], threads=3)
POWERS = [
    (0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (2, 0, 0), (0, 2, 0), (0, 0, 2), (1, 1, 0),
    (1, 0, 1), (0, 1, 1),
]  # fmt: skip
"""Of x, y and z, in the moments."""


@both_ways
@pytest.mark.parametrize("whole", [True, False])
@both_precisions
def test_moments(way: str, dtype: type, whole: bool) -> None:
    fields = random_fields(3, dtype, whole)
    found = np.full((len(SHAPES), N_MOMENTS), 1e30)
    taken(moments, way)(SHARES, fields, found)
    for i, shape in enumerate(SHAPES):
        x, y, z = np.indices(shape)
        phi = box(fields.phi, fields, i)
        inside = np.interp(phi, [3 / 8, 5 / 8], [0, 1])
        expected = [
            (weight * x**a * y**b * z**c).sum(dtype=float)
            for weight, powers in ((phi, POWERS[:4]), (inside, POWERS))
            for a, b, c in powers
        ]
        assert i == 3 or expected[4] > 0, "no point is inside"
        np.testing.assert_allclose(found[i], expected, rtol=1e-12 if dtype is np.float64 else 1e-6)


@both_ways
@pytest.mark.parametrize("whole", [True, False])
@pytest.mark.parametrize("level", [LOW_LEVEL, 0.9])
def test_extents(level: float, whole: bool, way: str) -> None:
    fields = random_fields(5, whole=whole)
    outer = box(fields.phi, fields, 0)
    outer[0], outer[:, :, -2:], outer[2, 2, 2] = 0, level, -2
    put(fields.phi, fields, 0, outer)
    taken(find_extents, way)(SHARES, fields, level)
    for i in range(3):
        where = np.argwhere(np.abs(box(fields.phi, fields, i)) > level)
        expected = np.stack([where.min(axis=0), where.max(axis=0) + 1], axis=1)
        np.testing.assert_array_equal(fields.extent[i], expected)
    assert (fields.extent[3, :, 0] > fields.extent[3, :, 1]).all(), "the faint cell has an extent"


@both_ways
def test_overlapping_pairs_are_those_of_a_comparison_of_all(way: str) -> None:
    rng = np.random.default_rng(8)
    low = rng.integers(-12, 12, (40, 3))
    high = low + rng.integers(1, 9, (40, 3))
    high[3] = low[3] - 1  # nothing in it
    high[4], low[4] = 30, -30
    order = np.argsort(low[:, 0])
    expected = {
        (i, j)
        for j in range(40)
        for i in range(j)
        if ((low[i] < high[j]) & (low[j] < high[i])).all()
    }
    find = taken(overlapping_pairs, way)
    count = find(order, low, high, np.zeros((0, 2), np.int64))
    assert count == len(expected) > 50
    pairs = np.full((count, 2), -1)
    assert find(order, low, high, pairs) == count
    assert {(i, j) for i, j in pairs.tolist()} == expected


def test_boxes_that_only_share_a_face_do_not_overlap() -> None:
    low = np.array([[0, 0, 0], [4, 0, 0], [0, 4, 0], [0, 0, 4], [3, 3, 3]])
    pairs = np.full((9, 2), -1)
    assert overlapping_pairs(np.array([0, 2, 3, 4, 1]), low, low + 4, pairs) == 4
    assert {tuple(pair) for pair in pairs[:4].tolist()} == {(0, 4), (1, 4), (2, 4), (3, 4)}
    assert (pairs[4:] == -1).all()
