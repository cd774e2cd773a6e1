"""Label images of segmented cells, and the voxels of each cell."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from morphosim import _validate
from morphosim._shown import short_repr
from morphosim.errors import warn

MOST_LOOSE = 0.05
"""A label whose pieces beside the largest make up more than this share is refused."""
MOST_LISTED = 10


class SegmentationWarning(UserWarning):
    """An image has a fault that is left out, or that a run will show; the message says which."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LabelImage:
    """Segmented cells: one whole number per voxel, 0 where there is no cell.

    Attributes
    ----------
    labels : (nx, ny, nz) integers >= 0
    spacing : float or (3,) µm, size of a voxel
    origin : (3,) µm, position of the centre of the voxel [0, 0, 0]

    Raises
    ------
    ValueError
        The labels are not three-dimensional or not whole numbers >= 0; or spacing or origin are
        not numbers that are allowed.
    """

    labels: NDArray[np.integer]
    spacing: ArrayLike
    origin: ArrayLike = (0.0, 0.0, 0.0)

    __repr__ = short_repr

    def __post_init__(self) -> None:
        object.__setattr__(self, "labels", _whole_numbers(self.labels))
        object.__setattr__(self, "spacing", _validate.spacing("spacing", self.spacing))
        object.__setattr__(self, "origin", _validate.vector("origin", self.origin))

    @property
    def steps(self) -> NDArray[np.float64]:
        """Size of a voxel along each axis, (3,) µm."""
        return np.asarray(self.spacing, np.float64)

    @property
    def voxel(self) -> float:
        """Volume of a voxel, µm³."""
        return float(np.prod(self.steps))

    def without(self, background: int) -> "LabelImage":
        """Copy with the label of a background set to 0."""
        _validate.integer("background", background, least=0)
        if background and background not in self.labels:
            message = f"background = {background}, but no voxel has this label"
            raise ValueError(message)
        return replace(self, labels=np.where(self.labels == background, 0, self.labels))


def _whole_numbers(values: ArrayLike) -> NDArray[np.integer]:
    """Return labels as integers, or raise ValueError."""
    labels = np.asarray(values)
    if labels.ndim != 3 or labels.size == 0:
        message = f"labels have shape {labels.shape}; expected three axes (x, y, z)"
        raise ValueError(message)
    if labels.dtype.kind not in "buif":
        message = f"labels have type {labels.dtype}; expected whole numbers"
        raise ValueError(message)
    if labels.dtype.kind == "f" and not (np.isfinite(labels) & (labels == np.rint(labels))).all():
        message = "labels hold numbers that are not whole; expected one whole number per voxel"
        raise ValueError(message)
    if labels.dtype.kind in "bf":
        labels = labels.astype(np.int64)
    if labels.dtype.kind == "i" and labels.min() < 0:
        message = f"labels hold {labels.min()}; expected 0 (no cell) and labels above 0"
        raise ValueError(message)
    return labels


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
        There are no labels, or some have fewer than `least_voxels` or are in several pieces; or no
        voxel is 0 and a label reaches all faces of the image, as a background does.

    Warns
    -----
    SegmentationWarning
        Loose voxels are left out, holes are filled, or no voxel is the background.
    """
    from scipy.ndimage import find_objects

    values, dense = np.unique(image.labels, return_inverse=True)
    dense = dense.reshape(image.labels.shape)
    if values[0] > 0:
        values, dense = np.concatenate([[0], values]), dense + 1
        _tell_of_background(values, dense)
    if len(values) == 1:
        message = "the image has no labels: all voxels are 0; expected a label above 0 per cell"
        raise ValueError(message)
    boxes = zip(values[1:], find_objects(dense), strict=True)
    pieces = [
        _piece(int(value), dense[box] == k, [b.start for b in box], dense.shape)
        for k, (value, box) in enumerate(boxes, start=1)
    ]
    _check_sizes(pieces, least_voxels)
    return _without_holes(_in_one_piece(pieces, dense.shape), dense)


def _tell_of_background(values: NDArray[np.integer], dense: NDArray[np.integer]) -> None:
    """Tell that no voxel is 0; ValueError if one of the labels plainly is the background."""
    faces = [dense[(slice(None),) * axis + (end,)] for axis in range(3) for end in (0, -1)]
    around = set.intersection(*(set(np.unique(face)) for face in faces))
    if around:
        label = values[min(around)]
        message = (
            f"no voxel of the image is 0, the background, and label {label} reaches all its "
            f"faces. If that is the background, give background = {label}, else take an image "
            "with a margin"
        )
        raise ValueError(message)
    message = (
        f"no voxel of the image is 0, the background: all of it is taken as {len(values) - 1} "
        "cells. If one of the labels is the background, give it as background"
    )
    warn(message, SegmentationWarning)


def _piece(label: int, mask: NDArray[np.bool_], first: ArrayLike, shape: tuple[int, ...]) -> Piece:
    """Piece with its mask at the voxel `first` of an image of this shape."""
    first = np.asarray(first, np.int64)
    at_border = bool((first == 0).any() or (first + mask.shape == shape).any())
    return Piece(label=label, mask=mask, first=first, at_border=at_border)


def _check_sizes(pieces: list[Piece], least: int) -> None:
    small = {piece.label: piece.count for piece in pieces if piece.count < least}
    if small:
        message = (
            f"labels of fewer than {least} voxels: {_counted(small)}. Set them to 0 in the image "
            "or join them to their cells; if cells are so small, lower least_voxels and "
            "numerics.spacing"
        )
        raise ValueError(message)


def _in_one_piece(pieces: list[Piece], shape: tuple[int, ...]) -> list[Piece]:
    """The largest piece of each label (voxels that share a corner are connected)."""
    largest = [_largest(piece, shape) for piece in pieces]
    loose = {
        before.label: before.count - after.count
        for before, after in zip(pieces, largest, strict=True)
        if after is not before
    }
    torn = {p.label: loose[p.label] for p in pieces if loose.get(p.label, 0) > MOST_LOOSE * p.count}
    if torn:
        message = (
            f"labels in several pieces, with voxels beside the largest: {_counted(torn)}. Give "
            "each cell a label of its own, and set fragments to 0 in the image"
        )
        raise ValueError(message)
    if loose:
        message = (
            f"voxels apart from the largest piece of their label are left out: {_counted(loose)}"
        )
        warn(message, SegmentationWarning)
    return largest


def _largest(piece: Piece, shape: tuple[int, ...]) -> Piece:
    """The largest connected part of a piece: itself, if it is in one piece."""
    from scipy.ndimage import find_objects, label

    parts, count = label(piece.mask, np.ones((3, 3, 3)))
    if count == 1:
        return piece
    k = int(np.argmax(np.bincount(parts.ravel())[1:]))
    box = find_objects(parts)[k]
    first = piece.first + [b.start for b in box]
    return _piece(piece.label, parts[box] == k + 1, first, shape)


def _without_holes(pieces: list[Piece], dense: NDArray[np.integer]) -> list[Piece]:
    """Pieces whose holes belong to them: voxels of the background within, such as a nucleus.

    A hole in which there is a voxel of another label stays.
    """
    full = [_filled(piece, dense) for piece in pieces]
    filled = {
        before.label: after.count - before.count
        for before, after in zip(pieces, full, strict=True)
        if after is not before
    }
    if filled:
        message = f"holes within labels are filled, with voxels of 0: {_counted(filled)}"
        warn(message, SegmentationWarning)
    return full


def _filled(piece: Piece, dense: NDArray[np.integer]) -> Piece:
    """A piece with its holes: itself, if it has none."""
    from scipy.ndimage import label

    outside, count = label(np.pad(~piece.mask, 1, constant_values=True))
    if count == 1:
        return piece
    parts = outside[1:-1, 1:-1, 1:-1]
    ends = piece.first + piece.mask.shape
    box = dense[tuple(slice(a, b) for a, b in zip(piece.first, ends, strict=True))]
    others = np.unique(parts[(box > 0) & ~piece.mask])
    holes = (parts > 0) & ~np.isin(parts, [outside[0, 0, 0], *others])
    return replace(piece, mask=piece.mask | holes) if holes.any() else piece


def _counted(voxels: dict[int, int]) -> str:
    """Labels with their numbers of voxels, as a text; at most ten of them."""
    listed = [f"{label} ({count})" for label, count in voxels.items()][:MOST_LISTED]
    more = len(voxels) - len(listed)
    return ", ".join(listed) + (f" and {more} more" if more else "")
