"""Contact areas as in segmented images: their formula on cut balls, and fields on voxels."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, generate_binary_structure

from morphosim import label_image, voxel_contact_areas
from morphosim.cell_field import CellField
from morphosim.measure.voxel_contacts import AREA_PER_VOXEL, boundary_voxels

RADIUS, HALF = 20.0, 12.0
"""Of the balls, and of the distance of their centres, in voxels."""
DISC = np.pi * (RADIUS**2 - HALF**2)


def cut_balls(normal: NDArray, centre: NDArray) -> NDArray[np.int64]:
    """Label image of two balls that share a flat disc of this normal."""
    x = np.indices((75, 75, 75)).reshape(3, -1).T - 37 - centre
    along = x @ (normal / np.linalg.norm(normal))
    distance2 = (x**2).sum(axis=1) + HALF**2
    inside = distance2 - 2 * HALF * abs(along) < RADIUS**2
    return np.where(inside, 1 + (along > 0), 0).reshape(75, 75, 75)


def off(normal: NDArray, centre: NDArray) -> float:
    """Relative error of the area."""
    return AREA_PER_VOXEL * boundary_voxels(cut_balls(normal, centre))[1, 2] / DISC - 1


@pytest.mark.parametrize(
    ("normal", "error"), [((1, 0, 0), 0.2031), ((1, 1, 0), -0.149), ((1, 1, 1), -0.305)]
)
def test_areas_of_lattice_planes(normal: tuple[int, int, int], error: float) -> None:
    """By 1.2031 max |n_k|: too large along a lattice plane, too small along (111)."""
    found = [off(np.array(normal), np.full(3, shift)) for shift in (0.1, 0.4)]
    assert np.mean(found) == pytest.approx(error, abs=0.03)


def test_areas_are_right_on_average_over_directions() -> None:
    rng = np.random.default_rng(3)
    directions = rng.normal(size=(200_000, 3))
    largest = abs(directions).max(axis=1) / np.linalg.norm(directions, axis=1)
    assert AREA_PER_VOXEL * largest.mean() == pytest.approx(1, abs=2e-3)
    found = [off(rng.normal(size=3), rng.uniform(-0.5, 0.5, 3)) for _ in range(24)]
    assert np.mean(found) == pytest.approx(0, abs=0.06)  # of one: 0.11, root mean square


def test_boundary_voxels_are_common_to_both_dilated_cells() -> None:
    """As CMap counts them: in an image whose boundaries belong to no cell."""
    labels, cross = cut_balls(np.array([3, 1, 2]), np.zeros(3)), generate_binary_structure(3, 1)
    counts = []
    for mine, other in ((1, 2), (2, 1)):
        parted = np.where(binary_dilation(labels == mine, cross) & (labels == other), 0, labels)
        both = binary_dilation(parted == mine, cross) & binary_dilation(parted == other, cross)
        counts.append(np.count_nonzero(both & (parted == 0)))
    rim = 2 * np.pi * np.sqrt(RADIUS**2 - HALF**2)  # voxels outside of the balls, at the edge
    assert 0 <= np.mean(counts) - boundary_voxels(labels)[1, 2] < rim


def test_boundaries_are_counted_by_pair() -> None:
    labels = np.zeros((6, 4, 1), np.uint64)
    labels[:3, :2], labels[3:, :2], labels[:3, 2:] = 5, 2, 9
    # 2 voxels of either side along x, 3 along y; 2 and 9 meet at an edge alone
    assert boundary_voxels(labels) == {(2, 5): 2, (5, 9): 3}
    assert boundary_voxels(np.zeros((3, 3, 3), int)) == {}
    assert boundary_voxels(np.zeros((1, 1, 1), int)) == {}


H, BALL, APART = 0.5, 4.0, 2.0
"""Spacing, radius of both cells, and distance of their centres from the contact, µm."""


def cut_cells(gap: float = 0.0, normal: tuple[int, int, int] = (0, 0, 1)) -> list[CellField]:
    """Two cells with a flat contact, their surfaces φ = 1/2 `gap` apart there."""
    origin, n = np.full(3, -14), np.array(normal) / np.linalg.norm(normal)
    x = (np.moveaxis(np.indices((29, 29, 29)), 0, -1) + origin) * H - [0.05, 0.11, -0.07]
    depths = [
        np.minimum(BALL - np.linalg.norm(x - side * APART * n, axis=-1), side * x @ n - gap / 2)
        for side in (-1, 1)
    ]
    phi = [(0.5 * (1 + np.tanh(d))).astype(np.float32) for d in depths]
    return [CellField(name, origin, values) for name, values in zip("ab", phi, strict=True)]


def test_fields_have_the_same_area_with_and_without_a_gap() -> None:
    """Up to a gap in which the fields add up to 1/2, of 1.1 µm."""
    plane = [voxel_contact_areas(cut_cells(gap), H)["a", "b"] for gap in (0.0, 0.8)]
    tilted = voxel_contact_areas(cut_cells(0.8, (1, 1, 1)), H)["a", "b"]
    assert plane[1] == pytest.approx(plane[0], rel=0.03)
    assert plane[1] / tilted == pytest.approx(np.sqrt(3), rel=0.03)
    # where the surfaces part, their profiles fill a little of the wedge between them
    assert 1 < plane[0] / AREA_PER_VOXEL / (np.pi * (BALL**2 - APART**2)) < 1.5
    assert voxel_contact_areas(cut_cells(1.2), H) == {}


def test_areas_follow_the_voxel_and_the_place_but_little() -> None:
    fields, shift = cut_cells(), np.array([3, -5, 7])
    moved = [CellField(f.name, f.origin + shift, f.phi) for f in fields]
    areas = [voxel_contact_areas(f, H, v)["a", "b"] for f, v in ((fields, 0.18), (moved, 0.3))]
    assert areas[0] == pytest.approx(areas[1], rel=0.05)


def test_cells_that_are_alone_have_no_areas() -> None:
    assert voxel_contact_areas(cut_cells()[:1], H, 0.5) == {}
    assert voxel_contact_areas([], H) == {}


def test_a_filled_label_image_has_no_gaps() -> None:
    fields = cut_cells(0.8)
    (_, gap), (_, full) = label_image(fields), label_image(fields, filled=True)
    line = (14, 14, slice(8, 21))
    assert gap[line].tolist() == [1] * 6 + [0] + [2] * 6
    assert sorted(full[line].tolist()) == full[line].tolist()
    assert 0 not in full[line]
    assert np.array_equal(full[gap > 0], gap[gap > 0])


def test_bad_voxels_are_refused() -> None:
    fields = cut_cells()
    with pytest.raises(ValueError, match="voxel = 0"):
        voxel_contact_areas(fields, H, 0)
    with pytest.raises(ValueError, match="spacing = -1"):
        voxel_contact_areas(fields, -1)
    with pytest.raises(ValueError, match=r"points is too large; voxel = 0\.001 um: take larger"):
        voxel_contact_areas(fields, H, 1e-3)
