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


def pool_of() -> BoxPool:
    limits = Limits(*np.array([1e-3, 4.0, 0.5]))
    cells = CellTable(COLUMNS)
    pool = BoxPool(cells, np.float64, limits, "history", False)
    axes = np.meshgrid(*[np.arange(24.0)] * 3, indexing="ij")
    distance = np.sqrt(sum((x - 11.5) ** 2 for x in axes))
    ball = 0.5 * (1 + np.tanh(6 - distance))
    rows = cells.add({"name": ["a", "b"]}, ["", ""])
    pool.lay(rows, [(np.zeros(3, np.int64), ball), (np.array([30, 2, 3]), ball)])
    return pool


@pytest.mark.parametrize("way", ["compiled", "python"])
def test_messages_bring_the_rows_of_the_band(way: str) -> None:
    kernels = (pack, unpack) if way == "compiled" else (pack.py_func, unpack.py_func)
    source = pool_of()
    first, end = source.origin[1] + (0, 1, 4), source.origin[1] + (6, 14, 11)
    part = Portion(np.array([1]), *(v[None] for v in (first, end - first, first, end)))
    room = np.zeros(size_of(part, source.dtype), np.uint8)
    sent = Parcel(part, np.array([1]), source.origin[[1]], room, source.dtype)
    count = kernels[0](
        sent.places, sent.low, sent.high, source.phi, source.boxes, sent.rows, sent.values
    )
    goal = pool_of()
    goal.arrange(np.array([0]), np.array([0]), np.stack([goal.origin[0], first]),
                 np.stack([goal.shape[0], end - first]))  # fmt: skip
    got = Parcel(part, np.array([1]), first[None], room.copy(), goal.dtype)
    kernels[1](got.places, got.low, got.high, goal.phi, goal.boxes, got.rows, got.values)
    rows = goal.band[goal.plane_start[1] : goal.plane_start[1] + 6]
    band = source.band[source.plane_start[1] : source.plane_start[1] + 6]
    np.testing.assert_array_equal(rows, np.clip(band, 1, 14) - 1)
    inside = (np.arange(13) >= rows[:, :1]) & (np.arange(13) < rows[:, 1:])
    assert 0 < inside.sum() < inside.size
    assert count == 7 * inside.sum()
    expected = source.box(1)[0:6, 1:14, 4:11] * inside[:, :, None]
    np.testing.assert_array_equal(goal.box(1), expected)


def test_a_message_may_be_of_a_part_of_the_box_that_takes_it() -> None:
    source, goal = pool_of(), pool_of()
    goal.box(1)[:] = 0
    low, high = np.array([[1, 3, 4]]), np.array([[6, 14, 11]])
    rows, values = np.zeros((5, 2), np.int32), np.zeros(5 * 11 * 7)
    cells = np.array([1])
    pack(cells, low, high, source.phi, source.boxes, rows, values)
    unpack(cells, low, high, goal.phi, goal.boxes, rows, values)
    first = source.plane_start[1]
    sent, got = (pool.band[first + 1 : first + 6] for pool in (source, goal))
    np.testing.assert_array_equal(got, np.clip(sent, 3, 14))
    part = (slice(1, 6), slice(3, 14), slice(4, 11))
    inside = (np.arange(3, 14) >= got[:, :1]) & (np.arange(3, 14) < got[:, 1:])
    expected = np.zeros_like(source.box(1))
    expected[part] = source.box(1)[part] * inside[:, :, None]
    np.testing.assert_array_equal(goal.box(1), expected)


def test_arrange_keeps_fields_and_empties_new_boxes() -> None:
    pool = pool_of()
    field, origin, shape = pool.box(1).copy(), pool.origin[1].copy(), pool.shape[1].copy()
    pool.lost[1] = 7.0
    pool.arrange(np.array([1]), np.array([2]), np.stack([origin] * 3), np.stack([shape] * 3))
    np.testing.assert_array_equal(pool.box(2), field)
    assert pool.lost.tolist() == [0, 0, 7]
    assert not pool.box(0).any()
    assert not pool.box(1).any()


def test_states_are_put_together_as_they_were() -> None:
    pool = pool_of()
    columns = pool.cells.select(np.arange(2), [c.name for c in COLUMNS if c.saved])
    state = pool.contents() | columns | {"face_peak": np.array([0.1, 0.2])}
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
