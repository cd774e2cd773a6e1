"""Adhesion to walls: contact angles by the balance of tensions; types, files, runs, errors."""

from pathlib import Path

import contact_angle
import numpy as np
import pytest

from morphosim import (
    BoxWalls,
    Cell,
    EllipsoidShell,
    FunctionWalls,
    Numerics,
    Physics,
    RunWriter,
    Scene,
    Simulation,
    Sphere,
    StabilityWarning,
    WallAdhesion,
    load_scene,
    save_scene,
)
from morphosim.scene.fingerprint import settings
from morphosim.scene.stability import check, explicit_rates

COARSE = pytest.mark.filterwarnings("ignore::morphosim.errors.ResolutionWarning")
"""For cells that go far along a wall at h = 0.5 µm."""


def scene(adhesion: WallAdhesion, radius: float = 3.0, walls: object = None) -> Scene:
    """Cells of types a and b on a plane."""
    cells = [
        Cell(name=kind, type=kind, shape=Sphere(center=(20 * k, 0, radius), radius=radius))
        for k, kind in enumerate("ab")
    ]
    box = BoxWalls(lower=(-20, -20, 0), upper=(40, 20, 40))
    return Scene(
        cells=cells, physics=Physics(terms=[adhesion]), confinement=walls or box,
        numerics=Numerics.preset("fast", threads=1), duration=40.0, save_every=20.0,
    )  # fmt: skip


@COARSE
def test_contact_angles_are_those_of_the_balance_of_tensions() -> None:
    expected = contact_angle.balanced_angle(0.8)
    assert 115 < expected < 125
    np.testing.assert_allclose(contact_angle.angle_of_a_large_cell(0.8), expected, atol=1.0)


def test_the_balance_of_tensions_in_its_limits() -> None:
    """No adhesion: a ball; strong adhesion: half of one. Both are known without a calculation."""
    np.testing.assert_allclose(contact_angle.balanced_angle(0.0), 180, atol=1.0)
    np.testing.assert_allclose(contact_angle.balanced_angle(4.0), 90, atol=0.5)


@COARSE
def test_only_cells_of_a_type_spread() -> None:
    simulation = Simulation(scene(WallAdhesion(sigma_by_type={"a": 1.5})))
    simulation.run(until=400)
    wet, dry = ((field.phi.sum(axis=(0, 1)) > 0.5).sum() for field in simulation.fields)
    (low, high) = simulation.centroids[:, 2]
    assert wet < dry
    assert low < high - 0.7


@pytest.mark.parametrize(
    "walls",
    [
        EllipsoidShell(center=(0, 0, 0), semi_axes=(6, 6, 6)),
        EllipsoidShell(center=(0, 0, 0), semi_axes=(6, 6, 6), width=0.7),
        FunctionWalls(
            function=lambda x, y, z: x**2 + y**2 + z**2 > 36, lower=(-7, -7, -7), upper=(7, 7, 7)
        ),
    ],
    ids=["hard", "soft", "function"],
)
def test_a_cell_is_drawn_to_any_wall(walls: object) -> None:
    """In a hollow ball: from beside its middle it moves to the wall, as fast by any of them."""
    cell = Cell(name="a", shape=Sphere(center=(2.0, 0, 0), radius=3))
    numerics = Numerics.preset("fast", threads=1)
    physics = Physics(terms=[WallAdhesion(sigma=1.0)])
    simulation = Simulation(
        Scene(cells=[cell], physics=physics, confinement=walls, numerics=numerics)
    )
    simulation.run(until=60)
    x, y, z = simulation.centroids[0]
    assert 2.3 < x < 3.5
    np.testing.assert_allclose([y, z], 0, atol=0.02)


def test_a_file_says_it_and_a_run_goes_on_bit_for_bit(tmp_path: Path) -> None:
    made = scene(WallAdhesion(sigma=0.5, sigma_by_type={"b": 0.2}))
    save_scene(made, tmp_path / "s.toml")
    read = load_scene(tmp_path / "s.toml")
    assert settings(read) == settings(made)
    assert 'kind = "wall_adhesion"' in (tmp_path / "s.toml").read_text(encoding="utf-8")
    whole, part = Simulation(read), Simulation(read)
    whole.run(observers=[RunWriter(tmp_path / "whole", 20.0)])  # with a step that ends there
    part.run(until=20, observers=[RunWriter(tmp_path / "run", 20.0)])
    resumed = Simulation.from_run(tmp_path / "run")
    resumed.run(observers=[RunWriter(tmp_path / "run", 20.0, resume=True)])
    for a, b in zip(resumed.fields, whole.fields, strict=True):
        np.testing.assert_array_equal(a.phi, b.phi)


def test_what_is_wrong_is_told() -> None:
    with pytest.raises(ValueError, match=r"wall_adhesion.sigma = -1 is not allowed"):
        WallAdhesion(sigma=-1)
    with pytest.raises(ValueError, match=r"type in wall_adhesion.sigma_by_type = 'x'"):
        scene(WallAdhesion(sigma_by_type={"x": 1}))
    cell = Cell(name="a", shape=Sphere(center=(0, 0, 0), radius=3))
    free = Scene(cells=[cell], physics=Physics(terms=[WallAdhesion(sigma=1)]))
    with pytest.raises(ValueError, match="no walls to adhere to"):
        Simulation(free)


def test_walls_that_tear_cells_apart_are_told() -> None:
    with pytest.warns(StabilityWarning, match=r"wall_adhesion.sigma = 5 is more than 11 times"):
        check(scene(WallAdhesion(sigma=5)))
    assert explicit_rates(scene(WallAdhesion(sigma=2)))["wall adhesion"] == 2
