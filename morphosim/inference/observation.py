"""Surfaces that are seen in a label image: where each cell ends, and what lies behind."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from morphosim.cell_field import CellField
from morphosim.importers.labels.label_image import LabelImage
from morphosim.importers.labels.resampling import signed_distance
from morphosim.kernels.offsets import grid_values
from morphosim.measure.contacts import pack
from morphosim.measure.label_image import labels_within

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
BACKGROUND = -1
"""Neighbour of a point where a cell is free."""
CLEAR = 0.8
"""Points nearer than this to a third cell, or where a contact ends, are not compared, µm: there an
image rounds edges off."""
GAP = 0.55
"""Where two cells lie nearer to a point than this, µm, it is no background: two tails of φ = 1/4
fill it (`measure.label_image`)."""
AROUND = 3.0
"""Margin around a cell in which its neighbours are looked for, µm."""


@dataclass(frozen=True, slots=True, eq=False)
class Surfaces:
    """Points on the surfaces of all cells; those of a contact are there from both sides.

    Attributes
    ----------
    names : N names, of the labels 1 to N
    points, normals : (P, 3), µm, and of unit length, outwards
    area : (P,) µm² of surface for which a point stands
    cell : (P,) int64
    neighbour : (P,) int64
        The cell behind; `BACKGROUND` where there is none.
    clear : (P,) bool
        Whether it is no nearer than `CLEAR` to a third cell or the end of a contact.
    """

    names: tuple[str, ...]
    points: Floats
    normals: Floats
    area: Floats
    cell: Integers
    neighbour: Integers
    clear: NDArray[np.bool_]

    @property
    def once(self) -> NDArray[np.bool_]:
        """(P,) whether a point is clear, and of a contact the one of the cell of lower number."""
        first = (self.neighbour == BACKGROUND) | (self.cell < self.neighbour)
        return np.asarray(self.clear & first)

    @property
    def contacts(self) -> list[tuple[int, int]]:
        """Pairs of cells in contact, i < j and sorted."""
        both = self.clear & (self.neighbour > self.cell)
        return sorted(
            set(zip(self.cell[both].tolist(), self.neighbour[both].tolist(), strict=True))
        )

    def volume_off(self, offset: Floats) -> Floats:
        """(N,) volume by which cells are too large, µm³, of surfaces that are off by so much."""
        return np.asarray(np.bincount(self.cell, offset * self.area, len(self.names)))


def surfaces_of(image: LabelImage, names: Sequence[str]) -> Surfaces:
    """Surfaces of an image whose labels are 1 to N, and whose contacts have no gaps."""
    parts = [_surface(image, k) for k in range(len(names))]
    points, normals, area, cell, neighbour, clear = map(np.concatenate, zip(*parts, strict=True))
    return Surfaces(tuple(names), points, normals, area, cell, neighbour, clear)


def has_gaps(image: LabelImage) -> bool:
    """Whether cells that touch have a voxel of background between them."""
    joined = parted = 0
    for axis in range(3):
        values = np.moveaxis(image.labels, axis, 0)
        a, b, c = values[:-2], values[1:-1], values[2:]
        joined += int(np.count_nonzero((a != b) & (a > 0) & (b > 0)))
        parted += int(np.count_nonzero((b == 0) & (a != c) & (a > 0) & (c > 0)))
    return parted > joined


def closed(image: LabelImage) -> LabelImage:
    """Copy without background between cells that touch: it belongs to the nearer of the two.

    That is background within `GAP`, or a voxel, of two cells.
    """
    from scipy.ndimage import distance_transform_edt

    sampling = image.steps / np.maximum(GAP, 1.01 * image.steps)
    nearest = np.full(image.labels.shape, np.inf, np.float32)
    owner = np.zeros(image.labels.shape, image.labels.dtype)
    count = np.zeros(image.labels.shape, np.int8)
    for label, box in _boxes(image):
        away = distance_transform_edt(image.labels[box] != label, sampling=sampling)
        count[box] += away <= 1
        nearer = away < nearest[box]
        owner[box][nearer] = label
        nearest[box][nearer] = away[nearer]
    between = (image.labels == 0) & (count >= 2)
    return replace(image, labels=np.where(between, owner, image.labels))


def _boxes(image: LabelImage) -> Iterator[tuple[int, tuple[slice, ...]]]:
    """Each label, and the box of voxels around it."""
    from scipy.ndimage import find_objects

    around = np.ceil(AROUND / image.steps).astype(int)
    for label, box in enumerate(find_objects(image.labels), start=1):
        if box is not None:
            yield (
                label,
                tuple(
                    slice(max(b.start - n, 0), b.stop + n) for b, n in zip(box, around, strict=True)
                ),
            )


def label_depth(image: LabelImage, label: int, margin: float) -> tuple[Floats, Floats]:
    """Depth of voxels below the surface of a label, µm, and the position of the first one, µm.

    They reach `margin` µm beyond the label.
    """
    labels, first = _around(image, label, margin)
    depth = signed_distance(labels == label, image.steps)
    return depth, np.asarray(image.origin) + first * image.steps


def _surface(image: LabelImage, k: int) -> tuple[NDArray, ...]:
    """Points, normals, areas, cell, neighbours and clearness of one cell's surface."""
    from skimage.measure import marching_cubes

    steps, label = image.steps, k + 1
    labels, first = _around(image, label, AROUND)
    depth = signed_distance(labels == label, steps).astype(np.float32)
    places, faces, _, _ = marching_cubes(depth, 0.0)
    normals, area = _normals_and_areas(places * steps, faces)
    outside = _sample(depth, places + 0.3 * normals * steps.min() / steps) < 0
    normals *= np.where(outside, 1.0, -1.0)[:, None]
    neighbour, clear = _behind(labels, label, places, normals, steps)
    points = places * steps + (np.asarray(image.origin) + first * steps)
    return points, normals, area, np.full(len(points), k), neighbour, clear


def _around(image: LabelImage, label: int, margin: float) -> tuple[NDArray[np.integer], Integers]:
    """Labels in the box around one of them, and its first voxel; beyond the image they are 0."""
    used = np.argwhere(image.labels == label)
    more = np.ceil(margin / image.steps).astype(int)
    first, last = used.min(axis=0) - more, used.max(axis=0) + more + 1
    return _block(image.labels, first, last), first


def _block(labels: NDArray[np.integer], first: Integers, last: Integers) -> NDArray[np.integer]:
    """Part of an image; what lies beyond it is background."""
    low, high = np.maximum(first, 0), np.minimum(last, labels.shape)
    part = labels[tuple(slice(a, b) for a, b in zip(low, high, strict=True))]
    return np.pad(part, list(zip(low - first, last - high, strict=True)))


def _sample(values: NDArray[np.floating], places: Floats) -> Floats:
    from scipy.ndimage import map_coordinates

    return np.asarray(map_coordinates(values, places.T, order=1))


def _normals_and_areas(points: Floats, faces: Integers) -> tuple[Floats, Floats]:
    """Normal of each vertex of a mesh, and a third of the area of the triangles around it."""
    a, b, c = np.moveaxis(points[faces], 1, 0)
    across = np.cross(b - a, c - a)
    area, normal = np.zeros(len(points)), np.zeros_like(points)
    for corner in faces.T:
        np.add.at(area, corner, np.linalg.norm(across, axis=1) / 6)
        np.add.at(normal, corner, across)
    size = np.linalg.norm(normal, axis=1, keepdims=True)
    return normal / np.where(size > 0, size, 1.0), area


def _behind(
    labels: NDArray[np.integer], label: int, places: Floats, normals: Floats, steps: Floats
) -> tuple[Integers, NDArray[np.bool_]]:
    """Neighbour at each vertex, and whether a third cell, or the background, is not near."""
    from scipy.ndimage import distance_transform_edt

    mine = labels == label
    inner = np.rint(places - 0.3 * normals * steps.min() / steps).astype(np.int64).T
    nearest = distance_transform_edt(
        mine, sampling=steps, return_distances=False, return_indices=True
    )[:, *inner]
    neighbour = labels[tuple(nearest)].astype(np.int64)
    neighbour[~mine[tuple(inner)]] = labels[tuple(inner)][~mine[tuple(inner)]]
    clear = np.zeros(len(places), bool)
    for other in np.unique(neighbour):
        at = neighbour == other
        away = distance_transform_edt(mine | (labels == other), sampling=steps)
        clear[at] = _sample(away, places[at]) > CLEAR + 0.5 * float(steps.mean())
    return neighbour - 1, clear


def photographed(fields: Sequence[CellField], spacing: float, image: LabelImage) -> LabelImage:
    """Label image of fields on the voxels of another image.

    A voxel belongs to the cell of largest φ where the sum of all φ exceeds 1/2: contacts have no
    gaps.
    """
    pool, boxes = pack(fields)
    step, shape = image.steps / spacing, np.array(image.labels.shape)
    first = np.asarray(image.origin) / spacing
    sampled = []
    for k, field in enumerate(fields):
        low = np.clip(np.ceil((boxes.origin[k] - first) / step), 0, shape).astype(np.int64)
        ends = np.floor((boxes.origin[k] + boxes.shape[k] - 1 - first) / step) + 1
        values = np.zeros(np.clip(ends, low, shape).astype(np.int64) - low, np.float32)
        grid_values(
            pool, boxes.origin, boxes.shape, boxes.start, k, first + low * step, step, values
        )
        sampled.append(CellField(field.name, low, values))
    labels = labels_within(sampled, np.zeros(3, np.int64), shape, filled=True)
    return replace(image, labels=labels)
