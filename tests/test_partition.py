"""Power partitions: volumes by independent sampling, symmetry, disjoint cells, errors."""

import numpy as np
import pytest
from numpy.typing import NDArray

from morphosim import EllipsoidShell
from morphosim.geometry.power_partition import PowerPartition, power_partition

A = 28.2846
SHELL = EllipsoidShell(
    center=(30, 20, 15), semi_axes=(A, 0.665 * A, 0.455 * A), cut=(np.inf, np.inf, 0.361 * A)
)
CENTER = np.array([30.0, 20.0, 15.0])
EIGHT_POINTS = np.array(
    [
        [14.6107, 13.7423, 14.2062],  # ABal
        [16.7871, 26.9799, 16.9214],  # ABar
        [27.9486, 25.2616, 10.7832],  # ABpl
        [38.3203, 27.8520, 17.7545],  # ABpr
        [26.6557, 11.6469, 17.1394],  # MS
        [38.3416, 10.9201, 14.6740],  # E
        [47.3959, 21.8881, 13.9386],  # C
        [48.9982, 14.0285, 15.2564],  # P3
    ]
)
EIGHT_VOLUMES = np.array([2879.625, 3107.875, 3104.75, 2807.5, 2498.75, 2199.0, 2371.375, 1129.75])
TOLERANCE = 0.025
"""Relative; the partition's own sampling is about 1.5 % off, and the start field is refitted."""


def shell_samples(h: float = 0.4) -> tuple[NDArray[np.float64], float]:
    """Jittered points in the eggshell, (M, 3) µm, and the volume each stands for, µm³."""
    low, high = SHELL.bounds()
    axes = [np.arange(a, b, h) for a, b in zip(low, high, strict=True)]
    corners = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    samples = corners + h * np.random.default_rng(0).random(corners.shape)
    return samples[SHELL.depth(*samples.T) > 0], h**3


def regions(partition: PowerPartition, samples: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which samples lie in which cell, (N, M)."""
    cells = range(len(partition.points))
    return np.array([partition.signed_distance(i, *samples.T) > 0 for i in cells])


def shell_volumes(partition: PowerPartition) -> NDArray[np.float64]:
    """Volumes of the cells in the eggshell, counted."""
    samples, each = shell_samples()
    return np.asarray(regions(partition, samples).sum(axis=1) * each)


def test_one_cell_in_open_space_is_a_ball() -> None:
    partition = power_partition([CENTER], [1000.0], None)
    radius = np.cbrt(3 * 1000.0 / (4 * np.pi))
    assert np.sqrt(partition.weights[0]) == pytest.approx(radius, rel=TOLERANCE / 3)
    depth = partition.signed_distance(0, CENTER[0] + np.array([0.0, 10.0]), *CENTER[1:])
    np.testing.assert_allclose(depth, np.sqrt(partition.weights[0]) - [0, 10])


def test_two_equal_cells_are_mirror_images() -> None:
    points = CENTER + np.array([[-3.0, 0.0, 0.0], [3.0, 0.0, 0.0]])
    partition = power_partition(points, [1500.0, 1500.0], SHELL)
    assert partition.weights[0] == pytest.approx(partition.weights[1], rel=1e-3)
    offsets = np.random.default_rng(1).uniform(-8, 8, (3, 500))
    left = partition.signed_distance(0, *(CENTER[:, None] + offsets))
    offsets[0] *= -1
    right = partition.signed_distance(1, *(CENTER[:, None] + offsets))
    np.testing.assert_allclose(left, right, atol=1e-2)


def test_depth_is_distance_to_planes_and_ball() -> None:
    rng = np.random.default_rng(2)
    points, x = rng.uniform(0, 20, (6, 3)), rng.uniform(0, 20, (200, 3))
    partition = PowerPartition(points=points, weights=rng.uniform(30, 90, 6))
    square = ((x[:, None] - points) ** 2).sum(axis=2)
    power = square - partition.weights
    for i in range(6):
        faces = [np.sqrt(partition.weights[i]) - np.sqrt(square[:, i])]
        for j in set(range(6)) - {i}:
            gap = 2 * np.linalg.norm(points[j] - points[i])
            faces.append((power[:, j] - power[:, i]) / gap)
        np.testing.assert_allclose(
            partition.signed_distance(i, *x.T), np.min(faces, axis=0), atol=1e-9
        )


def test_eight_cells_fill_the_eggshell_at_their_volumes() -> None:
    partition = power_partition(EIGHT_POINTS, EIGHT_VOLUMES, SHELL)
    samples, each = shell_samples()
    inside = regions(partition, samples)
    assert inside.sum(axis=0).max() == 1  # disjoint
    np.testing.assert_allclose(inside.sum(axis=1) * each, EIGHT_VOLUMES, rtol=TOLERANCE)
    centers = np.array([samples[cell].mean(axis=0) for cell in inside])
    assert np.linalg.norm(centers - EIGHT_POINTS, axis=1).max() < 2.0


@pytest.mark.parametrize(
    ("points", "volumes"),
    [
        ([CENTER], [5000.0]),
        ([[3.0, 20.0, 15.0], [30.0, 20.0, 24.9]], [3000.0, 5000.0]),  # at the wall
        ([CENTER, CENTER + np.array([0.1, 0, 0])], [3000.0, 3000.0]),  # nearly coincident
        (EIGHT_POINTS, EIGHT_VOLUMES * 0.985 * 26970 / EIGHT_VOLUMES.sum()),  # nearly full
    ],
)
def test_volumes_are_reached(points: list, volumes: list) -> None:
    reached = shell_volumes(power_partition(points, volumes, SHELL))
    np.testing.assert_allclose(reached, volumes, rtol=TOLERANCE)


def test_thirty_times_smaller_neighbour_keeps_its_volume() -> None:
    volumes = [15000.0, 500.0]  # at equal ball volumes the large cell swallows the small one
    partition = power_partition([CENTER, CENTER + np.array([6, 0, 0])], volumes, SHELL)
    np.testing.assert_allclose(shell_volumes(partition), volumes, rtol=2 * TOLERANCE)


@pytest.mark.parametrize(
    ("points", "volumes", "text"),
    [
        ([CENTER, CENTER], [10.0, 10.0], "0 and 1 coincide"),
        ([CENTER, [30.0, np.nan, 15.0]], [10.0, 10.0], r"\[1, 1\].*not finite"),
        ([CENTER], [-1.0], r"volumes\[0\] = .*-1.0"),
        ([CENTER], [10.0, 10.0], r"volumes has shape \(2,\)"),
        ([1.0, 2.0], [10.0, 10.0], r"positions has shape \(2,\)"),
        ([CENTER, [1.0, 2.0, 3.0]], [10.0, 10.0], r"\[1\] = \[1.0, 2.0, 3.0\].*outside"),
        ([CENTER], [30000.0], "30000 µm³ and the confinement holds 2[67]"),
    ],
)
def test_errors_name_the_thing_and_its_value(points: list, volumes: list, text: str) -> None:
    with pytest.raises(ValueError, match=text):
        power_partition(points, volumes, SHELL)
