"""Parts of a run, read from its Dataset: only what is asked for comes from disk."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from xarray.backends import BackendArray
from xarray.core import indexing

from morphosim.fields import CellField

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
    _check_saves(run, saves)
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


def _check_saves(run: xr.Dataset, saves: NDArray[np.int64]) -> None:
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


def axes(low: Iterable[int], shape: Iterable[int], spacing: float) -> dict[str, xr.Variable]:
    """Coordinates x, y and z in µm of a block of lattice points."""
    return {
        axis: xr.Variable(
            axis,
            (first + np.arange(n)) * spacing,
            {"units": "um", "long_name": f"position along {axis}"},
        )
        for axis, first, n in zip("xyz", low, shape, strict=True)
    }


def cell_fields(run: xr.Dataset, save: int) -> Iterator[CellField]:
    """Fields of all cells of a save, read one after the other."""
    names = variable(run, "cell", "cell").values
    boxes = saved_boxes(run, save)
    for box, cell in enumerate(boxes.cell):
        yield CellField(str(names[cell]), boxes.origin[box], boxes.read(box))


def stored_image(run: xr.Dataset, save: int) -> int | None:
    """Place along `image` of the label image that the run holds of a save, if it does."""
    if "label" not in run:
        return None
    saves = variable(run, "label_time", "image").values
    _check_saves(run, saves)
    found = np.flatnonzero(saves == save)
    return int(found[0]) if found.size else None


def read_labels(run: xr.Dataset, image: int) -> NDArray[np.int32]:
    """Read a label image that the run holds: (nx, ny, nz)."""
    stops = np.cumsum(variable(run, "label_size", "image").values, dtype=np.int64)
    shape = variable(run, "label_shape", "image", "axis")[image].values
    part = slice(stops[image] - np.prod(shape, dtype=np.int64), stops[image])
    values = variable(run, "label", "voxel")[part].values.astype(np.int32)
    if values.max() > run.sizes["cell"]:
        raise ValueError(SELECTION)
    return np.asarray(values.reshape(shape))


def block(run: xr.Dataset, save: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """First lattice point and shape of the block around all boxes of a save: its label image."""
    image = stored_image(run, save)
    if image is None:
        boxes = saved_boxes(run, save)
        return boxes.low, boxes.extent
    origin, shape = (
        variable(run, f"label_{name}", "image", "axis")[image].values.astype(np.int64)
        for name in ("origin", "shape")
    )
    return origin, shape


def contacts(run: xr.Dataset, save: int) -> list[tuple[str, str, float]]:
    """Names and area in µm² of each pair of cells that touch at a save.

    From `contact_area` (then each pair occurs in both orders), or beyond a number of cells from
    the list along `contact`.
    """
    names = variable(run, "cell", "cell").values.astype(str)
    if "contact_area" in run or "contact_time" not in run:
        areas = variable(run, "contact_area", "time", "cell", "neighbour")[save].values
        i, j = np.nonzero(np.nan_to_num(areas) > 0)
        others = run["neighbour"].values.astype(str)
        return _pairs(names[i], others[j], areas[i, j])
    saves, i, j, area = (
        variable(run, f"contact_{name}", "contact").values
        for name in ("time", "cell", "neighbour", "pair_area")
    )
    _check_saves(run, saves)
    if max(i.max(initial=-1), j.max(initial=-1)) >= len(names):
        raise ValueError(SELECTION)
    now = saves == save
    return _pairs(names[i[now]], names[j[now]], area[now])


def _pairs(a: NDArray, b: NDArray, area: NDArray) -> list[tuple[str, str, float]]:
    return list(zip(a.tolist(), b.tolist(), area.tolist(), strict=True))


class FullFields(BackendArray):
    """Fields of one save on a common lattice, 0 outside of boxes, as a lazy array.

    Only boxes of the chosen cells that meet the chosen points are read.

    Parameters
    ----------
    boxes : SavedBoxes
    cells : int
        Length of the first axis.
    """

    def __init__(self, boxes: SavedBoxes, cells: int) -> None:
        self._boxes = boxes
        self._of_cell = {int(cell): box for box, cell in enumerate(boxes.cell)}
        self.shape = (cells, *(int(n) for n in boxes.extent))
        self.dtype = boxes.phi.dtype

    def __getitem__(self, key: indexing.ExplicitIndexer) -> Any:
        return indexing.explicit_indexing_adapter(
            key, self.shape, indexing.IndexingSupport.OUTER, self._read
        )

    def _read(self, key: tuple[Any, ...]) -> NDArray:
        """Values at an outer key of whole numbers, slices and arrays."""
        places = [np.arange(n)[k] for n, k in zip(self.shape, key, strict=True)]
        cells, *points = (np.atleast_1d(place) for place in places)
        out = np.zeros((len(cells), *map(len, points)), self.dtype)
        for k, cell in enumerate(cells):
            if (box := self._of_cell.get(int(cell))) is not None:
                self._paste(out[k], box, points)
        return out.reshape([n for place in places for n in place.shape])

    def _paste(self, out: NDArray, box: int, points: Sequence[NDArray[np.intp]]) -> None:
        """Fill in what a box has at these points of the lattice."""
        offset = self._boxes.origin[box] - self._boxes.low
        local = [p - first for p, first in zip(points, offset, strict=True)]
        inside = [
            np.flatnonzero((p >= 0) & (p < n))
            for p, n in zip(local, self._boxes.shape[box], strict=True)
        ]
        if all(map(len, inside)):
            source = np.ix_(*(p[i] for p, i in zip(local, inside, strict=True)))
            out[np.ix_(*inside)] = self._boxes.read(box)[source]
