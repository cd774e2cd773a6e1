"""Surfaces by marching tetrahedra, against plain geometry."""

import numpy as np
import pytest

from morphosim.kernels.sharing import shares_of
from morphosim.kernels.surfaces import corners, cut_cube, surfaces

from .example_boxes import both_precisions, both_ways, put, taken
from .example_fields import (
    FAINT,
    LEVEL,
    SHAPES,
    make_work,
    pieces,
    random_fields,
    triangles,
    with_extents,
)

SHARES = shares_of([0, 1, 1, 4], threads=3)


@both_ways
@pytest.mark.parametrize("whole", [True, False])
@both_precisions
def test_area_and_volume(way: str, dtype: type, whole: bool) -> None:
    fields = with_extents(random_fields(1, dtype, whole))
    found = np.full((len(SHAPES), 2), 1e30)
    taken(surfaces, way)(SHARES, fields, LEVEL, make_work(fields, threads=3), found)
    for i in range(3):
        expected = list(pieces(fields, i, LEVEL))
        area, volume = sum(p.area for p in expected), sum(p.volume for p in expected)
        assert area > 50
        np.testing.assert_allclose(found[i], [area, volume], rtol=1e-10)
    assert (found[FAINT] == 0).all()


@both_ways
def test_the_surface_of_a_cell_that_fills_a_part_of_its_box(way: str) -> None:
    """What is held beyond the extent is not in the way."""
    fields, rng = random_fields(1, whole=True), np.random.default_rng(2)
    for i in range(3):
        values = rng.uniform(-0.1, 0.1, SHAPES[i])
        values[1:-1, 1:-1, 2:] = rng.uniform(0.2, 1, values[1:-1, 1:-1, 2:].shape)
        put(fields.phi, fields, i, values)
    with_extents(fields)
    assert (fields.extent[:3, 2, 0] == 2).all()
    found = np.full((len(SHAPES), 2), 1e30)
    taken(surfaces, way)(SHARES, fields, LEVEL, make_work(fields, threads=3), found)
    for i in range(3):
        expected = list(pieces(fields, i, LEVEL))
        area, volume = sum(p.area for p in expected), sum(p.volume for p in expected)
        np.testing.assert_allclose(found[i], [area, volume], rtol=1e-10)


@both_ways
def test_centre_of_the_surface_in_a_cube(way: str) -> None:
    rng = np.random.default_rng(4)
    for _ in range(30):
        values = rng.random((2, 2, 2))
        values[0, 0, 0], values[1, 0, 1] = 0, 1
        a, b, c = np.moveaxis(np.array(list(triangles(values, LEVEL))), 1, 0)
        areas = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
        area, _, *moment = taken(cut_cube, way)(tuple(values.ravel()), LEVEL)
        assert area == pytest.approx(areas.sum())
        np.testing.assert_allclose(moment, areas @ (a + b + c) / 3, rtol=1e-10)


@both_ways
@pytest.mark.parametrize(
    ("slope", "level"), [((1, 0, 0), 0.5), ((0.3, 1, 0.1), 0.6), ((1, 1, 1), 1.5), ((2, -1, 3), 3)]
)
def test_a_plane_is_cut_exactly(slope: tuple, level: float, way: str) -> None:
    """φ is linear in the cube: what lies above, and in a thin layer, as random points find it."""
    values = np.tensordot(slope, np.indices((2, 2, 2)), 1).astype(float)
    area, volume, *moment = taken(cut_cube, way)(tuple(values.ravel()), level)
    points = np.random.default_rng(0).random((400_000, 3))
    phi, steepness = points @ slope, np.linalg.norm(slope)
    layer = np.abs(phi - level) < 0.05 * steepness
    assert volume == pytest.approx((phi > level).mean(), abs=0.003)
    assert area == pytest.approx(layer.mean() / 0.1, rel=0.02)
    np.testing.assert_allclose(np.array(moment) / area, points[layer].mean(axis=0), atol=0.01)


@both_ways
def test_values_equal_to_the_level_are_outside(way: str) -> None:
    """Without a division by zero where the surface goes through corners."""
    cube = np.full(8, LEVEL)
    assert taken(cut_cube, way)(tuple(cube), LEVEL) == (0, 0, 0, 0, 0)
    cube[0] = 1
    found = taken(cut_cube, way)(tuple(cube), LEVEL)
    np.testing.assert_allclose(found, (3, 1, 2, 2, 2), err_msg="not the three far faces")


@both_ways
def test_corners_are_numbered_z_first(way: str) -> None:
    values = np.arange(60.0)
    assert taken(corners, way)(values, 7, 20, 5) == (7, 8, 12, 13, 27, 28, 32, 33)
