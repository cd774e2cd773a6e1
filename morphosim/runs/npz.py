"""Arrays of an .npz file, written and read in pieces; `numpy.load` reads such a file too."""

import struct
from pathlib import Path
from typing import IO, Any
from zipfile import ZIP_STORED, ZipFile

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from morphosim._parts import PIECE, Joined, Stored, pieces

ENDING = ".npy"
LOCAL_HEADER, LENGTHS = 30, "<HH"
"""Bytes of what stands before a file in an archive, without name and extra field, whose lengths
come last."""


def write_array(archive: ZipFile, name: str, values: Any) -> None:
    """Add an array, or one that is there in parts, to an archive that is being written."""
    with archive.open(name + ENDING, "w", force_zip64=True) as file:
        if not isinstance(values, Joined | Stored):
            npy.write_array(file, np.asanyarray(values), allow_pickle=False)
            return
        header = {
            "descr": npy.dtype_to_descr(values.dtype), "fortran_order": False,
            "shape": values.shape,
        }  # fmt: skip
        npy.write_array_header_1_0(file, header)
        for piece in pieces(values):
            file.write(piece.data)  # as it is: a copy takes as long as the checksum


def read_array(archive: ZipFile, name: str) -> NDArray[Any]:
    """Array of an archive."""
    with archive.open(name + ENDING) as file:
        return np.asarray(npy.read_array(file, allow_pickle=False))


def stored_array(archive: ZipFile, name: str) -> Any:
    """Array of an archive, checked against its checksum, that stays in the file until it is used.

    Raises
    ------
    zipfile.BadZipFile, ValueError
        It is not what was written.
    """
    info = archive.getinfo(name + ENDING)
    with archive.open(info) as file:
        version = npy.read_magic(file)
        if info.compress_type != ZIP_STORED or version != (1, 0):
            return read_array(archive, name)
        shape, in_columns, dtype = npy.read_array_header_1_0(file)
        if in_columns or not shape or dtype.hasobject:
            return read_array(archive, name)
        begin, size = file.tell(), int(np.prod(shape)) * dtype.itemsize
        _read_through(file)
    if info.file_size != begin + size:
        message = f"{name} has {info.file_size - begin} bytes; expected {size}"
        raise ValueError(message)
    path = Path(str(archive.filename))
    return Stored(path, _begin_of(path, info.header_offset) + begin, dtype, shape)


def _read_through(file: IO[bytes]) -> None:
    """Read to the end, where the checksum is compared."""
    while file.read(PIECE):
        pass


def _begin_of(path: Path, header: int) -> int:
    """Where the contents of a file begin within an archive, given where its header does."""
    with path.open("rb") as file:
        file.seek(header + LOCAL_HEADER - struct.calcsize(LENGTHS))
        name, extra = struct.unpack(LENGTHS, file.read(struct.calcsize(LENGTHS)))
    return header + LOCAL_HEADER + int(name) + int(extra)
