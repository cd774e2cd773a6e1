"""Division of one field: what is kept, how it is shared out, and where the plane lies."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from morphosim.cell_field import CellField, centroid
from morphosim.simulation.division import divided

from .helpers import H, sphere

NAMES = ("AB", "P1")
OBLIQUE = (0.3, -1.2, 0.7)


def mother(radius: float = 5.0, dtype: type = np.float64) -> CellField:
    """Ball about a point that is not on the lattice."""
    origin, phi = sphere((3.1, -2.3, 0.2), radius)
    return CellField("P0", origin, phi.astype(dtype))


def lopsided(dtype: type = np.float64) -> CellField:
    """Mother of no symmetry, with traces of negative values as real ones have."""
    cell = mother()
    x, y, z = np.meshgrid(
        *(np.linspace(0, 1, n) for n in cell.phi.shape), indexing="ij", sparse=True
    )
    phi = cell.phi * np.clip(4 * x - y + z, -1e-3, 1)
    return CellField("P0", cell.origin, phi.astype(dtype))


def share(first: CellField, second: CellField) -> float:
    one, two = (d.phi.sum(dtype=np.float64) for d in (first, second))
    return float(one / (one + two))


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("fraction", [0.15, 0.5, 0.5924, 0.9])
@pytest.mark.parametrize("axis", [(1, 0, 0), OBLIQUE])
def test_daughters_share_their_mother_as_told(axis: tuple, fraction: float, dtype: type) -> None:
    cell = lopsided(dtype)
    first, second = divided(cell, H, axis, fraction, NAMES, 1.0)
    assert share(first, second) == pytest.approx(fraction, abs=1e-6)
    together = first.phi.astype(float) + second.phi
    assert np.all(np.abs(together - cell.phi) <= np.finfo(dtype).eps * np.abs(cell.phi))
    for daughter in (first, second):
        assert daughter.phi.dtype == dtype
        assert daughter.phi.shape == cell.phi.shape
        np.testing.assert_array_equal(daughter.origin, cell.origin)
    assert (first.name, second.name) == NAMES


def test_the_mother_stays_as_she_is() -> None:
    cell, untouched = mother(), mother()
    for daughter in divided(cell, H, OBLIQUE, 0.4, NAMES, 1.0):
        daughter.phi[:] = 7
        daughter.origin[:] = 7
    np.testing.assert_array_equal(cell.phi, untouched.phi)
    np.testing.assert_array_equal(cell.origin, untouched.origin)


@pytest.mark.parametrize("axis", [(0, 0, -2), OBLIQUE, (-1, 1e-3, 0)])
def test_the_axis_points_from_the_second_daughter_to_the_first(axis: tuple) -> None:
    daughters = divided(mother(), H, axis, 0.6, NAMES, 1.0)
    first, second = (centroid(daughter, H) for daughter in daughters)
    found = (first - second) / np.linalg.norm(first - second)
    np.testing.assert_allclose(found, np.array(axis) / np.linalg.norm(axis), atol=2e-3)


def test_only_the_direction_of_the_axis_counts() -> None:
    short, long = (divided(lopsided(), H, a, 0.3, NAMES, 1.0) for a in ((0, 3, 4), (0, 6, 8)))
    np.testing.assert_array_equal(short[0].phi, long[0].phi)


def test_halves_of_what_is_symmetric_are_mirror_images() -> None:
    _, phi = sphere((0, 0, 0), 5)
    first, second = divided(CellField("P0", np.zeros(3, int), phi), H, (1, 1, 0), 0.5, NAMES, 1.0)
    np.testing.assert_allclose(first.phi, second.phi[::-1, ::-1], atol=1e-8)
    np.testing.assert_allclose(first.phi, first.phi.transpose(1, 0, 2), atol=1e-15)


def test_exchanged_daughters_are_the_same_with_the_opposite_axis() -> None:
    first, second = divided(lopsided(), H, OBLIQUE, 0.3, NAMES, 1.0)
    other, one = divided(lopsided(), H, np.negative(OBLIQUE), 0.7, NAMES[::-1], 1.0)
    np.testing.assert_allclose(one.phi, first.phi, atol=1e-8)
    np.testing.assert_allclose(other.phi, second.phi, atol=1e-8)


def depth_in(daughter: NDArray, cell: NDArray, scale: float) -> NDArray[np.float64]:
    """Depth below the new surface that the daughter's share of φ says, µm."""
    return np.asarray(np.arctanh(2 * daughter / cell - 1) / scale)


@pytest.mark.parametrize("scale", [0.8, 1.5])
@pytest.mark.parametrize("h", [0.25, 0.5])
def test_the_new_surface_is_a_plane_with_the_profile_at_rest(h: float, scale: float) -> None:
    # 24 points, the middles of 24 layers: the first daughter gets the upper six of them
    cell = CellField("P0", np.array([5, -7, 100]), np.ones((8, 9, 24)))
    first, _ = divided(cell, h, (0, 0, 1), 0.25, NAMES, scale * 0.5 / h)
    expected = np.broadcast_to((np.arange(24) - 17.5) * h, cell.phi.shape)
    near = np.abs(expected) < 5 * h
    found = depth_in(first.phi[near], cell.phi[near], scale * 0.5 / h)
    np.testing.assert_allclose(found, expected[near], atol=0.02 * h)


def share_of_ball(radius: float, plane: float) -> float:
    """Share of ∫ φ of a ball that lies above a plane with the profile at rest, by quadrature."""
    r = np.linspace(0, radius + 15, 20_001)
    below = np.cumsum(r * (1 + np.tanh(radius - r)))
    heights = np.concatenate([-r[:0:-1], r])
    area = np.interp(np.abs(heights), r, below[-1] - below)
    return float((area * (1 + np.tanh(heights - plane))).sum() / 2 / area.sum())


@pytest.mark.parametrize("fraction", [0.2, 0.5, 0.7])
def test_a_ball_is_cut_where_its_parts_have_their_volumes(fraction: float) -> None:
    cell = mother(radius=8.0)
    first, _ = divided(cell, H, (0, 1, 0), fraction, NAMES, 1.0)
    middle = tuple(n // 2 for n in cell.phi.shape)
    depth = depth_in(first.phi[middle], cell.phi[middle], 1.0)
    height = (cell.origin[1] + middle[1]) * H + 2.3
    assert share_of_ball(8.0, float(height - depth)) == pytest.approx(fraction, abs=1e-4)


def test_it_does_not_matter_how_far_from_the_origin_a_cell_is() -> None:
    near, far = lopsided(), lopsided()
    far.origin[:] += 10**6
    for one, other in zip(
        *(divided(cell, H, OBLIQUE, 0.4, NAMES, 1.0) for cell in (near, far)), strict=True
    ):
        np.testing.assert_allclose(one.phi, other.phi, atol=1e-7)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"axis": (0, 0, 0)}, ("'P0'", "axis = [0.0, 0.0, 0.0]", "direction")),
        ({"axis": (1, 0)}, ("axis", "(2,)", "(3,)")),
        ({"axis": (1, 0, np.nan)}, ("axis[2] = nan",)),
        ({"fraction": 0.0}, ("fraction = 0.0", "> 0")),
        ({"fraction": 1.0}, ("fraction = 1.0", "< 1")),
        ({"fraction": np.nan}, ("fraction = nan", "finite")),
        ({"fraction": "half"}, ("fraction = 'half'", "number")),
        ({"fraction": 1e-3}, ("'P0'", "'AB'", "at least 27", "finer spacing")),
        ({"fraction": 1 - 1e-3}, ("'P1'", "at least 27")),
        ({"spacing": 0}, ("spacing = 0", "> 0")),
        ({"scale": -1.0}, ("scale = -1.0", "> 0")),
        ({"names": ("AB", "AB")}, ("name 'AB' occurs twice",)),
        ({"names": ("AB",)}, ("names = ('AB',)", "two")),
        ({"names": ("AB", "")}, ("names", "''")),
        ({"names": "AB"}, ("names = 'AB'", "two")),
        ({"names": ("AB", 3)}, ("3", "not a text")),
        (
            {"field": CellField("P0", np.zeros(3, int), np.full((9, 9, 9), 0.4))},
            ("'P0'", "below 0.5 everywhere"),
        ),
    ],
)
def test_what_cannot_be_divided_is_told(changes: dict[str, Any], words: tuple[str, ...]) -> None:
    options = {"field": mother(), "spacing": H, "axis": OBLIQUE, "fraction": 0.4,
               "names": NAMES, "scale": 1.0}  # fmt: skip
    divided(**options)
    with pytest.raises((ValueError, TypeError)) as caught:
        divided(**(options | changes))
    for word in words:
        assert word in str(caught.value)
