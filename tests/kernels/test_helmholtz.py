"""Implicit solve of a box, against SciPy's cosine transforms."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.fft import dctn, idctn

from morphosim.engine.solvers.cosine_transforms import CosineTables
from morphosim.kernels.helmholtz import COLUMNS, helmholtz_solve
from morphosim.numerics.parameters import Numerics

from .example_boxes import both_ways, taken

H, LHS, GAMMA = 0.5, 3.0, 0.25
SHAPE, LARGE = (8, 10, 14), (36, 40, 48)
"""The second is transformed in several blocks."""
KINDS = [("exact", 6), ("stencil", 2), ("stencil", 4), ("stencil", 6)]
DIFFERENCES = {
    2: (1.0, -2.0, 1.0),
    4: (-1 / 12, 4 / 3, -5 / 2, 4 / 3, -1 / 12),
    6: (1 / 90, -3 / 20, 3 / 2, -49 / 18, 3 / 2, -3 / 20, 1 / 90),
}


def tables(kind: tuple[str, int], shape: tuple, dtype: type = np.float64) -> CosineTables:
    laplacian, order = kind
    numerics = Numerics(spacing=H, laplacian=laplacian, order=order)
    made = CosineTables(numerics, dtype)
    made.require(np.array([*shape, 20]))
    return made


def symbol(shape: tuple) -> NDArray:
    """k² of the cosine modes of a box."""
    k = [np.pi * np.arange(n) / (n * H) for n in shape]
    return sum(a**2 for a in np.meshgrid(*k, indexing="ij", sparse=True))


def filtered(field: NDArray, factor: NDArray) -> NDArray:
    return idctn(factor * dctn(field))


def random_field(shape: tuple = SHAPE) -> NDArray:
    return np.random.default_rng(8).random(shape)


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


def spaces(field: NDArray, dtype: type = np.float64) -> list[NDArray]:
    """The field as a row, and the two work spaces, all longer than needed."""
    work, other = (np.full(field.size + 9, 7, dtype) for _ in range(2))
    work[: field.size] = field.ravel()
    return [work, other, np.full(COLUMNS * max(field.shape) + 9, 7, dtype)]


def solve(field: NDArray, kind: tuple[str, int], way: str, dtype: type = np.float64) -> NDArray:
    work, other, spare = spaces(field, dtype)
    cosines = tables(kind, field.shape, dtype).arrays
    taken(helmholtz_solve, way)(
        work, other, spare, *np.array(field.shape), cosines, dtype(LHS), dtype(GAMMA)
    )
    assert (work[field.size :] == 7).all()
    return work[: field.size].reshape(field.shape)


def laplacian(field: NDArray, kind: tuple[str, int]) -> NDArray:
    """Δ of a field with Neumann faces."""
    if kind[0] == "exact":
        return filtered(field, -symbol(field.shape))
    return differences(field, kind[1])


@both_ways
@pytest.mark.parametrize("shape", [SHAPE, LARGE])
def test_solve_with_the_exact_symbol(shape: tuple, way: str) -> None:
    field = random_field(shape)
    expected = filtered(field, 1 / (LHS + GAMMA * symbol(shape)))
    np.testing.assert_allclose(solve(field, KINDS[0], way), expected, rtol=1e-11, atol=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_solve_undoes_the_operator(kind: tuple[str, int]) -> None:
    field = random_field()
    image = LHS * field - GAMMA * laplacian(field, kind)
    np.testing.assert_allclose(solve(image, kind, "compiled"), field, rtol=1e-11)


def test_solve_in_single_precision() -> None:
    field = random_field()
    found = solve(field, KINDS[0], "compiled", np.float32)
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, solve(field, KINDS[0], "compiled"), rtol=3e-6)
