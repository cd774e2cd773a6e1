"""Parts of a run, read from its Dataset: only what is asked for comes from disk."""

from collections.abc import Hashable, Iterable, Sequence
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from xarray.backends import BackendArray
from xarray.core import indexing

from morphosim.provenance import check_memory
from morphosim.runs.saved_fields import (
    SELECTION,
    SavedBoxes,
    check_saves,
    period,
    saved_boxes,
    variable,
)


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


def stored_image(run: xr.Dataset, save: int) -> int | None:
    """Place along `image` of the label image that the run holds of a save, if it does."""
    if "label" not in run:
        return None
    saves = variable(run, "label_time", "image").values
    check_saves(run, saves)
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
    """First lattice point and shape of the label image of a save.

    It is the block around all boxes, or along axes that repeat one period.
    """
    image = stored_image(run, save)
    if image is None:
        boxes = saved_boxes(run, save)
        repeats = period(run)
        return repeats.block(boxes.low, boxes.extent) if repeats else (boxes.low, boxes.extent)
    origin, shape = (
        variable(run, f"label_{name}", "image", "axis")[image].values.astype(np.int64)
        for name in ("origin", "shape")
    )
    return origin, shape


def contacts(run: xr.Dataset, save: int) -> list[tuple[str, str, float]]:
    """Names and area in µm² of each pair of cells that touch at a save.

    From a matrix of areas each pair occurs in both orders, where the run has both of its cells.
    """
    names = variable(run, "cell", "cell").values.astype(str)
    if _has_matrix(run):
        i, j, area = _matrix_entries(run, save)
        others = run["neighbour"].values.astype(str)
        return list(zip(names[i].tolist(), others[j].tolist(), area.tolist(), strict=True))
    pairs, area = contact_places(run, save)
    return [(a, b, s) for (a, b), s in zip(names[pairs].tolist(), area.tolist(), strict=True)]


def contact_places(run: xr.Dataset, save: int) -> tuple[NDArray[np.int64], NDArray[np.floating]]:
    """Places in `cell`, (P, 2), and area in µm² of each pair of cells that touch at a save.

    From `contact_area`, or beyond a number of cells from the list along `contact`.
    """
    if _has_matrix(run):
        i, j, area = _matrix_entries(run, save)
        place = variable(run, "cell", "cell").to_index().get_indexer(run["neighbour"].values)
        once = i < place[j]  # else it is the other order, or the run is without that cell
        return np.stack([i, place[j]], axis=1)[once], area[once]
    saves, i, j, area = (
        variable(run, f"contact_{name}", "contact").values
        for name in ("time", "cell", "neighbour", "pair_area")
    )
    check_saves(run, saves)
    if max(i.max(initial=-1), j.max(initial=-1)) >= run.sizes["cell"]:
        raise ValueError(SELECTION)
    now = slice(*np.searchsorted(saves, (save, save + 1)))
    return np.stack([i[now], j[now]], axis=1), area[now]


def _has_matrix(run: xr.Dataset) -> bool:
    return "contact_area" in run or "contact_time" not in run


def _matrix_entries(
    run: xr.Dataset, save: int
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.floating]]:
    """Places in `cell` and in `neighbour`, and areas, of cells that touch at a save."""
    areas = variable(run, "contact_area", "time", "cell", "neighbour")[save].values
    i, j = np.nonzero(np.nan_to_num(areas) > 0)
    return i, j, areas[i, j]


def cell_columns(run: xr.Dataset, save: int) -> dict[str, NDArray[Any]]:
    """Columns of a table with a row for each cell that is there at a save.

    They are time, cell and parent, and all that the run has per time and cell; what has more axes,
    as centroids do, has a column per place along them, such as `centroid_x`.
    """
    living = np.isfinite(variable(run, "volume", "time", "cell")[save].values)
    columns = {
        "time": np.full(living.sum(), run["time"].values[save]),
        "cell": run["cell"].values[living],
        "parent": variable(run, "parent", "cell").values[living],
    }
    for name in (*run.data_vars, *run.coords):
        data = run[name]
        if data.dims[:2] == ("time", "cell") and "neighbour" not in data.dims:
            columns |= _flat(name, data[save].isel(cell=living))
    return columns


def _flat(name: Hashable, data: xr.DataArray) -> dict[str, NDArray[Any]]:
    """One column per place along the dimensions after the first."""
    marks = [
        data[d].values if d in data.coords else np.arange(data.sizes[d]) for d in data.dims[1:]
    ]
    values = data.values
    return {
        "_".join([str(name), *(str(m[k]) for m, k in zip(marks, place, strict=True))]): values[
            (slice(None), *place)
        ]
        for place in np.ndindex(values.shape[1:])
    }


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
        check_memory(
            f"fields of {len(cells)} cells on {' x '.join(str(len(p)) for p in points)} points",
            float(np.prod([len(cells), *map(len, points)], dtype=float)) * self.dtype.itemsize,
            "select cells, or a plane, before taking values",
        )
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
