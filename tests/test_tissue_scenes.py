"""Tissues that start with many cells: populations in scene files, and the scenes made of them."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial import cKDTree

from morphosim import (
    Aggregate,
    ColumnarLayer,
    EllipsoidShell,
    Polyhedron,
    Simulation,
    built_in_scene,
    load_scene,
    save_scene,
)
from morphosim.geometry.phase_field import lattice_field
from morphosim.scene.columnar_layer import even_points

LAYER = EllipsoidShell(center=(1, 2, 3), semi_axes=(60, 40, 40), core=(45, 25, 25))


def centers(cells: list) -> np.ndarray:
    return np.array([cell.shape.center for cell in cells])


def test_an_aggregate_is_a_ball_of_mixed_cells_that_do_not_overlap() -> None:
    cells = Aggregate(counts={"A": 150, "B": 50}, radius=4.0, center=(5, 0, -5)).cells(None, 1)
    places, kinds = centers(cells), np.array([cell.type for cell in cells])
    assert [cells[0].name, cells[150].name] == ["A1", "B1"]
    assert cKDTree(places).query(places, k=2)[0][:, 1].min() >= 8 - 1e-6
    away = np.linalg.norm(places - (5, 0, -5), axis=1)
    radius = 4 * (200 / 0.5) ** (1 / 3)
    assert 0.8 * radius < away.max() < 1.1 * radius
    assert away[kinds == "A"].mean() == pytest.approx(away[kinds == "B"].mean(), rel=0.1)
    pairs = cKDTree(places).query_pairs(10.0, output_type="ndarray")
    unlike = (kinds[pairs[:, 0]] != kinds[pairs[:, 1]]).mean()
    assert unlike == pytest.approx(2 * 0.75 * 0.25, abs=0.08)


def test_a_population_has_the_seed_of_the_numerics_or_its_own() -> None:
    def places(**overrides: Any) -> np.ndarray:
        said = {"cells.counts": {"A": 4, "B": 5}} | {k.replace("_", "."): v
                                                     for k, v in overrides.items()}  # fmt: skip
        return centers(list(built_in_scene("sorting", said).cells))

    assert not np.allclose(places(), places(numerics_seed=1))
    np.testing.assert_array_equal(places(numerics_seed=1), places(cells_seed=1))
    np.testing.assert_array_equal(places(cells_seed=1), places(cells_seed=1, numerics_seed=7))


def test_points_are_spread_evenly_over_an_ellipsoid() -> None:
    axes = np.array([60.0, 40.0, 30.0])
    points = even_points(axes, 400, np.random.default_rng(0))
    np.testing.assert_allclose(np.linalg.norm(points / axes, axis=1), 1)
    nearest = cKDTree(points).query(points, k=2)[0][:, 1]
    area = 4 * np.pi * (((60 * 40) ** 1.6 + (60 * 30) ** 1.6 + (40 * 30) ** 1.6) / 3) ** (1 / 1.6)
    hexagonal = np.sqrt(2 / np.sqrt(3) * area / 400)
    assert nearest.min() > 0.6 * hexagonal  # at random the least of 400 is some 0.03 of it
    assert nearest.mean() == pytest.approx(0.87 * hexagonal, rel=0.06)


def test_columns_share_out_the_layer_between_shell_and_core() -> None:
    cells = ColumnarLayer(count=150, filling=0.9, type="epithelium").cells(LAYER, 0)
    assert (cells[0].name, cells[-1].name, cells[0].type) == ("c1", "c150", "epithelium")
    layer = 4 / 3 * np.pi * (60 * 40 * 40 - 45 * 25 * 25)
    assert sum(cell.shape.volume for cell in cells) == pytest.approx(layer, rel=0.05)
    assert all(c.volume == pytest.approx(0.9 * c.shape.volume) for c in cells)
    middles = np.array([np.mean(cell.shape.vertices, axis=0) for cell in cells])
    assert (LAYER.depth(*middles.T) > 3).all()
    # At random points between the walls, one column and no more is the deepest.
    points = np.random.default_rng(0).uniform((-59, -38, -37), (61, 42, 43), (4000, 3))
    points = points[LAYER.depth(*points.T) > 2]
    depths = np.array([cell.shape.depth(*points.T) for cell in cells])
    assert ((depths > 0).sum(axis=0) == 1).mean() > 0.99


def test_a_core_walls_off_its_inside() -> None:
    x, y, z = np.array([[1, 2, 3], [1, 30, 3], [1, 34.5, 3], [55, 2, 3], [1, 43, 3.0]]).T
    np.testing.assert_array_equal(LAYER.field(x, y, z), [1, 0, 0, 0, 1])
    assert EllipsoidShell(center=(0, 0, 0), semi_axes=(3, 2, 2)).depth(*np.zeros((3, 1))) == 3
    with pytest.raises(
        ValueError, match=r"confinement.core = .*: expected semi-axes > 0 that leav"
    ):
        EllipsoidShell(center=(0, 0, 0), semi_axes=(3, 2, 2), core=(2, 2, 1))


def test_a_polyhedron_is_the_hull_of_its_corners() -> None:
    corners = np.array([[x, y, z] for x in (0, 6) for y in (0, 8) for z in (0, 10)], float)
    block = Polyhedron(vertices=[*corners, (3, 4, 5)])
    assert block.volume == pytest.approx(480)
    x, y, z = np.array([[3, 4, 5], [1, 4, 5], [3, 4, 12.0]]).T
    np.testing.assert_allclose(block.depth(x, y, z), [3, 1, -2], atol=1e-12)
    _, phi = lattice_field(block, "a", 1.0, 0.5)
    assert phi.sum() * 0.5**3 == pytest.approx(480, rel=1e-3)


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({"kind": "columns", "count": 40}, "cells: a columnar layer lies between an ellipsoid and"),
        ({"kind": "columns", "count": 3}, "cells.count = 3 is not allowed"),
        ({"kind": "rows", "count": 3}, "cells.kind = 'rows'"),
        ({"kind": "aggregate", "counts": {"A": 0}, "radius": 4}, "sum of cells.counts = 0"),
        ({"kind": "aggregate", "counts": {"A": 9}, "radius": -1}, "cells.radius = -1"),
        ({"kind": "aggregate", "counts": {"A": 9}, "radius": 4, "filling": 0.9}, "cells.filling"),
        ({"kind": "aggregate", "radius": 4}, "counts"),
        ({"counts": {"A": 9}}, "expected a table with a kind out of"),
        ({"use": "morphosim:Sphere", "center": [0, 0, 0], "radius": 3}, "has no method cells"),
        ([], "scene.cells is empty"),
    ],
)
def test_a_population_that_cannot_be_is_told(table: Any, words: str, tmp_path: Path) -> None:
    file = tmp_path / "scene.toml"
    file.write_text("", encoding="utf-8")
    with pytest.raises((TypeError, ValueError), match=words):
        load_scene(file, {"cells": table})


def test_a_scene_with_a_population_is_saved_with_its_cells(tmp_path: Path) -> None:
    scene = built_in_scene("blastoderm", {"cells.count": 40, "cells.seed": 3})
    save_scene(scene, tmp_path / "scene.toml")
    again = load_scene(tmp_path / "scene.toml")
    assert again.names == scene.names
    for old, new in zip(scene.cells, again.cells, strict=True):
        assert new.volume == old.volume
        np.testing.assert_array_equal(new.shape.vertices, old.shape.vertices)


def test_the_blastoderm_has_the_size_of_the_egg() -> None:
    scene = built_in_scene("blastoderm")
    volumes = np.array([cell.volume for cell in scene.cells])
    assert len(scene.cells) == 6000
    assert volumes.std() < 0.15 * volumes.mean()
    walls = scene.confinement
    assert isinstance(walls, EllipsoidShell)
    assert np.asarray(walls.semi_axes).tolist() == [250, 90, 90]


def test_columns_stay_between_the_walls() -> None:
    walls = {"kind": "ellipsoid", "center": [0, 0, 0], "semi_axes": [24, 20, 20],
             "core": [14, 10, 10]}  # fmt: skip
    scene = built_in_scene("blastoderm", {"cells.count": 60, "confinement": walls})
    simulation = Simulation(scene)
    simulation.run(until=20)
    assert len(simulation.names) == 60
    np.testing.assert_allclose(simulation.volumes, simulation.targets, rtol=0.1)
    walls_at = scene.confinement.depth(*simulation.centroids.T)
    assert (walls_at > 3).all()


def test_cells_that_sort_begin_mixed_and_prefer_their_own_type() -> None:
    scene = built_in_scene("sorting")
    kinds = np.array(scene.types)
    pairs = cKDTree(centers(list(scene.cells))).query_pairs(10.0, output_type="ndarray")
    assert (kinds[pairs[:, 0]] != kinds[pairs[:, 1]]).mean() == pytest.approx(0.5, abs=0.03)
    sigma = scene.physics.sigma.types
    assert sigma["A", "A"] > sigma["B", "B"] > sigma["A", "B"]
    assert scene.physics.kappa > 0  # without noise cells do not change their places
