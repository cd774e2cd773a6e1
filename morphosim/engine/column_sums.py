"""Which accumulation columns exist: where frames of two cells meet, or where walls act."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import DTypeLike, NDArray

from morphosim.kernels.columns import ROWS, SHIFT, WIDTH, lay_tiles
from morphosim.kernels.frames import HALO, frame_shapes
from morphosim.kernels.layout import ColumnLists, Columns, Shares
from morphosim.kernels.sharing import equal_shares
from morphosim.physics.term import SpaceTerm

SHIFTS = np.array([SHIFT, SHIFT, 5])
TILE_SHAPE = (WIDTH, WIDTH, 32)
"""Columns consist of such tiles, on which walls are evaluated."""
_BITS = 21
_OFFSET = 1 << (_BITS - 1)
"""Added to tile coordinates so that three of them pack into one non-negative int64 key."""
_ABSENT = 1e-6
"""A tile where R of walls is below this everywhere has no walls."""
_PLACES = 32
"""Bits that hold the place of an entry of the cover."""
MOST_AT_ONCE = 512
"""Tiles on which walls are evaluated together."""
_LAST = np.iinfo(np.int64).max
"""A key beyond those of all tiles."""
Integers = NDArray[np.int64]


def pack(tiles: Integers) -> Integers:
    """One key per tile, ordered as (x, y, z) are; neighbours along z differ by 1."""
    x, y, z = (tiles + _OFFSET).T
    return np.asarray((x << (2 * _BITS)) | (y << _BITS) | z)


def unpack(keys: Integers) -> Integers:
    """Tile coordinates of keys."""
    mask = (1 << _BITS) - 1
    return np.stack([keys >> (2 * _BITS), (keys >> _BITS) & mask, keys & mask], axis=1) - _OFFSET


class Background:
    """Functions of space, R of walls or potentials ψ, on tiles; evaluated once per tile.

    Parameters
    ----------
    given : sequence of SpaceTerm
    spacing : float, µm
    dtype : of the fields
    everywhere : bool
        Whether it acts also where it is about 0, as a potential does, whose gradient counts.
    negative : bool
        Whether it may be.

    Attributes
    ----------
    most : float or None
        Largest value of all functions together, by what they say; None if some do not.
    """

    def __init__(
        self, given: Sequence[SpaceTerm], spacing: float, dtype: DTypeLike,
        everywhere: bool = False, negative: bool = False,
    ) -> None:  # fmt: skip
        self._given, self._spacing = given, spacing
        self._everywhere, self._negative = everywhere, negative
        known = [each.most for each in given if each.most is not None]
        self.most = float(sum(known)) if len(known) == len(given) else None
        self._keys = np.array([_LAST])  # sorted
        self._slots = np.array([-1])
        self._tiles = np.zeros((0, ROWS, TILE_SHAPE[2]), dtype)

    def acts(self, begin: Integers, end: Integers) -> NDArray[np.bool_]:
        """Whether walls act in each column of tiles [begin, end)."""
        depth = end - begin
        slots = self._slots_of(_tiles_of(begin, depth))
        return np.logical_or.reduceat(slots >= 0, np.cumsum(depth) - depth)

    def fill(self, begin: Integers, length: Integers, out: NDArray[np.floating]) -> None:
        """Values of columns (ROWS, length), one after the other, that begin with these tiles."""
        depth = length // TILE_SHAPE[2]
        lay_tiles(self._tiles, self._slots_of(_tiles_of(begin, depth)), depth, out)

    def _slots_of(self, keys: Integers) -> Integers:
        """Places of tiles in `_tiles`; -1 for those where walls do not act."""
        place = np.searchsorted(self._keys, keys)
        unknown = self._keys[place] != keys
        if unknown.any():
            new = np.unique(keys[unknown])
            for part in np.array_split(new, -(-len(new) // MOST_AT_ONCE)):
                self._evaluate(part)
            place = np.searchsorted(self._keys, keys)
        return np.asarray(self._slots[place])

    def _evaluate(self, keys: Integers) -> None:
        corners = unpack(keys) << SHIFTS
        axes = []
        for axis, n in enumerate(TILE_SHAPE):
            shape = [len(keys), 1, 1, 1]
            shape[axis + 1] = n
            points = corners[:, axis, None] + np.arange(n)
            axes.append((points * self._spacing).reshape(shape))
        full = (len(keys), *TILE_SHAPE)
        parts = [
            self._checked(each, np.broadcast_to(each.function(*axes), full)) for each in self._given
        ]
        values = parts[0] if len(parts) == 1 else np.sum(parts, axis=0)
        largest = np.abs(values.reshape(len(keys), -1)).max(axis=1)
        acts = self._everywhere | (largest > _ABSENT)
        slots = np.where(acts, len(self._tiles) + np.cumsum(acts) - 1, -1)
        tiles = values[acts].reshape(-1, *self._tiles.shape[1:]).astype(self._tiles.dtype)
        self._tiles = np.concatenate([self._tiles, tiles])
        order = np.argsort(np.concatenate([self._keys, keys]))
        self._keys = np.concatenate([self._keys, keys])[order]
        self._slots = np.concatenate([self._slots, slots])[order]

    def _checked(self, each: SpaceTerm, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Values of a function; ValueError if they are not finite, or those of a wall negative."""
        if not np.isfinite(values).all():
            message = f"{each.name}: its function of space is not finite everywhere"
            raise ValueError(message)
        if not self._negative and values.min() < 0:
            message = f"{each.name}: its wall is {values.min():g} somewhere; it must be ≥ 0"
            raise ValueError(message)
        return values


def _tiles_of(begin: Integers, depth: Integers) -> Integers:
    """Keys of all tiles of columns that begin with these tiles and have `depth` of them."""
    starts = np.cumsum(depth) - depth
    return np.repeat(begin - starts, depth) + np.arange(depth.sum())


class ColumnCover:
    """The columns of the present boxes, rebuilt when a frame covers other tiles than before.

    Parameters
    ----------
    dtype : type of the fields
    threads : number of threads that share the columns

    Attributes
    ----------
    columns : Columns
    sums : Columns
        Of them what cells feel: what is summed, not what walls and space add to it. So a step is
        compiled once, with walls or without.
    lists : ColumnLists
    shares : Shares
        Of the columns.
    wall : float
        Largest R of walls: by what they say, else on the columns.
    """

    columns: Columns
    sums: Columns
    lists: ColumnLists
    shares: Shares
    wall: float

    def __init__(self, dtype: DTypeLike, threads: int) -> None:
        self._dtype, self._threads = np.dtype(dtype), threads
        self._pools: dict[str, NDArray[np.floating]] = {}
        self.configure(0, None, ())

    def configure(
        self, n_types: int, background: Background | None, fields: Sequence[Background]
    ) -> None:
        """Say what is summed; it holds from the next `update` on, which makes all columns anew.

        Parameters
        ----------
        n_types : cell types with accumulated potentials, and one more for each field
        background : R of walls, or None
        fields : ψ of space
        """
        self._n_types, self._background, self._fields = n_types, background, tuple(fields)
        self._first = self._end = np.zeros((0, 3), np.int64)
        self._low = np.zeros(0, np.int64)

    def update(self, origin: Integers, shape: Integers, cells: int) -> None:
        """Make `columns` and `lists` fit the boxes of so many cells, and after them of images."""
        low = origin - HALO
        first, end = low >> SHIFTS, (low + frame_shapes(shape) - 1 >> SHIFTS) + 1
        same_tiles = np.array_equal(first, self._first) and np.array_equal(end, self._end)
        if same_tiles and np.array_equal(low[:, 2], self._low):
            return
        self._first, self._end, self._low = first, end, low[:, 2].copy()

        # Every column of every frame: whose it is, its place, and its tiles [bottom, top) as keys.
        width = (end - first)[:, :2]
        per_cell = width.prod(axis=1)
        cover_start = np.cumsum(per_cell) - per_cell
        owner = np.repeat(np.arange(len(origin)), per_cell)
        number = np.arange(len(owner)) - cover_start[owner]
        place = first[owner]
        place[:, :2] += np.stack(np.divmod(number, width[owner, 1]), axis=1)
        bottom = pack(place)
        top = bottom + (end - first)[owner, 2]

        # Those that overlap along z hang together.
        order = np.argsort(bottom)  # in whichever order those come that begin alike
        reached = np.maximum.accumulate(top[order])
        opens = np.concatenate([[True], bottom[order][1:] >= reached[:-1]])
        begin = bottom[order][opens]
        final = reached[np.concatenate([np.flatnonzero(opens)[1:] - 1, [len(order) - 1]])]
        group = np.empty(len(owner), np.int64)
        group[order] = np.cumsum(opens) - 1

        needed = np.bincount(group) > 1
        if cells < len(origin):
            needed &= np.bincount(group, owner < cells) > 0
        for space in (self._background, *self._fields):
            if space is not None:
                needed |= space.acts(begin, final)
        length = (final - begin) * TILE_SHAPE[2]
        points = np.where(needed, ROWS * length, 0)
        start = np.where(needed, np.cumsum(points) - points, -1)

        corner = unpack(begin) << SHIFTS
        cover = np.stack(
            [start[group], length[group], low[owner, 2] - corner[group, 2]], axis=1
        ).astype(np.int64)
        felt = np.zeros(len(origin), bool)
        felt[owner[needed[group]]] = True
        rank = np.where(needed, np.cumsum(needed) - 1, -1)
        self.lists = self._make_lists(
            start[needed], length[needed], corner[needed], rank[group], owner
        )
        load = self.lists.length * np.diff(self.lists.cell_start)
        self.shares = equal_shares(load, self._threads)
        self.columns = Columns(
            cover_start=cover_start,
            cover=cover,
            felt=felt,
            background=self._of_walls(begin[needed], length[needed]),
            field=self._of_space(begin[needed], length[needed]),
            repulsion=self._pool("repulsion", int(points.sum())),
            potential=(
                self._pool("potential", int(points.sum()) * self._n_types)
                if self._n_types
                else None
            ),
        )
        self.sums = self.columns._replace(background=None, field=None)
        self._points = int(points.sum())
        self.wall = self._largest_wall()

    @property
    def largest(self) -> float:
        """Largest sum of R at any point, each cell's own share included."""
        return float(self.columns.repulsion[: self._points].max(initial=0.0))

    def _largest_wall(self) -> float:
        if self._background is None:
            return 0.0
        if self._background.most is not None:
            return self._background.most
        return float(self.columns.background[: self._points].max(initial=0.0))

    @property
    def nbytes(self) -> int:
        """Bytes of the columns' sums."""
        return sum(pool.nbytes for pool in self._pools.values())

    def _pool(self, name: str, points: int) -> NDArray[np.floating]:
        pool = self._pools.get(name)
        if pool is None or len(pool) < points:
            pool = np.zeros(points + points // 8, self._dtype)
            self._pools[name] = pool
        return pool

    def _of_walls(self, begin: Integers, length: Integers) -> NDArray[np.floating] | None:
        """R of walls on the columns that begin with these tiles."""
        if self._background is None:
            return None
        values = self._pool("background", ROWS * int(length.sum()))
        self._background.fill(begin, length, values)
        return values

    def _of_space(self, begin: Integers, length: Integers) -> NDArray[np.floating] | None:
        """(F, points) ψ of space, likewise."""
        if not self._fields:
            return None
        shape = len(self._fields), ROWS * int(length.sum())
        values = self._pool("field", shape[0] * shape[1])[: shape[0] * shape[1]].reshape(shape)
        for field, row in zip(self._fields, values, strict=True):
            field.fill(begin, length, row)
        return values

    def _make_lists(
        self, start: Integers, length: Integers, corner: Integers, column: Integers, owner: Integers
    ) -> ColumnLists:
        """Cells over each column, in the order of their numbers.

        `column` (K,) tells the column of each entry of the cover, -1 for none, and `owner` (K,)
        its cell.
        """
        over = np.flatnonzero(column >= 0)
        order = np.sort(column[over] << _PLACES | over) & ((1 << _PLACES) - 1)  # both, in one sort
        cell_start = np.concatenate(
            [[0], np.cumsum(np.bincount(column[over], minlength=len(start)))]
        )
        return ColumnLists(
            start=start,
            length=length,
            corner=corner,
            cell_start=cell_start.astype(np.int64),
            cells=owner[order],
        )
