"""Sums over cells on columns, against sums over whole boxes."""

import numpy as np
import pytest
from numpy.typing import NDArray

from morphosim.kernels.columns import ROWS, SHIFT, WIDTH, accumulate, gather, lay_tiles
from morphosim.kernels.frames import HALO, frame_size
from morphosim.kernels.layout import Boxes

from .example_boxes import (
    ORIGINS,
    both_ways,
    empty_frame,
    empty_spans,
    held,
    in_band,
    loaded,
    make_boxes,
    put,
    read_by,
    set_band,
    spread_out,
    taken,
    with_halo,
)
from .example_columns import SPACE, TYPES, Cover, G, interaction

CELLS = range(len(ORIGINS))


def test_columns_are_powers_of_two() -> None:
    assert WIDTH == 1 << SHIFT
    assert ROWS == WIDTH**2


def test_the_example_has_columns_above_each_other_and_some_that_do_not_exist() -> None:
    cover = Cover(make_boxes(seed=11)[0])
    places = [place for place, _, _ in cover.extents]
    assert len(set(places)) < len(places)
    assert min(len(found) for found in cover.under) > 1
    assert min(cover.start) == -1
    # One row of columns under a box that begins left of 0 in the lattice, one right of it.
    assert min(place[0] for place in places) < 0 < max(place[0] for place in places)


def make_pair_potential(boxes: Boxes) -> tuple[NDArray, NDArray]:
    """Where the frames of pulled cells start (cell 2 is not pulled), and their pool."""
    sizes = [0 if i == 2 else frame_size(i, boxes) + 7 for i in CELLS]
    ends = np.cumsum(sizes)
    start = np.where(np.array(sizes) > 0, ends - sizes, -1)
    return start, np.random.default_rng(12).random(ends[-1])


@both_ways
@pytest.mark.parametrize("whole", [True, False])
@pytest.mark.parametrize(
    ("background", "attracts", "pairs", "fields"),
    [
        (True, False, False, 0), (False, True, False, 0), (True, True, True, 2),
        (False, False, True, 0), (False, True, False, 1),
    ],
)  # fmt: skip
def test_cells_feel_the_others_and_space(
    background: bool, attracts: bool, pairs: bool, fields: int, whole: bool, way: str
) -> None:
    boxes, phi = make_boxes(seed=11, whole=whole)
    cover = Cover(boxes)
    columns = cover.columns(background, 3 + fields if attracts else 0, fields)
    pairs_start, pool = make_pair_potential(boxes) if pairs else (None, None)
    taken(accumulate, way)(cover.shares(), cover.lists(), phi, boxes, interaction(fields), columns)
    assert np.isnan(columns.repulsion[cover.between()]).all()
    for i in CELLS:
        repulsion = np.full(held(boxes, i).sum() + 3, np.nan)
        psi = empty_frame(boxes, i) if attracts or pairs else None
        taken(gather, way)(
            i, boxes, whole, interaction(fields), columns, pairs_start, pool,
            loaded(boxes, i, phi, whole), repulsion, psi, empty_spans(boxes, i),
        )  # fmt: skip
        worked = in_band(boxes, i, whole)
        expected = cover.felt_repulsion(phi, columns, i)[HALO:-HALO, HALO:-HALO, HALO:-HALO]
        found = spread_out(repulsion, boxes, i)
        np.testing.assert_allclose(found[worked], expected[worked], rtol=1e-12, atol=1e-13)
        assert np.isnan(repulsion[-3:]).all()
        if psi is not None:
            found, near = with_halo(psi, boxes, i), read_by(worked)
            expected = np.zeros(found.shape)
            if attracts:
                expected += cover.felt_potential(phi, i)
            for k in range(fields):
                expected += SPACE[k, TYPES[i]] * cover.at(columns.field[k], i)
            if pairs and pairs_start[i] >= 0:
                expected += with_halo(pool[pairs_start[i] :], boxes, i)
            np.testing.assert_allclose(found[near], expected[near], rtol=1e-12, atol=1e-13)


@both_ways
def test_a_span_of_less_than_a_block_is_felt(way: str) -> None:
    """As ghost cells have, of which a part is known: also if it is one point."""
    boxes, phi = make_boxes(seed=11)
    spans = np.zeros((8, 10, 2), int)
    spans[3, 4], spans[4, 4], spans[5, 5] = (3, 10), (7, 8), (2, 17)
    phi[boxes.start[1] :][:2000] = np.nan
    set_band(boxes, 1, spans)
    put(phi, boxes, 1, np.random.default_rng(16).uniform(1, 2, boxes.shape[1]))
    cover = Cover(boxes, absent=0)
    columns = cover.columns(background=False, n_types=3)
    taken(accumulate, way)(cover.shares(), cover.lists(), phi, boxes, interaction(), columns)
    repulsion, psi = np.full(held(boxes, 0).sum(), np.nan), empty_frame(boxes, 0)
    gather(
        0, boxes, False, interaction(), columns, None, None, loaded(boxes, 0, phi), repulsion, psi,
        empty_spans(boxes, 0),
    )  # fmt: skip
    worked, near = in_band(boxes, 0), read_by(in_band(boxes, 0))
    expected = cover.felt_repulsion(phi, columns, 0)[HALO:-HALO, HALO:-HALO, HALO:-HALO]
    found = spread_out(repulsion, boxes, 0)
    np.testing.assert_allclose(found[worked], expected[worked], rtol=1e-12, atol=1e-13)
    expected = cover.felt_potential(phi, 0)
    np.testing.assert_allclose(
        with_halo(psi, boxes, 0)[near], expected[near], rtol=1e-12, atol=1e-13
    )


@both_ways
@pytest.mark.parametrize("whole", [True, False])
def test_a_cell_does_not_feel_itself(whole: bool, way: str) -> None:
    """Not even where its field is too faint for the band."""
    boxes, phi = make_boxes(seed=11, whole=whole)
    for i in CELLS:
        if i != 2:
            set_band(boxes, i, 0, whole)
    band = np.zeros((14, 8, 2), int)
    band[:10, 2:5] = (0, 22) if whole else (3, 20)
    set_band(boxes, 2, band, whole)
    put(phi, boxes, 2, np.random.default_rng(15).random(boxes.shape[2]))
    cover = Cover(boxes, absent=0)
    columns = cover.columns(background=False, n_types=3)
    taken(accumulate, way)(cover.shares(), cover.lists(), phi, boxes, interaction(), columns)
    assert np.nanmax(columns.repulsion) > 0.5 * G
    repulsion, psi = np.full(held(boxes, 2).sum(), np.nan), empty_frame(boxes, 2)
    taken(gather, way)(
        2, boxes, whole, interaction(), columns, None, None, loaded(boxes, 2, phi, whole),
        repulsion, psi, empty_spans(boxes, 2),
    )  # fmt: skip
    near = read_by(in_band(boxes, 2, whole))
    np.testing.assert_allclose(repulsion, 0, atol=1e-14)
    np.testing.assert_allclose(with_halo(psi, boxes, 2)[near], 0, atol=1e-14)


def test_a_cell_without_columns_feels_nothing() -> None:
    for whole in (True, False):
        boxes, phi = make_boxes(seed=11, whole=whole)
        cover = Cover(boxes, absent=1)
        columns = cover.columns(background=False, n_types=3)
        assert not columns.felt.any()
        repulsion, psi = np.full(held(boxes, 0).sum(), np.nan), empty_frame(boxes, 0)
        gather(
            0, boxes, whole, interaction(), columns, None, None, loaded(boxes, 0, phi, whole),
            repulsion, psi, empty_spans(boxes, 0),
        )  # fmt: skip
        assert (with_halo(psi, boxes, 0)[read_by(in_band(boxes, 0, whole))] == 0).all()
        assert (repulsion == 0).all()


def test_the_sums_do_not_depend_on_the_lists() -> None:
    boxes, phi = make_boxes(seed=11)
    cover = Cover(boxes)
    results = []
    for threads in (1, 2, 7):
        columns = cover.columns(background=True, n_types=3)
        accumulate(cover.shares(threads), cover.lists(), phi, boxes, interaction(), columns)
        results.append(np.concatenate([columns.repulsion, columns.potential]))
    np.testing.assert_array_equal(results[0], results[1])
    np.testing.assert_array_equal(results[0], results[2])
    assert np.isfinite(results[0]).any()


@both_ways
def test_columns_are_laid_of_tiles(way: str) -> None:
    tiles = np.random.default_rng(23).uniform(1, 2, (4, ROWS, 3))
    columns = [[1, -1], [], [3, 3, 0]]
    out = np.full(5 * tiles[0].size, np.nan)
    slots, depth = np.array([k for column in columns for k in column]), [len(c) for c in columns]
    taken(lay_tiles, way)(tiles, slots, np.array(depth), out)
    known = dict(enumerate(tiles)) | {-1: np.zeros_like(tiles[0])}
    laid = [np.hstack([known[k] for k in column]).ravel() for column in columns if column]
    np.testing.assert_array_equal(out, np.concatenate(laid))
