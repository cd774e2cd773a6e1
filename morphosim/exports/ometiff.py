"""Label images as one OME-TIFF time series: `labels.ome.tif`, and `labels.csv` with the names."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from morphosim.accessor import MorphoAccessor
from morphosim.measure.label_image import MOST_POINTS, check_size
from morphosim.progress import Tell
from morphosim.runs.saved_fields import spacing
from morphosim.runs.views import block

CLASSIC_TIFF_BYTES = (1 << 32) - (1 << 25)
"""Larger images are BigTIFF: classic TIFF has 32-bit offsets."""


def write(run: xr.Dataset, directory: Path, saves: Sequence[int], tell: Tell) -> list[Path]:
    """Write the label images of all saves on the lattice around all their boxes, and the names.

    Labels are those of `ds.morpho.labels`. One save is in memory at a time.
    """
    import pandas as pd
    import tifffile

    low, shape = _common_block(run, saves)
    names = run["cell"].values
    kind = np.dtype(np.uint16 if len(names) <= np.iinfo(np.uint16).max else np.uint32)
    size = (len(saves), *(int(n) for n in shape[::-1]))
    image, table = directory / "labels.ome.tif", directory / "labels.csv"
    tifffile.imwrite(
        image,
        _planes(run, saves, low, shape, kind, tell),
        shape=size,
        dtype=kind,
        ome=True,
        bigtiff=np.prod(size, dtype=float) * kind.itemsize > CLASSIC_TIFF_BYTES,
        photometric="minisblack",
        compression="zlib",
        metadata=_metadata(run, saves, low, int(shape[2])),
    )
    tell(len(saves), len(saves))
    rows = pd.DataFrame({"label": np.arange(1, len(names) + 1), "cell": names})
    rows.to_csv(table, index=False)
    return [image, table]


def _common_block(
    run: xr.Dataset, saves: Sequence[int]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """First lattice point and shape of the block that holds the label images of these saves."""
    lows, shapes = np.moveaxis(np.array([block(run, save) for save in saves]), 1, 0)
    low = lows.min(axis=0)
    shape = (lows + shapes).max(axis=0) - low
    if np.prod(shape, dtype=float) > MOST_POINTS:
        message = (
            f"a label image of {' x '.join(map(str, shape))} points, which holds the boxes of all "
            f"{len(saves)} saves, is too large; choose fewer times, or cells that are nearer"
        )
        raise ValueError(message)
    check_size(shapes[shapes.prod(axis=1).argmax()], "choose other times")  # of one save at once
    return low, shape


def _planes(
    run: xr.Dataset,
    saves: Sequence[int],
    low: NDArray[np.int64],
    shape: NDArray[np.int64],
    kind: np.dtype,
    tell: Tell,
) -> Iterator[NDArray]:
    """Planes (y, x) of all saves, z faster than time."""
    times = run["time"].values
    for done, save in enumerate(saves):
        if done:
            tell(done, len(saves))
        labels = MorphoAccessor(run).labels(float(times[save])).values.astype(kind)
        x, y, z = block(run, save)[0] - low
        for k in range(shape[2]):
            plane = np.zeros((shape[1], shape[0]), kind)
            if z <= k < z + labels.shape[2]:
                plane[y : y + labels.shape[1], x : x + labels.shape[0]] = labels[:, :, k - z].T
            yield plane


def _metadata(
    run: xr.Dataset, saves: Sequence[int], low: NDArray[np.int64], planes: int
) -> dict[str, Any]:
    """OME metadata; time and position are written with every plane."""
    step, times = spacing(run), run["time"].values[list(saves)]
    about = (
        "Label images: 0 outside, else 1 + the place of the cell in labels.csv. Times are in "
        "silico time, not seconds."
    )
    sizes = {f"PhysicalSize{axis}": step for axis in "XYZ"}
    units = {f"PhysicalSize{axis}Unit": "µm" for axis in "XYZ"}
    return {
        "axes": "TZYX",
        "Name": str(run.attrs.get("title", "MorphoSim run")),
        "Description": about,
        "Channel": {"Name": ["cells"]},
        **sizes,
        **units,
        **_timing(times),
        "Plane": _planes_said(times, low, step, planes),
    }


def _timing(times: NDArray[np.float64]) -> dict[str, float]:
    """The increment of even times."""
    steps = np.diff(times)
    even = steps.size > 0 and np.allclose(steps, steps[0], rtol=1e-6, atol=0)
    return {"TimeIncrement": float(steps[0])} if even else {}


def _planes_said(
    times: NDArray[np.float64], low: NDArray[np.int64], step: float, planes: int
) -> dict[str, list[Any]]:
    """Time of every plane, and position of its first voxel."""
    x, y = (np.full(len(times) * planes, low[axis] * step) for axis in (0, 1))
    z = np.tile((low[2] + np.arange(planes)) * step, len(times))
    said: dict[str, list[Any]] = {"DeltaT": np.repeat(times, planes).tolist()}
    for axis, position in zip("XYZ", (x, y, z), strict=True):
        said |= {f"Position{axis}": position.tolist(), f"Position{axis}Unit": ["µm"] * len(z)}
    return said
