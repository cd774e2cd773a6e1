"""Fields of cells at the border between ranks, sent in every step; and what it costs."""

import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from morphosim.engine.box_pool import BoxPool
from morphosim.kernels.messages import pack, unpack
from morphosim.mpi.ghost_regions import Portion

if TYPE_CHECKING:
    from mpi4py.MPI import Comm

Integers = NDArray[np.int64]
ROW = 4
"""Bytes that say which points of a row follow."""
SUM = 8
"""Bytes of a cell's Σ φ."""


@dataclass
class Traffic:
    """What a rank has sent so far.

    Attributes
    ----------
    steps : int
    fields : int
        Bytes of fields.
    notices : int
        Bytes of what every rank tells all others: cells whose boxes have moved, or that moved to
        another rank.
    messages : int
        Messages with fields.
    seconds : float
        Spent to send and to wait, for ranks that are behind also.
    """

    steps: int = 0
    fields: int = 0
    notices: int = 0
    messages: int = 0
    seconds: float = 0.0


class Parcel:
    """A message to or from one rank: Σ φ of each cell, and then the rows of its field.

    Parameters
    ----------
    portion : Portion
    places : (K,) its cells in the pool
    base : (K, 3) origins of their boxes there
    room : 1-D bytes, at least `size_of` the portion
    dtype : of the fields
    """

    def __init__(
        self, portion: Portion, places: Integers, base: Integers, room: NDArray[np.uint8],
        dtype: np.dtype,
    ) -> None:  # fmt: skip
        self.places, self.low, self.high = places, portion.first - base, portion.end - base
        self.bytes = room[: size_of(portion, dtype)]
        sums = SUM * len(places)
        fields = _whole(sums + ROW * portion.rows, dtype)
        self.sums = self.bytes[:sums].view(np.float64)
        self.rows = self.bytes[sums : sums + ROW * portion.rows].view(np.int16).reshape(-1, 2)
        self.values = self.bytes[fields:].view(dtype)


def size_of(portion: Portion, dtype: np.dtype) -> int:
    """Most bytes that a message with this portion has."""
    head = _whole(SUM * len(portion.cells) + ROW * portion.rows, dtype)
    return head + dtype.itemsize * portion.points


def _whole(size: int, dtype: np.dtype) -> int:
    """A number of bytes rounded up to whole values."""
    return -(-size // dtype.itemsize) * dtype.itemsize


class GhostExchange:
    """The messages of a rank with its neighbours.

    Parameters
    ----------
    comm : communicator
    """

    def __init__(self, comm: "Comm") -> None:
        self._comm = comm
        self._rooms: dict[tuple[str, int], NDArray[np.uint8]] = {}

    def plan(
        self,
        pool: BoxPool,
        rows: Integers,
        sends: Mapping[int, Portion],
        gets: Mapping[int, Portion],
    ) -> None:
        """Lay out the messages, for as long as boxes and owners stay.

        Parameters
        ----------
        pool : BoxPool
            Of the rank's cells and ghost cells.
        rows : (n,) numbers of its cells
        sends, gets : by rank, what is sent to it and what it sends
        """
        self._pool = pool

        def parcels(way: str, portions: Mapping[int, Portion]) -> dict[int, Parcel]:
            result = {}
            for partner, portion in portions.items():
                places = np.searchsorted(rows, portion.cells)
                room = self._room(way, partner, size_of(portion, pool.dtype))
                base = pool.origin[places]
                result[partner] = Parcel(portion, places, base, room, pool.dtype)
            return result

        self._sends, self._gets = parcels("send", sends), parcels("get", gets)

    def _room(self, way: str, partner: int, size: int) -> NDArray[np.uint8]:
        """Bytes for a message, used again for the next."""
        room = self._rooms.get((way, partner))
        if room is None or len(room) < size:
            room = np.zeros(size + size // 8, np.uint8)
            self._rooms[way, partner] = room
        return room

    def run(self, traffic: Traffic) -> None:
        """Send the present fields, and take in those of the neighbours."""
        begin = time.perf_counter()
        pool, boxes = self._pool, self._pool.boxes
        incoming = {p: self._comm.Irecv(box.bytes, p) for p, box in self._gets.items()}
        outgoing = []
        for partner, box in self._sends.items():
            box.sums[:] = pool.totals[box.places]
            count = pack(box.places, box.low, box.high, pool.acting, boxes, box.rows, box.values)
            used = box.bytes[: box.bytes.size - box.values.nbytes + count * box.values.itemsize]
            outgoing.append(self._comm.Isend(used, partner))
            traffic.fields += used.nbytes
        for partner, box in self._gets.items():
            incoming[partner].Wait()
            pool.totals[box.places] = box.sums
            unpack(box.places, box.low, box.high, pool.acting, boxes, box.rows, box.values)
        for request in outgoing:
            request.Wait()
        traffic.messages += len(outgoing)
        traffic.seconds += time.perf_counter() - begin
