"""Cells as a picture of many needs them: those that can be seen, no finer than it takes."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from morphosim.cell_field import CellField
from morphosim.measure.surfaces import SURFACE
from morphosim.pictures.cut import Cut
from morphosim.pictures.meshes import CellMesh, field_meshes, types_of
from morphosim.provenance import check_memory
from morphosim.runs.saved_fields import (
    MOST_READ,
    SavedBoxes,
    saved_boxes,
    spacing,
    time_index,
    variable,
)

if TYPE_CHECKING:
    import xarray as xr

MOST_POINTS = 30_000_000
"""Lattice points of all boxes that a picture takes in: of more it takes every second, or third."""
COARSEST = 3
"""Cells are still round if every third lattice point along each axis is taken."""
FEW = 200
"""So many cells are all drawn, even those that cannot be seen."""
CHANNEL = 3
"""Gaps between cells that are narrower, in lattice points, let nothing be seen."""
NEAR = 4
"""Cells this near to the open space may be seen, lattice points."""
BYTES = 30
"""Memory that a lattice point takes that is taken in: its values, and its share of the meshes."""

Lattice = NDArray[np.int64]


def drawn_meshes(
    run: "xr.Dataset", time: float | None = None, cut: Cut | None = None
) -> list[CellMesh]:
    """Surfaces of the cells of a save that can be seen from outside, or where they are cut.

    As `cell_meshes` makes them. Beyond `MOST_POINTS` they are made from every second or third
    lattice point, and beyond `FEW` cells those are left out that others enclose: time and memory
    grow with what is seen.

    Parameters
    ----------
    run : Dataset of `open_run`
    time : float, optional
        The nearest save; the last by default.
    cut : Cut, optional
        What is beyond it is left out, and cells that it meets have a flat face.

    Raises
    ------
    ValueError
        See `cell_meshes`; or so many cells do not fit into memory.
    """
    save = time_index(run, time)
    fields, width = _coarse(run, save)
    if cut is not None:
        fields = [field for field in fields if _is_left(field, cut, width)]
    chosen = seen_places(fields, width, cut) if len(fields) > FEW else None
    meshes = field_meshes(fields, width, types_of(run, save), chosen)
    if cut is None:
        return meshes
    return [left for mesh in meshes if len((left := cut.closed(mesh)).faces)]


def whole_meshes(run: "xr.Dataset", save: int) -> list[CellMesh]:
    """Surfaces of all cells of a save, coarser where there are many, for a view that can be cut.

    For the errors see `drawn_meshes`.
    """
    return field_meshes(*_coarse(run, save), types_of(run, save))


def _coarse(run: "xr.Dataset", save: int) -> tuple[list[CellField], float]:
    """Fields of a save, and the spacing of their lattice, µm."""
    boxes = saved_boxes(run, save)
    step = coarseness(boxes, MOST_POINTS)
    return coarse_fields(run, boxes, step), spacing(run) * step


def coarseness(boxes: SavedBoxes, points: int) -> int:
    """Every how many lattice points to take along each axis, for at most so many `points` in all.

    Raises
    ------
    ValueError
        Even of the coarsest there are more than fit into memory.
    """
    count = float(boxes.start[-1] - boxes.start[0])
    step = next((n for n in range(1, COARSEST) if count / n**3 <= points), COARSEST)
    needed = BYTES * count / step**3 + MOST_READ * boxes.phi.dtype.itemsize
    check_memory(
        f"a picture of {len(boxes.cell)} cells", needed, "take a time at which there are fewer"
    )
    return step


def coarse_fields(run: "xr.Dataset", boxes: SavedBoxes, step: int) -> list[CellField]:
    """Fields at the lattice points whose numbers along x, y and z are multiples of `step`."""
    names = variable(run, "cell", "cell").values[boxes.cell]
    fields = []
    for box, phi in enumerate(boxes.read_each()):
        origin = boxes.origin[box]
        skipped = -origin % step
        x, y, z = (slice(first, None, step) for first in skipped.tolist())
        values = phi if step == 1 else np.ascontiguousarray(phi[x, y, z])
        fields.append(CellField(str(names[box]), (origin + skipped) // step, values))
    return fields


def seen_places(fields: Sequence[CellField], spacing: float, cut: Cut | None = None) -> Lattice:
    """Places of the fields that can be seen from outside of all, or from beyond a cut.

    They have φ > 1/2 near the open space: where Σφ < 1/2, as far as that is connected from outside
    by ways of some width.
    """
    from scipy.ndimage import label, maximum_filter, minimum_filter

    low, filled = _filled(fields)
    if cut is not None:
        along = (low[cut.axis] + np.arange(filled.shape[cut.axis])) * spacing
        np.moveaxis(filled, cut.axis, 0)[cut.depth(along) < 0] = False
    wide = minimum_filter(~filled, CHANNEL, mode="constant", cval=True)
    ways, _ = label(wide)
    near = maximum_filter(ways == ways[0, 0, 0], CHANNEL + 2 * NEAR)
    return np.array(
        [
            k for k, field in enumerate(fields)
            if (near[_within(field, low)] & (field.phi > SURFACE)).any()
        ],
        np.int64,
    )  # fmt: skip


def _filled(fields: Sequence[CellField]) -> tuple[Lattice, NDArray[np.bool_]]:
    """Where Σφ > 1/2, and the first lattice point; with free rims."""
    origins = np.array([field.origin for field in fields])
    ends = origins + np.array([field.phi.shape for field in fields])
    low = origins.min(axis=0) - CHANNEL
    total = np.zeros(ends.max(axis=0) + CHANNEL - low, np.float32)
    for field in fields:
        total[_within(field, low)] += field.phi
    return low, total > SURFACE


def _within(field: CellField, low: Lattice) -> tuple[slice, ...]:
    """Part of a lattice that begins at `low` that a field fills."""
    starts = (field.origin - low).tolist()
    return tuple(slice(a, a + n) for a, n in zip(starts, field.phi.shape, strict=True))


def _is_left(field: CellField, cut: Cut, spacing: float) -> bool:
    """Whether a cut leaves anything of a field's box."""
    ends = field.origin[cut.axis] + np.array([0, field.phi.shape[cut.axis] - 1])
    return bool((cut.depth(ends * spacing) > 0).any())
