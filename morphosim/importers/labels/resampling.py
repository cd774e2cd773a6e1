"""Shapes in a label image: cells sampled anew on cubes, and a wall around them."""

import numpy as np
from numpy.typing import NDArray

from morphosim.geometry.confinement import MaskWalls
from morphosim.importers.labels.label_image import LabelImage, Piece

Floats = NDArray[np.float64]


def resampled(
    piece: Piece, image: LabelImage, step: float, volume: float
) -> tuple[NDArray[np.bool_], Floats]:
    """Mask of a piece on cubes of edge `step`, and the position of its first voxel, µm.

    The signed distance to the surface is interpolated between voxels; of the cubes, those
    deepest inside that make up `volume` (µm³) are the mask. Cubes that are equally deep are in or
    out together, so a mask with flat faces may miss the volume by a little.
    """
    from scipy.ndimage import uniform_filter

    steps = image.steps
    around = 1 + np.ceil(2 * step / steps).astype(int)
    padded = np.pad(piece.mask, [(n, n) for n in around])
    origin = np.asarray(image.origin) + (piece.first - around) * steps
    first = origin + 0.5 * (step - steps)  # so that cubes fill a voxel where they fit into it
    depth = _sampled(signed_distance(padded, steps), origin, steps, first, step)
    depth = uniform_filter(depth, 3, mode="nearest").round(6)  # fewer cubes are equally deep
    wanted = min(max(round(volume / step**3), 1), depth.size)
    level = np.partition(depth, -wanted, axis=None)[-wanted]
    more, fewer = depth >= level, depth > level
    nearer = abs(np.count_nonzero(more) - wanted) <= abs(np.count_nonzero(fewer) - wanted)
    chosen = more if nearer else fewer
    box = _box(chosen)
    return chosen[box], first + [b.start * step for b in box]


def signed_distance(mask: NDArray[np.bool_], steps: Floats) -> Floats:
    """Distance of voxels to the nearest one on the other side, µm, positive inside."""
    from scipy.ndimage import distance_transform_edt

    inside = distance_transform_edt(mask, sampling=steps)
    return np.asarray(inside - distance_transform_edt(~mask, sampling=steps))


def _sampled(values: Floats, origin: Floats, steps: Floats, first: Floats, step: float) -> Floats:
    """Values of an image at points `step` apart from `first` on, linear in between."""
    from scipy.ndimage import map_coordinates

    last = origin + (np.array(values.shape) - 0.5) * steps
    axes = [
        (np.arange(a, b, step) - o) / h
        for a, b, o, h in zip(first, last, origin, steps, strict=True)
    ]
    points = np.stack(np.meshgrid(*axes, indexing="ij"))
    return np.asarray(map_coordinates(values, points, order=1, mode="nearest"))


def _box(mask: NDArray[np.bool_]) -> tuple[slice, ...]:
    """The smallest box that holds the voxels that are set."""
    used = [np.flatnonzero(mask.any(axis=axes)) for axes in ((1, 2), (0, 2), (0, 1))]
    return tuple(slice(int(k[0]), int(k[-1]) + 1) for k in used)


def walls_around(image: LabelImage, step: float, clearance: float, closing: float) -> MaskWalls:
    """Wall at a distance (µm) from all labels, on the lattice of spacing `step`.

    Gaps of up to twice `closing` (µm) between cells are inside.
    """
    from scipy.ndimage import distance_transform_edt

    steps = image.steps
    around = np.ceil((clearance + closing + 2 * step) / steps).astype(int) + 2  # room for `far`
    used = _box(image.labels > 0)
    padded = np.pad(image.labels[used] > 0, [(n, n) for n in around])
    origin = np.asarray(image.origin) + ([b.start for b in used] - around) * steps
    first = np.ceil(origin / step) * step
    cells = _sampled(signed_distance(padded, steps), origin, steps, first, step) > 0
    far = distance_transform_edt(~cells, sampling=step) - step / 2 > clearance + closing
    inside = distance_transform_edt(~far, sampling=step) - step / 2 > closing
    box = _box(inside)
    return MaskWalls(inside=inside[box], origin=first + [b.start * step for b in box], spacing=step)
