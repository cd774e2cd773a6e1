"""Random numbers: known answers of Philox, and what normal vectors must be."""

import numpy as np
import pytest

from morphosim.kernels.noise import normal_vectors, philox

from .example_boxes import both_ways, taken

ONES = "ffffffff"
# Known answers published with Random123: counter, key, result.
KNOWN = [
    ("00000000 " * 4, "00000000 " * 2, "6627e8d5 e169c58d bc57ac4c 9b00dbd8"),
    (f"{ONES} " * 4, f"{ONES} " * 2, "408f276d 41c83b0e a20bc7c6 6d5451fd"),
    (
        "243f6a88 85a308d3 13198a2e 03707344",
        "a4093822 299f31d0",
        "d16cfe09 94fdcceb 5001e420 24126ea1",
    ),
]


def words(text: str) -> list[np.uint64]:
    return [np.uint64(int(word, 16)) for word in text.split()]


def vectors(cells, seed: int = 3, step: int = 7) -> np.ndarray:
    out = np.empty((len(cells), 3))
    normal_vectors(np.uint64(seed), np.uint64(step), np.asarray(cells, np.uint64), out)
    return out


@both_ways
@pytest.mark.parametrize(("counter", "key", "result"), KNOWN)
def test_philox_gives_the_known_answers(counter: str, key: str, result: str, way: str) -> None:
    assert list(taken(philox, way)(*words(counter), *words(key))) == words(result)


def test_normal_vectors_in_python_are_the_compiled_ones() -> None:
    cells, out = np.array([0, 5, 2**40], np.uint64), np.empty((3, 3))
    normal_vectors.py_func(np.uint64(3), np.uint64(7), cells, out)
    np.testing.assert_allclose(out, vectors(cells), rtol=1e-13)


def test_normal_vectors_are_normal() -> None:
    u = vectors(np.arange(100_000))
    n = len(u)
    np.testing.assert_allclose(u.mean(axis=0), 0, atol=4 / np.sqrt(n))
    np.testing.assert_allclose(u.var(axis=0), 1, atol=4 * np.sqrt(2 / n))
    np.testing.assert_allclose((u**4).mean(axis=0), 3, atol=4 * np.sqrt(96 / n))


def test_axes_cells_and_steps_are_independent() -> None:
    n = 100_000
    u = vectors(np.arange(n + 1))
    next_step = vectors(np.arange(n + 1), step=8)
    other_seed = vectors(np.arange(n + 1), seed=4)
    columns = np.hstack([u[1:], u[:-1], next_step[1:], other_seed[1:]])
    for values in (columns, columns**2):
        correlation = np.corrcoef(values.T) - np.eye(columns.shape[1])
        assert np.abs(correlation).max() < 5 / np.sqrt(n)


def test_a_cell_has_its_numbers_whatever_cells_are_present() -> None:
    np.testing.assert_array_equal(vectors([9, 4, 2**35]), vectors([2**35, 4, 1, 9])[[3, 1, 0]])


@pytest.mark.parametrize("high", [1, 2**32])
def test_all_64_bits_count(high: int) -> None:
    first = vectors([0], seed=0, step=0)
    for other in (
        vectors([high], seed=0, step=0), vectors([0], high, 0), vectors([0], 0, high)
    ):  # fmt: skip
        assert np.abs(other - first).min() > 1e-6
