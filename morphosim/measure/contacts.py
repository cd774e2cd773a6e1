"""Which cells touch, and over what area.

Definitions of the published program: two cells touch where {φ > 0.44}, dilated by one lattice
step, overlap; the contact area of i with j is that part of the φ_i = 0.34 surface on which
φ_j >= 0.2, and the area of a pair is the mean of both sides. Surfaces are found by marching
tetrahedra, and how much of them is in contact by linear interpolation.
"""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numba import get_num_threads
from numpy.typing import NDArray

from morphosim import _validate
from morphosim.cell_field import CellField
from morphosim.kernels.contacts import Neighbours, contacts
from morphosim.kernels.layout import Boxes, Shares
from morphosim.kernels.moments import Fields, find_extents, overlapping_pairs
from morphosim.kernels.rows import whole_rows
from morphosim.kernels.sharing import equal_shares
from morphosim.kernels.surfaces import Work
from morphosim.period import Period, with_images

TOUCH_LEVEL = 0.44
SURFACE_LEVEL = 0.34
NEIGHBOUR_LEVEL = 0.2
Integers = NDArray[np.int64]


def touching(fields: Iterable[CellField]) -> dict[tuple[str, str], int]:
    """Pairs of names that touch, with the number of lattice points that both cells cover."""
    from scipy.ndimage import binary_dilation, generate_binary_structure

    cross = generate_binary_structure(3, 1)
    masks = [
        CellField(f.name, f.origin - 1, binary_dilation(np.pad(f.phi > TOUCH_LEVEL, 1), cross))
        for f in fields
    ]
    origin, shape = _places(masks)
    counts = {}
    for i, j in overlapping(origin, origin + shape).tolist():
        a, b = common(masks[i], masks[j])
        shared = int(np.count_nonzero(a & b))
        if shared:
            counts[masks[i].name, masks[j].name] = shared
    return counts


def contact_areas(fields: Sequence[CellField], spacing: float) -> dict[tuple[str, str], float]:
    """Contact area in µm² of every pair whose surfaces meet.

    Raises
    ------
    ValueError
        `spacing` is not positive.
    """
    _validate.number("spacing", spacing, above=0)
    pairs, areas, _ = pair_areas(prepare(*pack(fields)), spacing)
    names = [f.name for f in fields]
    return {
        (names[i], names[j]): area
        for (i, j), area in zip(pairs.tolist(), areas.tolist(), strict=True)
    }


class Prepared(NamedTuple):
    """What the kernels that measure all cells need."""

    shares: Shares
    fields: Fields
    """Of all cells, and in periodic space after them those of their images."""
    work: Work
    cell: Integers
    """Cell of each field."""
    cells: int
    """Number of cells."""


def pack(fields: Sequence[CellField]) -> tuple[NDArray[np.floating], Boxes]:
    """Pool of these fields, and where they lie in it; see `measure.measure`."""
    origin, shape = _places(fields)
    ends = np.cumsum(shape.prod(axis=1))
    single = all(f.phi.dtype == np.float32 for f in fields)
    pool: NDArray[np.floating] = np.zeros(ends.max(initial=0), np.float32 if single else np.float64)
    for field, end in zip(fields, ends.tolist(), strict=True):
        pool[end - field.phi.size : end] = field.phi.ravel()
    start = np.asarray(ends - shape.prod(axis=1))
    return pool, Boxes(origin, shape, start, *whole_rows(shape))


def shared_out(shape: Integers) -> Shares:
    """How threads share cells with boxes of these shapes (N, 3)."""
    shares: Shares = equal_shares(shape.prod(axis=1), get_num_threads())
    return shares


def placed(phi: NDArray[np.floating], boxes: Boxes) -> Fields:
    """The fields of a pool; what part of its box each fills is to be found."""
    return Fields(phi, *boxes, np.zeros((len(boxes.start), 3, 2), np.int64))


def prepare(phi: NDArray[np.floating], boxes: Boxes, period: Period | None = None) -> Prepared:
    """Share the cells out between threads, and find what part of its box each fills."""
    shares = shared_out(boxes.shape)
    fields = placed(phi, boxes)
    find_extents(shares, fields, NEIGHBOUR_LEVEL)  # the lowest level of all
    points = np.maximum(fields.extent[:, :, 1] - fields.extent[:, :, 0] + 2, 1)
    most, longest = points.prod(axis=1).max(initial=1), points[:, 2].max(initial=1)
    work = Work(
        values=np.empty((shares.threads, most), phi.dtype),
        cubes=np.empty((shares.threads, longest), np.int64),
        pieces=np.empty((shares.threads, longest, 8)),
    )
    cell = np.arange(len(boxes.start))
    if period is not None:
        owner, origin = period.images(boxes, 1)
        cell = np.concatenate([cell, owner])
        fields = Fields(phi, *with_images(boxes, owner, origin), fields.extent[cell])
    return Prepared(shares, fields, work, cell, len(boxes.start))


def pair_areas(
    prepared: Prepared, spacing: float
) -> tuple[Integers, NDArray[np.float64], NDArray[np.float64]]:
    """Which cells are in contact, and over what area.

    Returns
    -------
    pairs : (P, 2) int64, i < j and sorted
    areas : (P,) float64, µm²
    touched : (N,) float64
        Area of that part of each cell's surface φ = 0.34 where any neighbour has φ >= 0.2, µm².
    """
    pairs, sides, touched = side_areas(prepared)
    areas = sides.reshape(2, -1).mean(axis=0) * spacing**2
    return pairs[areas > 0], areas[areas > 0], touched * spacing**2


def side_areas(
    prepared: Prepared,
) -> tuple[Integers, NDArray[np.float64], NDArray[np.float64]]:
    """What part of each cell's own surface its neighbours cover, in squared lattice steps.

    Returns
    -------
    pairs : (P, 2) int64
        That may be in contact, i < j and sorted.
    sides : (2 P,) float64
        What j covers of i, of all pairs, and then what i covers of j.
    touched : (N,) float64, see `pair_areas`
    """
    fields, count = prepared.fields, prepared.cells
    low, high = fields.origin + fields.extent[:, :, 0], fields.origin + fields.extent[:, :, 1]
    pairs = overlapping(low - 1, high + 1)  # from the cubes of one in reach of the other
    both = np.concatenate([pairs, pairs[:, ::-1]])
    both = both[both[:, 0] < count]  # what images touch, their cells do
    order = np.lexsort((both[:, 1], both[:, 0]))
    neighbours = Neighbours(
        start=np.searchsorted(both[order, 0], np.arange(count + 1)), cell=both[order, 1]
    )
    found, touched = np.zeros(len(order)), np.zeros(count)
    contacts(
        prepared.shares, fields, SURFACE_LEVEL, NEIGHBOUR_LEVEL, neighbours, prepared.work, found,
        touched,
    )  # fmt: skip
    sides = np.zeros(len(order))
    sides[order] = found
    if len(fields.start) > count:
        pairs, sides = _of_cells(prepared.cell[both], sides)
    return pairs, sides, touched


def _of_cells(both: Integers, areas: NDArray[np.float64]) -> tuple[Integers, NDArray[np.float64]]:
    """Pairs and sides of cells, of what each covers of a cell by itself and by its images.

    A cell that touches its own image is in no pair.
    """
    others = both[:, 0] != both[:, 1]
    both, areas = both[others], areas[others]
    pairs, place = np.unique(np.sort(both, axis=1), axis=0, return_inverse=True)
    place = place.reshape(-1) + np.where(both[:, 0] < both[:, 1], 0, len(pairs))
    return pairs, np.asarray(np.bincount(place, areas, 2 * len(pairs)), np.float64)


def overlapping(low: Integers, high: Integers) -> Integers:
    """Pairs (P, 2) of boxes [low, high), each (N, 3), that overlap; i < j and sorted."""
    corners = np.ascontiguousarray(low), np.ascontiguousarray(high)
    order = np.argsort(low[:, 0], kind="stable")
    count = overlapping_pairs(order, *corners, np.zeros((0, 2), np.int64))
    pairs = np.zeros((count, 2), np.int64)
    overlapping_pairs(order, *corners, pairs)
    return pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]


def _places(fields: Sequence[CellField]) -> tuple[Integers, Integers]:
    """Origin and shape of each box, (N, 3) both."""
    origin = np.array([f.origin for f in fields], np.int64).reshape(-1, 3)
    return origin, np.array([f.phi.shape for f in fields], np.int64).reshape(-1, 3)


def common(a: CellField, b: CellField) -> tuple[NDArray, NDArray]:
    """Views of both arrays on the part of the lattice that they share."""
    low = np.maximum(a.origin, b.origin)
    high = np.minimum(a.origin + a.phi.shape, b.origin + b.phi.shape)
    views = [
        f.phi[tuple(slice(p, q) for p, q in zip(low - f.origin, high - f.origin, strict=True))]
        for f in (a, b)
    ]
    return views[0], views[1]
