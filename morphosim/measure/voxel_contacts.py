"""Contact areas as they are measured in segmented microscope images, to compare like with like.

Cells of such an image are parted by a boundary one voxel thick, whose voxels are common to both
cells if each is dilated by its face neighbours. Per voxel face of area, a flat boundary of unit
normal n has max |n_k| such voxels. So their number times 1.2031, 1 / mean of max |n_k|, is an area
that is right on average over all directions: 20 % too large along a lattice plane, 31 % too small
along (111).
"""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from morphosim import _validate
from morphosim.cell_field import CellField
from morphosim.measure.label_image import check_size, label_image

VOXEL = 0.18
"""Voxel edge, µm, of the embryos that contact areas are known of (CMap)."""
AREA_PER_VOXEL = 1.2031
"""Mean area of a boundary per voxel of it, in voxel faces."""
Integers = NDArray[np.int64]


def voxel_contact_areas(
    fields: Sequence[CellField], spacing: float, voxel: float = VOXEL
) -> dict[tuple[str, str], float]:
    """Contact area, µm², of every pair of cells, as it is measured in a segmented image of them.

    Parameters
    ----------
    fields
        Cells, such as `Simulation.fields`.
    spacing
        Of their lattice, µm.
    voxel
        Edge of the image's voxels, µm. A voxel belongs to the cell of largest φ where the sum of
        all φ exceeds 0.5.

    Raises
    ------
    ValueError
        `spacing` or `voxel` is not positive, or the image would have more than 2³¹ voxels.
    """
    _validate.number("spacing", spacing, above=0)
    _validate.number("voxel", voxel, above=0)
    if not fields:
        return {}
    _, labels = label_image([_on_voxels(f, spacing, voxel) for f in fields], filled=True)
    return {
        (fields[i - 1].name, fields[j - 1].name): AREA_PER_VOXEL * count * voxel**2
        for (i, j), count in boundary_voxels(labels).items()
    }


def boundary_voxels(labels: NDArray[np.integer]) -> dict[tuple[int, int], float]:
    """Voxels of the boundary between two labels that are in face contact; 0 is background.

    The boundary may lie in either cell: the number is the mean of both.
    """
    sides = np.unique(np.concatenate(list(_face_pairs(labels))), axis=0)
    both = np.sort(np.stack([labels.ravel()[sides[:, 0]], sides[:, 1]], axis=1), axis=1)
    pairs, counts = np.unique(both, axis=0, return_counts=True)
    return {
        (i, j): count / 2 for (i, j), count in zip(pairs.tolist(), counts.tolist(), strict=True)
    }


def _face_pairs(labels: NDArray[np.integer]) -> Iterator[Integers]:
    """Place of each voxel with a face neighbour of another label, and that label: (n, 2)."""
    for axis in range(3):
        low, high = (np.moveaxis(labels, axis, 0)[part] for part in (slice(-1), slice(1, None)))
        at = np.nonzero((low != high) & (low > 0) & (high > 0))
        for values, shift in ((high, 0), (low, 1)):
            place = [at[0] + shift, at[1], at[2]]
            place.insert(axis, place.pop(0))
            found = [np.ravel_multi_index(place, labels.shape), values[at]]
            yield np.stack(found, axis=1, dtype=np.int64)


def _on_voxels(field: CellField, spacing: float, voxel: float) -> CellField:
    """The field at voxels of edge `voxel`, µm, by cubic splines; its lattice is that of the voxels.

    Its voxels' numbers times `voxel` are positions.
    """
    from scipy.ndimage import affine_transform

    around = 2 + int(voxel / spacing)
    origin = field.origin - around
    phi = np.pad(field.phi, around).astype(np.float32, copy=False)
    first = np.ceil(origin * spacing / voxel).astype(np.int64)
    last = np.floor((origin + np.array(phi.shape) - 1) * spacing / voxel).astype(np.int64)
    check_size(last - first + 1, f"voxel = {voxel:g} um: take larger voxels")
    values = affine_transform(
        phi, np.full(3, voxel / spacing), first * voxel / spacing - origin,
        tuple(last - first + 1), order=3,
    )  # fmt: skip
    return CellField(field.name, first, values)
