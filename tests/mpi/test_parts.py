"""What needs no ranks: owners, neighbours, messages, and what is missing."""

import sys

import numpy as np
import pytest
from numpy.typing import NDArray

from morphosim.bench import packed_points
from morphosim.cell_table import CellTable
from morphosim.engine.box_pool import COLUMNS, BoxPool
from morphosim.kernels.layout import Limits
from morphosim.kernels.messages import pack, unpack
from morphosim.mpi import distributed_simulation
from morphosim.mpi import state_transfer as contents
from morphosim.mpi.communicator import world
from morphosim.mpi.decompose import owners, work
from morphosim.mpi.ghost_exchange import Parcel, size_of
from morphosim.mpi.ghost_regions import Portion, Reach, portions


def boxes(seed: int, count: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    rng = np.random.default_rng(seed)
    return rng.integers(-60, 120, (count, 3)), 2 * rng.integers(4, 12, (count, 3))


@pytest.mark.parametrize("ranks", [1, 2, 3, 4, 7, 16])
def test_owners_share_out_the_work_by_space(ranks: int) -> None:
    points = packed_points(640, 4.0)
    owner = owners(points, np.ones(640), ranks)
    counts = np.bincount(owner, minlength=ranks)
    assert counts.min() >= 0.9 * 640 / ranks - 1
    assert counts.max() <= 1.1 * 640 / ranks + 1
    spread = [np.ptp(points[owner == r], axis=0).prod() for r in range(ranks)]
    assert sum(spread) < 1.1 * np.ptp(points, axis=0).prod()


def test_owners_give_every_rank_a_cell() -> None:
    weight = np.array([100.0, 1, 1, 1])
    owner = owners(np.arange(12.0).reshape(4, 3), weight, 4)
    assert sorted(owner) == [0, 1, 2, 3]
    with pytest.raises(ValueError, match="4 cells on 5 ranks"):
        owners(np.zeros((4, 3)), weight, 5)


def test_frozen_cells_weigh_less() -> None:
    shape = np.full((2, 3), 10)
    assert work(shape, np.array([False, True])).tolist() == [1000, 100]


def test_pairs_are_all_that_have_a_tile_in_common() -> None:
    origin, shape = boxes(0, 80)
    origin[1], shape[1] = origin[0], shape[0]
    reach = Reach.of(origin, shape)
    mine, others = np.arange(0, 80, 2), np.arange(1, 80, 2)
    a, b = reach.pairs(mine, others)
    common = (reach.first[:, None] < reach.end[None]) & (reach.first[None] < reach.end[:, None])
    expected = [(i, j) for i in mine for j in others if common.all(axis=2)[i, j]]
    assert sorted(zip(a, b, strict=True)) == expected
    assert 0 < len(expected) < 40 * 40


def test_what_one_rank_sends_is_what_the_other_expects() -> None:
    origin, shape = boxes(1, 60)
    owner = owners(origin.astype(float), np.ones(60), 4)
    plans = [portions(origin, shape, owner, rank) for rank in range(4)]
    checked = 0
    for rank, (sends, _) in enumerate(plans):
        for partner, sent in sends.items():
            got = plans[partner][1][rank]
            for name in ("cells", "low", "shape", "first", "end"):
                np.testing.assert_array_equal(getattr(got, name), getattr(sent, name))
            checked += 1
    assert checked >= 6


def test_portion_holds_all_that_is_read_and_lies_in_the_box() -> None:
    origin, shape = boxes(2, 60)
    reach, owner = Reach.of(origin, shape), np.arange(60) % 2
    _, gets = portions(origin, shape, owner, 0)
    got = gets[1]
    assert (got.low >= origin[got.cells]).all()
    assert (got.low + got.shape <= (origin + shape)[got.cells]).all()
    for k, cell in enumerate(got.cells.tolist()):
        for i in np.flatnonzero(owner == 0).tolist():
            low = np.maximum(reach.low[i], origin[cell])
            high = np.minimum(reach.high[i], (origin + shape)[cell])
            if (low < high).all():
                assert (got.first[k] <= low).all()
                assert (got.end[k] >= high).all()


def test_columns_under_a_cell_are_those_of_all_ghost_cells() -> None:
    origin, shape = boxes(3, 60)
    reach, owner = Reach.of(origin, shape), np.arange(60) % 2
    _, gets = portions(origin, shape, owner, 0)
    copies = Reach.of(gets[1].low, gets[1].shape)

    def tiles(reach: Reach, k: int, i: int, whole: Reach) -> tuple[list, list]:
        first = np.maximum(reach.first[k], whole.first[i])
        return first.tolist(), np.minimum(reach.end[k], whole.end[i]).tolist()

    a, b = reach.pairs(np.flatnonzero(owner == 0), np.flatnonzero(owner == 1))
    for i, cell in zip(a.tolist(), b.tolist(), strict=True):
        k = int(np.searchsorted(gets[1].cells, cell))
        assert tiles(copies, k, i, reach) == tiles(reach, cell, i, reach)


def pool_of(band_only: bool, dtype: type = np.float64) -> BoxPool:
    limits = Limits(*np.array([1e-3, 4.0, 0.5], dtype))
    cells = CellTable(COLUMNS)
    pool = BoxPool(cells, dtype, limits, "history", band_only)
    axes = np.meshgrid(*[np.arange(24.0)] * 3, indexing="ij")
    distance = np.sqrt(sum((x - 11.5) ** 2 for x in axes))
    balls = [(0.5 * (1 + np.tanh(radius - distance))).astype(dtype) for radius in (5, 6)]
    rows = cells.add({"name": ["a", "b"]}, ["", ""])
    origins = np.zeros(3, np.int64), np.array([30, 2, 3])
    pool.lay(rows, zip(origins, balls, strict=True))
    return pool


def in_whole_box(pool: BoxPool) -> NDArray:
    """Values of the second cell, which is held as a whole box."""
    start, shape = pool.start[1], pool.shape[1]
    return pool.phi[start : start + shape.prod()].reshape(shape)


def spans(pool: BoxPool, part: tuple[slice, slice]) -> NDArray[np.int64]:
    """Points [low, high) of the second cell's rows in a part of its box, x slowest."""
    rows, shape = pool.rows_of(1), pool.shape[1, :2]
    ends = [values[rows].reshape(shape)[part].ravel() for values in (pool.low, pool.high)]
    return np.stack(ends, axis=1).astype(np.int64)


def cut(spans: NDArray[np.int64], low: int, high: int) -> NDArray[np.int64]:
    """Spans within [low, high); those that are empty are at its begin."""
    inside = np.clip(spans, low, high)
    return np.where(np.diff(inside, axis=1) > 0, inside, low)


@pytest.mark.parametrize("band_only", [False, True])
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@pytest.mark.parametrize("way", ["compiled", "python"])
def test_messages_bring_the_rows_of_the_band(way: str, dtype: type, band_only: bool) -> None:
    kernels = (pack, unpack) if way == "compiled" else (pack.py_func, unpack.py_func)
    source = pool_of(band_only, dtype)
    first, end = source.origin[1] + (0, 1, 1), source.origin[1] + (5, 14, 8)
    part = Portion(np.array([1]), *(v[None] for v in (first, end - first, first, end)))
    room = np.zeros(size_of(part, source.dtype), np.uint8)
    sent = Parcel(part, np.array([1]), source.origin[[1]], room, source.dtype)
    count = kernels[0](
        sent.places, sent.low, sent.high, source.phi, source.boxes, sent.rows, sent.values
    )
    goal = pool_of(band_only, dtype)
    goal.arrange(np.array([0]), np.array([0]), np.stack([goal.origin[0], first]),
                 np.stack([goal.shape[0], end - first]))  # fmt: skip
    got = Parcel(part, np.array([1]), first[None], room.copy(), goal.dtype)
    kernels[1](got.places, got.low, got.high, goal.phi, goal.boxes, got.rows, got.values)
    rows = spans(goal, (slice(None), slice(None)))
    expected = cut(spans(source, (slice(0, 5), slice(1, 14))), 1, 8) - 1
    np.testing.assert_array_equal(rows, expected)
    z = np.arange(7)
    inside = ((z >= rows[:, :1]) & (z < rows[:, 1:])).reshape(5, 13, 7)
    assert 0 < inside.sum() < inside.size
    lengths = np.diff(rows, axis=1)
    assert ((lengths > 0) & (lengths < 7)).any() == band_only
    assert count == inside.sum()
    box = source.box(1)[0:5, 1:14, 1:8]
    assert np.abs(box * inside).max() > 0.01
    np.testing.assert_array_equal(in_whole_box(goal), box * inside)


@pytest.mark.parametrize("band_only", [False, True])
def test_a_message_may_be_of_a_part_of_the_box_that_takes_it(band_only: bool) -> None:
    source, goal = pool_of(band_only), pool_of(band_only)
    goal.arrange(np.array([0]), np.array([0]), goal.origin.copy(), goal.shape.copy())
    low, high = np.array([[1, 3, 1]]), np.array([[6, 14, 8]])
    rows, values = np.zeros((5 * 11, 2), np.int16), np.zeros(5 * 11 * 7)
    cells = np.array([1])
    pack(cells, low, high, source.phi, source.boxes, rows, values)
    unpack(cells, low, high, goal.phi, goal.boxes, rows, values)
    sent, got = (spans(pool, (slice(1, 6), slice(3, 14))) for pool in (source, goal))
    np.testing.assert_array_equal(got, cut(sent, 1, 8))
    part, z = (slice(1, 6), slice(3, 14), slice(1, 8)), np.arange(1, 8)
    inside = ((z >= got[:, :1]) & (z < got[:, 1:])).reshape(5, 11, 7)
    expected = np.zeros_like(source.box(1))
    expected[part] = source.box(1)[part] * inside
    np.testing.assert_array_equal(in_whole_box(goal), expected)


@pytest.mark.parametrize("band_only", [False, True])
def test_arrange_keeps_fields_and_empties_new_boxes(band_only: bool) -> None:
    pool = pool_of(band_only)
    field, origin, shape = pool.box(1).copy(), pool.origin[1].copy(), pool.shape[1].copy()
    pool.lost[1] = 7.0
    pool.arrange(np.array([1]), np.array([2]), np.stack([origin] * 3), np.stack([shape] * 3))
    np.testing.assert_array_equal(pool.box(2), field)
    assert pool.lost.tolist() == [0, 0, 7]
    assert not pool.box(0).any()
    assert not pool.box(1).any()


@pytest.mark.parametrize("band_only", [False, True])
def test_states_are_put_together_as_they_were(band_only: bool) -> None:
    pool = pool_of(band_only)
    columns = pool.cells.select(np.arange(2), [c.name for c in COLUMNS if c.saved])
    state = pool.contents() | columns | {"face_peak": np.array([0.1, 0.2])}
    assert len(set(state["points"].tolist())) == 2
    parts = [contents.select(state, np.array([i])) for i in (1, 0)]
    merged = contents.merge([*parts, {"rows": np.zeros(0, np.int64)}])
    assert merged.keys() == state.keys()
    for name, value in state.items():
        np.testing.assert_array_equal(merged[name], value)


def test_missing_mpi4py_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mpi4py", None)
    with pytest.raises(ImportError, match=r"needs mpi4py .* pip install '\.\[mpi\]'"):
        world()


def test_a_stop_that_comes_while_ranks_are_asked_ends_the_run_a_step_later(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """By another thread; this rank does not end before the others."""
    simulation = object.__new__(distributed_simulation.DistributedSimulation)

    class Ranks:
        def allgather(self, why: str) -> list[str]:
            simulation.stop("meanwhile")
            return ["", why]

    monkeypatch.setattr(distributed_simulation, "world", Ranks)
    assert [simulation._is_stopped() for _ in range(2)] == [False, True]
    assert simulation.stopped == "meanwhile"
