"""Gravity, centrifuge, flow and chemotaxis: velocities by theory; files, runs, errors, warnings."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

from morphosim import (
    BoxWalls,
    Cell,
    Centrifuge,
    Chemotaxis,
    Flow,
    Gravity,
    Numerics,
    Physics,
    RunWriter,
    Scene,
    Simulation,
    Sphere,
    Term,
    load_scene,
    save_scene,
)
from morphosim.scene.fingerprint import settings
from morphosim.scene.stability import concerns

TAU = Physics().tau
PLACES = np.indices((41, 5, 41)).astype(float)
RAMP = 0.1 * PLACES[0] + 0.05 * PLACES[2]
"""A concentration that rises by 0.1 per µm along x and 0.05 along z, from (-20, -2, -20)."""


def bowl(x: Any, y: Any, z: Any) -> Any:
    """A concentration, largest at the origin."""
    return 100 - 0.01 * (x**2 + y**2 + z**2)


def scene(*terms: Term, types: Sequence[str] = ("",), **options: Any) -> Scene:
    """Cells far apart along y; those of single precision are off by 10⁻⁴."""
    cells = [
        Cell(name=f"c{k}", type=kind, shape=Sphere(center=(0, 16 * k, 0), radius=4))
        for k, kind in enumerate(types)
    ]
    numerics = Numerics(threads=1, solver="band", dt=0.5)
    values = {"cells": cells, "physics": Physics(terms=terms), "numerics": numerics}
    return Scene(**(values | options))


def velocities(made: Scene) -> NDArray[np.float64]:
    """(N, 3) when they have built up, times τ."""
    simulation = Simulation(made)
    simulation.run(until=15)
    before = simulation.centroids
    simulation.run(until=35)
    return (simulation.centroids - before) / 20 * TAU


@pytest.mark.parametrize(
    ("terms", "expected"),
    [
        ([Gravity(weight=0.1)], [0, 0, -0.1]),
        ([Gravity(weight=0.1, direction=(3, 0, 4))], [0.06, 0, 0.08]),
        ([Flow(velocity=(0.02, -0.01, 0))], [0.02 * TAU, -0.01 * TAU, 0]),
        ([Chemotaxis(sensitivity=0.5, gradient=(0.1, 0, 0.1))], [0.05, 0, 0.05]),
        (
            [Gravity(weight=0.1), Gravity(weight=0.05, direction=(1, 0, 0))],
            [0.05, 0, -0.1],
        ),
    ],
)
def test_a_cell_moves_with_its_force_over_its_viscosity(
    terms: list[Term], expected: ArrayLike
) -> None:
    found = velocities(scene(*terms))
    np.testing.assert_allclose(found, [expected], rtol=1e-3, atol=1e-4)


def test_types_feel_what_is_theirs() -> None:
    """Two potentials of other strengths for three types, one of which feels neither."""
    terms = [
        Chemotaxis(
            sensitivity=0.5, sensitivity_by_type={"b": -0.25, "c": 0}, values=RAMP,
            origin=(-20, -2, -20),
        ),
        Chemotaxis(sensitivity=0, sensitivity_by_type={"b": 0.4}, gradient=(0, 0, 0.1), level=9),
        Gravity(weight_by_type={"a": 0.03}),
    ]  # fmt: skip
    found = velocities(scene(*terms, types="abc"))
    expected = [[0.05, 0, 0.025 - 0.03], [-0.025, 0, -0.0125 + 0.04], [0, 0, 0]]
    np.testing.assert_allclose(found, expected, rtol=2e-3, atol=2e-4)


def test_receptors_saturate() -> None:
    """At C = K the slope of C / (1 + C/K) is a quarter of that of C."""
    linear = Chemotaxis(sensitivity=0.5, gradient=(0.1, 0, 0), level=10)
    full = Chemotaxis(sensitivity=0.5, gradient=(0.1, 0, 0), level=10, saturation=10)
    assert full.signal(0, 0, 0) == 5
    ((x, _, _),) = velocities(scene(full))
    assert 0.0125 > x > 0.95 * 0.0125  # less as it climbs
    np.testing.assert_array_equal(linear.signal(np.array([-200.0, 0, 10]), 0, 0), [0, 10, 11])


def test_a_centrifuge_drives_cells_out_exponentially() -> None:
    """By exp(k t/τ), from the axis through (0, -10, 0) along z."""
    simulation = Simulation(scene(Centrifuge(strength=0.02, center=(0, -10, 7))))
    simulation.run(until=40)
    x, y, z = simulation.centroids[0]
    np.testing.assert_allclose(y + 10, 10 * np.exp(0.02 * 40 / TAU), rtol=5e-3)
    np.testing.assert_allclose([x, z], 0, atol=1e-3)


def test_a_function_of_space_is_climbed() -> None:
    cells = [Cell(name="a", shape=Sphere(center=(8, 0, 0), radius=4))]
    simulation = Simulation(scene(Chemotaxis(sensitivity=1.0, function=bowl), cells=cells))
    simulation.run(until=40)
    expected = 8 * np.exp(-0.02 * 40 / TAU)
    np.testing.assert_allclose(simulation.centroids[0], [expected, 0, 0], rtol=5e-3, atol=1e-3)


def everything() -> Scene:
    """Each term, its parameters not those by default."""
    terms = [
        Gravity(weight=0.02, weight_by_type={"a": -0.01}, direction=(0, 1, -1)),
        Centrifuge(strength=0.001, strength_by_type={"b": 0.002}, axis=(0, 1, 0), center=(1, 0, 0)),
        Flow(velocity=(0.01, 0, 0)),
        Chemotaxis(sensitivity=0.1, gradient=(0.1, 0, 0), saturation=5.0),
        Chemotaxis(sensitivity_by_type={"a": 0.1}, values=RAMP, origin=(-20, -2, -20)),
        Chemotaxis(sensitivity=0.1, function=bowl),
    ]
    return scene(*terms, types="abc", duration=12.0, save_every=4.0)


def test_files_say_them_and_a_run_goes_on_bit_for_bit(tmp_path: Path) -> None:
    save_scene(everything(), tmp_path / "s.toml")
    read = load_scene(tmp_path / "s.toml")
    assert settings(read) == settings(everything())
    assert 'kind = "chemotaxis"' in (tmp_path / "s.toml").read_text(encoding="utf-8")
    whole = Simulation(read)
    whole.run()
    part = Simulation(read)
    part.run(until=4, observers=[RunWriter(tmp_path / "run", 4.0)])
    resumed = Simulation.from_run(tmp_path / "run")
    resumed.run()
    two = Simulation(read.with_numerics(threads=2))
    two.run()
    for other in (resumed, two):
        for a, b in zip(other.fields, whole.fields, strict=True):
            np.testing.assert_array_equal(a.phi, b.phi)


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda: Gravity(weight=np.nan), "gravity.weight = nan is not allowed"),
        (lambda: Gravity(direction=(0, 0, 0)), "has no direction"),
        (lambda: Gravity(weight_by_type={"a": "x"}), r"gravity.weight_by_type\['a'\] = 'x'"),
        (lambda: Flow(velocity=(1, 2)), "flow.velocity"),
        (lambda: Centrifuge(axis=(0, 0, 0)), "centrifuge.axis"),
        (lambda: Chemotaxis(sensitivity=1), "expected exactly one"),
        (lambda: Chemotaxis(gradient=(1, 0, 0), values=RAMP), "gradient and values"),
        (lambda: Chemotaxis(gradient=(1, 0, 0), saturation=0), "chemotaxis.saturation = 0"),
        (lambda: Chemotaxis(gradient=(1, 0, 0), level=-1), "chemotaxis.level = -1"),
        (lambda: Chemotaxis(values=RAMP, level=1), "level = 1 is of a gradient"),
        (lambda: Chemotaxis(values=-RAMP), "values down to -6"),
        (lambda: Chemotaxis(values=RAMP[0]), "chemotaxis.values has shape"),
        (lambda: Chemotaxis(values=RAMP, spacing=0), "chemotaxis.spacing"),
        (lambda: Chemotaxis(function=len), "chemotaxis.function"),
        (lambda: scene(Gravity(weight_by_type={"x": 1})), "type in gravity.weight_by_type = 'x'"),
        (
            lambda: Simulation(scene(Chemotaxis(sensitivity=1, function=lambda x, y, z: x))).step(),
            "chemotaxis.function gives .* somewhere",
        ),
    ],
)  # fmt: skip
def test_what_is_wrong_is_told(make: Any, text: str) -> None:
    with pytest.raises((ValueError, TypeError), match=text):
        make()


@pytest.mark.parametrize(
    "term",
    [
        Gravity(weight_by_type={"a": -3.0}), Flow(velocity=(0, 1.2, 0)),
        Chemotaxis(sensitivity=30.0, gradient=(0.1, 0, 0)),
        Chemotaxis(sensitivity=30.0, values=RAMP), Centrifuge(strength=0.2),
        Chemotaxis(sensitivity=-3.0, function=lambda x, y, z: 100 - x),
    ],
    ids=lambda term: type(term).__name__,
)  # fmt: skip
def test_too_long_a_step_is_told_before_it_is_taken(term: Term) -> None:
    walls = BoxWalls(lower=(-20, -8, -8), upper=(20, 8, 8))
    slow, fast = (
        scene(term, types="a", confinement=walls).with_numerics(dt=dt) for dt in (0.02, 0.5)
    )
    (told,) = concerns(fast)
    assert "interface widths in a step of numerics.dt = 0.5" in told
    assert not concerns(slow)
    assert not concerns(fast.with_numerics(scheme="linearised", tolerance=20))
