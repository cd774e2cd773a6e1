"""Fields of a run: which boxes belong to a save, and their values."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from morphosim.fields import CellField

if TYPE_CHECKING:
    import xarray as xr


def time_index(run: "xr.Dataset", time: float | None) -> int:
    """Index of the save nearest to `time`; the last save for None."""
    if time is None:
        return int(run.sizes["time"]) - 1
    return int(np.abs(run["time"].values - time).argmin())


def boxes_at(run: "xr.Dataset", index: int) -> NDArray[np.int64]:
    """Numbers of the boxes of one save, in order.

    Raises
    ------
    ValueError
        The run was saved without fields.
    """
    if "phi" not in run:
        message = f"{run.attrs.get('title', 'the run')} has no fields: it was saved without"
        raise ValueError(message)
    return np.flatnonzero(run["box_time"].values == range(run.sizes["time"])[index])


def load_fields(
    run: "xr.Dataset", index: int, cells: Sequence[str] | None = None
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
        The run was saved without fields.
    """
    names = run["cell"].values
    sizes = run["row_size"].values if "row_size" in run else np.zeros(0, np.int64)
    ends = np.cumsum(sizes)
    found = []
    for b in boxes_at(run, index).tolist():
        name = str(names[int(run["box_cell"].values[b])])
        if cells is None or name in cells:
            part = slice(int(ends[b] - sizes[b]), int(ends[b]))
            found.append((name, b, part))
    return [
        CellField(name, run["box_origin"].values[b], values.reshape(run["box_shape"].values[b]))
        for (name, b, _), values in zip(found, _read(run, [p for _, _, p in found]), strict=True)
    ]


def _read(run: "xr.Dataset", parts: Sequence[slice]) -> list[NDArray[Any]]:
    """Values of `phi` in these slices; one read where they follow each other."""
    if not parts:
        return []
    first, last = parts[0].start, parts[-1].stop
    if sum(p.stop - p.start for p in parts) < last - first:
        return [run["phi"].isel(sample=p).values for p in parts]
    values = run["phi"].isel(sample=slice(first, last)).values
    return [values[p.start - first : p.stop - first] for p in parts]
