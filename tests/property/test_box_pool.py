"""Boxes that come, go and move: fields stay what they are, and nothing gets lost uncounted."""

from dataclasses import dataclass

import numpy as np
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule
from numpy.typing import NDArray

from morphosim.cell_table import CellTable
from morphosim.engine.box_pool import COLUMNS, MOST_FREE, BoxPool, Slots
from morphosim.kernels.boxes import TOTAL
from morphosim.kernels.layout import Limits

TOLERANCE = 1e-2
SEEDS = st.integers(0, 2**32 - 1)


@dataclass(frozen=True)
class Expected:
    """What a cell's box should hold.

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
    ends = start + [Slots.capacity(int(n)) for n in size]
    return bool((ends[order][:-1] > start[order][1:]).any() or (ends > end).any())


class Pools(RuleBasedStateMachine):
    """A pool, and beside it what each of its boxes should hold."""

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
        idle = self.pool._slots.end - sum(map(Slots.capacity, self.pool.sizes().tolist()))
        assert idle <= MOST_FREE * self.pool._slots.end

    def change(self, i: int, phi: NDArray[np.float64]) -> None:
        """Give a cell another field in its box; its history is twice the field."""
        self.pool.box(i)[:] = phi
        self.pool.box(i, self.pool.history)[:] = 2 * phi
        given = phi.sum() + self.pool.lost[i]
        self.pool.survey(np.array([i]))
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
        for i, (first, shape) in enumerate(
            zip(self.pool.plane_start, self.pool.shape, strict=True)
        ):
            rows = self.pool.band[first : first + shape[0]]
            y = np.arange(shape[1])
            banded = (y >= rows[:, :1]) & (y < rows[:, 1:])
            assert banded[(np.abs(self.pool.box(i)) > TOLERANCE).any(axis=2)].all()

    @invariant()
    def sizes_are_few(self) -> None:
        assert (self.pool.shape % 2 == 0).all()

    @invariant()
    def stretches_do_not_overlap(self) -> None:
        pool = self.pool
        assert not stretches_overlap(pool.start, pool.sizes(), len(pool.phi))
        assert not stretches_overlap(pool.plane_start, pool.shape[:, 0], len(pool.band))

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
