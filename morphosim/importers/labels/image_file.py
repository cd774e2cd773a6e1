"""Files of label images: TIFF, OME-TIFF, .npy, .npz and netCDF."""

import unicodedata
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from morphosim import _validate
from morphosim._files import check_file, guarded, listed
from morphosim.importers.labels.label_image import LabelImage

TIME_NAMES = ("t", "time")
MICROMETRES = {
    "um": 1.0, "μm": 1.0, "micron": 1.0, "microns": 1.0, "micrometer": 1.0, "micrometers": 1.0,
    "micrometre": 1.0, "micrometres": 1.0, "nm": 1e-3, "mm": 1e3, "cm": 1e4, "m": 1e6,
}  # fmt: skip
"""Units of length that files name, in µm."""
REFERENCE_FRAME = "reference frame"
"""OME's unit of positions that have none."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Found:
    """What a file holds: labels, the letter of each axis, and µm by letter where it says so."""

    labels: NDArray[Any]
    letters: str
    steps: Mapping[str, float] = field(default_factory=dict)
    first: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Wanted:
    """What of a file is wanted; see `read_labels`."""

    axes: str | None
    key: str | None
    time_index: int | None


def read_labels(
    path: str | Path,
    *,
    axes: str | None = None,
    spacing: ArrayLike | None = None,
    origin: ArrayLike | None = None,
    key: str | None = None,
    time_index: int | None = None,
) -> LabelImage:
    """Label image from a file: .tif, .tiff (also OME-TIFF), .npy, .npz or .nc.

    Parameters
    ----------
    path : path
    axes : str, optional
        Order of the array's axes: the letters x, y, z and, where there are several times, t. By
        default what the file says (OME metadata, names of netCDF dimensions), else "zyx" or "tzyx"
        for TIFF, and "xyz" or "txyz" for the others.
    spacing : float or (3,) in the order x, y, z, optional
        Size of a voxel in µm; by default what OME metadata or netCDF coordinates say.
    origin : (3,) µm, optional
        Position of the first voxel's centre; by default what OME metadata (PositionX, ...) or
        netCDF coordinates say, else 0.
    key : str, optional
        Array of an .npz file or variable of a netCDF file; by default the only one (of a netCDF
        file the only one of integers with three or four dimensions).
    time_index : int, optional
        Which time, counted from 0, where the file holds more than one; -1 is the last.

    Returns
    -------
    LabelImage

    Raises
    ------
    FileNotFoundError
        The file does not exist.
    ValueError
        The file cannot be read, what it holds is no label image, or it does not say what is not
        given; the message says what to give.
    ImportError
        A compressed TIFF file needs the package imagecodecs.

    Examples
    --------
    >>> read_labels("embryo.tif", spacing=(0.2, 0.2, 0.6))  # doctest: +SKIP
    """
    path = Path(path)
    wanted = _Wanted(axes=_checked_axes(axes), key=key, time_index=time_index)
    check_file(path, READERS)
    found = READERS[path.suffix.lower()](path, wanted)
    order = [found.letters.index(letter) for letter in "xyz"]
    return LabelImage(
        labels=found.labels.transpose(order),
        spacing=_spacing(path, found.steps) if spacing is None else spacing,
        origin=[found.first.get(a, 0.0) for a in "xyz"] if origin is None else origin,
    )


def _checked_axes(axes: str | None) -> str | None:
    if axes is None:
        return None
    letters = str(axes).lower()
    if sorted(letters) not in (sorted("xyz"), sorted("txyz")):
        message = f"axes = {axes!r}: expected the letters x, y, z in the array's order, such as "
        message += "'zyx', or with t, such as 'tzyx'"
        raise ValueError(message)
    return letters


def _spacing(path: Path, steps: Mapping[str, float]) -> list[float]:
    missing = [letter for letter in "xyz" if letter not in steps]
    if missing:
        message = (
            f"{path} does not say the size of its voxels along {', '.join(missing)}; give spacing "
            "in µm, one number or three (x, y, z)"
        )
        raise ValueError(message)
    return [steps[letter] for letter in "xyz"]


def _letters(where: str, shape: tuple[int, ...], said: str, default: str, wanted: _Wanted) -> str:
    """Letter of each axis: as wanted, else as the file says, else by default."""
    if wanted.axes is not None:
        letters = wanted.axes
    elif set("xyz") <= set(said):
        letters = said
    else:
        letters = ("t" if len(shape) == 4 else "") + default
    if len(letters) != len(shape) or not set(letters) <= set("txyz"):
        message = f"{where} has shape {shape}, with axes {said or letters!r}; expected x, y, z and "
        message += "at most t: take one channel, or give axes"
        raise ValueError(message)
    return letters


def _at_time(
    where: str, values: Any, letters: str, time_index: int | None
) -> tuple[NDArray[Any], str]:
    """Labels at one time, and their axes."""
    if "t" not in letters:
        if time_index is not None:
            message = f"{where} has no time axis (axes {letters!r}), but time_index = {time_index}"
            raise ValueError(message)
        return np.asarray(values), letters
    axis = letters.index("t")
    count = values.shape[axis]
    if time_index is None and count != 1:
        message = f"{where} holds {count} times; choose one by time_index, 0 to {count - 1}"
        raise ValueError(message)
    chosen = _validate.integer("time_index", time_index or 0, least=-count)
    if chosen >= count:
        message = f"time_index = {chosen}, but {where} holds {count} times (0 to {count - 1})"
        raise ValueError(message)
    index = (slice(None),) * axis + (chosen,)
    return np.asarray(values[index]), letters.replace("t", "")


def _read_tiff(path: Path, wanted: _Wanted) -> _Found:
    _check_no_key(path, wanted)
    values, said, metadata = guarded(path, lambda: _tiff_content(path))
    letters = _letters(str(path), values.shape, said, "zyx", wanted)
    labels, letters = _at_time(str(path), values, letters, wanted.time_index)
    return _Found(
        labels=labels, letters=letters, steps=_ome_steps(path, metadata),
        first=_ome_first(path, metadata),
    )  # fmt: skip


def _tiff_content(path: Path) -> tuple[NDArray[Any], str, str | None]:
    """Array, letters of its axes and OME metadata of the first image of a TIFF file."""
    import tifffile

    with tifffile.TiffFile(path) as file:
        series = file.series[0]
        try:
            return series.asarray(), series.axes.lower(), file.ome_metadata
        except ValueError as error:
            if "imagecodecs" not in str(error):
                raise
            message = f"{path}: {error}; try: pip install imagecodecs"
            raise ImportError(message) from error


def _ome_steps(path: Path, metadata: str | None) -> dict[str, float]:
    """Size of a voxel by axis that OME metadata state, µm."""
    said = _ome_said(path, metadata, ".//{*}Pixels")
    return {
        letter: float(said[key]) * _unit(f"{path}: {key}", said.get(f"{key}Unit", "µm"))
        for letter, key in ((letter, f"PhysicalSize{letter.upper()}") for letter in "xyz")
        if key in said
    }


def _ome_first(path: Path, metadata: str | None) -> dict[str, float]:
    """Position of the first voxel by axis that OME metadata state in a unit of length, µm."""
    said = _ome_said(path, metadata, ".//{*}Pixels/{*}Plane[@TheZ='0']")
    return {
        letter: float(said[key]) * _unit(f"{path}: {key}", said[f"{key}Unit"])
        for letter, key in ((letter, f"Position{letter.upper()}") for letter in "xyz")
        if key in said and said.get(f"{key}Unit", REFERENCE_FRAME) != REFERENCE_FRAME
    }


def _ome_said(path: Path, metadata: str | None, place: str) -> Mapping[str, str]:
    """Attributes of the first element at a place in OME metadata."""
    from xml.etree import ElementTree

    if metadata is None:
        return {}
    root = guarded(path, lambda: ElementTree.fromstring(metadata))
    found = root.find(place)
    return {} if found is None else found.attrib


def _unit(name: str, unit: str) -> float:
    """Return a unit of length in µm, or raise ValueError."""
    plain = unicodedata.normalize("NFKC", unit).strip()
    _validate.choice(f"unit of {name}", plain if plain in MICROMETRES else unit, MICROMETRES)
    return MICROMETRES[plain]


def _check_no_key(path: Path, wanted: _Wanted) -> None:
    if wanted.key is not None:
        message = f"key = {wanted.key!r}, but {path} holds one array; keys are for .npz and .nc"
        raise ValueError(message)


def _read_npy(path: Path, wanted: _Wanted) -> _Found:
    _check_no_key(path, wanted)
    return _plain_array(str(path), guarded(path, lambda: np.asarray(np.load(path))), wanted)


def _read_npz(path: Path, wanted: _Wanted) -> _Found:
    arrays = guarded(path, lambda: dict(np.load(path)))
    key = _chosen(f"array of {path}", wanted.key, arrays, list(arrays))
    return _plain_array(f"{path}: {key}", arrays[key], wanted)


def _plain_array(where: str, values: NDArray[Any], wanted: _Wanted) -> _Found:
    letters = _letters(where, values.shape, "", "xyz", wanted)
    labels, letters = _at_time(where, values, letters, wanted.time_index)
    return _Found(labels=labels, letters=letters)


def _chosen(name: str, key: str | None, known: Iterable[str], likely: Sequence[str]) -> str:
    """Return the name asked for, or the only likely one."""
    if key is not None:
        _validate.choice(name, key, known)
        return key
    if len(likely) != 1:
        message = f"{name}: {len(likely)} could be the labels; choose one by key out of "
        raise ValueError(message + listed(list(known)))
    return likely[0]


def _read_netcdf(path: Path, wanted: _Wanted) -> _Found:
    import xarray as xr

    def open_plainly() -> Any:
        return xr.open_dataset(path, decode_times=False, mask_and_scale=False)

    with guarded(path, open_plainly) as data:
        known = [str(name) for name in data.data_vars]
        likely = [n for n in known if data[n].dtype.kind in "iu" and data[n].ndim in (3, 4)]
        variable = data[_chosen(f"variable of {path}", wanted.key, known, likely)]
        where = f"{path}: {variable.name}"
        names = [str(name).lower() for name in variable.dims]
        said = "".join("t" if n in TIME_NAMES else n if len(n) == 1 else "?" for n in names)
        letters = _letters(where, variable.shape, said, "xyz", wanted)
        places = {
            letter: _places(where, variable[dim], str(dim))
            for letter, dim in zip(letters, variable.dims, strict=True)
            if letter != "t" and dim in variable.coords and variable.sizes[dim] > 1
        }
        labels, letters = _at_time(where, variable, letters, wanted.time_index)
    first, steps = ({k: p[i] for k, p in places.items()} for i in (0, 1))
    return _Found(labels=labels, letters=letters, steps=steps, first=first)


def _places(where: str, coordinate: Any, dim: str) -> tuple[float, float]:
    """First value and step of an even coordinate, µm."""
    unit = _unit(f"{where}: coordinate {dim}", coordinate.attrs.get("units", "um"))
    values = _validate.array(f"{where}: coordinate {dim}", coordinate.values, (None,)) * unit
    steps = np.diff(values)
    step = (values[-1] - values[0]) / len(steps)
    if not np.allclose(steps, step, rtol=1e-3, atol=0) or step <= 0:
        message = (
            f"{where}: coordinate {dim} has steps from {steps.min():g} to {steps.max():g} µm; "
            "expected even steps upwards"
        )
        raise ValueError(message)
    return float(values[0]), float(step)


READERS: dict[str, Callable[[Path, _Wanted], _Found]] = {
    ".tif": _read_tiff, ".tiff": _read_tiff, ".npy": _read_npy, ".npz": _read_npz,
    ".nc": _read_netcdf,
}  # fmt: skip
"""Function that reads a file, by extension."""
