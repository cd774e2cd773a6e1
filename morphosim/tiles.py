"""Which tiles exist: where boxes of two cells meet, or where the confinement acts."""

import numpy as np
from numpy.typing import DTypeLike, NDArray

from morphosim.kernels.layout import TileLists, Tiles
from morphosim.kernels.tiles import SHIFTS, TILE_POINTS, TILE_SHAPE, enumerate_covered
from morphosim.walls import Repulsion

_OFFSET = 1 << 20
"""Added to tile coordinates so that three of them pack into one non-negative int64 key."""
_ABSENT = 1e-6
"""A tile with g_e φ_e² below this everywhere has no confinement."""
Integers = NDArray[np.int64]


def tile_ranges(origin: Integers, shape: Integers) -> tuple[Integers, Integers]:
    """First tile and number of tiles under each box, per axis."""
    first = origin >> np.array(SHIFTS)
    last = (origin + shape - 1) >> np.array(SHIFTS)
    return first, last - first + 1


def pack(tiles: Integers) -> Integers:
    """One key per tile, ordered as (x, y, z) are."""
    shifted = tiles + _OFFSET
    return np.asarray((shifted[:, 0] << 42) | (shifted[:, 1] << 21) | shifted[:, 2])


def unpack(keys: Integers) -> Integers:
    """Tile coordinates of keys."""
    mask = (1 << 21) - 1
    return np.stack([keys >> 42, (keys >> 21) & mask, keys & mask], axis=1) - _OFFSET


class Background:
    """The confinement's g_e φ_e² (see `walls`) on tiles, evaluated once per tile."""

    def __init__(self, repulsion: Repulsion, spacing: float, dtype: DTypeLike) -> None:
        self._repulsion, self._spacing, self._dtype = repulsion, spacing, np.dtype(dtype)
        self._known: dict[int, NDArray[np.floating] | None] = {}

    def require(self, keys: Integers) -> NDArray[np.bool_]:
        """Evaluate tiles not yet known; tell in which of `keys` the confinement acts."""
        new = np.array([key for key in keys.tolist() if key not in self._known], np.int64)
        for part in np.array_split(new, max(1, len(new) // 512)):
            if len(part):
                self._evaluate(part)
        return np.array([self._known[key] is not None for key in keys.tolist()], bool)

    def stack(self, keys: Integers) -> NDArray[np.floating]:
        """Flat values of these tiles, zero where the confinement is absent."""
        result = np.zeros((len(keys), TILE_POINTS), self._dtype)
        for k, key in enumerate(keys.tolist()):
            values = self._known[key]
            if values is not None:
                result[k] = values
        return result.ravel()

    def _evaluate(self, keys: Integers) -> None:
        corners = unpack(keys) << np.array(SHIFTS)
        axes = []
        for axis, n in enumerate(TILE_SHAPE):
            shape = [len(keys), 1, 1, 1]
            shape[axis + 1] = n
            points = corners[:, axis, None] + np.arange(n)
            axes.append((points * self._spacing).reshape(shape))
        values = np.broadcast_to(self._repulsion(*axes), (len(keys), *TILE_SHAPE))
        if not np.isfinite(values).all():
            message = "the confinement's field is not finite everywhere; φ_e must be 0 … 1"
            raise ValueError(message)
        acts = values.reshape(len(keys), -1).max(axis=1) > _ABSENT
        for key, tile, present in zip(keys.tolist(), values, acts, strict=True):
            self._known[key] = tile.ravel().astype(self._dtype) if present else None


class TileCover:
    """The tiles of the present boxes, rebuilt when a box covers other tiles than before.

    Parameters
    ----------
    dtype : type of the fields
    threads : number of threads that share the tiles
    n_types : cell types with accumulated potentials; 0 without attraction by type
    background : Background or None
    """

    def __init__(
        self, dtype: DTypeLike, threads: int, n_types: int, background: Background | None
    ) -> None:
        self._dtype = np.dtype(dtype)
        self._threads, self._n_types, self._background = threads, n_types, background
        self._first = self._counts = np.zeros((0, 3), np.int64)
        self._pools: dict[str, NDArray[np.floating]] = {}

    def update(self, origin: Integers, shape: Integers) -> None:
        """Make `tiles` and `lists` fit the boxes."""
        first, counts = tile_ranges(origin, shape)
        if np.array_equal(first, self._first) and np.array_equal(counts, self._counts):
            return
        self._first, self._counts = first, counts
        per_cell = counts.prod(axis=1)
        cover_start = np.concatenate([[0], np.cumsum(per_cell)]).astype(np.int64)
        covered = np.empty((cover_start[-1], 3), np.int64)
        enumerate_covered(origin, counts, cover_start, covered)
        owners = np.repeat(np.arange(len(origin)), per_cell)
        keys, inverse, uses = np.unique(pack(covered), return_inverse=True, return_counts=True)
        needed = uses > 1
        if self._background is not None:
            needed |= self._background.require(keys)
        slots = np.where(needed, np.cumsum(needed) - 1, -1)
        cover = slots[inverse]
        self.lists = self._make_lists(keys[needed], cover, owners)
        self.tiles = Tiles(
            cover_start=cover_start[:-1],
            cover=cover,
            background=None if self._background is None else self._background.stack(keys[needed]),
            repulsion=self._pool("repulsion", int(needed.sum())),
            potential=(
                self._pool("potential", int(needed.sum()) * self._n_types)
                if self._n_types
                else None
            ),
        )

    @property
    def nbytes(self) -> int:
        """Bytes of the tiles' sums."""
        background = 0 if self.tiles.background is None else self.tiles.background.nbytes
        return background + sum(pool.nbytes for pool in self._pools.values())

    def _pool(self, name: str, tiles: int) -> NDArray[np.floating]:
        pool = self._pools.get(name)
        if pool is None or len(pool) < tiles * TILE_POINTS:
            pool = np.zeros((tiles + tiles // 8) * TILE_POINTS, self._dtype)
            self._pools[name] = pool
        return pool

    def _make_lists(self, keys: Integers, cover: Integers, owners: Integers) -> TileLists:
        """Cells over each active tile, in the order of their numbers."""
        order = np.argsort(cover, kind="stable")
        order = order[np.searchsorted(cover[order], 0) :]
        cell_start = np.searchsorted(cover[order], np.arange(len(keys) + 1))
        share = np.linspace(0, len(order), self._threads + 1)
        return TileLists(
            bounds=np.searchsorted(cell_start, share).astype(np.int64),
            slot=np.arange(len(keys)),
            corner=unpack(keys) << np.array(SHIFTS),
            cell_start=cell_start.astype(np.int64),
            cells=owners[order],
        )
