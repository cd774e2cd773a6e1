"""Contacts: touching against the full grid, areas against those of spheres, discs and caps."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from morphosim import contact_areas, touching
from morphosim.cell_field import CellField
from morphosim.measure.contacts import NEIGHBOUR_LEVEL, SURFACE_LEVEL, TOUCH_LEVEL, overlapping
from morphosim.measure.surfaces import cell_surface

H = 0.25


def profile(depth: NDArray) -> NDArray[np.float64]:
    return 0.5 * (1 + np.tanh(depth))


def depth_at(level: float) -> float:
    """Depth at which the profile has a value."""
    return float(np.arctanh(2 * level - 1))


SURFACE, NEIGHBOUR = -depth_at(SURFACE_LEVEL), -depth_at(NEIGHBOUR_LEVEL)
"""How far outside of φ = 1/2 these levels lie, µm."""


def field(name: str, low: tuple, high: tuple, depth, h: float = H) -> CellField:
    """Field of a depth, on the lattice points of a box given in µm."""
    origin = np.rint(np.array(low) / h).astype(np.int64)
    shape = np.rint(np.array(high) / h).astype(np.int64) - origin + 1
    axes = [(o + np.arange(n)) * h for o, n in zip(origin, shape, strict=True)]
    points = np.meshgrid(*axes, indexing="ij", sparse=True)
    values = np.broadcast_to(depth(*points), shape)
    return CellField(name, origin, profile(values).astype(np.float32))


def ball(name: str, x: float, radius: float, margin: float = 4.0) -> CellField:
    """Ball on the x axis."""
    r = radius + margin
    return field(
        name, (x - r, -r, -r), (x + r, r, r),
        lambda px, py, pz: radius - np.sqrt((px - x) ** 2 + py**2 + pz**2),
    )  # fmt: skip


# --- touching ----------------------------------------------------------------------------------


def random_fields(seed: int) -> list[CellField]:
    """Boxes of noise at random places, dense enough that some touch and some do not."""
    rng = np.random.default_rng(seed)
    return [
        CellField(
            f"cell {k}",
            rng.integers(-8, 9, 3),
            rng.random(rng.integers(2, 7, 3)) * rng.uniform(0.45, 0.7),
        )
        for k in range(7)
    ]


def spread(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Mask and its six neighbours; its outermost points must be unset."""
    result = mask.copy()
    for axis in range(3):
        for step in (-1, 1):
            result |= np.roll(mask, step, axis)
    return result


def touching_on_the_full_grid(fields: list[CellField]) -> dict[tuple[str, str], int]:
    covers = []
    for f in fields:
        grid = np.zeros((40, 40, 40), bool)
        first = f.origin + 16
        grid[tuple(slice(a, a + n) for a, n in zip(first, f.phi.shape, strict=True))] = (
            f.phi > TOUCH_LEVEL
        )
        covers.append(spread(grid))
    counts = {
        (fields[i].name, fields[j].name): int((covers[i] & covers[j]).sum())
        for i in range(len(fields))
        for j in range(i + 1, len(fields))
    }
    return {pair: count for pair, count in counts.items() if count}


@pytest.mark.parametrize("seed", range(8))
def test_touching_is_that_of_the_full_grid(seed: int) -> None:
    fields = random_fields(seed)
    expected = touching_on_the_full_grid(fields)
    assert 0 < len(expected) < 21
    assert touching(fields) == expected


@pytest.mark.parametrize(("gap", "shared"), [(0, 2), (1, 2), (2, 1), (3, 0)])
def test_touching_reaches_two_lattice_steps_also_between_boxes(gap: int, shared: int) -> None:
    a = CellField("a", np.zeros(3, np.int64), np.ones((1, 1, 1)))
    b = CellField("b", np.array([gap, 0, 0]), np.ones((1, 1, 1)))
    expected = {("a", "b"): 7 if gap == 0 else shared} if shared else {}
    assert touching([a, b]) == expected


def test_levels_are_those_of_the_published_program() -> None:
    assert (TOUCH_LEVEL, SURFACE_LEVEL, NEIGHBOUR_LEVEL) == (0.44, 0.34, 0.2)
    a = CellField("a", np.zeros(3, np.int64), np.full((3, 3, 3), 0.44))
    assert touching([a, a]) == {}


# --- areas -------------------------------------------------------------------------------------


def cap(radius: float, other: float, distance: float) -> float:
    """Area of the part of a sphere that lies in a ball `distance` away."""
    cosine = (radius**2 + distance**2 - other**2) / (2 * radius * distance)
    return 2 * np.pi * radius**2 * (1 - cosine)


@pytest.mark.parametrize(("radius", "distance"), [(3.0, 5.0), (3.0, 6.5), (2.0, 4.0)])
def test_area_between_two_balls(radius: float, distance: float) -> None:
    fields = [ball("big", 0, 3.0), ball("other", distance, radius)]
    sides = [
        cap(3 + SURFACE, radius + NEIGHBOUR, distance),
        cap(radius + SURFACE, 3 + NEIGHBOUR, distance),
    ]
    areas = contact_areas(fields, H)
    assert areas == {("big", "other"): pytest.approx(np.mean(sides), rel=0.03)}


def test_area_between_a_ball_and_a_flat_face() -> None:
    height = 2.0  # of the ball's centre above the face at x = 0
    wall = field("wall", (-6, -8, -8), (4, 8, 8), lambda x, y, z: -x + 0 * y + 0 * z)
    areas = contact_areas([wall, ball("ball", height, 3.0)], H)
    disc = np.pi * ((3 + NEIGHBOUR) ** 2 - (height - SURFACE) ** 2)
    dome = 2 * np.pi * (3 + SURFACE) * (3 + SURFACE - (height - NEIGHBOUR))
    assert areas == {("wall", "ball"): pytest.approx((disc + dome) / 2, rel=0.02)}


def test_area_scales_with_the_spacing() -> None:
    fields = [ball("a", 0, 3.0), ball("b", 5.0, 3.0)]
    fine, coarse = contact_areas(fields, 0.25), contact_areas(fields, 1.0)
    assert coarse["a", "b"] == pytest.approx(16 * fine["a", "b"])


def test_area_is_that_of_the_same_fields_elsewhere() -> None:
    fields = [ball("a", 0, 3.0), ball("b", 5.0, 3.0)]
    moved = [CellField(f.name, f.origin + np.array([10**5, -7, 3]), f.phi) for f in fields]
    assert contact_areas(moved, H)["a", "b"] == pytest.approx(contact_areas(fields, H)["a", "b"])
    assert touching(moved) == touching(fields)


def test_no_contact_between_cells_far_apart_or_alone() -> None:
    near, far = ball("near", 0, 3.0), ball("far", 9.0, 3.0)  # the boxes overlap
    assert contact_areas([near, far], H) == {}
    assert touching([near, far]) == {}
    assert contact_areas([near], H) == touching([near]) == {}


def test_pairs_are_named_in_the_order_of_the_cells() -> None:
    fields = [ball("z", 10, 3.0), ball("m", 5, 3.0), ball("a", 0, 3.0)]
    pairs = {("z", "m"), ("m", "a")}
    assert set(contact_areas(fields, H)) == set(touching(fields)) == pairs


def test_a_cell_that_has_vanished_has_no_contact() -> None:
    # A scene with on_vanish = "ignore" keeps such a cell.
    gone = ball("gone", 5, 3.0)
    faint = CellField("gone", gone.origin, 0.1 * gone.phi)
    assert contact_areas([ball("a", 0, 3.0), faint], H) == {}


def area_by_marching_cubes(fields: list[CellField], h: float) -> float:
    """Contact area of two cells, by the triangles of scikit-image, each in or out as a whole."""
    sides = []
    for mine, other in (fields, fields[::-1]):
        surface = cell_surface(mine, h, SURFACE_LEVEL)
        corners = surface.vertices[surface.faces]
        local = corners.mean(axis=1) / h - other.origin
        inside = map_coordinates(other.phi.astype(float), local.T, order=1) >= NEIGHBOUR_LEVEL
        edges = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        sides.append(np.linalg.norm(edges[inside], axis=1).sum() / 2)
    return float(np.mean(sides))


def pair_at(shift: NDArray, distance: float, h: float) -> list[CellField]:
    """Two balls of 3 µm on a slant, moved by `shift`."""
    centres = [shift, shift + distance * np.array([2, 1, -2]) / 3]
    return [
        field(
            name, tuple(c - 6), tuple(c + 6),
            lambda *p, c=c: 3 - np.sqrt(sum((a - b) ** 2 for a, b in zip(p, c, strict=True))), h,
        )
        for name, c in zip("ab", centres, strict=True)
    ]  # fmt: skip


@pytest.mark.parametrize("distance", [5.0, 5.8])
def test_area_is_that_of_marching_cubes(distance: float) -> None:
    fields = pair_at(np.zeros(3), distance, H)
    area = contact_areas(fields, H)["a", "b"]
    assert area == pytest.approx(area_by_marching_cubes(fields, H), rel=0.01)


def test_error_of_the_area_falls_with_the_spacing() -> None:
    """By nearly a factor of four: about as its square."""
    expected = cap(3 + SURFACE, 3 + NEIGHBOUR, 5.0)
    shifts = np.random.default_rng(5).random((6, 3))
    errors = [
        np.mean([contact_areas(pair_at(h * s, 5.0, h), h)["a", "b"] for s in shifts]) - expected
        for h in (0.5, 0.25)
    ]
    assert abs(errors[0]) < 0.02 * expected
    assert 2.7 < errors[0] / errors[1] < 5


def test_area_hardly_depends_on_where_the_lattice_is() -> None:
    shifts = np.random.default_rng(3).random((12, 3)) * 0.5
    areas = [contact_areas(pair_at(shift, 5.0, 0.5), 0.5)["a", "b"] for shift in shifts]
    assert np.ptp(areas) < 0.01 * np.mean(areas)


def test_a_cell_cut_by_the_face_of_its_box_is_closed_there() -> None:
    """As cells are that an image cuts; the other cell touches it from beyond the face."""
    cut = field("cut", (0, -8, -8), (8, 8, 8), lambda x, y, z: 4 - x + 0 * y + 0 * z)
    areas = contact_areas([cut, ball("ball", -2.5, 3.0)], H)
    # φ of the cut cell falls from 1 to 0 within the lattice step before x = 0.
    face, reach = -H * (1 - SURFACE_LEVEL), -H * (1 - NEIGHBOUR_LEVEL)
    disc = np.pi * ((3 + NEIGHBOUR) ** 2 - (face + 2.5) ** 2)
    dome = 2 * np.pi * (3 + SURFACE) * (3 + SURFACE - (reach + 2.5))
    assert areas == {("cut", "ball"): pytest.approx((disc + dome) / 2, rel=0.01)}


# --- overlapping boxes ---------------------------------------------------------------------------


def test_overlapping_boxes_are_those_of_a_comparison_of_all() -> None:
    rng = np.random.default_rng(1)
    low = rng.integers(-20, 20, (60, 3))
    high = low + rng.integers(1, 25, (60, 3))
    meets = (low[:, None] < high) & (low < high[:, None])
    expected = np.argwhere(np.triu(meets.all(axis=2), k=1))
    assert 100 < len(expected) < 1000
    np.testing.assert_array_equal(overlapping(low, high), expected)


def test_no_boxes_and_one_box() -> None:
    none = np.zeros((0, 3), np.int64)
    assert overlapping(none, none).shape == (0, 2)
    assert overlapping(np.zeros((1, 3), np.int64), np.ones((1, 3), np.int64)).shape == (0, 2)
    assert contact_areas([], H) == touching([]) == {}


def test_spacing_must_be_positive() -> None:
    with pytest.raises(ValueError, match="spacing = -1 is not allowed"):
        contact_areas([], -1)
