"""Label images in netCDF files, as the CF conventions say that values are stored."""

import warnings
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from morphosim import _validate
from morphosim._files import guarded, listed
from morphosim.importers.labels.image_axes import (
    UNKNOWN,
    Found,
    Wanted,
    at_time,
    check_memory,
    chosen_name,
    letters_of,
    unit,
)

TIME_NAMES = ("t", "time")
CLASSIC = (b"CDF\x01", b"CDF\x02")
"""How files of netCDF's classic formats begin."""
PACKED = 1e-3
"""Values that are packed as floats are this near to the whole numbers that they stand for."""


def read_netcdf(path: Path, wanted: Wanted) -> Found:
    """Labels of a netCDF file, unpacked; where a value is missing there is no cell.

    They are turned round along axes whose coordinate falls.
    """
    import xarray as xr

    def open_plainly() -> Any:
        return xr.open_dataset(path, decode_times=False)

    _check_whole(path)
    with warnings.catch_warnings(), guarded(path, open_plainly) as data:
        warnings.simplefilter("ignore", xr.SerializationWarning)  # of several fill values
        variable = data[_chosen(path, data, wanted.key)]
        where = f"{path}: {variable.name}"
        check_memory(where, variable.nbytes)
        said = "".join(_letter(data, str(dim)) for dim in variable.dims)
        letters = letters_of(where, variable.shape, said, "xyz", wanted)
        chosen, left = at_time(where, variable, letters, wanted.time_index)
        labels = guarded(path, lambda: _whole(np.asarray(chosen)))
        coordinates = {
            letter: (str(dim), guarded(path, variable[dim].load))
            for letter, dim in zip(letters, variable.dims, strict=True)
            if letter != "t" and dim in variable.coords and variable.sizes[dim] > 1
        }

    falling = [letter for letter, (_, values) in coordinates.items() if _falls(values)]
    labels = np.flip(labels, tuple(left.index(letter) for letter in falling))
    coordinates |= {k: (coordinates[k][0], coordinates[k][1][::-1]) for k in falling}

    def places(which: int) -> dict[str, float]:
        return {k: _places(where, values, dim)[which] for k, (dim, values) in coordinates.items()}

    return Found(labels=labels, letters=left, steps=lambda: places(1), first=lambda: places(0))


def _check_whole(path: Path) -> None:
    """Raise ValueError if variables of a classic file lie beyond its end: they would read as 0.

    Those of netCDF-4 are checked by its library.
    """
    with path.open("rb") as file:
        if file.read(4) not in CLASSIC:
            return
    from scipy.io import netcdf_file

    try:
        with netcdf_file(path, mmap=True):
            pass
    except Exception as error:  # it raises what it stumbles over
        message = f"{path} is cut short, or damaged: it ends at byte {path.stat().st_size}, and "
        raise ValueError(message + "its header says that there is more") from error


def _chosen(path: Path, data: Any, key: str | None) -> str:
    """Name of the variable of labels: asked for, or the only one that is likely to hold them.

    Those are the ones of three or four dimensions that are stored as whole numbers as they are;
    else as packed ones; else as others.
    """
    known = [str(name) for name in data.data_vars]
    if not known and (groups := _groups(path)):
        message = f"{path} holds groups alone, {listed(groups)}, which are not read. Take one out: "
        raise ValueError(message + "xarray.open_dataset(path, group=name).to_netcdf(other)")
    images = [n for n in known if data[n].ndim in (3, 4) and data[n].dtype.kind in "biuf"]
    whole = [n for n in images if np.dtype(data[n].encoding.get("dtype", "f")).kind in "biu"]
    plain = [n for n in whole if not {"scale_factor", "add_offset"} & set(data[n].encoding)]
    return chosen_name(f"variable of {path}", key, known, plain or whole or images)


def _groups(path: Path) -> list[str]:
    """Names of the groups of a netCDF file, which only the newer kind has."""
    import netCDF4

    with netCDF4.Dataset(path) as file:
        return list(file.groups)


def _letter(data: Any, dim: str) -> str:
    """Letter of a dimension: what its coordinate says (CF: axis), or its name."""
    axis = str(data[dim].attrs.get("axis", "")) if dim in data.coords else ""
    name = (axis or dim).lower()
    if name in TIME_NAMES:
        return "t"
    if name.startswith("channel"):
        return "c"
    return name if name in ("x", "y", "z", "c") else UNKNOWN


def _whole(values: NDArray[Any]) -> NDArray[Any]:
    """Labels with 0 where a value is missing; packed ones as the whole numbers that they mean."""
    if values.dtype.kind != "f":
        return values
    present = np.where(np.isnan(values), 0, values)
    rounded = np.rint(present)
    return rounded if (np.abs(present - rounded) < PACKED).all() else present


def _falls(coordinate: Any) -> bool:
    """Whether a coordinate runs from above to below, as y of many images does."""
    values = coordinate.values
    return values.dtype.kind in "iuf" and bool((values[1:] < values[:-1]).all())


def _places(where: str, coordinate: Any, dim: str) -> tuple[float, float]:
    """First value and step of an even coordinate, µm."""
    scale = unit(f"{where}: coordinate {dim}", str(coordinate.attrs.get("units", "um")))
    values = _validate.array(f"{where}: coordinate {dim}", coordinate.values, (None,)) * scale
    steps = np.diff(values)
    step = (values[-1] - values[0]) / len(steps)
    if not np.allclose(steps, step, rtol=1e-3, atol=0) or step <= 0:
        message = (
            f"{where}: coordinate {dim} has steps from {steps.min():g} to {steps.max():g} µm; "
            "expected even steps; give spacing and origin"
        )
        raise ValueError(message)
    return float(values[0]), float(step)
