"""Which volume a cell starts with: that of its target, or of its shape."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from morphosim import (
    Cell,
    Ellipsoid,
    EllipsoidShell,
    Field,
    Mask,
    Numerics,
    Physics,
    Scene,
    Simulation,
    Sphere,
    VolumeCourse,
    built_in_scene,
    packed_cells,
)
from morphosim.geometry.phase_field import lattice_field
from morphosim.scene.cell import NEAR

from .helpers import grid_around, on_grid
from .reference import full_grid as fg

BALL = 4 / 3 * np.pi * 4**3


def ball(x: float = 0.0, radius: float = 4.0, name: str = "a", **options: object) -> Cell:
    return Cell(name=name, shape=Sphere(center=(x, 0.1, 0.2), radius=radius), **options)


def pair() -> list[Cell]:
    """The cells of README."""
    return [ball(radius=5), ball(9.5, radius=4, name="b", volume=300.0)]


@pytest.mark.parametrize(
    "volume",
    [None, BALL, 300.0, 220.0, lambda t: 300 - t,
     VolumeCourse(times=[0, 50], volumes=[260, 520])],
)  # fmt: skip
def test_a_ball_starts_with_its_target_volume(volume: object) -> None:
    cell = ball(volume=volume)
    start = Simulation(Scene(cells=[cell]))
    assert start.volumes == pytest.approx(cell.target_volume(0), rel=5e-4)
    assert start.targets == cell.target_volume(0)


@pytest.mark.parametrize("volume", [BALL * (1 + NEAR) + 1, 400.0, BALL * (1 - NEAR) - 1, 100.0])
def test_a_ball_grows_or_shrinks_to_a_target_far_from_its_size(volume: float) -> None:
    assert Simulation(Scene(cells=[ball(volume=volume)])).volumes == pytest.approx(BALL, rel=5e-4)


SCENES: dict[str, Callable[[], Scene]] = {
    "ellipsoid": lambda: Scene(
        cells=[Cell(name="a", shape=Ellipsoid(center=(0, 0, 0), semi_axes=(7, 5, 4)), volume=550)]
    ),
    "small": lambda: Scene(cells=[ball(radius=2)], numerics=Numerics(S=8)),
    "coarse": lambda: Scene(cells=pair(), numerics=Numerics.preset("draft")),
    "wide interface": lambda: Scene(cells=pair(), physics=Physics(c=0.5)),
    "overlapping": lambda: Scene(cells=[ball(), ball(3, name="b")]),
    "frozen": lambda: Scene(cells=[ball(frozen=True), ball(9, name="b")]),
    "beyond walls": lambda: Scene(
        cells=[ball(5)],
        confinement=EllipsoidShell(center=(0, 0, 0), semi_axes=(8, 6, 6), cut=(np.inf, np.inf, 3)),
    ),
    "no constraint": lambda: Scene(cells=pair(), physics=Physics(volume_constraint="none")),
    "packed": lambda: Scene(cells=packed_cells({"A": 3, "B": 2}, 4, (0, 0, 0), (25, 25, 25))),
    "points": lambda: built_in_scene("celegans-8"),
    "mask": lambda: Scene(cells=[Cell(name="a", shape=Mask(mask=np.ones((9, 12, 15))))]),
}


@pytest.mark.parametrize("kind", list(SCENES))
def test_all_cells_start_with_their_target_volumes(kind: str) -> None:
    simulation = Simulation(SCENES[kind]())
    assert simulation.volumes == pytest.approx(simulation.targets, rel=1e-3)


def test_what_was_measured_stays_whatever_the_target_is() -> None:
    mask = Mask(mask=np.ones((9, 12, 15)))
    field = Field(phi=lattice_field(mask, "a", 1.0, 0.5)[1])
    for shape in (mask, field):
        cell = Cell(name="a", shape=shape, volume=1.1 * mask.volume)
        start = Simulation(Scene(cells=[cell]))
        assert start.volumes == pytest.approx(mask.volume, rel=1e-3)


def test_the_pair_of_the_readme_loses_only_what_its_surface_tension_presses_out() -> None:
    """v/V = 1 - p/M' with p = 2γ/R: 1.3 and 1.6 %, and no more on the way."""
    physics = Physics(sigma=0.5)
    simulation = Simulation(Scene(cells=pair(), physics=physics))
    pressed = 2 * physics.gamma / (np.array([4.8, 4.0]) * physics.volume_strength)
    least = np.ones(2)
    for _ in range(10):
        simulation.step()
        least = np.minimum(least, simulation.volumes / simulation.targets)
    assert least == pytest.approx(1 - pressed, abs=2e-3)
    assert simulation.volumes / simulation.targets == pytest.approx(1 - pressed, abs=1e-3)


def deviation(cells: list[Cell], steps: int) -> tuple[float, float]:
    """Largest difference of φ, and relative one of volumes, to the published scheme on the grid."""
    numerics = Numerics.preset("published", precision="double", threads=1)
    simulation = Simulation(Scene(cells=cells, physics=Physics(sigma=0.5), numerics=numerics))
    low, shape = grid_around(simulation.engine, margin=2)
    model = fg.Model(
        h=0.5,
        gamma=0.25,
        g=1.6,
        M=8.0,
        sigma=0.5 * np.ones((2, 2)),
        targets=simulation.targets,
        gradient=6,
    )
    found: list[np.ndarray] = []
    fg.run(
        on_grid(simulation.engine, low, shape), model, 2.0, numerics.S, "bdf2", n_steps=steps,
        on_step=lambda _, phi: found.append(phi),
    )  # fmt: skip
    simulation.step(steps)
    phi = np.abs(on_grid(simulation.engine, low, shape) - found[-1]).max()
    volume = np.abs(simulation.volumes / fg.volume(found[-1], 0.5) - 1).max()
    return float(phi), float(volume)


def test_the_error_against_the_full_grid_is_no_larger_than_from_balls_above_their_targets() -> None:
    targets = [cell.target_volume(0) for cell in pair()]
    above = [
        replace(cell, shape=Field(phi=phi, origin=0.5 * origin), volume=target)
        for cell, target, integral in zip(pair(), targets, (575.24, 309.39), strict=True)
        for origin, phi in [lattice_field(cell.shape, "a", 1.0, 0.5, integral)]
    ]
    phi, volume = deviation(pair(), 2)
    worse = deviation(above, 2)
    assert phi < worse[0] < 4e-4
    assert volume < worse[1] < 4e-5
