"""Chebyshev iterations towards the implicit step on the band, against NumPy and SciPy."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.sparse import csr_array, diags_array
from scipy.sparse.linalg import spsolve

from morphosim.kernels.chebyshev import iterate
from morphosim.kernels.frames import HALO, strides
from morphosim.kernels.layout import Boxes
from morphosim.kernels.stencils import LAPLACIAN_COEFFICIENTS
from morphosim.numerics.chebyshev import chebyshev_roots, largest_eigenvalue

from .example_boxes import (
    H,
    band_of,
    both_ways,
    empty_frame,
    flat_laplacian,
    in_band,
    in_runs,
    inside,
    lay_out,
    make_boxes,
    make_stencil,
    taken,
    with_halo,
)

CELL = 1
LHS, GAMMA, WEIGHT = 9.0, 0.25, 0.04
ORDERS = pytest.mark.parametrize("order", [2, 4, 6])


def random_frame(boxes: Boxes, seed: int, everywhere: bool) -> NDArray[np.float64]:
    """A field that is 0 outside of the band; with random values in the runs' halos or 0."""
    values = np.random.default_rng(seed).normal(size=len(empty_frame(boxes, CELL)))
    frame = np.where(in_runs(boxes, CELL), values, 0)
    if not everywhere:
        kept = inside(frame, boxes, CELL).copy()
        frame[:] = 0
        inside(frame, boxes, CELL)[:] = kept
    return frame


def do_iteration(
    way: str,
    boxes: Boxes,
    source: NDArray,
    target: NDArray,
    rhs: NDArray,
    order: int,
    weight: float,
) -> None:
    real = source.dtype.type
    taken(iterate, way)(
        CELL, boxes, source, target, rhs, make_stencil(order, real), real(LHS), real(GAMMA),
        real(weight), real(1),
    )  # fmt: skip


def laplacian(boxes: Boxes, frame: NDArray, order: int) -> NDArray:
    """Δ in the box of a field that is 0 outside of it."""
    field = inside(frame, boxes, CELL)
    wide = np.pad(field, HALO)
    middle = (slice(HALO, -HALO),) * 3
    centre, *sides = LAPLACIAN_COEFFICIENTS[order]
    result = 3 * centre * field
    for axis in range(3):
        for m, w in enumerate(sides, 1):
            result = result + w * (np.roll(wide, m, axis) + np.roll(wide, -m, axis))[middle]
    return np.asarray(result / H**2)


@both_ways
@ORDERS
def test_an_iteration(order: int, way: str) -> None:
    boxes, _ = make_boxes(seed=30)
    source, rhs = (random_frame(boxes, seed, everywhere=False) for seed in (31, 32))
    target = empty_frame(boxes, CELL)
    do_iteration(way, boxes, source, target, rhs, order, WEIGHT)
    u, r, found = (inside(f, boxes, CELL) for f in (source, rhs, target))
    expected = u + WEIGHT * (r - LHS * u + GAMMA * laplacian(boxes, source, order))
    rows = in_band(boxes, CELL)
    assert 0 < rows.sum() < rows.size
    np.testing.assert_allclose(found[rows], expected[rows], rtol=1e-12, atol=1e-13)
    np.testing.assert_array_equal(np.isnan(target), ~in_runs(boxes, CELL))


@both_ways
@ORDERS
def test_the_halos_between_rows_are_points_of_the_run(order: int, way: str) -> None:
    """There a point's neighbours along z are those before and after it in the frame."""
    boxes, _ = make_boxes(seed=30)
    source, rhs = (random_frame(boxes, seed, everywhere=True) for seed in (31, 32))
    target = np.zeros_like(source)
    do_iteration(way, boxes, source, target, rhs, order, WEIGHT)
    change = rhs - LHS * source + GAMMA * flat_laplacian(source, boxes, CELL, order)
    expected = np.where(in_runs(boxes, CELL), source + WEIGHT * change, 0)
    np.testing.assert_allclose(target, expected, rtol=1e-12, atol=1e-13)


def test_single_precision_stays_single() -> None:
    boxes, _ = make_boxes(seed=30)
    source, rhs = (random_frame(boxes, seed, everywhere=False) for seed in (31, 32))
    expected, found = np.zeros_like(source), np.zeros(source.shape, np.float32)
    do_iteration("compiled", boxes, source, expected, rhs, 6, WEIGHT)
    do_iteration("compiled", boxes, source.astype("f4"), found, rhs.astype("f4"), 6, WEIGHT)
    np.testing.assert_allclose(found, expected, atol=2e-6)
    assert np.abs(found - expected).max() > 0


def weights(order: int, count: int) -> NDArray[np.float64]:
    top = GAMMA * largest_eigenvalue(order, H)
    return 1 / chebyshev_roots(LHS, GAMMA * 4, top, count)


def solved_by_iterations(
    boxes: Boxes, rhs: NDArray, order: int, cycles: int, start: NDArray | None = None
) -> NDArray:
    """Frame after `cycles` times six iterations, from 0."""
    here = np.zeros_like(rhs) if start is None else start.copy()
    there = np.zeros_like(rhs)
    for weight in np.tile(weights(order, 6), cycles):
        do_iteration("compiled", boxes, here, there, rhs, order, weight)
        here, there = there, here
    return here


def operator(boxes: Boxes, order: int) -> csr_array:
    """Lhs - γΔ on flat frames."""
    size = len(empty_frame(boxes, CELL))
    centre, *sides = LAPLACIAN_COEFFICIENTS[order]
    entries = {0: LHS - GAMMA * 3 * centre / H**2}
    for stride in (*strides(CELL, boxes), 1):
        for m, w in enumerate(sides, 1):
            entries[m * stride] = entries[-m * stride] = -GAMMA * w / H**2
    matrix = diags_array(
        [np.full(size - abs(k), v) for k, v in entries.items()], offsets=list(entries)
    )
    return csr_array(matrix)


@ORDERS
def test_iterations_converge_to_the_solution_that_is_zero_outside_of_the_band(order: int) -> None:
    boxes, _ = make_boxes(seed=30)
    rhs, domain = random_frame(boxes, 33, everywhere=True), in_runs(boxes, CELL)
    expected = np.zeros_like(rhs)
    matrix = operator(boxes, order)[domain][:, domain]
    expected[domain] = spsolve(matrix.tocsc(), rhs[domain])
    found = solved_by_iterations(boxes, rhs, order, cycles=12)
    np.testing.assert_allclose(found, expected, atol=1e-12)


@ORDERS
def test_the_halos_do_not_matter_where_the_field_vanishes_before(order: int) -> None:
    """Long rows with the source in their middle: the solution in the box alone is the same."""
    boxes, _ = lay_out([(0, 0, 0)] * 2, [(8, 8, 8), (5, 6, 60)])
    band_of(boxes, CELL)[:] = [(2, 4), (1, 5), (6, 0), (0, 6), (3, 5)]
    rhs = empty_frame(boxes, CELL, 0.0)
    rng = np.random.default_rng(34)
    rows = in_band(boxes, CELL)
    inside(rhs, boxes, CELL)[rows, 28:32] = rng.normal(size=(rows.sum(), 4))
    number = inside(np.arange(len(rhs)), boxes, CELL)[rows].ravel()
    matrix = operator(boxes, order)[number][:, number]
    expected = np.zeros(len(rhs))
    expected[number] = spsolve(matrix.tocsc(), rhs[number])
    found = solved_by_iterations(boxes, rhs, order, cycles=14)
    np.testing.assert_allclose(
        inside(found, boxes, CELL), inside(expected, boxes, CELL), atol=1e-11
    )
    assert np.abs(expected).max() > 0.02


def test_one_cycle_of_iterations_reduces_every_error() -> None:
    """In the norm of the symmetric operator's eigenvectors, which is that of the points."""
    boxes, _ = make_boxes(seed=30)
    for seed in range(35, 40):
        error = random_frame(boxes, seed, everywhere=True)
        left = solved_by_iterations(boxes, np.zeros_like(error), 6, 1, error)
        assert np.linalg.norm(left) < 0.6 * np.linalg.norm(error)
        assert with_halo(left, boxes, CELL).any()
