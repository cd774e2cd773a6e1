"""Label images in files of NumPy: .npy and .npz."""

import math
import os
import zipfile
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from morphosim._files import guarded
from morphosim.importers.labels.image_axes import (
    UNKNOWN,
    Found,
    Wanted,
    at_time,
    check_memory,
    chosen_name,
    letters_of,
)

PICKLED = (
    "{where} holds Python objects, not an array; they are not read, as reading them could run "
    "code. If it is cellpose's _seg.npy, save its masks as an array and import that: "
    "np.save('masks.npy', np.load('..._seg.npy', allow_pickle=True).item()['masks']), with "
    "axes = 'zyx'; or take cellpose's io.save_masks"
)


def read_npy(path: Path, wanted: Wanted) -> Found:
    """Labels of an .npy file."""
    if wanted.key is not None:
        message = f"key = {wanted.key!r}, but {path} holds one array"
        raise ValueError(message)
    with path.open("rb") as file:
        _check_header(path, str(path), file, os.path.getsize(path))
    return _found(str(path), guarded(path, lambda: np.asarray(np.load(path))), wanted)


def read_npz(path: Path, wanted: Wanted) -> Found:
    """Labels of an .npz file."""
    with guarded(path, lambda: zipfile.ZipFile(path)) as archive:
        sizes = {
            info.filename.removesuffix(".npy"): info
            for info in archive.infolist() if info.filename.endswith(".npy")
        }  # fmt: skip
        key = chosen_name(f"array of {path}", wanted.key, sizes, list(sizes))
        where = f"{path}: {key}"
        with guarded(path, lambda: archive.open(sizes[key])) as file:
            _check_header(path, where, file, sizes[key].file_size)

    def load() -> NDArray[Any]:
        with np.load(path) as arrays:
            return np.asarray(arrays[key])

    return _found(where, guarded(path, load), wanted)


def _found(where: str, values: NDArray[Any], wanted: Wanted) -> Found:
    letters = letters_of(where, values.shape, UNKNOWN * values.ndim, "xyz", wanted)
    labels, letters = at_time(where, values, letters, wanted.time_index)
    return Found(labels=labels, letters=letters)


def _check_header(path: Path, where: str, file: IO[bytes], size: int) -> None:
    """Raise ValueError if the header of an array does not fit to the bytes that follow it."""
    dtype, count = guarded(path, lambda: _header(file))
    if dtype.hasobject:
        raise ValueError(PICKLED.format(where=where))
    needed, have = count * dtype.itemsize, size - file.tell()
    if needed > have:
        message = f"{where} is cut short, or damaged: its header says {needed} bytes of data"
        raise ValueError(f"{message}, and {have} are there")
    check_memory(where, needed)


def _header(file: IO[bytes]) -> tuple[np.dtype, int]:
    """Type and number of the values of an array, from its header."""
    readers = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}
    version = npy.read_magic(file)
    if version not in readers:  # version 3 is for names of fields that are no Latin letters
        message = f"format {version} holds no plain array"
        raise ValueError(message)
    shape, _, dtype = readers[version](file)
    return dtype, math.prod(shape)
