"""Arrays that are there in parts, so that what is as large as all fields is not held twice."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, Protocol, overload

import numpy as np
from numpy.typing import DTypeLike, NDArray

PIECE = 1 << 23
"""Bytes of an array that are at hand at once."""


class InParts(Protocol):
    """An array of which only slices along the first axis are held; NumPy arrays are such too."""

    @property
    def dtype(self) -> np.dtype[Any]:
        """Type of its values."""

    @property
    def shape(self) -> tuple[int, ...]:
        """Its shape."""

    def __getitem__(self, part: slice) -> NDArray[Any]: ...


def pieces(values: InParts) -> Iterator[NDArray[Any]]:
    """All of an array with at least one axis, in order, piece by piece; parts are not copied."""
    if isinstance(values, Joined):
        yield from values.parts
        return
    row = int(np.prod(values.shape[1:])) * values.dtype.itemsize
    rows = max(PIECE // max(row, 1), 1)
    for start in range(0, values.shape[0], rows):
        yield values[start : start + rows]


class Made(Sequence[NDArray[Any]]):
    """Arrays that are made when they are asked for.

    Parameters
    ----------
    make : function of an item
    items : sequence
    """

    def __init__(self, make: Callable[[Any], NDArray[Any]], items: Sequence[Any]) -> None:
        self._make, self._items = make, items

    def __len__(self) -> int:
        return len(self._items)

    @overload
    def __getitem__(self, k: int) -> NDArray[Any]: ...
    @overload
    def __getitem__(self, k: slice) -> Sequence[NDArray[Any]]: ...
    def __getitem__(self, k: int | slice) -> NDArray[Any] | Sequence[NDArray[Any]]:
        if isinstance(k, slice):
            return Made(self._make, self._items[k])
        return self._make(self._items[k])


class Joined:
    """Arrays one after the other, as if they were one.

    Parameters
    ----------
    parts : sequence of arrays, at least one
        Of one type, and of one shape but for the first axis. They are not copied.
    lengths : of the parts along the first axis, if they are `Made` when they are asked for
    """

    def __init__(
        self, parts: Sequence[NDArray[Any]], lengths: NDArray[np.int64] | None = None
    ) -> None:
        self.parts = parts
        self._ends = np.cumsum([len(part) for part in parts] if lengths is None else lengths)
        self.dtype: np.dtype[Any] = parts[0].dtype
        self.shape: tuple[int, ...] = (int(self._ends[-1]), *parts[0].shape[1:])

    def __getitem__(self, part: slice) -> NDArray[Any]:
        low, high, _ = part.indices(self.shape[0])
        first = int(np.searchsorted(self._ends, low, side="right"))
        found = [np.zeros((0, *self.shape[1:]), self.dtype)]
        for k in range(first, len(self.parts)):
            start = int(self._ends[k]) - len(self.parts[k])
            if start >= high:
                break
            found.append(self.parts[k][max(low - start, 0) : high - start])
        return np.concatenate(found)

    def __array__(self, dtype: DTypeLike | None = None, copy: bool | None = None) -> NDArray[Any]:
        return np.concatenate(self.parts).astype(dtype or self.dtype, copy=False)


class Stored:
    """Array whose values lie one after the other in a file, and are read when they are used.

    Parameters
    ----------
    path : of the file, which must stay as it is
    offset : bytes before the first value
    dtype, shape : of the array, with at least one axis, the last one fastest
    """

    def __init__(
        self, path: Path, offset: int, dtype: DTypeLike, shape: tuple[int, ...]
    ) -> None:  # fmt: skip
        self.path, self.offset = path, offset
        self.dtype: np.dtype[Any] = np.dtype(dtype)
        self.shape = shape
        self._row = int(np.prod(shape[1:]))

    def __getitem__(self, part: slice) -> NDArray[Any]:
        low, high, _ = part.indices(self.shape[0])
        count = max(high - low, 0) * self._row
        offset = self.offset + low * self._row * self.dtype.itemsize
        values = np.fromfile(self.path, self.dtype, count, offset=offset)
        return values.reshape(-1, *self.shape[1:]) if self._row else np.zeros((count, 0))

    def __array__(self, dtype: DTypeLike | None = None, copy: bool | None = None) -> NDArray[Any]:
        return self[:].astype(dtype or self.dtype, copy=False)
