"""Attraction of single pairs, against sums over whole frames."""

import numpy as np
from numpy.typing import NDArray

from morphosim.kernels.frames import frame_size
from morphosim.kernels.layout import Boxes, Pairs
from morphosim.kernels.pairs import accumulate_pairs
from morphosim.kernels.sharing import shares_of

from .example_boxes import GAP, both_ways, grid, make_boxes, seen_from, taken, with_halo

# Pulled cell, pulling cell, weight: one of either sign, one pair that does not overlap.
ROWS = [(0, 1, 0.5), (0, 2, -0.2), (1, 0, 0.3), (2, 0, 0.9), (2, 1, 0.7), (3, 0, 0.4)]


def make_pairs(boxes: Boxes, gap: int = GAP) -> tuple[Pairs, NDArray[np.float64]]:
    """The pairs, and a pool of frames, so far apart, with nothing sensible in it."""
    n = len(boxes.start)
    pulled = np.array([i for i, _, _ in ROWS])
    frame_start, end = np.full(n, -1), gap
    for i in np.unique(pulled):
        frame_start[i] = end
        end += frame_size(i, boxes) + gap
    pairs = Pairs(
        start=np.searchsorted(pulled, np.arange(n + 1)).astype(np.int64),
        cell=np.array([j for _, j, _ in ROWS]),
        weight=np.array([w for _, _, w in ROWS]),
        frame_start=frame_start,
    )
    return pairs, np.full(end, 1e30)


def frame(target: NDArray, pairs: Pairs, boxes: Boxes, i: int) -> NDArray:
    first = pairs.frame_start[i]
    return target[first : first + frame_size(i, boxes)]


@both_ways
def test_pairs_add_the_weighted_fields_of_their_cells(way: str) -> None:
    boxes, phi = make_boxes(seed=9)
    pairs, target = make_pairs(boxes)
    order, shares = np.array([2, 0, 4, 3, 1]), shares_of([0, 3, 5], threads=2)
    taken(accumulate_pairs, way)(shares, order, pairs, phi, boxes, target)
    assert seen_from(boxes, phi, 1, 0).any()
    assert not seen_from(boxes, phi, 0, 3).any()
    between = np.ones(len(target), bool)
    for i in range(len(boxes.start)):
        if pairs.frame_start[i] < 0:
            continue
        found = frame(target, pairs, boxes, i)
        expected = np.zeros(len(found))
        for pulled, j, weight in ROWS:
            if pulled == i:
                with_halo(expected, boxes, i)[:] += weight * seen_from(boxes, phi, j, i)
        np.testing.assert_allclose(
            grid(found, boxes, i), grid(expected, boxes, i), rtol=1e-13, atol=1e-15
        )
        frame(between, pairs, boxes, i)[:] = False
    assert (target[between] == 1e30).all()


@both_ways
def test_cells_that_pull_on_the_same_points_add_up(way: str) -> None:
    """In a pool without gaps, whose first frame begins at 0."""
    origins = ((0, 0, 0), (1, 2, 1), (2, -1, 3), (90, 0, 0), (99, 0, 0))
    boxes, phi = make_boxes(9, origins, ((8, 8, 16),) * 5)
    pairs, target = make_pairs(boxes, gap=0)
    taken(accumulate_pairs, way)(
        shares_of([0, 1], threads=1), np.array([0]), pairs, phi, boxes, target
    )
    one, other = seen_from(boxes, phi, 1, 0), seen_from(boxes, phi, 2, 0)
    assert ((one > 0) & (other > 0)).any()
    found = with_halo(frame(target, pairs, boxes, 0), boxes, 0)
    np.testing.assert_allclose(found, 0.5 * one - 0.2 * other, rtol=1e-13, atol=1e-15)


@both_ways
def test_the_halo_of_a_frame_sees_others_too(way: str) -> None:
    """A cell whose box only touches the halo: it is felt through the gradient."""
    origins = ((0, 0, 0), (0, 0, 16), (0, -9, 0), (8, 0, 0), (99, 0, 0))
    boxes, phi = make_boxes(9, origins, ((8, 8, 16),) * 5)
    pairs, target = make_pairs(boxes)
    taken(accumulate_pairs, way)(
        shares_of([0, 1], threads=1), np.array([0]), pairs, phi, boxes, target
    )
    found = with_halo(frame(target, pairs, boxes, 0), boxes, 0)
    assert found.any()
    assert not found[3:-3, 3:-3, 3:-3].any()
    expected = sum(w * seen_from(boxes, phi, j, 0) for i, j, w in ROWS if i == 0)
    np.testing.assert_allclose(found, expected, rtol=1e-13)


@both_ways
def test_cells_that_are_not_listed_are_left_alone(way: str) -> None:
    boxes, phi = make_boxes(seed=9)
    pairs, target = make_pairs(boxes)
    taken(accumulate_pairs, way)(
        shares_of([0, 1], threads=1), np.array([1]), pairs, phi, boxes, target
    )
    for i in (0, 2, 3):
        assert (frame(target, pairs, boxes, i) == 1e30).all()
    assert np.abs(frame(target, pairs, boxes, 1)).max() < 1


def test_the_result_does_not_depend_on_the_lists() -> None:
    boxes, phi = make_boxes(seed=9)
    results = []
    for order, bounds in (([0, 1, 2, 3, 4], [0, 5]), ([4, 2, 0, 3, 1], [0, 1, 1, 4, 5])):
        pairs, target = make_pairs(boxes)
        accumulate_pairs(shares_of(bounds, threads=2), np.array(order), pairs, phi, boxes, target)
        results.append(target)
    np.testing.assert_array_equal(*results)
