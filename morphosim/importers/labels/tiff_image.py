"""Label images in TIFF files: OME-TIFF, stacks of ImageJ and Fiji, and plain ones."""

import logging
import struct
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO

from morphosim import _validate
from morphosim._extras import how_to_install
from morphosim._files import guarded, listed
from morphosim.importers.labels.image_axes import (
    UNKNOWN,
    Found,
    Steps,
    Wanted,
    at_time,
    check_memory,
    letters_of,
    unit,
)

REFERENCE_FRAME = "reference frame"
"""OME's unit of positions that have none."""
PLANAR = {"i", "o", "h", "b"}
"""Letters of tifffile for a sequence of planes of which the file does not say what they are."""
PIXEL = ("", "pixel", "pixels")
"""Units of an image without a scale."""
BIG = 43
"""Number of the kind of TIFF file whose offsets have eight bytes."""
TYPE_SIZES = {1: 1, 2: 1, 3: 2, 4: 4, 5: 8, 6: 1, 7: 1, 8: 2, 9: 4, 10: 8, 11: 4, 12: 8, 13: 4,
              16: 8, 17: 8, 18: 8}  # fmt: skip
"""Bytes of a value, by TIFF's number of its type."""


def read_tiff(path: Path, wanted: Wanted) -> Found:
    """Labels of a TIFF file, with the size and the place of voxels that it says."""
    import tifffile

    _check_whole(path)
    with _quiet(), guarded(path, lambda: tifffile.TiffFile(path)) as file:
        series = guarded(path, lambda: list(file.series))
        k = _chosen(path, series, wanted.key)
        where = str(path) if len(series) == 1 else f"{path}, image {k}"
        chosen = series[k]
        pages = guarded(path, lambda: list(chosen.pages))
        _check_data(where, chosen, pages, path.stat().st_size)
        said = "".join(UNKNOWN if a in PLANAR else a for a in chosen.axes.lower())
        letters = letters_of(where, chosen.shape, said, "zyx", wanted)
        values = guarded(path, lambda: _values(path, chosen))
        ome, imagej, page = file.ome_metadata, file.imagej_metadata, chosen.keyframe
        resolution = [page.tags.get(f"{axis}Resolution") for axis in "XY"]
        ratios = [None if tag is None else tag.value for tag in resolution]
    labels, letters = at_time(where, values, letters, wanted.time_index)
    steps, first = partial(_steps, path, k, ome, imagej, ratios), partial(_ome_first, path, k, ome)
    return Found(labels=labels, letters=letters, steps=steps, first=first)


@contextmanager
def _quiet() -> Iterator[None]:
    """Tifffile logs what is wrong with a file; where it matters, it raises too, or we do."""
    logger = logging.getLogger("tifffile")
    before, logger.disabled = logger.disabled, True
    try:
        yield
    finally:
        logger.disabled = before


def _chosen(path: Path, series: list[Any], key: str | None) -> int:
    """Number of the image asked for, by name or number, or of the only one."""
    names = [str(one.name) for one in series]
    if key is not None:
        known = {str(k): k for k in range(len(series))}
        known |= {name: k for k, name in reversed(list(enumerate(names))) if name}
        _validate.choice(f"image of {path}", key, known)
        return known[key]
    if len(series) != 1:
        each = [
            f"{k} {name!r} ({one.axes}, shape {one.shape})" if name else f"{k} ({one.axes}, "
            f"shape {one.shape})" for k, (name, one) in enumerate(zip(names, series, strict=True))
        ]  # fmt: skip
        message = f"{path} holds {len(series)} images: {', '.join(each) or listed([])}; choose one "
        raise ValueError(message + "by key, its name or number")
    return 0


def _values(path: Path, series: Any) -> Any:
    """Array of an image."""
    try:
        return series.asarray()
    except ValueError as error:
        if "imagecodecs" not in str(error):
            raise
        message = f"{path}: {error}; {how_to_install('images')}"
        raise ImportError(message) from error


# --- whether the file is whole -----------------------------------------------------------------


def _check_whole(path: Path) -> None:
    """Raise ValueError if a page, or what is said of one, lies beyond the end of the file."""
    size = path.stat().st_size
    with path.open("rb") as file:
        for end in _ends(file):
            _check_end(str(path), end, size)


def _check_end(where: str, end: int, size: int) -> None:
    if end > size:
        message = f"{where} is cut short, or damaged: it ends at byte {size}, and says that it "
        raise ValueError(f"{message}goes on to byte {end} at least")


def _ends(file: BinaryIO) -> Iterator[int]:
    """Ends of the pages of a TIFF file, and of what they refer to but their data.

    Each comes before it is read.
    """

    def read(kind: str) -> int:
        return int(struct.unpack(order + kind, file.read(struct.calcsize(kind)))[0])

    order = {b"II": "<", b"MM": ">"}.get(file.read(2), "")
    if not order:
        return  # not a TIFF file
    yield 4
    counts, number = ("Q", "Q") if read("H") == BIG else ("H", "I")
    width, entry = struct.calcsize(number), struct.calcsize(f"<HH{number}{number}")
    yield 4 + (width if width == 4 else 12)
    file.seek(width)
    offset, seen = read(number), set[int]()
    while offset and offset not in seen:
        seen.add(offset)
        yield offset + struct.calcsize(counts)
        file.seek(offset)
        size = read(counts) * entry
        yield offset + struct.calcsize(counts) + size + width
        tags = struct.iter_unpack(f"{order}HH{number}{number}", file.read(size))
        ends = [(TYPE_SIZES.get(kind, 0) * count, place) for _, kind, count, place in tags]
        yield from (place + length for length, place in ends if length > width)
        offset = read(number)


def _check_data(where: str, series: Any, pages: Sequence[Any], size: int) -> None:
    """Raise ValueError if the planes of an image are not all there, or more than fit in memory."""
    check_memory(where, series.nbytes)
    if series.dataoffset is not None:
        _check_end(where, series.dataoffset + series.nbytes, size)
    for page in pages:
        if page is None:
            message = f"{where} lacks planes of its {series.shape[0]}; it may be cut short, or "
            raise ValueError(message + "a part of several files")
        spans = zip(page.dataoffsets, page.databytecounts, strict=False)  # damaged: some
        _check_end(where, max((a + n for a, n in spans), default=0), size)


# --- size and place of voxels ------------------------------------------------------------------


def _steps(path: Path, k: int, ome: str | None, imagej: Any, ratios: Sequence[Any]) -> Steps:
    """Size of a voxel by axis, µm."""
    return _imagej_steps(path, imagej, ratios) if ome is None else _ome_steps(path, k, ome)


def _imagej_steps(path: Path, said: Mapping[str, Any] | None, ratios: Sequence[Any]) -> Steps:
    """Size of a voxel by axis that ImageJ states: voxels per unit along x, y, and the spacing."""
    if not said or str(said.get("unit", "")).lower() in PIXEL:
        return {}
    scale = unit(str(path), str(said["unit"]).replace("\\u00B5", "µ"))
    steps = {
        axis: scale * ratio[1] / ratio[0] for axis, ratio in zip("xy", ratios, strict=True)
        if isinstance(ratio, tuple) and len(ratio) == 2 and min(ratio) > 0
    }  # fmt: skip
    if "spacing" in said:
        steps["z"] = scale * abs(_validate.parsed_number(f"{path}: spacing", said["spacing"]))
    return steps


def _ome_steps(path: Path, k: int, metadata: str) -> Steps:
    """Size of a voxel by axis that OME metadata state, µm."""
    said = _ome_said(path, k, metadata, "{*}Pixels")
    return {
        letter: _validate.parsed_number(f"{path}: {key}", said[key])
        * unit(f"{path}: {key}", said.get(f"{key}Unit", "µm"))
        for letter, key in ((letter, f"PhysicalSize{letter.upper()}") for letter in "xyz")
        if key in said and said.get(f"{key}Unit", "µm").lower() not in PIXEL
    }


def _ome_first(path: Path, k: int, metadata: str | None) -> Steps:
    """Position of the first voxel by axis that OME metadata state in a unit of length, µm."""
    said = _ome_said(path, k, metadata, "{*}Pixels/{*}Plane[@TheZ='0']")
    return {
        letter: _validate.parsed_number(f"{path}: {key}", said[key])
        * unit(f"{path}: {key}", said[f"{key}Unit"])
        for letter, key in ((letter, f"Position{letter.upper()}") for letter in "xyz")
        if key in said and said.get(f"{key}Unit", REFERENCE_FRAME) != REFERENCE_FRAME
    }


def _ome_said(path: Path, k: int, metadata: str | None, place: str) -> Mapping[str, str]:
    """Attributes of the first element at a place in OME metadata of image `k`."""
    from xml.etree import ElementTree

    if metadata is None:
        return {}
    images = guarded(path, lambda: ElementTree.fromstring(metadata)).findall("{*}Image")
    found = images[k].find(place) if k < len(images) else None
    return {} if found is None else found.attrib
