"""Hard walls on the lattice: where they are, and that the lattice's place does not matter."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import solve_banded
from scipy.special import expit

from morphosim.geometry.confinement import BoxWalls, EllipsoidShell, FunctionWalls
from morphosim.numerics.parameters import Numerics
from morphosim.physics.confinement_repulsion import distance, matching_shift, wall_repulsion

from .helpers import advance, centroids, make_engine, sphere

PLANE = BoxWalls(lower=(-100, -100, -100), upper=(0, 100, 100))
SHELL = EllipsoidShell(center=(0.1, -0.2, 0.3), semi_axes=(9.0, 6.0, 4.0), cut=(np.inf, np.inf, 3))


def apparent_zero(wall: Callable[[NDArray], NDArray]) -> float:
    """Where φ, straight from inside, would vanish, by finite differences of φ'' = wall(z) φ."""
    step = 0.002
    z = np.arange(-8.0, 6.0, step)
    bands = np.ones((3, len(z)))
    bands[1] = -2 - step**2 * wall(z)
    right = np.zeros(len(z))
    right[0] = -1.0  # φ = 1 beyond the left end
    phi = solve_banded((1, 1), bands, right)
    slope = (phi[1] - phi[0]) / step
    return float(z[0] - phi[0] / slope)


@pytest.mark.parametrize("decay", [0.125, 0.4])
@pytest.mark.parametrize("diffuseness", [0.05, 0.15, 0.3])
def test_the_resolved_wall_repels_as_a_hard_one_does(diffuseness: float, decay: float) -> None:
    # Behind a hard wall φ = exp(-z/ℓ): seen from inside it vanishes at ℓ.
    shift = matching_shift(diffuseness, decay)
    found = apparent_zero(lambda z: expit((z - shift) / diffuseness) / decay**2)
    assert found == pytest.approx(decay, abs=2e-3)


def pressed_distance(offset: float, walls: str, **options: object) -> float:
    """How far from a wall at `offset` µm the centroid of a cell that is pressed to it settles."""
    box = BoxWalls(lower=(offset - 50, -50, -50), upper=(offset, 50, 50))
    engine = make_engine(
        [sphere((offset - 2.6, 0.0, 0.0), 3.0)],
        shell=box,
        dt=1.0,
        S=12.0,
        walls=walls,
        **options,
    )
    advance(engine, 40)
    return offset - float(centroids(engine)[0, 0])


def test_a_resolved_wall_does_not_feel_the_lattice() -> None:
    offsets = (0.0, 0.13, 0.25, 0.37)
    found = {
        walls: [pressed_distance(offset, walls) for offset in offsets]
        for walls in ("resolved", "stepped")
    }
    # Spread over the wall's place between two lattice planes. Measured: 3.6 and 244 nm.
    assert np.ptp(found["resolved"]) < 0.008
    assert np.ptp(found["stepped"]) > 0.1


@pytest.mark.parametrize("scheme", ["bdf2", "linearised"])
@pytest.mark.parametrize("gamma", [0.0625, 0.25, 1.0])
def test_a_resolved_wall_is_where_the_hard_one_is(gamma: float, scheme: str) -> None:
    # The hard wall's φ appears to vanish at √(γ/g_e) behind it, on any lattice.
    for spacing in (0.5, 0.25):
        numerics = Numerics(spacing=spacing, scheme=scheme)
        repulsion = wall_repulsion(PLANE, 16.0, gamma, numerics)
        found = apparent_zero(lambda z, r=repulsion: r(z, 0.0, 0.0) / gamma)
        assert found == pytest.approx(np.sqrt(gamma / 16.0), abs=2e-3)


@pytest.mark.parametrize(("scheme", "strongest"), [("bdf2", 4.0), ("linearised", 16.0)])
def test_a_resolved_wall_is_stronger_where_it_is_implicit(scheme: str, strongest: float) -> None:
    # In γ/h²; never stronger than the hard one.
    for g_e, spacing in ((1000.0, 0.5), (1000.0, 0.25), (3.0, 0.5)):
        repulsion = wall_repulsion(PLANE, g_e, 0.25, Numerics(spacing=spacing, scheme=scheme))
        deep = float(repulsion(30.0, 0.0, 0.0))
        assert deep == pytest.approx(min(g_e, strongest * 0.25 / spacing**2))


def test_cells_with_their_own_tension_meet_the_wall_where_they_should() -> None:
    # With the wall of γ = 0.25 they are 140 nm apart.
    own, common = (pressed_distance(0.0, "resolved", **how) for how in (
        {"gamma": 1.0}, {"physics": {"gamma": 1.0}},
    ))  # fmt: skip
    assert own == pytest.approx(common, abs=1e-9)


def test_distance_is_that_to_the_surface() -> None:
    along = np.array([3.9, 3.0, 2.5]) + 0.3
    found = distance(SHELL, np.full(3, 0.1), np.full(3, -0.2), along, 0.25)
    np.testing.assert_allclose(found, 3.3 - along, atol=0.03)  # the cut plane
    x = np.array([8.0, 9.0, 9.5]) + 0.1
    found = distance(SHELL, x, np.full(3, -0.2), np.full(3, 0.3), 0.25)
    np.testing.assert_allclose(found, 9.1 - x, atol=0.02)
    y = np.array([5.0, 6.0, 6.5]) - 0.2  # depth falls by 9/6 along this semi-axis
    found = distance(SHELL, np.full(3, 0.1), y, np.full(3, 0.3), 0.25)
    np.testing.assert_allclose(found, 5.8 - y, atol=0.02)


def test_soft_and_stepped_walls_are_taken_as_they_are() -> None:
    points = [np.linspace(-12, 12, 49), np.array(0.0), np.array(0.0)]
    soft = BoxWalls(lower=(-5, -5, -5), upper=(5, 5, 5), width=0.8)
    function = FunctionWalls(
        function=lambda x, y, z: 0.5 + 0 * (x + y + z), lower=(-1, -1, -1), upper=(1, 1, 1)
    )
    for walls, numerics in (
        (soft, Numerics()),
        (function, Numerics()),
        (SHELL, Numerics(walls="stepped")),
    ):
        found = wall_repulsion(walls, 7.0, 0.25, numerics)(*points)
        np.testing.assert_array_equal(found, 7.0 * walls.field(*points) ** 2)
