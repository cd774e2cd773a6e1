"""Values of many files as one array that is read when it is used."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from xarray.backends import BackendArray
from xarray.core import indexing

from morphosim._files import guarded
from morphosim.provenance import check_memory

MOST_AT_ONCE = 1 << 22
"""Variables of a run with more values are read when they are used."""


@dataclass(frozen=True, slots=True)
class Segment:
    """One-dimensional variable of one file.

    Attributes
    ----------
    path, group, name : where it is
    length : number of values
    table : (K,) new value for each value, or None
    """

    path: Path
    group: str
    name: str
    length: int
    table: NDArray[Any] | None = None

    def read(self, part: slice) -> NDArray[Any]:
        """Values of a slice; ValueError that names the file if it is damaged."""
        values = guarded(self.path, lambda: self._values(part))
        return values if self.table is None else self.table[values]

    def _values(self, part: slice) -> NDArray[Any]:
        """Values of a slice as they are in the file."""
        with xr.open_dataset(self.path, engine="netcdf4", group=self.group, cache=False) as file:
            return np.asarray(file[self.name][part].values)


class Chain(BackendArray):
    """Segments, one after the other."""

    def __init__(self, segments: Sequence[Segment], dtype: np.dtype[Any]) -> None:
        self.segments = tuple(segments)
        self.dtype = dtype
        self._ends = np.cumsum([segment.length for segment in segments])
        self.shape = (int(self._ends[-1]),)

    def __getitem__(self, key: indexing.ExplicitIndexer) -> Any:
        return indexing.explicit_indexing_adapter(
            key, self.shape, indexing.IndexingSupport.BASIC, self._get
        )

    def _get(self, key: tuple[int | slice, ...]) -> Any:
        (part,) = key
        if not isinstance(part, slice):
            return self._read(int(part), int(part) + 1)[0]
        wanted = range(*part.indices(self.shape[0]))
        if not wanted:
            return np.zeros(0, self.dtype)
        low, high = min(wanted[0], wanted[-1]), max(wanted[0], wanted[-1]) + 1
        values = self._read(low, high)
        return values if wanted.step == 1 else values[np.asarray(wanted) - low]

    def _read(self, low: int, high: int) -> NDArray[Any]:
        """Values [low, high)."""
        check_memory(
            f"{high - low} values of all {self.shape[0]}", (high - low) * self.dtype.itemsize,
            "take those of one save, as run.morpho.phi, full and labels do",
        )  # fmt: skip
        first = int(np.searchsorted(self._ends, low, side="right"))
        parts = []
        for k in range(first, len(self.segments)):
            start = int(self._ends[k]) - self.segments[k].length
            if start >= high:
                break
            part = slice(max(low - start, 0), min(high - start, self.segments[k].length))
            parts.append(self.segments[k].read(part))
        return np.concatenate(parts).astype(self.dtype, copy=False)


def chained(segments: Sequence[Segment]) -> Any:
    """Lazy array of segments, for a variable of a Dataset."""
    kinds = [segment.read(slice(0, 1)).dtype for segment in (segments[0], segments[-1])]
    return indexing.LazilyIndexedArray(Chain(segments, np.result_type(*kinds)))


class Stack(BackendArray):
    """Values of all saves, of which only those are put together that are asked for.

    Parameters
    ----------
    shape : of the whole, time first
    dtype : of the values
    at : function
        Gives those of one save.
    """

    def __init__(
        self, shape: tuple[int, ...], dtype: np.dtype[Any], at: Callable[[int], NDArray[Any]]
    ) -> None:  # fmt: skip
        self.shape, self.dtype, self._at = shape, dtype, at

    def __getitem__(self, key: indexing.ExplicitIndexer) -> Any:
        return indexing.explicit_indexing_adapter(
            key, self.shape, indexing.IndexingSupport.OUTER, self._get
        )

    def _get(self, key: tuple[Any, ...]) -> NDArray[Any]:
        saves = np.arange(self.shape[0])[key[0]]
        shape = (np.size(saves), *self.shape[1:])
        check_memory(
            f"a variable of shape {shape}", np.prod(shape, dtype=float) * self.dtype.itemsize,
            "select times first, as in isel(time=-1)",
        )  # fmt: skip
        if not np.ndim(saves):
            return self._part(int(saves), key[1:])
        parts = [self._part(save, key[1:]) for save in saves.tolist()]
        if parts:
            return np.stack(parts)
        nothing = np.zeros((0, *self.shape[1:]), self.dtype)
        return _outer(nothing, (slice(None), *key[1:]))

    def _part(self, save: int, key: tuple[Any, ...]) -> NDArray[Any]:
        return np.asarray(_outer(self._at(save), key))


def _outer(values: NDArray[Any], key: tuple[Any, ...]) -> NDArray[Any]:
    """Values at whole numbers, slices and arrays, each along its own axis."""
    for axis in reversed(range(len(key))):
        values = values[(slice(None),) * axis + (key[axis],)]
    return values


def stacked(
    shape: tuple[int, ...], dtype: np.dtype[Any], at: Callable[[int], NDArray[Any]]
) -> Any:  # fmt: skip
    """Array of all saves for a variable of a Dataset; lazy if it is large."""
    whole = Stack(shape, dtype, at)
    if np.prod(shape, dtype=float) > MOST_AT_ONCE:
        return indexing.LazilyIndexedArray(whole)
    return whole[indexing.BasicIndexer((slice(None),) * len(shape))]
