"""How far centroids move, and how fast, of cells that come and go."""

import numpy as np
import pytest

from morphosim.measure.motion import Positions, root_mean_square, trajectory

NOWHERE = [np.nan] * 3
PLACES = np.array([[0.0, 0, 0], [5, 0, 0], [0, 5, 0]])


@pytest.mark.parametrize(
    ("before", "now"),
    [(["a", "b", "c"], ["c", "d", "b"]), (np.array([0, 1, 2]), np.array([2, 3, 1]))],
    ids=["names", "numbers"],
)
def test_speed_is_that_of_the_same_cell(before: object, now: object) -> None:
    then = Positions(10.0, before, PLACES)
    later = Positions(14.0, now, PLACES[[2, 0, 1]] + [3, 4, 0])
    np.testing.assert_array_equal(then.of(now), [PLACES[2], NOWHERE, PLACES[1]])
    np.testing.assert_array_equal(later.distance(then), [5, np.nan, 5])
    np.testing.assert_array_equal(later.speed(then), [1.25, np.nan, 1.25])
    assert root_mean_square(later.speed(then)) == 1.25


def test_without_any_common_cell_no_speed_is_known() -> None:
    later = Positions(1.0, ["a"], PLACES[:1])
    for before in (Positions(0.0, ["b", "c"], PLACES[:2]), Positions(0.0, [], PLACES[:0])):
        assert np.isnan(later.speed(before)).all()
    assert np.isnan(root_mean_square(np.array([np.nan])))


def test_many_cells_in_any_order() -> None:
    random = np.random.default_rng(0)
    names = np.array([f"c{k}" for k in range(1000)])
    then = Positions(0.0, names, random.random((1000, 3)))
    kept = random.permutation(1000)[:900]
    now = Positions(2.0, [*names[kept], "new"], random.random((901, 3)))
    expected = np.linalg.norm(now.centroids[:900] - then.centroids[kept], axis=1)
    np.testing.assert_array_equal(now.distance(then), [*expected, np.nan])


def test_trajectory_of_a_cell_that_comes_late() -> None:
    position = np.array([[NOWHERE], [[0, 0, 0]], [[3, 4, 0]], [[0, 0, 0]]])
    displacement, path, speed = trajectory(position, np.array([0.0, 1, 3, 4]))
    np.testing.assert_array_equal(displacement[:, 0], [np.nan, 0, 5, 0])
    np.testing.assert_array_equal(path[:, 0], [np.nan, 0, 5, 10])
    np.testing.assert_array_equal(speed[:, 0], [np.nan, np.nan, 2.5, 5])
