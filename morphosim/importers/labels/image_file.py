"""Files of label images: TIFF, OME-TIFF, .npy, .npz and netCDF."""

from collections.abc import Callable
from pathlib import Path

from numpy.typing import ArrayLike

from morphosim import _validate
from morphosim._files import check_file
from morphosim.importers.labels.image_axes import Found, Steps, Wanted, checked_axes
from morphosim.importers.labels.label_image import LabelImage
from morphosim.importers.labels.netcdf_image import read_netcdf
from morphosim.importers.labels.numpy_image import read_npy, read_npz
from morphosim.importers.labels.tiff_image import read_tiff


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
        default what the file says (OME metadata, ImageJ's, names of netCDF dimensions); of axes
        that it leaves open the last is z, the one before t, and if it says nothing they are "zyx"
        or "tzyx" in TIFF files, and "xyz" or "txyz" in the others.
    spacing : float or (3,) in the order x, y, z, optional
        Size of a voxel in µm; by default what OME metadata, ImageJ's, or netCDF coordinates say.
    origin : (3,) µm, optional
        Position of the first voxel's centre; by default what OME metadata (PositionX, ...) or
        netCDF coordinates say, else 0.
    key : str, optional
        Array of an .npz file, variable of a netCDF file, or image of a TIFF file by its name or its
        number, counted from 0; by default the only one (of a netCDF file the only one of integers
        with three or four dimensions). Values of a netCDF file are unpacked; missing ones are 0;
        axes whose coordinate falls are turned round.
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
        The file cannot be read, is cut short, or larger than the memory; what it holds is no
        label image in space; or it does not say what is not given. The message says what to give.
    ImportError
        A compressed TIFF file needs the package imagecodecs (extra `images`).

    Examples
    --------
    >>> read_labels("embryo.tif", spacing=(0.2, 0.2, 0.6))  # doctest: +SKIP
    """
    path = Path(path)
    wanted = Wanted(axes=checked_axes(axes), key=key, time_index=time_index)
    check_file(path, READERS)
    found = READERS[path.suffix.lower()](path, wanted)
    order = [found.letters.index(letter) for letter in "xyz"]
    with _validate.told_of(str(path)):
        return LabelImage(
            labels=found.labels.transpose(order),
            spacing=_spacing(path, found.steps()) if spacing is None else spacing,
            origin=_origin(found.first()) if origin is None else origin,
        )


def _origin(first: Steps) -> list[float]:
    return [first.get(axis, 0.0) for axis in "xyz"]


def _spacing(path: Path, steps: Steps) -> list[float]:
    missing = [letter for letter in "xyz" if letter not in steps]
    if missing:
        message = (
            f"{path} does not say the size of its voxels along {', '.join(missing)}; give spacing "
            "in µm, one number or three (x, y, z)"
        )
        raise ValueError(message)
    return [steps[letter] for letter in "xyz"]


READERS: dict[str, Callable[[Path, Wanted], Found]] = {
    ".tif": read_tiff, ".tiff": read_tiff, ".npy": read_npy, ".npz": read_npz, ".nc": read_netcdf,
}  # fmt: skip
"""Function that reads a file, by extension."""
