"""Shapes in a label image: the voxels of each cell, sampled anew on cubes, and a wall around all."""

import warnings
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from morphosim.confinement import MaskWalls
from morphosim.labelfile import LabelImage

Floats = NDArray[np.float64]
MOST_LOOSE = 0.05
"""A label whose pieces beside the largest make up more than this share is refused."""
MOST_LISTED = 10


class SegmentationWarning(UserWarning):
    """An image has a fault that is left out, or that a run will show; the message says which."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Piece:
    """The voxels of one label.

    Attributes
    ----------
    label : int
    mask : (nx, ny, nz) bool, cropped to the label
    first : (3,) int, voxel of the image at which the mask begins
    at_border : bool
        Whether the label has voxels at a face of the image.
    """

    label: int
    mask: NDArray[np.bool_]
    first: NDArray[np.int64]
    at_border: bool

    @property
    def count(self) -> int:
        """Number of voxels."""
        return int(np.count_nonzero(self.mask))


def pieces_of(image: LabelImage, least_voxels: int) -> list[Piece]:
    """The labels of an image in ascending order, each in one piece.

    Raises
    ------
    ValueError
        There are no labels, or some have fewer than `least_voxels` or are in several pieces.

    Warns
    -----
    SegmentationWarning
        Loose voxels are left out.
    """
    from scipy.ndimage import find_objects

    values, dense = np.unique(image.labels, return_inverse=True)
    dense = dense.reshape(image.labels.shape)
    if values[0] > 0:  # there is no background: label 1 is the first value
        values, dense = np.concatenate([[0], values]), dense + 1
    if len(values) == 1:
        message = "the image has no labels: all voxels are 0; expected a label above 0 per cell"
        raise ValueError(message)
    pieces = [
        _piece(int(value), dense[box] == k, box, dense.shape)
        for k, (value, box) in enumerate(zip(values[1:], find_objects(dense), strict=True), start=1)
    ]
    _check_sizes(pieces, least_voxels)
    return _in_one_piece(pieces)


def _piece(
    label: int, mask: NDArray[np.bool_], box: tuple[slice, ...], shape: tuple[int, ...]
) -> Piece:
    at_border = any(b.start == 0 or b.stop == n for b, n in zip(box, shape, strict=True))
    first = np.array([b.start for b in box], np.int64)
    return Piece(label=label, mask=mask, first=first, at_border=at_border)


def _check_sizes(pieces: list[Piece], least: int) -> None:
    small = {piece.label: piece.count for piece in pieces if piece.count < least}
    if small:
        message = (
            f"labels of fewer than {least} voxels: {counted(small)}. Set them to 0 in the image or "
            "join them to their cells; for cells that are so small lower least_voxels and "
            "numerics.spacing"
        )
        raise ValueError(message)


def _in_one_piece(pieces: list[Piece]) -> list[Piece]:
    """The largest piece of each label (voxels that share a corner are connected)."""
    largest = [_largest(piece) for piece in pieces]
    loose = {
        before.label: before.count - after.count
        for before, after in zip(pieces, largest, strict=True)
        if after is not before
    }
    torn = {p.label: loose[p.label] for p in pieces if loose.get(p.label, 0) > MOST_LOOSE * p.count}
    if torn:
        message = (
            f"labels in several pieces, with voxels beside the largest: {counted(torn)}. Give each "
            "cell a label of its own, and set fragments to 0 in the image"
        )
        raise ValueError(message)
    if loose:
        message = f"voxels apart from the largest piece of their label are left out: {counted(loose)}"
        warnings.warn(message, SegmentationWarning, stacklevel=4)
    return largest


def _largest(piece: Piece) -> Piece:
    """The largest connected part of a piece: itself, if it is in one piece."""
    from scipy.ndimage import find_objects, label

    parts, count = label(piece.mask, np.ones((3, 3, 3)))
    if count == 1:
        return piece
    k = int(np.argmax(np.bincount(parts.ravel())[1:]))
    box = find_objects(parts)[k]
    return Piece(
        label=piece.label,
        mask=parts[box] == k + 1,
        first=piece.first + [b.start for b in box],
        at_border=piece.at_border,
    )


def counted(voxels: dict[int, int]) -> str:
    """Labels with their numbers of voxels, as a text; at most ten of them."""
    listed = [f"{label} ({count})" for label, count in voxels.items()][:MOST_LISTED]
    more = len(voxels) - len(listed)
    return ", ".join(listed) + (f" and {more} more" if more else "")


def resampled(
    piece: Piece, image: LabelImage, step: float, volume: float
) -> tuple[NDArray[np.bool_], Floats]:
    """Mask of a piece on cubes of edge `step`, and the position of its first voxel, µm.

    The signed distance to the surface is interpolated between voxels; of the cubes, those
    deepest inside that make up `volume` (µm³) are the mask. Cubes that are equally deep are in or
    out together, so a mask with flat faces may miss the volume by a little.
    """
    steps = np.asarray(image.spacing)
    around = 1 + np.ceil(2 * step / steps).astype(int)
    padded = np.pad(piece.mask, [(n, n) for n in around])
    corner = np.asarray(image.origin) + (piece.first - around - 0.5) * steps
    depth = _on_cubes(_signed_distance(padded, steps), steps, step)
    wanted = min(max(round(volume / step**3), 1), depth.size)
    level = np.partition(depth, -wanted, axis=None)[-wanted]
    more, fewer = depth >= level, depth > level
    nearer = abs(np.count_nonzero(more) - wanted) <= abs(np.count_nonzero(fewer) - wanted)
    chosen = more if nearer else fewer
    box = _box(chosen)
    return chosen[box], corner + (np.array([b.start for b in box]) + 0.5) * step


def _signed_distance(mask: NDArray[np.bool_], steps: Floats) -> Floats:
    """Distance of voxels to the nearest one on the other side, µm, positive inside."""
    from scipy.ndimage import distance_transform_edt

    inside = distance_transform_edt(mask, sampling=steps)
    return np.asarray(inside - distance_transform_edt(~mask, sampling=steps))


def _on_cubes(values: Floats, steps: Floats, step: float) -> Floats:
    """Values at the centres of cubes that fill the voxels from the first voxel's corner on."""
    from scipy.ndimage import map_coordinates

    counts = np.ceil(np.array(values.shape) * steps / step - 1e-9).astype(int)
    places = [(np.arange(n) + 0.5) * step / s - 0.5 for n, s in zip(counts, steps, strict=True)]
    points = np.stack(np.meshgrid(*places, indexing="ij"))
    return np.asarray(map_coordinates(values, points, order=1, mode="nearest"))


def _box(mask: NDArray[np.bool_]) -> tuple[slice, ...]:
    """The smallest box that holds the voxels that are set."""
    used = [np.flatnonzero(mask.any(axis=axes)) for axes in ((1, 2), (0, 2), (0, 1))]
    return tuple(slice(int(k[0]), int(k[-1]) + 1) for k in used)


def walls_around(
    image: LabelImage, step: float, clearance: float, closing: float
) -> MaskWalls:
    """Wall at a distance (µm) from all labels, on cubes of edge `step`.

    Gaps of up to twice `closing` (µm) between cells are inside.
    """
    from scipy.ndimage import distance_transform_edt

    steps = np.asarray(image.spacing)
    around = np.ceil((clearance + closing) / steps).astype(int) + 2
    used = _box(image.labels > 0)
    padded = np.pad(image.labels[used] > 0, [(n, n) for n in around])
    corner = np.asarray(image.origin) + ([b.start for b in used] - around - 0.5) * steps
    cells = _on_cubes(_signed_distance(padded, steps), steps, step) > 0
    far = distance_transform_edt(~cells, sampling=step) - step / 2 > clearance + closing
    inside = distance_transform_edt(~far, sampling=step) - step / 2 > closing
    box = _box(inside)
    origin = corner + (np.array([b.start for b in box]) + 0.5) * step
    return MaskWalls(inside=inside[box], origin=origin, spacing=step)
