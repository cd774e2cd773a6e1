"""The parts of a state that ranks hold, taken apart and put together.

A state is what `Engine.contents` gives: arrays with one row per cell, and flat arrays in which the
cells' boxes follow each other.
"""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from mpi4py.MPI import Comm

State = Mapping[str, Any]
FLAT = ("phi", "history", "low", "high")
MOST_BYTES = 1 << 30
"""Bytes per message; MPI counts them in 32 bits."""


def select(state: State, cells: NDArray[np.int64]) -> dict[str, NDArray]:
    """Part of a state that belongs to some cells, in their order, with their numbers as "rows"."""
    count = len(state["shape"])
    result = {"rows": cells}
    for name, values in state.items():
        if name in FLAT:
            ends, sizes = _places(state, name)
            chosen = [slice(ends[i] - sizes[i], ends[i]) for i in cells.tolist()]
            result[name] = np.concatenate([values[part] for part in chosen])
        elif values.shape[:1] == (count,):
            result[name] = values[cells]
    return result


def merge(parts: Sequence[State]) -> dict[str, NDArray]:
    """State of all cells from parts, each with the numbers of its cells as "rows"."""
    parts = [part for part in parts if len(part["rows"])]
    order = np.argsort(np.concatenate([part["rows"] for part in parts]))
    result = {}
    for name in parts[0].keys() - {"rows"}:
        if name in FLAT:
            stretches = [s for part in parts for s in _stretches(part, name)]
            result[name] = np.concatenate([stretches[k] for k in order.tolist()])
        else:
            result[name] = np.concatenate([part[name] for part in parts])[order]
    return result


def _stretches(state: State, name: str) -> list[NDArray]:
    """The boxes of a flat array."""
    return np.split(state[name], _places(state, name)[0][:-1])


def _places(state: State, name: str) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Where the boxes of a flat array end in it, and their sizes there."""
    shape = state["shape"]
    sizes = shape[:, :2].prod(axis=1) if name in ("low", "high") else state["points"]
    return np.cumsum(sizes), sizes


def sendable(columns: State) -> dict[str, NDArray]:
    """Columns of a cell table with their texts as arrays of text, as `CellTable.saved` has them."""
    return {
        name: values.astype(str) if values.dtype == object else values
        for name, values in columns.items()
    }


def send(comm: "Comm", part: State, to: int) -> None:
    """Send arrays of any size to another rank, which calls `receive`."""
    comm.send({name: (value.shape, value.dtype.str) for name, value in part.items()}, to)
    for value in part.values():
        for piece in _pieces(np.ascontiguousarray(value)):
            comm.Send(piece, to)


def receive(comm: "Comm", source: int) -> dict[str, NDArray]:
    """Get what another rank sends by `send`."""
    part = {name: np.empty(*layout) for name, layout in comm.recv(source=source).items()}
    for value in part.values():
        for piece in _pieces(value):
            comm.Recv(piece, source)
    return part


def gather(comm: "Comm", part: State, everyone: bool) -> list[State] | None:
    """Parts of all ranks, on rank 0 or on all; None elsewhere."""
    if comm.rank == 0:
        parts: list[State] = [part]
        parts += [receive(comm, source) for source in range(1, comm.size)]
        for to in range(1, comm.size) if everyone else ():
            for other in parts:
                send(comm, other, to)
        return parts
    send(comm, part, 0)
    return [receive(comm, 0) for _ in range(comm.size)] if everyone else None


def _pieces(value: NDArray) -> list[NDArray[np.uint8]]:
    """An array's bytes, in stretches that one message may hold."""
    flat = value.reshape(-1).view(np.uint8)
    return [flat[k : k + MOST_BYTES] for k in range(0, len(flat), MOST_BYTES)]
