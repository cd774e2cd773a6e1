"""Boxes that come, go and move: fields stay what they are, and nothing gets lost uncounted."""

from dataclasses import dataclass

import numpy as np
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule
from numpy.typing import NDArray

from morphosim.cell_table import CellTable
from morphosim.engine.box_pool import COLUMNS, MOST_FREE, BoxPool, Slots, _grown
from morphosim.kernels.boxes import N_SURVEYED, TOTAL
from morphosim.kernels.layout import Limits
from morphosim.kernels.rows import BLOCK, N_SPANS, n_listed
from morphosim.kernels.step import accept_band, accept_box, keep_history

TOLERANCE = 1e-2
SEEDS = st.integers(0, 2**32 - 1)


@dataclass(frozen=True)
class Expected:
    """What should be held of a cell.

    Attributes
    ----------
    origin : lattice position of the first point of `phi`
    phi : the field; what does not exceed the tolerance may be cut off
    given : Σ φ
    memory : the history is this many times the field
    """

    origin: NDArray[np.int64]
    phi: NDArray[np.float64]
    given: float
    memory: float


def new_pool(band_only: bool) -> BoxPool:
    """A pool of fields in double precision with histories."""
    limits = Limits(*np.array([TOLERANCE, 4.0, 0.5]))
    return BoxPool(CellTable(COLUMNS), np.float64, limits, "history", band_only)


def add(pool: BoxPool, fields: list[tuple[NDArray, NDArray]]) -> None:
    """New cells, with names of their own."""
    names = [str(pool.cells.next_id + k) for k in range(len(fields))]
    pool.lay(pool.cells.add({"name": names}, [""] * len(fields)), fields)


def hold(pool: BoxPool, chosen: list[int]) -> None:
    """Keep some cells alone, in this order, as a saved state would bring them back."""
    rows, columns = np.array(chosen), pool.cells.saved()
    fields = pool.contents(rows)
    pool.cells.restore(
        columns | {name: columns[name][rows] for name in columns.keys() - {"kinds", "next_id"}}
    )
    pool.restore(fields)


def blob(rng: np.random.Generator, shape: NDArray[np.int64]) -> NDArray[np.float64]:
    """A field that exceeds the tolerance in a random part of a box, whose faces it may touch."""
    low = rng.integers(0, shape)
    high = rng.integers(low + 1, shape + 1)
    field = rng.uniform(-TOLERANCE, TOLERANCE, shape) * (rng.random(shape) < rng.random())
    inside = tuple(slice(a, b) for a, b in zip(low, high, strict=True))
    field[inside] = rng.uniform(2 * TOLERANCE, 1, high - low)
    return field


def stretches_overlap(start: NDArray[np.int64], size: NDArray[np.int64], end: int) -> bool:
    """Whether two stretches of a pool share a place, or one lies beyond its end."""
    order = np.argsort(start)
    ends = start + size
    return bool((ends[order][:-1] > start[order][1:]).any() or (ends > end).any())


def step(pool: BoxPool, i: int, phi: NDArray[np.float64], history: NDArray[np.float64]) -> None:
    """Give a cell another field, as far as it is held, and survey it: as the end of a step does."""
    boxes, out = pool.boxes, np.zeros(N_SURVEYED)
    nx, ny, _ = pool.shape[i]
    if not pool.band_only:
        found = np.zeros((nx, 2), np.int32)
        assert accept_box(i, pool.phi, phi.ravel(), boxes, pool.limits, found, out, pool.surveys)
        keep_history(i, pool.history, boxes, history.ravel())
        return
    spans, there = np.zeros((N_SPANS, n_listed.py_func(nx, ny)), np.int16), in_band(pool, i)
    accept_band(
        i, pool.phi, pool.history, phi[there], history[there], boxes, pool.room[i], pool.limits,
        spans, out, pool.surveys, pool.lost,
    )  # fmt: skip


def in_band(pool: BoxPool, i: int) -> NDArray[np.bool_]:
    """Which points of a cell's box are in its band."""
    z, rows = np.arange(pool.shape[i, 2]), pool.rows_of(i)
    low, high = (ends[rows].reshape(*pool.shape[i, :2], 1) for ends in (pool.low, pool.high))
    return np.asarray((z >= low) & (z < high))


class Pools(RuleBasedStateMachine):
    """A pool, and beside it what it should hold of each cell."""

    @initialize(band_only=st.booleans())
    def begin(self, band_only: bool) -> None:
        self.pool, self.cells = new_pool(band_only), list[Expected]()

    @rule(seed=SEEDS, count=st.integers(1, 3))
    def add(self, seed: int, count: int) -> None:
        rng = np.random.default_rng(seed)
        fields = [
            (rng.integers(-50, 50, 3), blob(rng, rng.integers(6, 20, 3))) for _ in range(count)
        ]
        add(self.pool, fields)
        self.cells += [Expected(origin, phi, phi.sum(), 0) for origin, phi in fields]

    @precondition(lambda self: self.cells)
    @rule(data=st.data())
    def remove(self, data: st.DataObject) -> None:
        i = data.draw(st.integers(0, len(self.cells) - 1))
        self.pool.release(np.array([i]))
        self.pool.cells.remove(i)
        del self.cells[i]

    @precondition(lambda self: self.cells)
    @rule(seeds=st.lists(SEEDS, min_size=1, max_size=3), all_move=st.booleans())
    def step(self, seeds: list[int], all_move: bool) -> None:
        """Change some fields, as a step does, and lay the boxes anew where that needs it."""
        chosen = {seed % len(self.cells): seed for seed in seeds}
        for i, seed in chosen.items():
            self.change(i, blob(np.random.default_rng(seed), self.pool.shape[i]))
        moving = range(len(self.cells)) if all_move else sorted(chosen)
        self.pool.refit(np.array(moving))
        idle = self.pool._slots.end - self.pool.room.sum()
        assert idle <= MOST_FREE * self.pool._slots.end

    def change(self, i: int, phi: NDArray[np.float64]) -> None:
        """Give a cell another field on what is held of its box; its history is twice the field."""
        phi = np.where(in_band(self.pool, i), phi, 0) if self.pool.band_only else phi
        given = phi.sum() + self.pool.lost[i]
        step(self.pool, i, phi, 2 * phi)
        self.cells[i] = Expected(self.pool.origin[i].copy(), phi, given, 2)

    @precondition(lambda self: self.cells)
    @rule(data=st.data())
    def restore(self, data: st.DataObject) -> None:
        """Hold some of the cells, in another order."""
        everyone = st.permutations(range(len(self.cells)))
        chosen = data.draw(everyone)[: data.draw(st.integers(1, len(self.cells)))]
        hold(self.pool, chosen)
        self.cells = [self.cells[k] for k in chosen]

    @invariant()
    def every_field_is_intact(self) -> None:
        assert len(self.pool) == len(self.cells)
        for i, cell in enumerate(self.cells):
            held = seen(cell, self.pool.origin[i], self.pool.box(i))
            history = seen(cell, self.pool.origin[i], self.pool.box(i, self.pool.history))
            cut = held == 0
            assert (np.abs(cell.phi[cut]) <= TOLERANCE).all()
            np.testing.assert_array_equal(held[~cut], cell.phi[~cut])
            np.testing.assert_array_equal(history, cell.memory * held)

    @invariant()
    def bands_hold_what_exceeds_the_tolerance(self) -> None:
        for i in range(len(self.pool)):
            assert in_band(self.pool, i)[np.abs(self.pool.box(i)) > TOLERANCE].all()

    @invariant()
    def spans_are_blocks_or_longer(self) -> None:
        """Or none; all of their rows where the whole boxes are held."""
        for i, shape in enumerate(self.pool.shape):
            rows = self.pool.rows_of(i)
            length = (self.pool.high - self.pool.low)[rows]
            least = BLOCK if self.pool.band_only else shape[2]
            assert ((length == 0) | (length >= least)).all()
            places = self.pool.place[rows] + self.pool.low[rows]
            expected = np.cumsum(length) - length
            if not self.pool.band_only:
                expected = np.arange(len(length)) * shape[2]
            np.testing.assert_array_equal(places, expected)

    @invariant()
    def sizes_are_few(self) -> None:
        assert (self.pool.shape % 2 == 0).all()
        assert (self.pool.shape >= [8, 8, BLOCK]).all()

    @invariant()
    def stretches_do_not_overlap(self) -> None:
        pool = self.pool
        assert not stretches_overlap(pool.start, pool.room, len(pool.phi))
        assert len(pool.history) == len(pool.phi)
        for i in range(len(pool)):
            assert pool.stretch(i).stop <= pool.start[i] + pool.room[i]
        rows = np.array([Slots.capacity(int(n)) for n in pool.shape[:, :2].prod(axis=1)], np.int64)
        for values in (pool.low, pool.high, pool.place):
            assert not stretches_overlap(pool.row_start, rows, len(values))

    @invariant()
    def lost_and_kept_are_what_was_given(self) -> None:
        for i, cell in enumerate(self.cells):
            kept = self.pool.box(i).sum()
            np.testing.assert_allclose(kept + self.pool.lost[i], cell.given, rtol=1e-12, atol=1e-12)
            np.testing.assert_allclose(self.pool.surveys[i, TOTAL], kept, rtol=1e-12, atol=1e-12)


def seen(cell: Expected, origin: NDArray[np.int64], box: NDArray) -> NDArray[np.float64]:
    """A box's values where a cell was given its field, 0 beyond the box; it has none elsewhere."""
    low = np.minimum(origin, cell.origin)
    shape = np.maximum(origin + box.shape, cell.origin + cell.phi.shape) - low
    values = np.zeros(shape)
    values[part(origin - low, box.shape)] = box
    here = part(cell.origin - low, cell.phi.shape)
    result = values[here].copy()
    values[here] = 0
    assert not values.any(), "a value where none was given"
    return result


def part(first: NDArray[np.int64], shape: tuple[int, ...]) -> tuple[slice, ...]:
    """Where an array of this shape lies in a larger one."""
    return tuple(slice(a, a + n) for a, n in zip(first, shape, strict=True))


TestPools = Pools.TestCase
TestPools.settings = settings(max_examples=settings().max_examples // 2, stateful_step_count=20)


def test_pools_grow_at_once_to_what_is_expected() -> None:
    held = np.arange(4.0)
    assert len(_grown(np.zeros(0), 8, 50.0)) == 8  # the first cells may be all
    assert len(_grown(held, 8, 1.0)) == 12
    wide = _grown(held, 8, 50.0)
    assert len(wide) == 440
    np.testing.assert_array_equal(wide[:5], [0, 1, 2, 3, 0])
    counted = new_pool(band_only=True)
    counted.expected = 640
    assert counted._more == 10
