"""Fields of a run: which boxes belong to a save, and their values."""

import json
from collections.abc import Collection, Iterator
from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from morphosim import _validate
from morphosim.cell_field import CellField
from morphosim.period import Period
from morphosim.provenance import check_memory

CLOSE = 1e-6
"""Times this near to each other are the same."""
MOST_READ = 1 << 23
"""Values of fields that are read at once."""
MOST_TOLD = 16
"""Times that an error lists."""
SELECTION = (
    "the Dataset is a selection of a run, so that it is not known which field or contact belongs "
    "to which of its cells and times; take "
    "ds.morpho of the whole run, and select by cell, by time, or in the result"
)


def variable(run: xr.Dataset, name: str, *dimensions: str) -> xr.DataArray:
    """Variable of a run.

    Raises
    ------
    ValueError
        The Dataset has no such variable of these dimensions.
    """
    if name not in run or run[name].dims != dimensions:
        has = (
            f"it is of ({', '.join(map(str, run[name].dims))})" if name in run else "it is missing"
        )
        message = (
            f"the Dataset has no variable {name!r} of ({', '.join(dimensions)}): {has}; "
            "open the run with morphosim.open_run and leave its dimensions as they are"
        )
        raise ValueError(message)
    return run[name]


def period(run: xr.Dataset) -> Period | None:
    """After which space repeats; None where it does not."""
    lengths = period_lengths(run)
    return Period.of(lengths, spacing(run)) if any(lengths) else None


def period_lengths(run: xr.Dataset) -> tuple[float, ...]:
    """Lengths in µm after which space repeats along x, y, z; 0 where it does not."""
    return tuple(json.loads(run.attrs.get("period_um", "[0.0, 0.0, 0.0]")))


def spacing(run: xr.Dataset) -> float:
    """Lattice spacing in µm; ValueError if the Dataset does not have it."""
    if "spacing_um" not in run.attrs:
        message = "the Dataset has no attribute 'spacing_um'; open the run with morphosim.open_run"
        raise ValueError(message)
    return float(run.attrs["spacing_um"])


@dataclass(frozen=True, slots=True)
class SavedBoxes:
    """Boxes of the cells of one save, whose fields are on disk.

    Attributes
    ----------
    cell : (B,) int
        Places in `run.cell`.
    origin, shape : (B, 3) int64
    start : (B + 1,) int64
        Places in `phi` of the first values of each box.
    phi : (sample,) DataArray
    """

    cell: NDArray[np.int64]
    origin: NDArray[np.int64]
    shape: NDArray[np.int64]
    start: NDArray[np.int64]
    phi: xr.DataArray

    @property
    def low(self) -> NDArray[np.int64]:
        """First lattice point of the block around all boxes."""
        return np.asarray(self.origin.min(axis=0))

    @property
    def extent(self) -> NDArray[np.int64]:
        """Points per axis of the block around all boxes."""
        return np.asarray((self.origin + self.shape).max(axis=0) - self.low)

    def read(self, box: int) -> NDArray:
        """Read φ of one box."""
        values = self.phi.isel(sample=slice(self.start[box], self.start[box + 1])).values
        return np.asarray(values.reshape(self.shape[box]))

    def read_some(self, first: int, stop: int) -> list[NDArray]:
        """Read φ of the boxes from `first` to before `stop` at once."""
        starts = self.start[first : stop + 1]
        values = self.phi.isel(sample=slice(starts[0], starts[-1])).values
        parts = np.split(values, starts[1:-1] - starts[0])
        return [part.reshape(n) for part, n in zip(parts, self.shape[first:stop], strict=True)]

    def read_each(self) -> Iterator[NDArray]:
        """Read φ of all boxes, so many at once as are `MOST_READ` values, or one."""
        first = 0
        while first < len(self.cell):
            stop = int(np.searchsorted(self.start, self.start[first] + MOST_READ, side="right")) - 1
            stop = max(stop, first + 1)
            yield from self.read_some(first, stop)
            first = stop


def saved_boxes(run: xr.Dataset, save: int) -> SavedBoxes:
    """Find the boxes of one save, without reading fields.

    Raises
    ------
    ValueError
        A variable is missing, the save has no fields, or the Dataset is a selection of a run.
    """
    if "phi" not in run:
        message = "the run has no fields ('phi' is missing): it was saved without"
        raise ValueError(message)
    saves = variable(run, "box_time", "box").values
    check_saves(run, saves)
    first, stop = np.searchsorted(saves, (save, save + 1))
    if first == stop:
        message = f"the save at t = {float(run['time'][save]):g} was made without fields"
        raise ValueError(message)
    sizes = variable(run, "row_size", "box").values
    box = slice(first, stop)
    cell = variable(run, "box_cell", "box")[box].values
    boxes = SavedBoxes(
        cell,
        variable(run, "box_origin", "box", "axis")[box].values.astype(np.int64),
        variable(run, "box_shape", "box", "axis")[box].values.astype(np.int64),
        np.append(0, np.cumsum(sizes[box], dtype=np.int64)) + sizes[:first].sum(dtype=np.int64),
        variable(run, "phi", "sample"),
    )
    _check_cells(run, save, boxes)
    return boxes


def check_saves(run: xr.Dataset, saves: NDArray[np.int64]) -> None:
    """Raise if indices into time cannot be meant for this Dataset."""
    times = variable(run, "time", "time").values
    if saves.max(initial=-1) >= len(times) or (np.diff(times) <= 0).any():
        raise ValueError(SELECTION)


def _check_cells(run: xr.Dataset, save: int, boxes: SavedBoxes) -> None:
    """Raise unless every box is where the table says that the box of its cell is."""
    if boxes.cell.max() >= run.sizes["cell"]:
        raise ValueError(SELECTION)
    low = variable(run, "box_low", "time", "cell", "axis")[save].values[boxes.cell]
    if not (np.abs(low / spacing(run) - boxes.origin) < 0.5).all():
        raise ValueError(SELECTION)


def save_count(run: xr.Dataset) -> int:
    """Number of saves; ValueError for a Dataset that is not of whole runs."""
    count = int(run.sizes.get("time", 0))
    if not count:
        message = (
            "the Dataset has no saves along 'time'; take ds.morpho of the whole run, and give the "
            "time to its functions"
        )
        raise ValueError(message)
    return count


def time_index(run: xr.Dataset, time: float | None) -> int:
    """Index of the save nearest to `time`, if it is near; the last save for None.

    Raises
    ------
    ValueError
        It is negative, or the nearest is further away than half the time between saves there.
    """
    count = save_count(run)
    if time is None:
        return count - 1
    time, times = _validate.number("time", time, least=0), run["time"].values
    index = int(np.abs(times - time).argmin())
    gap = np.diff(times)[max(index - 1, 0) : index + 1].max(initial=0)
    if np.abs(times[index] - time) > gap / 2 + CLOSE:
        message = (
            f"time = {time:g}: the run has no save near it; it has saves at t = {_some(times)}"
        )
        raise ValueError(message)
    return index


def _some(times: NDArray[np.float64]) -> str:
    """Times for an error: all, or the first and the last ones of many."""
    texts = [f"{time:g}" for time in times]
    if len(texts) > MOST_TOLD:
        texts = [*texts[: MOST_TOLD // 2], "…", *texts[-MOST_TOLD // 2 :]]
    return ", ".join(texts)


def load_fields(
    run: xr.Dataset, index: int, cells: Collection[str] | None = None
) -> list[CellField]:
    """Fields of cells at one save.

    Parameters
    ----------
    run : Dataset of `open_run`
    index : int
        Number of the save; negative counts from the last.
    cells : names, optional
        By default all that are alive.

    Raises
    ------
    IndexError
        There is no such save.
    ValueError
        The run was saved without fields, or the Dataset is a selection of a run. Or the fields do
        not fit into memory.
    """
    if cells is None:
        boxes = saved_boxes(run, _checked(run, index))
        values = int(boxes.start[-1] - boxes.start[0])
        check_memory(
            f"the fields of the {len(boxes.cell)} cells", values * boxes.phi.dtype.itemsize,
            "take some of them by cells = [...]",
        )  # fmt: skip
        return list(each_field(run, index))
    boxes = saved_boxes(run, _checked(run, index))
    return [
        CellField(name, boxes.origin[box], boxes.read(box))
        for box, name in enumerate(_names(run, boxes))
        if name in cells
    ]


def each_field(run: xr.Dataset, index: int) -> Iterator[CellField]:
    """Fields of all cells at one save, one after the other; see `load_fields`."""
    boxes = saved_boxes(run, _checked(run, index))
    for field in zip(_names(run, boxes), boxes.origin, boxes.read_each(), strict=True):
        yield CellField(*field)


def _checked(run: xr.Dataset, index: int) -> int:
    """Number of a save, from 0; IndexError if there is none."""
    count = save_count(run)
    if not -count <= index < count:
        message = f"index = {index}: the run has no such save; it has {count}, from 0 on"
        raise IndexError(message)
    return index % count


def _names(run: xr.Dataset, boxes: SavedBoxes) -> list[str]:
    """Names of the cells of boxes."""
    return [str(name) for name in variable(run, "cell", "cell").values[boxes.cell]]
