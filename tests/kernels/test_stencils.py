"""Central differences: exact on polynomials up to their order, and no further."""

import numpy as np
import pytest

from morphosim.kernels.stencils import COEFFICIENTS, LAPLACIAN_COEFFICIENTS, derivative

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
