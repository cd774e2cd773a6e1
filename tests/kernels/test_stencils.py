"""Central differences: exact on polynomials up to their order, and no further."""

import itertools

import numpy as np
import pytest
from numpy.typing import NDArray

from morphosim.engine.stencil import make_stencil
from morphosim.kernels.stencils import (
    COEFFICIENTS,
    LAPLACIAN_COEFFICIENTS,
    around,
    derivative,
    second_derivatives,
    weighted_neighbours,
)

from .example_boxes import both_ways, taken

H = 0.3
SHAPE = (7, 8, 9)
POINT = (3, 4, 4)


def strides() -> list[int]:
    return [SHAPE[1] * SHAPE[2], SHAPE[2], 1]


def difference(way: str, order: int, field: np.ndarray, axis: int) -> float:
    """The kernel's derivative at one point of a box."""
    weights = [np.float64(w / H) for w in COEFFICIENTS[order]]
    c1, c2, c3 = (*weights, None, None)[:3]
    index = np.uint64(np.ravel_multi_index(POINT, SHAPE))
    return taken(derivative, way)(field.ravel(), index, np.uint64(strides()[axis]), c1, c2, c3)


@both_ways
@pytest.mark.parametrize("order", [2, 4, 6])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_derivative_is_exact_up_to_its_order(order: int, axis: int, way: str) -> None:
    x = (np.indices(SHAPE)[axis] - POINT[axis]) * H + 0.7
    for power in range(order + 1):
        exact = power * 0.7 ** (power - 1) if power else 0.0
        assert difference(way, order, x**power, axis) == pytest.approx(exact, abs=1e-12)
    beyond = order + 1
    assert difference(way, order, x**beyond, axis) != pytest.approx(beyond * 0.7**order, abs=1e-4)


@pytest.mark.parametrize("order", [2, 4, 6])
def test_derivative_equals_shifted_arrays(order: int) -> None:
    field = np.random.default_rng(1).random(SHAPE)
    for axis in range(3):
        shifted = sum(
            w * (np.roll(field, -m, axis) - np.roll(field, m, axis))
            for m, w in enumerate(COEFFICIENTS[order], start=1)
        )
        assert difference("compiled", order, field, axis) == pytest.approx(shifted[POINT] / H)


@pytest.mark.parametrize("order", [2, 4, 6])
def test_second_differences_are_exact_up_to_their_order(order: int) -> None:
    centre, *sides = LAPLACIAN_COEFFICIENTS[order]
    for power in range(order + 2):
        value = sum(w * (m**power + (-m) ** power) for m, w in enumerate(sides, 1))
        value += centre * (power == 0)
        assert value == pytest.approx(2.0 if power == 2 else 0.0, abs=1e-12)


def laplacian(way: str, order: int, field: np.ndarray) -> float:
    """Δ at one point of a box: the kernel's sum over neighbours, and the point itself."""
    l0, *sides = (np.float64(w / H**2) for w in LAPLACIAN_COEFFICIENTS[order])
    l1, l2, l3 = (*sides, None, None)[:3]
    index = np.uint64(np.ravel_multi_index(POINT, SHAPE))
    steps = (np.uint64(s) for s in strides())
    near = taken(weighted_neighbours, way)(field.ravel(), index, *steps, l1, l2, l3)
    return near + 3 * l0 * field[POINT]


@both_ways
def test_around_adds_the_six_neighbours(way: str) -> None:
    field = np.random.default_rng(3).random(SHAPE)
    x, y, z = POINT
    for m in (1, 2, 3):
        near = [field[x + a, y, z] + field[x, y + a, z] + field[x, y, z + a] for a in (-m, m)]
        steps = (np.uint64(m * s) for s in strides())
        index = np.uint64(np.ravel_multi_index(POINT, SHAPE))
        assert taken(around, way)(field.ravel(), index, *steps) == pytest.approx(sum(near))


@both_ways
@pytest.mark.parametrize("order", [2, 4, 6])
def test_laplacian_is_exact_up_to_its_order(order: int, way: str) -> None:
    """On all products of powers of x, y, z up to one more than the order; not on two more."""
    place = np.array([0.7, -0.4, 0.9])
    points = (np.indices(SHAPE).T - POINT).T * H + place[:, None, None, None]
    for powers in itertools.product(range(order + 2), repeat=3):
        if sum(powers) > order + 1:
            continue
        field = np.prod([p**n for p, n in zip(points, powers, strict=True)], axis=0)
        exact = 0.0
        for axis, n in enumerate(powers):
            if n >= 2:
                lower = np.array(powers)
                lower[axis] -= 2
                exact += n * (n - 1) * np.prod(place**lower)
        assert laplacian(way, order, field) == pytest.approx(exact, abs=1e-11)
    beyond = order + 2
    for axis in range(3):
        exact = beyond * (beyond - 1) * place[axis] ** order
        found = laplacian(way, order, points[axis] ** beyond)
        assert found != pytest.approx(exact, abs=1e-4)


@both_ways
@pytest.mark.parametrize("order", [2, 4, 6])
def test_second_derivatives_are_exact_up_to_their_order(order: int, way: str) -> None:
    """On all products of powers of x, y, z up to one more than the order; not on two more."""
    place = np.array([0.7, -0.4, 0.9])
    points = (np.indices(SHAPE).T - POINT).T * H + place[:, None, None, None]
    index = np.uint64(np.ravel_multi_index(POINT, SHAPE))
    sx, sy, _ = (np.uint64(s) for s in strides())
    stencil = make_stencil(order, H, np.dtype(float))

    def found(powers: tuple[int, ...]) -> NDArray[np.float64]:
        field = np.prod([p**n for p, n in zip(points, powers, strict=True)], axis=0)
        return np.array(taken(second_derivatives, way)(field.ravel(), index, sx, sy, stencil))

    def exact(powers: tuple[int, ...]) -> NDArray[np.float64]:
        polynomials = [np.polynomial.Polynomial([0] * n + [1]) for n in powers]

        def derived(*times: int) -> float:
            factors = [p.deriv(t) if t else p for p, t in zip(polynomials, times, strict=True)]
            return float(np.prod([f(x) for f, x in zip(factors, place, strict=True)]))

        orders = [(2, 0, 0), (0, 2, 0), (0, 0, 2), (1, 1, 0), (1, 0, 1), (0, 1, 1)]
        return np.array([derived(*times) for times in orders])

    for powers in itertools.product(range(order + 2), repeat=3):
        if sum(powers) <= order + 1:
            np.testing.assert_allclose(found(powers), exact(powers), atol=1e-11)
    for k, pair in enumerate([(0, 1), (0, 2), (1, 2)]):
        powers = np.zeros(3, int)
        powers[list(pair)] = order + 1, 1
        beyond = tuple(powers.tolist())
        assert found(beyond)[3 + k] != pytest.approx(exact(beyond)[3 + k], abs=1e-4)
