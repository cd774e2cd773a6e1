"""Viscosity τ by cell type: with all terms and schemes as τ of all; files, runs, errors, rates.

Steps are taken in plain Python, on a coarse lattice: no kernel is compiled for it.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from morphosim import (
    BoxWalls,
    Cell,
    Chemotaxis,
    Flow,
    Gravity,
    Numerics,
    Physics,
    RunWriter,
    Scene,
    Simulation,
    Sphere,
    load_scene,
    save_scene,
)
from morphosim.scene.fingerprint import settings
from morphosim.scene.stability import explicit_rate, largest_euler_step
from morphosim.simulation import warming
from morphosim.simulation.kernel_calls import recorded

from .own_terms import Lean

TAU = 2.62
COARSE = Numerics(
    threads=1, dt=0.5, S=3.0, spacing=1.0, allow_coarse=True, precision="double", box_tolerance=1e-2
)
pytestmark = pytest.mark.filterwarnings(
    "ignore::morphosim.scene.stability.StabilityWarning",
    "ignore::morphosim.errors.ResolutionWarning",
)


def scene(numerics: Numerics, types: str = "bb", apart: float = 4.6, **tau: Any) -> Scene:
    """Two cells that adhere to each other and are pressed to walls, with terms of all kinds."""
    cells = [
        Cell(name=f"c{k}", type=kind, shape=Sphere(center=(apart * k, 0, 0), radius=2.4))
        for k, kind in enumerate(types)
    ]
    terms = [
        Gravity(weight=0.05), Flow(velocity=(0.01, 0, 0)), Lean(),
        Chemotaxis(sensitivity=0.1, gradient=(0, 0.1, 0), level=5),
    ]  # fmt: skip
    walls = BoxWalls(lower=(-3, -2, -3), upper=(apart + 3, 3, 3), width=0.5)
    physics = Physics(sigma=0.3, kappa=0.02, terms=terms, **tau)
    return Scene(cells=cells, physics=physics, numerics=numerics, confinement=walls)


def fields(made: Scene, steps: int = 3) -> list[NDArray]:
    """Fields after some steps in plain Python."""
    with warming.not_ahead(), recorded():
        simulation = Simulation(made)
        simulation.step(steps)
    return [field.phi for field in simulation.fields]


SCHEMES = {
    "band": replace(COARSE, solver="band"),
    "dct": replace(COARSE, solver="dct"),
    "euler": replace(COARSE, scheme="euler", solver="band", dt=0.1),
    "linearised": replace(COARSE, scheme="linearised"),
}


@pytest.mark.parametrize("scheme", SCHEMES)
def test_a_types_viscosity_acts_as_that_of_all(scheme: str) -> None:
    """S is in the unit of τ, and is that of the τ by which the scheme goes."""
    numerics = SCHEMES[scheme]
    doubled = replace(numerics, S=6.0)
    by_type = fields(scene(numerics, tau=TAU, tau_by_type={"b": 2 * TAU}))
    alike, other = fields(scene(doubled, tau=2 * TAU)), fields(scene(numerics, tau=TAU))
    for a, b, c in zip(by_type, alike, other, strict=True):
        np.testing.assert_allclose(a, b, atol=1e-12)
        assert a.shape != c.shape or np.abs(a - c).max() > 1e-3


def test_each_type_has_its_own() -> None:
    numerics = SCHEMES["dct"]
    a, b = fields(scene(numerics, "ab", 20.0, tau=TAU, tau_by_type={"b": 2 * TAU}))
    expected_a, _ = fields(scene(numerics, "ab", 20.0, tau=TAU))
    _, expected_b = fields(scene(replace(numerics, S=6.0), "ab", 20.0, tau=2 * TAU))
    np.testing.assert_allclose(a, expected_a, atol=1e-12)
    np.testing.assert_allclose(b, expected_b, atol=1e-12)
    assert b.shape != a.shape or np.abs(a - b).max() > 1e-3


def test_files_say_it_and_wrong_values_are_told(tmp_path: Path) -> None:
    made = scene(COARSE, tau_by_type={"b": 5.0})
    save_scene(made, tmp_path / "s.toml")
    assert settings(load_scene(tmp_path / "s.toml")) == settings(made)
    assert load_scene(tmp_path / "s.toml").physics.tau_by_type == {"b": 5.0}
    save_scene(scene(COARSE), tmp_path / "plain.toml")
    assert "tau_by_type" not in (tmp_path / "plain.toml").read_text(encoding="utf-8")
    with pytest.raises(ValueError, match=r"physics.tau_by_type\['b'\] = 0 is not allowed"):
        Physics(tau_by_type={"b": 0})
    with pytest.raises(ValueError, match=r"type in physics.tau_by_type = 'x'"):
        scene(COARSE, tau_by_type={"x": 1.0})


def test_a_run_goes_on_bit_for_bit(tmp_path: Path) -> None:
    made = replace(scene(SCHEMES["band"], "ab", tau_by_type={"b": 5.0}), duration=1.5)
    with warming.not_ahead(), recorded():
        whole, part = Simulation(made), Simulation(made)
        whole.run()
        part.run(until=0.5, observers=[RunWriter(tmp_path / "run", 0.5)])
        resumed = Simulation.from_run(tmp_path / "run")
        resumed.run()
    for a, b in zip(resumed.fields, whole.fields, strict=True):
        np.testing.assert_array_equal(a.phi, b.phi)


def test_stability_knows_the_least_viscosity() -> None:
    """Rates count as of cells with `tau`, which S and δt refer to."""
    usual, thin, thick = (
        scene(replace(COARSE, S=None), tau_by_type=by_type)
        for by_type in ({}, {"b": TAU / 2}, {"b": 2 * TAU})
    )
    for made, factor in ((thin, 2), (thick, 0.5)):
        np.testing.assert_allclose(explicit_rate(made), factor * explicit_rate(usual), rtol=1e-3)
        euler = [replace(each, numerics=SCHEMES["euler"]) for each in (usual, made)]
        steps = [largest_euler_step(each) for each in euler]
        np.testing.assert_allclose(steps[0], factor * steps[1], rtol=1e-3)
