"""Chebyshev iterations towards the implicit step on the band, against NumPy and SciPy."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.sparse import csr_array, diags_array
from scipy.sparse.linalg import spsolve

from morphosim.kernels.chebyshev import iterate
from morphosim.kernels.frames import HALO, strides
from morphosim.kernels.layout import Boxes
from morphosim.kernels.rows import FRAME, STRETCH
from morphosim.kernels.stencils import LAPLACIAN_COEFFICIENTS
from morphosim.numerics.chebyshev import chebyshev_roots, largest_eigenvalue

from .example_boxes import (
    H,
    band_in_frame,
    blocks_of,
    both_ways,
    empty_frame,
    flat_laplacian,
    held,
    in_band,
    inside,
    lay_out,
    make_boxes,
    make_stencil,
    spread_out,
    stretch,
    taken,
    with_halo,
)

CELL = 1
LHS, GAMMA, WEIGHT = 9.0, 0.25, 0.04
ORDERS = pytest.mark.parametrize("order", [2, 4, 6])


def random_field(boxes: Boxes, seed: int) -> NDArray[np.float64]:
    """A field in the box that is 0 outside of the band."""
    values = np.random.default_rng(seed).normal(size=boxes.shape[CELL])
    return np.where(in_band(boxes, CELL), values, 0)


def in_frame(boxes: Boxes, field: NDArray) -> NDArray[np.float64]:
    """A frame with this field, and 0 around it."""
    frame = empty_frame(boxes, CELL, 0.0)
    inside(frame, boxes, CELL)[:] = field
    return frame


def do_iteration(
    way: str,
    boxes: Boxes,
    source: NDArray,
    target: NDArray,
    rhs: NDArray,
    order: int,
    weight: float,
    where: int = FRAME,
) -> None:
    real = source.dtype.type
    blocks, n = blocks_of(boxes, CELL)
    taken(iterate, way)(
        CELL, boxes, blocks, n, where, source, target, rhs, make_stencil(order, real), real(LHS),
        real(GAMMA), real(weight), real(1),
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
    """Into a frame, and into a stretch, as the last one goes."""
    boxes, _ = make_boxes(seed=30)
    field, rhs = (random_field(boxes, seed) for seed in (31, 32))
    source, given = in_frame(boxes, field), stretch(rhs, boxes, CELL)
    target, last = empty_frame(boxes, CELL), np.full(held(boxes, CELL).sum() + 3, np.nan)
    do_iteration(way, boxes, source, target, given, order, WEIGHT)
    do_iteration(way, boxes, source, last, given, order, WEIGHT, STRETCH)
    expected = field + WEIGHT * (rhs - LHS * field + GAMMA * laplacian(boxes, source, order))
    band = in_band(boxes, CELL)
    assert 0 < band.sum() < band.size
    found = inside(target, boxes, CELL)
    np.testing.assert_allclose(found[band], expected[band], rtol=1e-12, atol=1e-13)
    np.testing.assert_array_equal(np.isnan(target), ~band_in_frame(boxes, CELL))
    found = spread_out(last, boxes, CELL)
    np.testing.assert_allclose(found[band], expected[band], rtol=1e-12, atol=1e-13)
    assert np.isnan(last[-3:]).all()


@both_ways
@ORDERS
def test_neighbours_are_those_in_the_frame(order: int, way: str) -> None:
    """Whatever is in it beside the band."""
    boxes, _ = make_boxes(seed=30)
    rng = np.random.default_rng(31)
    source, rhs = rng.normal(size=len(empty_frame(boxes, CELL))), random_field(boxes, 32)
    target = np.zeros_like(source)
    do_iteration(way, boxes, source, target, stretch(rhs, boxes, CELL), order, WEIGHT)
    change = in_frame(boxes, rhs) - LHS * source
    change += GAMMA * flat_laplacian(source, boxes, CELL, order)
    expected = np.where(band_in_frame(boxes, CELL), source + WEIGHT * change, 0)
    np.testing.assert_allclose(target, expected, rtol=1e-12, atol=1e-13)


def test_single_precision_stays_single() -> None:
    boxes, _ = make_boxes(seed=30)
    source = in_frame(boxes, random_field(boxes, 31))
    rhs = stretch(random_field(boxes, 32), boxes, CELL)
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
    """Frame after `cycles` times six iterations, from 0; `rhs` is a field in the box."""
    here = empty_frame(boxes, CELL, 0.0) if start is None else start.copy()
    there, given = np.zeros_like(here), stretch(rhs, boxes, CELL)
    for weight in np.tile(weights(order, 6), cycles):
        do_iteration("compiled", boxes, here, there, given, order, weight)
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


def solution(boxes: Boxes, rhs: NDArray, order: int) -> NDArray:
    """What is sought, as a frame: 0 outside of the band."""
    domain, expected = band_in_frame(boxes, CELL), empty_frame(boxes, CELL, 0.0)
    matrix = operator(boxes, order)[domain][:, domain]
    expected[domain] = spsolve(matrix.tocsc(), in_frame(boxes, rhs)[domain])
    return expected


@ORDERS
def test_iterations_converge_to_the_solution_that_is_zero_outside_of_the_band(order: int) -> None:
    boxes, _ = make_boxes(seed=30)
    rhs = random_field(boxes, 33)
    found = solved_by_iterations(boxes, rhs, order, cycles=12)
    np.testing.assert_allclose(found, solution(boxes, rhs, order), atol=1e-12)


@ORDERS
def test_ends_of_spans_do_not_matter_where_the_field_vanishes_before(order: int) -> None:
    """Long rows with the source in their middle: the solution on whole rows is the same."""
    rows = np.zeros((5, 6, 2), int)
    for x, (low, high) in enumerate([(2, 4), (1, 5), (6, 0), (0, 6), (3, 5)]):
        rows[x, low:high] = 2, 59
    rows[1, 2], rows[3, 4] = (0, 60), (3, 57)
    boxes, _ = lay_out([(0, 0, 0)] * 2, [(8, 8, 16), (5, 6, 60)], [np.zeros((8, 8, 2)), rows])
    whole = rows[..., 1:] > 0
    wide, _ = lay_out(
        [(0, 0, 0)] * 2, boxes.shape, [np.zeros((8, 8, 2)), np.where(whole, [0, 60], 0)]
    )
    rhs, rng = np.zeros((5, 6, 60)), np.random.default_rng(34)
    rhs[whole[..., 0], 28:32] = rng.normal(size=(whole.sum(), 4))
    expected = solution(wide, rhs, order)
    found = solved_by_iterations(boxes, rhs, order, cycles=14)
    np.testing.assert_allclose(
        inside(found, boxes, CELL), inside(expected, boxes, CELL), atol=1e-11
    )
    assert np.abs(expected).max() > 0.02


def test_one_cycle_of_iterations_reduces_every_error() -> None:
    """In the norm of the symmetric operator's eigenvectors, which is that of the points."""
    boxes, _ = make_boxes(seed=30)
    for seed in range(35, 40):
        error = in_frame(boxes, random_field(boxes, seed))
        left = solved_by_iterations(boxes, np.zeros(boxes.shape[CELL]), 6, 1, error)
        assert np.linalg.norm(left) < 0.6 * np.linalg.norm(error)
        assert with_halo(left, boxes, CELL).any()
