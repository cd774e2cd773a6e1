"""Start states of equal cells at random places."""

import time
from typing import Any

import numpy as np
import pytest
from scipy.spatial import cKDTree

from morphosim.scene.random_packing import packed_cells, random_positions

CUBE = ((-32.0, -32.0, -32.0), (32.0, 32.0, 32.0))


def nearest(positions: np.ndarray) -> float:
    return float(cKDTree(positions).query(positions, k=2)[0][:, 1].min())


def test_no_two_balls_are_nearer_than_twice_the_radius() -> None:
    positions = random_positions(125, 5.0, *CUBE, seed=4)
    assert nearest(positions) >= 10 - 1e-6
    assert nearest(positions) < 10.5  # pushed apart, not spread out
    assert (np.abs(positions) < 32).all()
    # Cells fill the whole cube evenly: no layer of a quarter of it is half empty.
    for axis in range(3):
        counts, _ = np.histogram(positions[:, axis], 4, (-32, 32))
        assert counts.min() > 125 / 8


def test_the_forces_are_those_of_equations_12_and_13() -> None:
    """One pair and one wall, iterated by hand from the same draw."""
    low, high, radius = np.zeros(3), np.array([14.0, 12.0, 12.0]), 5.0
    hand = np.random.default_rng(7).uniform(low, high, (2, 3))
    steps = 0
    while np.linalg.norm(hand[0] - hand[1]) < 2 * radius:
        d = np.minimum(high - hand, hand)
        wall = np.where(d < radius, 0.1 * (radius - d), 0) * np.where(hand < high / 2, 1, -1)
        pair = 0.05 * (hand[0] - hand[1])
        hand = hand + wall + np.array([pair, -pair])
        steps += 1
    assert steps > 1
    np.testing.assert_allclose(random_positions(2, radius, low, high, seed=7), hand, atol=1e-9)


def test_a_seed_tells_the_places() -> None:
    one, same, other = (random_positions(30, 5.0, *CUBE, seed=s) for s in (1, 1, 2))
    np.testing.assert_array_equal(one, same)
    assert np.abs(one - other).max() > 1


def test_ten_thousand_cells_take_seconds() -> None:
    begin = time.perf_counter()
    positions = random_positions(10_000, 5.0, (0, 0, 0), (250, 250, 250))
    assert time.perf_counter() - begin < 30  # 1 s on a quiet machine
    assert nearest(positions) >= 10 - 1e-6


@pytest.mark.parametrize(
    ("count", "side", "error"),
    [
        (400, 64.0, "fill 80 % of the box.*64 % at most, which is 320 cells here"),
        (1, 9.0, "does not hold a cell of radius 5"),
        (0, 64.0, "count = 0 is not allowed"),
    ],
)
def test_what_does_not_fit_is_refused_at_once(count: int, side: float, error: str) -> None:
    with pytest.raises(ValueError, match=error):
        random_positions(count, 5.0, (0, 0, 0), (side, side, side))


def test_what_cannot_be_pushed_apart_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("morphosim.scene.random_packing.MOST_ITERATIONS", 50)
    with pytest.raises(ValueError, match="60 % of the box, are not apart after 50 iterations"):
        random_positions(300, 5.0, *CUBE)


def test_cells_of_several_types() -> None:
    cells = packed_cells({"R": 3, "G": 2}, 5.0, *CUBE, seed=1)
    assert [cell.name for cell in cells] == ["R1", "R2", "R3", "G1", "G2"]
    assert [cell.type for cell in cells] == ["R"] * 3 + ["G"] * 2
    assert all(cell.shape.volume == pytest.approx(500 * np.pi / 3) for cell in cells)


@pytest.mark.parametrize(
    ("counts", "options", "words"),
    [
        (3, {}, "counts = 3"),
        ({"R": 2.5}, {}, r"counts\['R'\] = 2.5 is not a whole number"),
        ({"R": 10**40}, {}, r"counts\['R'\] = 1000.* <= 10000000"),
        ({"R": -1}, {}, r"counts\['R'\] = -1 is not allowed"),
        ({"R\0": 1}, {}, "counts: type = .* control character"),
        ({"R": 1}, {"seed": -1}, "seed = -1 is not allowed"),
        ({"R": 1}, {"seed": "x"}, "seed = 'x' is not a whole number"),
    ],
)
def test_counts_and_seeds_are_whole_numbers(counts: Any, options: dict, words: str) -> None:
    with pytest.raises((TypeError, ValueError), match=words):
        packed_cells(counts, 5.0, *CUBE, **options)
