"""Attraction of single pairs, against sums over whole boxes."""

import numpy as np

from morphosim.kernels.layout import Pairs
from morphosim.kernels.pairs import accumulate_pairs

from .example_boxes import both_ways, box, empty_pool, make_boxes, seen_from, taken

# Pulled cell, pulling cell, weight: one of either sign, one pair that does not overlap.
ROWS = [(0, 1, 0.5), (0, 2, -0.2), (1, 0, 0.3), (2, 0, 0.9), (2, 1, 0.7), (3, 0, 0.4)]


def make_pairs(n: int) -> Pairs:
    pulled = np.array([i for i, _, _ in ROWS])
    return Pairs(
        start=np.searchsorted(pulled, np.arange(n + 1)).astype(np.int64),
        cell=np.array([j for _, j, _ in ROWS]),
        weight=np.array([w for _, _, w in ROWS]),
    )


@both_ways
def test_pairs_add_the_weighted_fields_of_their_cells(way: str) -> None:
    boxes, phi = make_boxes(seed=9)
    n, target = len(boxes.start), empty_pool(phi)
    order, bounds = np.array([2, 0, 3, 1]), np.array([0, 3, 4])
    taken(accumulate_pairs, way)(bounds, order, make_pairs(n), phi, boxes, target)
    assert seen_from(boxes, phi, 1, 0).any()
    for i in range(n):
        expected = np.zeros(boxes.shape[i])
        for pulled, j, weight in ROWS:
            if pulled == i:
                expected += weight * seen_from(boxes, phi, j, i)
        np.testing.assert_allclose(box(target, boxes, i), expected, rtol=1e-13, atol=1e-15)


@both_ways
def test_cells_that_are_not_listed_are_left_alone(way: str) -> None:
    boxes, phi = make_boxes(seed=9)
    target = empty_pool(phi)
    taken(accumulate_pairs, way)(
        np.array([0, 1]), np.array([1]), make_pairs(len(boxes.start)), phi, boxes, target
    )
    for i in (0, 2, 3):
        assert (box(target, boxes, i) == 1e30).all()
    assert np.abs(box(target, boxes, 1)).max() < 1
