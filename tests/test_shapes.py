"""Shapes and confinements: depth, bounds and volume, and the start fields on the lattice."""

from collections.abc import Sequence

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq

from morphosim import (
    BoxWalls,
    Ellipsoid,
    EllipsoidShell,
    Field,
    FunctionWalls,
    Mask,
    MaskWalls,
    Sphere,
)
from morphosim.cell_field import CellField, centroid
from morphosim.geometry.phase_field import lattice_field, profile

H = 0.5
CENTER = np.array([1.3, -2.1, 0.4])
DIRECTIONS = np.random.default_rng(0).normal(size=(200, 3))
DIRECTIONS /= np.linalg.norm(DIRECTIONS, axis=1, keepdims=True)


def start(shape: object, h: float = H, scale: float = 1.0) -> CellField:
    return CellField("a", *lattice_field(shape, "a", scale, h))


def volume(field: CellField, h: float = H) -> float:
    return float(field.phi.sum() * h**3)


def open_grid(low: ArrayLike, steps: ArrayLike, shape: Sequence[int]) -> list[NDArray]:
    axes = [a + h * np.arange(n) for a, h, n in zip(low, steps, shape, strict=True)]
    return list(np.meshgrid(*axes, indexing="ij", sparse=True))


def ball_mask(radius: float, steps: NDArray) -> tuple[NDArray[np.bool_], NDArray]:
    """Voxels of a ball about CENTER, and the position of the first."""
    origin = CENTER - radius - 1.5 * steps
    shape = np.ceil((2 * radius + 3 * steps) / steps).astype(int)
    return Sphere(center=CENTER, radius=radius).depth(*open_grid(origin, steps, shape)) > 0, origin


def surface_radii(field: CellField, center: NDArray, h: float = H) -> NDArray[np.float64]:
    """Distance from the centre to φ = 1/2 along many directions."""
    from scipy.ndimage import map_coordinates

    r = np.arange(1.5, 8, 0.02)
    points = center + DIRECTIONS[:, None, :] * r[:, None]
    index = np.moveaxis(points / h - field.origin, -1, 0)
    phi = map_coordinates(field.phi, index, order=1)
    return np.asarray(r[(phi > 0.5).sum(axis=1)])


# --- shapes ------------------------------------------------------------------------------------


def test_sphere() -> None:
    ball = Sphere(center=CENTER, radius=3)
    points = CENTER + DIRECTIONS * np.linspace(0, 9, 200)[:, None]
    np.testing.assert_allclose(ball.depth(*points.T), 3 - np.linspace(0, 9, 200), atol=1e-12)
    np.testing.assert_allclose(ball.bounds(), (CENTER - 3, CENTER + 3))
    assert ball.volume == pytest.approx(113.0973, abs=1e-3)


@pytest.mark.parametrize("radius", [2.0, 3.0, 5.0, 20.0])
@pytest.mark.parametrize("scale", [0.8, 1.2])
def test_start_field_of_a_sphere_has_its_volume(radius: float, scale: float) -> None:
    field = start(Sphere(center=CENTER, radius=radius), scale=scale)
    assert volume(field) == pytest.approx(4 / 3 * np.pi * radius**3, rel=1.1e-4)
    np.testing.assert_allclose(centroid(field, H), CENTER, atol=1e-3)


@pytest.mark.parametrize("radius", [3.0, 5.0])
@pytest.mark.parametrize("scale", [0.8, 1.2])
def test_surface_of_a_start_field_lies_within_its_sphere(radius: float, scale: float) -> None:
    # The Fermi integral ∫ 4π r² (1 + tanh(s (R - r))) / 2 dr, up to terms of exp(-4 s R).
    def integral(R: float) -> float:
        plain = 4 * np.pi / 3 * (R**3 + np.pi**2 * R / (4 * scale**2))
        return float(plain + np.pi / scale**3 * np.exp(-2 * scale * R))

    surface = brentq(lambda R: integral(R) - 4 / 3 * np.pi * radius**3, 0.5, radius)
    field = start(Sphere(center=CENTER, radius=radius), scale=scale)
    np.testing.assert_allclose(surface_radii(field, CENTER), surface, atol=0.06)


SHAPES = {
    "sphere": Sphere(center=CENTER, radius=3),
    "ellipsoid": Ellipsoid(center=CENTER, semi_axes=(7, 5, 4)),
    "mask": Mask(mask=np.ones((9, 12, 7)), spacing=0.5),
    "large": Sphere(center=CENTER, radius=30),
}


@pytest.mark.parametrize("kind", list(SHAPES))
@pytest.mark.parametrize("share", [0.75, 1.0, 1.25, 2.0])
def test_start_field_has_the_volume_that_is_asked_for(kind: str, share: float) -> None:
    """Down to its tail: the box grows with it."""
    shape, h = SHAPES[kind], 1.0 if kind == "large" else H
    _, phi = lattice_field(shape, "a", 1.0, h, share * shape.volume)
    assert phi.sum() * h**3 == pytest.approx(share * shape.volume, rel=1.1e-4)
    assert max(np.take(phi, k, axis).max() for axis in range(3) for k in (0, -1)) < 5e-5


def test_a_shape_larger_than_its_bounds_is_refused() -> None:
    with pytest.raises(ValueError, match=r"cell 'a': its shape has a volume of .*bounds"):
        lattice_field(Boastful(Sphere(center=CENTER, radius=3)), "a", 1.0, H)


class Boastful:
    """A shape that says a hundred times its volume."""

    def __init__(self, shape: Sphere) -> None:
        self.exact, self.depth, self.bounds = True, shape.depth, shape.bounds
        self.volume = 100 * shape.volume


def test_start_field_reaches_down_to_its_tail() -> None:
    field = start(Sphere(center=CENTER, radius=3))
    faces = [np.take(field.phi, k, axis) for axis in range(3) for k in (0, -1)]
    assert max(face.max() for face in faces) < 2e-5


def test_ellipsoid() -> None:
    axes = np.array([7.0, 5.0, 4.0])
    egg = Ellipsoid(center=CENTER, semi_axes=axes)
    surface = CENTER + DIRECTIONS * axes
    np.testing.assert_allclose(egg.depth(*surface.T), 0, atol=1e-12)
    assert float(egg.depth(*CENTER)) == 4  # the nearest surface
    normals = DIRECTIONS / axes
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    for distance in (-0.3, 0.3):  # to first order the depth is the distance
        depth = egg.depth(*(surface - distance * normals).T)
        np.testing.assert_allclose(depth, distance, rtol=0.1)
    np.testing.assert_allclose(egg.bounds(), (CENTER - axes, CENTER + axes))
    assert egg.volume == pytest.approx(4 / 3 * np.pi * 140)


def test_ellipsoid_with_equal_axes_is_a_sphere() -> None:
    points = (CENTER + DIRECTIONS * np.linspace(1, 9, 200)[:, None]).T
    egg = Ellipsoid(center=CENTER, semi_axes=(3, 3, 3))
    ball = Sphere(center=CENTER, radius=3)
    np.testing.assert_allclose(egg.depth(*points), ball.depth(*points), atol=1e-12)


@pytest.mark.parametrize("steps", [(0.5, 0.5, 0.5), (0.25, 0.5, 0.8)])
@pytest.mark.parametrize("smoothing", [0.0, 2.0, 4.5])
def test_mask_of_a_ball(steps: tuple, smoothing: float) -> None:
    mask, origin = ball_mask(4.0, np.array(steps))
    shape = Mask(mask=mask, origin=origin, spacing=steps, smoothing=smoothing)
    assert shape.volume == mask.sum() * np.prod(steps)
    assert shape.volume == pytest.approx(268.08, rel=0.02)
    field = start(shape)
    assert volume(field) == pytest.approx(shape.volume, rel=1e-5)
    np.testing.assert_allclose(centroid(field, H), CENTER, atol=0.1)
    # ∫ φ is the volume, so that the surface lies where R³ + π² R / 4 is that of the ball.
    radius = max(np.roots([1, 0, np.pi**2 / 4, -64]).real)
    found = surface_radii(field, CENTER)
    assert abs(found.mean() - radius) < 0.25 * max(steps)
    assert found.std() < (0.5 if smoothing == 0 else 0.25) * max(steps)


def test_mask_lies_where_its_origin_and_spacing_say() -> None:
    mask = np.zeros((9, 9, 9))
    mask[2:6, 3:8, 1:7] = 7  # any value that is not zero
    shape = Mask(mask=mask, origin=(10, -20, 30), spacing=(0.5, 1, 2), smoothing=0)
    np.testing.assert_allclose(shape.bounds(), [(11, -17, 32), (12.5, -13, 42)])
    inside = np.array([[11.5, -15.0, 36.0], [11.5, -15.0, 60.0]])
    assert (shape.depth(*inside.T) > 0).tolist() == [True, False]


def test_smoothing_of_a_mask_keeps_a_plane_where_it_is() -> None:
    mask = np.zeros((24, 24, 24))
    mask[4:12, 2:22, 2:22] = 1  # its face is at x = 11.5 * 0.5
    x = np.linspace(4.75, 6.75, 9)
    for smoothing in (0.0, 4.5):
        depth = Mask(mask=mask, smoothing=smoothing).depth(x, np.full(9, 6.0), np.full(9, 6.0))
        np.testing.assert_allclose(depth, 5.75 - x, atol=1e-9)


def test_field_on_the_lattice_is_taken_as_it_is() -> None:
    phi = np.random.default_rng(1).uniform(0, 1, (6, 7, 8))
    field = start(Field(phi=phi, origin=(3.0, -1.5, 20.5), spacing=H))
    np.testing.assert_array_equal(field.origin, (6, -3, 41))
    np.testing.assert_allclose(field.phi, phi, atol=1e-12)


def test_field_drops_what_is_negligible() -> None:
    phi = np.full((9, 9, 9), 1e-7)
    phi[3:6, 2:4, 4:9] = 0.8
    field = start(Field(phi=phi))
    np.testing.assert_array_equal(field.origin, (3, 2, 4))
    np.testing.assert_allclose(field.phi, np.full((3, 2, 5), 0.8))


@pytest.mark.parametrize("spacing", [0.5, 0.4, (0.3, 0.5, 0.6)])
def test_field_off_the_lattice_is_interpolated(spacing: ArrayLike) -> None:
    steps = np.broadcast_to(spacing, 3)
    origin = CENTER - 8.17
    points = open_grid(origin, steps, np.ceil(16.34 / steps).astype(int))
    phi = profile(Sphere(center=CENTER, radius=4).depth(*points), 1.0)
    shape = Field(phi=phi, origin=origin, spacing=spacing)
    field = start(shape)
    assert shape.volume == pytest.approx(phi.sum() * np.prod(steps))
    assert volume(field) == pytest.approx(shape.volume, rel=2e-3)
    np.testing.assert_allclose(centroid(field, H), CENTER, atol=5e-3)
    grid = open_grid(field.origin * H, [H] * 3, field.phi.shape)
    np.testing.assert_allclose(
        field.phi, profile(Sphere(center=CENTER, radius=4).depth(*grid), 1.0), atol=0.06
    )


def test_field_is_zero_beyond_its_values() -> None:
    shape = Field(phi=np.ones((4, 4, 4)))
    x = np.array([-9.0, -0.6, -0.25, 0.0, 1.5, 1.75, 2.1, 3.9])
    values = shape.values(x, np.full(8, 0.5), np.full(8, 0.5))
    np.testing.assert_allclose(values, [0, 0, 0.5, 1, 1, 0.5, 0, 0])


# --- confinements ------------------------------------------------------------------------------

A = 28.2846
EGGSHELL = EllipsoidShell(
    center=(30, 20, 15), semi_axes=(A, 0.665 * A, 0.455 * A), cut=(np.inf, np.inf, 0.361 * A)
)


def along(confinement: object, axis: int, values: ArrayLike, center: ArrayLike) -> list[NDArray]:
    """Points on a line through the centre, as arguments of a confinement."""
    points = np.tile(np.asarray(center, float), (len(np.atleast_1d(values)), 1))
    points[:, axis] += values
    return list(points.T)


@pytest.mark.parametrize(("axis", "half"), [(0, A), (1, 0.665 * A), (2, 0.361 * A)])
def test_eggshell_ends_at_its_axes_and_its_cut(axis: int, half: float) -> None:
    offsets = np.array([-half - 0.01, -half + 0.01, 0, half - 0.01, half + 0.01])
    points = along(EGGSHELL, axis, offsets, EGGSHELL.center)
    np.testing.assert_array_equal(EGGSHELL.field(*points), [1, 0, 0, 0, 1])
    assert (EGGSHELL.depth(*points) > 0).tolist() == [False, True, True, True, False]
    low, high = EGGSHELL.bounds()
    assert (high - low)[axis] == pytest.approx(2 * half)
    assert (high + low)[axis] == pytest.approx(2 * EGGSHELL.center[axis])


def test_eggshell_holds_the_volume_of_a_cut_ellipsoid() -> None:
    a, b, c = EGGSHELL.semi_axes
    cut = 0.361 * A
    low, high = EGGSHELL.bounds()
    n = 80
    points = open_grid(low + (high - low) / (2 * n), (high - low) / n, (n, n, n))
    inside = float((1 - EGGSHELL.field(*points)).mean() * np.prod(high - low))
    assert inside == pytest.approx(2 * np.pi * a * b * (cut - cut**3 / (3 * c**2)), rel=5e-3)


def test_width_makes_the_wall_a_tanh() -> None:
    shell = EllipsoidShell(center=(0, 0, 0), semi_axes=(9, 9, 9), width=0.7)
    box = BoxWalls(lower=(-9, -50, -50), upper=(9, 50, 50), width=0.7)
    x = np.linspace(5, 13, 33)
    for walls in (shell, box):
        found = walls.field(x, 0 * x, 0 * x)
        np.testing.assert_allclose(found, 0.5 * (1 + np.tanh((x - 9) / 0.7)), atol=1e-12)


def test_box_walls() -> None:
    box = BoxWalls(lower=(-1, -2, -3), upper=(4, 5, 6))
    points = np.array([[0, 0, 0], [3, 0, 0], [0, 4.5, 0], [0, 0, 6], [7, 0, 0], [0, -2.5, 0]]).T
    np.testing.assert_allclose(box.depth(*points), [1, 1, 0.5, 0, -3, -0.5])
    np.testing.assert_array_equal(box.field(*points), [0, 0, 0, 1, 1, 1])
    np.testing.assert_array_equal(box.bounds(), [(-1, -2, -3), (4, 5, 6)])


def test_mask_walls_are_their_voxels() -> None:
    inside = np.zeros((5, 6, 7))
    inside[0:4, 2:6, 3:6] = 1
    walls = MaskWalls(inside=inside, origin=(10, 0, -5), spacing=(1, 2, 0.5))
    points = open_grid((10, 0, -5), (1, 2, 0.5), (5, 6, 7))
    np.testing.assert_array_equal(walls.field(*points), 1 - inside)
    np.testing.assert_array_equal(walls.depth(*points) > 0, inside > 0)
    shifted = [p + 0.24 * h for p, h in zip(points, (1, 2, 0.5), strict=True)]
    np.testing.assert_array_equal(walls.field(*shifted), 1 - inside)
    np.testing.assert_allclose(walls.bounds(), [(9.5, 3, -3.75), (13.5, 11, -2.25)])
    assert walls.field(np.array([99.0]), np.zeros(1), np.zeros(1)) == 1  # beyond the image


@pytest.mark.parametrize("kind", ["mask", "function"])
def test_depth_of_other_walls_is_a_distance(kind: str) -> None:
    ball = Sphere(center=CENTER, radius=8)
    if kind == "mask":
        mask, origin = ball_mask(8.0, np.full(3, H))
        walls: MaskWalls | FunctionWalls = MaskWalls(inside=mask, origin=origin, spacing=H)
    else:
        walls = FunctionWalls(
            function=lambda x, y, z: (ball.depth(x, y, z) < 0) * 1.0,
            lower=CENTER - 9,
            upper=CENTER + 9,
        )
    points = (CENTER + DIRECTIONS * np.linspace(0.5, 12, 200)[:, None]).T
    np.testing.assert_allclose(walls.depth(*points), ball.depth(*points), atol=0.5)


def test_function_walls_are_their_function() -> None:
    walls = FunctionWalls(
        function=lambda x, y, z: np.clip((x + y) / 10, 0, 1), lower=(-9, -8, -7), upper=(9, 8, 7)
    )
    points = open_grid((-2, -2, -2), (1, 1, 1), (5, 5, 5))
    found = walls.field(*points)
    assert found.shape == (5, 5, 5)  # also where the function does not depend on z
    np.testing.assert_allclose(found[..., 0], np.clip((points[0] + points[1])[..., 0] / 10, 0, 1))
    np.testing.assert_array_equal(walls.bounds(), [(-9, -8, -7), (9, 8, 7)])
