"""Sums over cells on tiles, against sums over whole boxes."""

from dataclasses import dataclass, field

import numpy as np
import pytest
from numpy.typing import NDArray

from morphosim.kernels.layout import Boxes, Interaction, TileLists, Tiles
from morphosim.kernels.tiles import (
    SHIFTS,
    TILE_POINTS,
    TILE_SHAPE,
    accumulate,
    enumerate_covered,
    gather,
)

from .example_boxes import both_ways, box, make_boxes, positions, seen_from, taken

G = np.float64(1.6)
TYPES = np.array([0, 1, 1, 2])
PULL = np.array([[0.4, 0.0, 0.1], [0.7, 0.3, 0.2], [0.5, 0.6, 0.9]])
"""pull[j, i]; one of them zero."""


@dataclass
class Cover:
    """Tiles under the boxes: their coordinates cell by cell, and which of them exist."""

    boxes: Boxes
    way: str
    cover_start: NDArray = field(init=False)
    covered: NDArray = field(init=False)
    slots: dict = field(init=False)

    def __post_init__(self) -> None:
        origin, shape = self.boxes.origin, self.boxes.shape
        counts = ((origin + shape - 1) >> SHIFTS) - (origin >> SHIFTS) + 1
        ends = np.cumsum(counts.prod(axis=1))
        self.cover_start = np.concatenate([[0], ends[:-1]])
        self.covered = np.full((ends[-1], 3), 999)
        taken(enumerate_covered, self.way)(origin, counts, self.cover_start, self.covered)
        # Leave out every fifth tile: where a tile is missing, nothing is felt.
        tiles = sorted({tuple(tile) for tile in self.covered.tolist()})
        present = [tile for k, tile in enumerate(tiles) if k % 5]
        self.slots = {tile: slot for slot, tile in enumerate(present)}

    def lists(self) -> TileLists:
        """Cells over each tile that exists, for two threads."""
        bounds = np.append(self.cover_start, len(self.covered))
        over = {tile: [] for tile in self.slots}
        for i in range(len(self.cover_start)):
            for tile in map(tuple, self.covered[bounds[i] : bounds[i + 1]].tolist()):
                if tile in over:
                    over[tile].append(i)
        sizes = [len(cells) for cells in over.values()]
        return TileLists(
            bounds=np.array([0, len(sizes) // 3, len(sizes)]),
            slot=np.arange(len(sizes)),
            corner=np.array(list(self.slots)) * TILE_SHAPE,
            cell_start=np.cumsum([0, *sizes]),
            cells=np.array([i for cells in over.values() for i in cells]),
        )

    def tiles(self, background: bool, n_types: int) -> Tiles:
        """Sums not yet made; the background is random."""
        n = len(self.slots) * TILE_POINTS
        rng = np.random.default_rng(10)
        return Tiles(
            cover_start=self.cover_start,
            cover=np.array([self.slots.get(tuple(tile), -1) for tile in self.covered.tolist()]),
            background=rng.random(n) if background else None,
            repulsion=np.full(n, 1e30),
            potential=np.full(n * n_types, 1e30) if n_types else None,
        )

    def at(self, values: NDArray | None, i: int) -> NDArray:
        """Values by slot at the points of cell i's box; 0 where no tile exists."""
        result = np.zeros(self.boxes.shape[i])
        points = np.broadcast_arrays(*positions(self.boxes, i))
        for index in np.ndindex(result.shape):
            point = np.array([p[index] for p in points])
            slot = self.slots.get(tuple((point // TILE_SHAPE).tolist()))
            if slot is not None:
                place = np.ravel_multi_index(tuple(point % TILE_SHAPE), TILE_SHAPE)
                result[index] = values[slot * TILE_POINTS + place]
        return result


def test_tiles_are_powers_of_two() -> None:
    assert tuple(1 << shift for shift in SHIFTS) == TILE_SHAPE
    assert np.prod(TILE_SHAPE) == TILE_POINTS


@both_ways
def test_covered_tiles_hold_each_box(way: str) -> None:
    boxes, _ = make_boxes(seed=11)
    cover = Cover(boxes, way)
    bounds = np.append(cover.cover_start, len(cover.covered))
    for i in range(len(boxes.start)):
        points = np.stack(np.broadcast_arrays(*positions(boxes, i)), axis=-1).reshape(-1, 3)
        expected = np.unique(points // TILE_SHAPE, axis=0)
        np.testing.assert_array_equal(cover.covered[bounds[i] : bounds[i + 1]], expected)


@both_ways
@pytest.mark.parametrize(
    ("background", "attracts", "pairs"),
    [(True, False, False), (False, True, False), (True, True, True), (False, False, True)],
)
def test_cells_feel_the_others_and_the_background(
    background: bool, attracts: bool, pairs: bool, way: str
) -> None:
    boxes, phi = make_boxes(seed=11)
    cover = Cover(boxes, way)
    tiles = cover.tiles(background, n_types=3 if attracts else 0)
    interaction = Interaction(g=G, types=TYPES, pull=PULL)
    pair_potential = np.random.default_rng(12).random(len(phi)) if pairs else None
    taken(accumulate, way)(cover.lists(), phi, boxes, interaction, tiles)
    exists = np.ones(len(cover.slots) * TILE_POINTS)
    n = len(boxes.start)
    for i in range(n):
        others = {j: seen_from(boxes, phi, j, i) for j in range(n) if j != i}
        size = boxes.shape[i].prod()
        repulsion = np.full(size + 3, np.nan)
        psi = np.full(size + 3, np.nan) if attracts or pairs else None
        taken(gather, way)(i, phi, boxes, interaction, tiles, pair_potential, repulsion, psi)

        felt = cover.at(exists, i) * sum(G * other**2 for other in others.values())
        if background:
            felt += cover.at(tiles.background, i)
        np.testing.assert_allclose(repulsion[:size], felt.ravel(), rtol=1e-12, atol=1e-13)
        if psi is not None:
            pulled = np.zeros(boxes.shape[i])
            if attracts:
                weights = {j: PULL[TYPES[j], TYPES[i]] for j in others}
                pulled += cover.at(exists, i) * sum(weights[j] * others[j] for j in others)
            if pairs:
                pulled += box(pair_potential, boxes, i)
            np.testing.assert_allclose(psi[:size], pulled.ravel(), rtol=1e-12, atol=1e-13)


@both_ways
def test_a_cell_does_not_feel_itself(way: str) -> None:
    """Not even where its field is too faint for the band."""
    boxes, phi = make_boxes(seed=11)
    phi[:] = 0
    boxes.spans[:] = 99, 0
    alone = make_boxes(seed=11)
    nx, ny, _ = boxes.shape[0]
    rows = slice(boxes.row_start[0], boxes.row_start[0] + nx * ny)
    boxes.spans[rows] = alone[0].spans[rows]
    faint = np.random.default_rng(15).random(tuple(boxes.shape[0])) * 1e-3
    box(phi, boxes, 0)[:] = box(alone[1], boxes, 0) + faint
    cover = Cover(boxes, way)
    tiles = cover.tiles(background=False, n_types=3)
    interaction = Interaction(g=G, types=TYPES, pull=PULL)
    taken(accumulate, way)(cover.lists(), phi, boxes, interaction, tiles)
    repulsion, psi = (np.full(boxes.shape[0].prod(), np.nan) for _ in range(2))
    taken(gather, way)(0, phi, boxes, interaction, tiles, None, repulsion, psi)
    np.testing.assert_allclose(repulsion, 0, atol=1e-14)
    np.testing.assert_allclose(psi, 0, atol=1e-14)
