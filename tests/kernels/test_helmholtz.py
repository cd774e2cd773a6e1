"""Implicit solve and Laplacian of a box, against SciPy's cosine transforms."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.fft import dctn, idctn

from morphosim.kernels.helmholtz import helmholtz_solve, laplacian
from morphosim.transforms import CosineTables

from .example_boxes import both_ways, taken

H, LHS, GAMMA = 0.5, 3.0, 0.25
SHAPE = (8, 10, 14)
KINDS = [("exact", 6), ("stencil", 2), ("stencil", 4), ("stencil", 6)]
DIFFERENCES = {
    2: (1.0, -2.0, 1.0),
    4: (-1 / 12, 4 / 3, -5 / 2, 4 / 3, -1 / 12),
    6: (1 / 90, -3 / 20, 3 / 2, -49 / 18, 3 / 2, -3 / 20, 1 / 90),
}


def tables(kind: tuple[str, int], dtype: type = np.float64) -> CosineTables:
    made = CosineTables(H, *kind, dtype)
    made.require(np.array([*SHAPE, 20]))
    return made


def symbol() -> NDArray:
    """k² of the cosine modes of a box."""
    k = [np.pi * np.arange(n) / (n * H) for n in SHAPE]
    return sum(a**2 for a in np.meshgrid(*k, indexing="ij", sparse=True))


def filtered(field: NDArray, factor: NDArray) -> NDArray:
    return idctn(factor * dctn(field))


def random_field() -> NDArray:
    return np.random.default_rng(8).random(SHAPE)


def differences(field: NDArray, order: int) -> NDArray:
    """Laplacian by second differences; beyond the faces the field is mirrored."""
    weights = DIFFERENCES[order]
    half = len(weights) // 2
    result = np.zeros(field.shape)
    for axis in range(3):
        pad = [(half, half) if a == axis else (0, 0) for a in range(3)]
        mirrored = np.pad(field, pad, mode="symmetric")
        for m, w in enumerate(weights):
            result += w / H**2 * np.take(mirrored, np.arange(field.shape[axis]) + m, axis)
    return result


def solve(field: NDArray, kind: tuple[str, int], way: str, dtype: type = np.float64) -> NDArray:
    work, other = (np.zeros(field.size + 9, dtype) for _ in range(2))
    work[: field.size] = field.ravel()
    taken(helmholtz_solve, way)(
        work, other, *np.array(SHAPE), tables(kind, dtype).arrays, dtype(LHS), dtype(GAMMA)
    )
    return work[: field.size].reshape(SHAPE)


def apply_laplacian(field: NDArray, kind: tuple[str, int], way: str) -> NDArray:
    work, other = field.ravel().copy(), np.zeros(field.size)
    taken(laplacian, way)(work, other, *np.array(SHAPE), tables(kind).arrays, np.float64(GAMMA))
    return work.reshape(SHAPE)


@both_ways
def test_exact_laplacian(way: str) -> None:
    field = random_field()
    expected = filtered(field, -GAMMA * symbol())
    np.testing.assert_allclose(apply_laplacian(field, KINDS[0], way), expected, atol=1e-11)


@pytest.mark.parametrize("order", [2, 4, 6])
def test_stencil_laplacian_is_that_of_differences(order: int) -> None:
    field = random_field()
    found = apply_laplacian(field, ("stencil", order), "compiled")
    np.testing.assert_allclose(found, GAMMA * differences(field, order), atol=1e-11)


@both_ways
def test_solve_with_the_exact_symbol(way: str) -> None:
    field = random_field()
    expected = filtered(field, 1 / (LHS + GAMMA * symbol()))
    np.testing.assert_allclose(solve(field, KINDS[0], way), expected, rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize("kind", KINDS)
def test_solve_undoes_the_operator(kind: tuple[str, int]) -> None:
    field = random_field()
    image = LHS * field - apply_laplacian(field, kind, "compiled")
    np.testing.assert_allclose(solve(image, kind, "compiled"), field, rtol=1e-11)


def test_solve_in_single_precision() -> None:
    field = random_field()
    found = solve(field, KINDS[0], "compiled", np.float32)
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, solve(field, KINDS[0], "compiled"), rtol=3e-6)
