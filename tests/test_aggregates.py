"""Aggregates: what hangs together, how types sort, how round it is."""

from pathlib import Path

import numpy as np
import pytest

from morphosim import Cell, Numerics, RunWriter, Scene, Simulation, Sphere, open_run
from morphosim.geometry.phase_field import ball_radius
from morphosim.measure.aggregates import Aggregates
from morphosim.measure.measurement import measure_fields


def aggregate(*places: tuple[float, float, float], types: str, radius: float = 5.0) -> Aggregates:
    cells = [
        Cell(name=str(k), shape=Sphere(center=place, radius=radius))
        for k, place in enumerate(places)
    ]
    simulation = Simulation(Scene(cells=cells, numerics=Numerics(threads=1)))
    return Aggregates(measure_fields(simulation.fields, 0.5), list(types))


def test_aggregates_by_contact() -> None:
    row = [(10.0 * k, 0.0, 0.0) for k in (0, 1, 2, 4, 5, 7)]
    found = aggregate(*row, types="aabbab")
    np.testing.assert_array_equal(found.aggregate, [0, 0, 0, 1, 1, 2])
    assert (found.n_aggregates, found.single_cells, found.largest_aggregate) == (3, 1, 3)
    assert found.sorting_index == pytest.approx(1 / 3)  # aa, ab, ba
    np.testing.assert_allclose(found.radial_position, [10, 0, 10, 5, 5, 0], atol=0.01)


def test_figures_of_a_ball_and_of_a_pair() -> None:
    ball = aggregate((0, 0, 0), types="a", radius=6.0)
    radius = ball_radius(4 / 3 * np.pi * 6**3, 1.0)  # of the surface φ = 1/2
    assert ball.radius_of_gyration == pytest.approx(np.sqrt(3 / 5) * radius, rel=0.01)
    assert ball.roundness == pytest.approx(1, rel=1e-3)
    assert ball.aggregate_sphericity == pytest.approx(1, rel=0.01)
    assert np.isnan(ball.sorting_index)
    pair = aggregate((-5, 0, 0), (5, 0, 0), types="ab")
    # Two balls at ± 5: semi-axes √(R² + 5·25) and R; twice the surface, twice the volume.
    radius = ball_radius(4 / 3 * np.pi * 5**3, 1.0)
    assert pair.roundness == pytest.approx(radius / np.sqrt(radius**2 + 125), rel=0.01)
    assert pair.radius_of_gyration == pytest.approx(np.sqrt(25 + 3 / 5 * radius**2), rel=0.01)
    assert 2 ** (-1 / 3) < pair.aggregate_sphericity < 1.2 * 2 ** (-1 / 3)


def test_roundness_of_many_cells_is_that_of_their_second_moments() -> None:
    """Cells on the points of a lattice in half a ball."""
    grid = np.arange(-15.0, 16.0, 5.0)
    points = np.array(np.meshgrid(grid, grid, grid)).reshape(3, -1).T
    points = points[(np.linalg.norm(points, axis=1) < 16) & (points[:, 2] >= 0)]
    found = aggregate(*map(tuple, points), types="a" * len(points), radius=2.6)
    variance = np.sort(points.var(axis=0)) + 2.6**2 / 5
    assert found.n_aggregates == 1
    assert found.roundness == pytest.approx(np.sqrt(variance[0] / variance[-1]), rel=0.02)
    assert found.radius_of_gyration == pytest.approx(np.sqrt(variance.sum()), rel=0.02)


def test_exposed_fraction() -> None:
    """A cell in the middle of six is covered most; a lone one not at all."""
    star = [(0, 0, 0), *(tuple(8.5 * s * e) for e in np.eye(3) for s in (1, -1)), (40, 0, 0)]
    cells = [Cell(name=str(k), shape=Sphere(center=p, radius=5)) for k, p in enumerate(star)]
    simulation = Simulation(Scene(cells=cells, numerics=Numerics(threads=1)))
    simulation.step(10)
    exposed = measure_fields(simulation.fields, 0.5).exposed_fraction
    assert exposed[0] < 0.6
    assert (exposed[1:7] > 0.7).all()
    assert (exposed[1:7] < 0.95).all()
    assert exposed[7] == pytest.approx(1)


def test_figures_are_variables_of_the_run(tmp_path: Path) -> None:
    cells = [
        Cell(name=name, type=kind, shape=Sphere(center=(x, 0, 0), radius=5))
        for name, kind, x in (("p", "a", 0), ("q", "a", 9), ("r", "b", 30))
    ]
    simulation = Simulation(Scene(cells=cells, numerics=Numerics(threads=1)))
    simulation.run(until=4, observers=[RunWriter(tmp_path / "run", every=2)])
    with open_run(tmp_path / "run") as run:
        assert run["n_aggregates"].values.tolist() == [2, 2, 2]
        assert run["single_cells"].values.tolist() == [1, 1, 1]
        assert run["sorting_index"].values.tolist() == [1, 1, 1]
        assert run["aggregate"].sel(cell="r").values.tolist() == [1, 1, 1]
        assert run["radial_position"].dims == ("time", "cell")
        assert run["exposed_fraction"].sel(cell="r").values == pytest.approx([1, 1, 1])
        assert (run["roundness"] < 0.8).all()
        assert run["radius_of_gyration"].attrs["units"] == "um"
