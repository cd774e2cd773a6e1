"""The band solver: against the full grid, against the cosine transforms, and at its limits."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from morphosim import Attraction, BoxWalls, Cell, Numerics, Physics, Scene, Simulation, Sphere
from morphosim.numerics.chebyshev import chebyshev_roots, largest_eigenvalue
from morphosim.numerics.schemes import coefficients

from .helpers import EXPECTED_TO_FAIL, advance, assert_band_alone
from .test_certificate import STRESSES, TOLERANCES, full_run, measured, start, targets
from .test_engine_against_reference import TERMS, TOGETHER, check


def pair(**numerics: Any) -> Scene:
    """Two adhering cells pressed into a box."""
    cells = [
        Cell(name=name, shape=Sphere(center=(x, 0.0, 0.0), radius=4.0))
        for name, x in (("left", 0.0), ("right", 8.3))
    ]
    walls = BoxWalls(lower=(-4.1, -3.6, -3.7), upper=(12.3, 3.8, 3.6))
    return Scene(
        cells=cells, physics=Physics(sigma=0.5), confinement=walls, numerics=Numerics(**numerics)
    )


def centroids(steps: int, **numerics: Any) -> np.ndarray:
    simulation = Simulation(pair(**({"threads": 1} | numerics)))
    simulation.step(steps)
    return simulation.centroids


# --- accuracy ------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["relative volume", "shell", "together"])  # each is compiled
def test_many_iterations_are_the_scheme_on_the_full_grid(name: str) -> None:
    """With the stencil's Laplacian; what is left is the band's cut at the box tolerance."""
    case = TOGETHER if name == "together" else TERMS[name]
    limits = replace(
        case.limits, first=max(4 * case.limits.first, 2e-5), tenth=max(4 * case.limits.tenth, 2e-4),
        centroid=max(3 * case.limits.centroid, 0.1), volume=3e-4,
    )  # fmt: skip
    numerics = case.numerics | {"solver": "band", "sweeps": 12, "laplacian": "stencil"}
    check(replace(case, numerics=numerics, limits=limits, without=()))


def test_two_iterations_are_within_a_nanometre_of_the_transforms() -> None:
    begin, exact = centroids(0), centroids(60)
    assert np.abs(exact - begin).max() > 0.05, "the cells move"
    error = 1e3 * np.abs(centroids(60, solver="band") - exact).max()
    assert error < 1.0
    assert error > 1e-3, "another solver, not the same"


def test_more_iterations_are_nearer_to_the_exact_solution() -> None:
    exact = centroids(30, laplacian="stencil", box_tolerance=1e-5)
    errors = [
        np.abs(centroids(30, solver="band", sweeps=n, box_tolerance=1e-5) - exact).max()
        for n in (2, 3, 6)
    ]
    assert errors[1] < 0.7 * errors[0]
    assert errors[2] < 0.2 * errors[0]


def test_the_steady_state_does_not_depend_on_the_iterations() -> None:
    scene = Scene(cells=[Cell(name="a", shape=Sphere(center=(0.1, 0.2, 0.3), radius=3.0))])
    volumes = []
    for sweeps in (2, 8):
        simulation = Simulation(
            scene.with_numerics(solver="band", sweeps=sweeps, precision="double")
        )
        simulation.run(until=400)
        volumes.append(simulation.volumes[0])
    assert volumes[0] == pytest.approx(volumes[1], rel=1e-7)


# --- the certificate -----------------------------------------------------------------------------


@pytest.mark.parametrize("name", STRESSES)
def test_volumes_are_those_of_the_full_grid_within_what_is_stated(name: str) -> None:
    stress = STRESSES[name]
    banded = replace(stress, numerics=stress.numerics | {"solver": "band"})
    engine, wanted = start(banded, TOLERANCES[0]), targets(banded)
    assert engine.numerics.solver == "band"
    for volumes in full_run(name)[1]:
        surface = 2 * (engine.pool.shape[:, [0, 1, 2]] * engine.pool.shape[:, [1, 2, 0]]).sum(1)
        tail = engine.face_peak * surface * engine.numerics.spacing**2 / 2
        assert (np.abs(engine.volumes - volumes) < np.abs(engine.lost_volume) + tail).all()
        advance(engine, 1, wanted)
    assert engine.face_peak.max() < 8 * TOLERANCES[0]
    assert measured(engine)


def test_outside_of_the_band_there_is_nothing() -> None:
    simulation = Simulation(pair(solver="band", threads=1))
    simulation.step(40)
    pool = simulation.engine.pool
    assert pool.history is not None
    for i in range(2):
        assert_band_alone(pool, i)


# --- what must not matter ------------------------------------------------------------------------


def test_the_number_of_threads_does_not_matter() -> None:
    one, two = (Simulation(pair(solver="band", threads=n)) for n in (1, 2))
    for simulation in (one, two):
        simulation.step(15)
    for a, b in zip(one.fields, two.fields, strict=True):
        np.testing.assert_array_equal(a.phi, b.phi)


def test_attraction_by_pairs_alone() -> None:
    """No accumulated potential; with both as one pair it is the same as one σ for all."""
    cells = pair().cells
    sigma = Attraction(pairs={("left", "right"): 0.5})
    found = []
    for physics in (Physics(sigma=sigma), Physics(sigma=0.5)):
        scene = Scene(cells=cells, physics=physics, numerics=Numerics(solver="band", threads=1))
        simulation = Simulation(scene)
        simulation.step(20)
        found.append(simulation.centroids)
    np.testing.assert_allclose(*found, atol=2e-6)


# --- the iterations ------------------------------------------------------------------------------


@pytest.mark.parametrize("dt", [0.05, 0.5, 2.0, 8.0])
@pytest.mark.parametrize("S", [0.0, 3.0, 12.0])
@pytest.mark.parametrize("spacing", [0.25, 0.5, 0.75])
def test_iterations_reduce_every_error(dt: float, S: float, spacing: float) -> None:
    numerics = Numerics(dt=dt, S=S, spacing=spacing)
    lhs, top = (
        coefficients(numerics, 2.62, numerics.S, False)["lhs"],
        0.25 * largest_eigenvalue(6, spacing),
    )
    roots = chebyshev_roots(lhs, 0.5, top, numerics.sweeps)
    symbol = lhs + np.linspace(0, top, 1001)
    error = np.abs(np.prod(1 - symbol[:, None] / roots, axis=1))
    assert error.max() <= 0.6 + 1e-9
    assert roots.min() == pytest.approx(lhs + 0.5)
    assert len(roots) >= numerics.sweeps


def test_stiff_diffusion_takes_more_iterations() -> None:
    standard = coefficients(Numerics(), 2.62, 6.0, False)["lhs"]
    assert len(chebyshev_roots(standard, 0.5, 0.25 * largest_eigenvalue(6, 0.5), 2)) == 2
    plain = coefficients(Numerics(), 2.62, 0.0, False)["lhs"]
    assert len(chebyshev_roots(plain, 0.5, 0.25 * largest_eigenvalue(6, 0.5), 2)) > 2


@pytest.mark.parametrize("order", [2, 4, 6])
def test_largest_eigenvalue_is_that_of_the_checkerboard(order: int) -> None:
    from morphosim.kernels.stencils import LAPLACIAN_COEFFICIENTS

    checker = (-1.0) ** np.indices((8, 8, 8)).sum(axis=0)
    weights = LAPLACIAN_COEFFICIENTS[order]
    laplacian = sum(
        w * (np.roll(checker, m, axis) + np.roll(checker, -m, axis)) / (2 if m == 0 else 1)
        for axis in range(3)
        for m, w in enumerate(weights)
    )
    np.testing.assert_allclose(-laplacian / checker / 0.5**2, largest_eigenvalue(order, 0.5))


@EXPECTED_TO_FAIL
def test_the_first_order_scheme_runs_on_the_band() -> None:
    exact = centroids(40, scheme="imex1", S=6.0)
    assert np.abs(centroids(40, scheme="imex1", S=6.0, solver="band") - exact).max() < 2e-3
