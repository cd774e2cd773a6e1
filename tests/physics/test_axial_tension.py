"""Tension along an axis: the shape of least energy, axes, rates, and what is refused."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from morphosim import AxialTension, Cell, Numerics, Physics, Polarity, Scene, Simulation, Sphere
from morphosim.physics.axial_tension import weighted_curvature
from morphosim.scene import stability
from morphosim.simulation import warming
from morphosim.simulation.kernel_calls import recorded

AXIS = np.array([2.0, 1.0, 2.0]) / 3
PLAIN = Numerics(threads=1, spacing=1.0, allow_coarse=True, box_tolerance=1e-2, S=3.0, dt=0.5)
pytestmark = pytest.mark.filterwarnings(
    "ignore::morphosim.scene.stability.StabilityWarning",
    "ignore::morphosim.errors.ResolutionWarning",
)


def scene(numerics: Numerics = PLAIN, radius: float = 3.0, **physics: Any) -> Scene:
    ball = Cell(name="ball", shape=Sphere(center=(0, 0, 0), radius=radius))
    return Scene(cells=[ball], physics=Physics(**physics), numerics=numerics)


def second_derivatives(f: Any, x: NDArray) -> tuple[NDArray, NDArray]:
    """∇f and ∇∇f at points (3, n), by central differences."""
    h, unit = 1e-2, np.eye(3)[:, :, None]
    weights = {1: 3 / 4, 2: -3 / 20, 3: 1 / 60}

    def slope(g: Any, axis: int, at: NDArray) -> NDArray:
        e = h * unit[axis]
        return sum(w * (g(at + m * e) - g(at - m * e)) for m, w in weights.items()) / h

    first = np.stack([slope(f, a, x) for a in range(3)])
    second = np.stack(
        [[slope(lambda y, b=b: slope(f, b, y), a, x) for b in range(3)] for a in range(3)]
    )
    return first, second


@pytest.mark.parametrize("chi", [-0.5, 0.0, 1.25, 5.0])
def test_on_the_ellipsoid_the_weighted_curvature_is_everywhere_the_same(chi: float) -> None:
    """γ (Δφ - n·∇∇φ·n) + f = - 2 γ |∇φ| / r, where the ellipsoid is r wide and r √(1 + χ) long."""
    gamma, r = 0.3, 4.0
    stretched = np.eye(3) - chi / (1 + chi) * np.outer(AXIS, AXIS)

    def phi(x: NDArray) -> NDArray:
        return (1 + np.tanh(r - np.sqrt(np.einsum("in,ij,jn->n", x, stretched, x)))) / 2

    way = np.random.default_rng(5).normal(size=(3, 50))
    x = way * r / np.sqrt(np.einsum("in,ij,jn->n", way, stretched, way))
    g, h = second_derivatives(phi, x)
    values = [gamma, chi, *AXIS, 1e-12, 2.0]
    laplacian = np.trace(h)
    second = (h[0, 0], h[1, 1], h[2, 2], h[0, 1], h[0, 2], h[1, 2])
    f = weighted_curvature(values, phi(x), *g, laplacian, second)
    slope = np.linalg.norm(g, axis=0)
    own = laplacian - np.einsum("in,ijn,jn->n", g, h, g) / slope**2
    np.testing.assert_allclose(gamma * own + f, -2 * gamma * slope / r, rtol=1e-6)


def length(simulation: Simulation, way: NDArray) -> float:
    """Distance from the centroid to where φ = 1/2, along a direction, µm."""
    (field,), h = simulation.fields, simulation.scene.numerics.spacing
    phi = field.phi.astype(float)
    points = np.indices(phi.shape)
    middle = (points * phi).sum((1, 2, 3)) / phi.sum()
    t = np.linspace(0, 0.45 * min(phi.shape), 500)
    along = map_coordinates(phi, middle[:, None] + t * way[:, None], order=3)
    return float(np.interp(-0.5, -along, t) * h)


def test_a_free_cell_becomes_the_ellipsoid() -> None:
    """With an error that falls as 1/R²: at 5 µm 1.2 % for χ = 1.25."""
    made = scene(
        Numerics(threads=1, solver="band"), 5.0, terms=[AxialTension(chi=1.25, direction=3 * AXIS)]
    )
    simulation = Simulation(made)
    simulation.run(until=250)
    across = np.array([1.0, -2.0, 0.0]) / np.sqrt(5)
    ratio = length(simulation, AXIS) / length(simulation, across)
    assert ratio == pytest.approx(1.5, rel=0.015)
    assert length(simulation, -AXIS) == pytest.approx(length(simulation, AXIS), rel=2e-3)


def values(made: Scene, steps: int) -> tuple[NDArray, Simulation]:
    """What the kernels are given after so many steps in plain Python."""
    with warming.not_ahead(), recorded():
        simulation = Simulation(made)
        simulation.step(steps)
    points = simulation.engine._values.points
    return points[points.dtype.names[0]], simulation


def test_the_axis_is_the_cells_polarity_as_it_turns() -> None:
    polarity = Polarity(diffusion=0.05, initial=(0, 0, 1))
    found, simulation = values(scene(terms=[AxialTension(chi=0.5), polarity]), 3)
    p = simulation.column("polarity")[0]
    assert abs(p[2]) < 0.999
    np.testing.assert_allclose(found[0, :5], [0.25, 0.5, *p], atol=1e-6)


def test_types_and_tensions_of_single_cells_count() -> None:
    cells = [
        Cell(name=f"c{k}", type=kind, shape=Sphere(center=(9.0 * k, 0, 0), radius=3), gamma=gamma)
        for k, (kind, gamma) in enumerate([("x", None), ("y", 0.5)])
    ]
    term = AxialTension(chi_by_type={"y": 2.0}, direction=(0, 0, 5))
    found, _ = values(Scene(cells=cells, physics=Physics(terms=[term]), numerics=PLAIN), 1)
    np.testing.assert_allclose(found[:, :5], [[0.25, 0, 0, 0, 1], [0.5, 2, 0, 0, 1]])


@pytest.mark.parametrize(
    ("scheme", "chi", "more"),
    [
        ("bdf2", 0.3, 0.0),
        ("bdf2", 1.0, 2 / 3),
        ("bdf2", -0.75, 2 / 3),
        ("euler", 0.3, 0.3),
        ("linearised", 1.0, 0.0),
    ],
)
def test_rates_are_those_of_the_finest_waves_beyond_what_is_implicit(
    scheme: str, chi: float, more: float
) -> None:
    """18.1 γ/(3 h²) of each χ that counts."""
    numerics = Numerics(threads=1, scheme=scheme, order=6, dt=0.01)  # type: ignore[arg-type]
    term = AxialTension(chi=chi, direction=AXIS)
    made = scene(numerics, terms=[term])
    found, h = term.explicit_rate(stability.conditions(made, made.physics)), numerics.spacing
    assert found == pytest.approx(0.25 * more * 18.13 / 3 / h**2, rel=1e-3, abs=1e-9)
    total = stability.explicit_rate(made)
    assert total >= found


def test_what_linearised_takes_implicitly_is_stiffer() -> None:
    assert AxialTension(chi=2.0, chi_by_type={"a": 3.0}, direction=AXIS).stiffening == 3.0
    assert AxialTension(chi=-0.75, direction=AXIS).stiffening == pytest.approx(1.0)


def test_what_cannot_be_is_told() -> None:
    for chi in (-0.8, 9.0, np.nan):
        with pytest.raises(ValueError, match=r"axial_tension.chi = \S+ is not allowed"):
            AxialTension(chi=chi, direction=AXIS)
    with pytest.raises(ValueError, match="has no direction"):
        AxialTension(chi=1.0, direction=(0, 0, 0))
    with pytest.raises(ValueError, match=r"type in axial_tension\.chi_by_type = 'x'"):
        scene(terms=[AxialTension(chi_by_type={"x": 1.0}, direction=AXIS)])
    with pytest.raises(ValueError, match="along the cells' polarity, and they have none"):
        Simulation(scene(terms=[AxialTension(chi=1.0)]))
    assert not AxialTension(direction=AXIS).present
    assert replace(AxialTension(chi=1.0, direction=AXIS), chi=0.0).present is False
