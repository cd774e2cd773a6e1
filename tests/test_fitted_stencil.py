"""Weights of central differences that are fitted to the interface."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from morphosim import Cell, Numerics, Physics, Scene, Simulation, Sphere
from morphosim.numerics.stencils import stencil_weights

SPACINGS = (1 / 3, 0.4, 0.5, 2 / 3)


def errors(order: int | str, h: float, width: float, scale: float = 1.0) -> NDArray:
    """Root mean square errors of both derivatives of an interface so many µm wide."""
    odd, even = stencil_weights(order, h * scale)
    z = np.linspace(-8, 8, 801)

    def phi(steps: int) -> NDArray:
        return 0.5 * (1 + np.tanh((z + steps * h) / width))

    slope = 2 * phi(0) * (1 - phi(0)) / width
    first = sum(w * (phi(m) - phi(-m)) for m, w in enumerate(odd, 1)) / h
    second = sum(w * (phi(m) + phi(-m)) for m, w in enumerate(even[1:], 1)) + even[0] * phi(0)
    found = first - slope, second / h**2 - 2 * slope * (1 - 2 * phi(0)) / width
    return np.sqrt([np.mean(error**2) for error in found])


@pytest.mark.parametrize("h", SPACINGS)
def test_they_differentiate_an_interface_better_than_the_sixth_order(h: float) -> None:
    usual = errors(6, h, 1.0)
    for width in (0.8, 0.9, 1.0, 1.1):
        assert (errors("fitted", h, width) < 0.85 * errors(6, h, width)).all(), width
    # An oblique interface is wider along an axis, and either error smaller.
    for width in (1.3, 1.5, 2.0, 3.0):
        assert (errors("fitted", h, width) < 0.6 * usual).all(), width


@pytest.mark.parametrize("h", [0.02, *SPACINGS])
def test_they_are_exact_for_polynomials_of_second_degree(h: float) -> None:
    odd, even = (np.array(weights) for weights in stencil_weights("fitted", h))
    steps = np.arange(1, 4)
    assert 2 * odd @ steps == pytest.approx(1, abs=1e-12)
    assert even[0] + 2 * even[1:].sum() == pytest.approx(0, abs=1e-12)
    assert even[1:] @ steps**2 == pytest.approx(1, abs=1e-12)


def test_they_become_those_of_the_sixth_order_on_fine_lattices() -> None:
    apart = [
        max(
            np.abs(np.subtract(fitted, sixth)).max()
            for fitted, sixth in zip(
                stencil_weights("fitted", h), stencil_weights(6, h), strict=True
            )
        )
        for h in (0.5, 0.25, 0.12, 0.06, 0.01)
    ]
    assert apart == sorted(apart, reverse=True)
    assert apart[-2] < 0.01
    assert apart[-1] == 0


def test_they_are_fitted_to_the_interface_of_the_scene() -> None:
    # c = 8 makes it half as wide, so that it is on h = 0.25 what c = 2 is on 0.5.
    assert stencil_weights("fitted", 0.25 * Physics(c=8.0).interface_scale) == stencil_weights(
        "fitted", 0.5 * Physics(c=2.0).interface_scale
    )


def test_adhering_cells_are_nearer_to_those_of_a_fine_lattice() -> None:
    cells = [
        Cell(name=name, shape=Sphere(center=center, radius=4.0))
        for name, center in (("a", (0.1, 0.2, -0.1)), ("b", (7.5, 2.67, -0.1)))
    ]

    def distance(**numerics: Any) -> float:
        chosen = Numerics(solver="band", box_tolerance=1e-5, **numerics)
        simulation = Simulation(Scene(cells=cells, physics=Physics(sigma=0.5), numerics=chosen))
        simulation.run(until=100.0)
        return float(np.linalg.norm(np.diff(simulation.centroids, axis=0)))

    # Measured: 1.0 and 0.6 nm, which a smaller box tolerance changes no more.
    fine = distance(spacing=0.25)
    sixth, fitted = (abs(distance(order=order) - fine) for order in (6, "fitted"))
    assert fitted < 0.7 * sixth


def test_the_symbol_of_a_stencil_is_that_of_an_order() -> None:
    with pytest.raises(ValueError, match="'fitted' has none"):
        Numerics(order="fitted", laplacian="stencil")
