"""What runs hold: name, dimensions, unit and meaning of every variable, in one place."""

from dataclasses import dataclass
from typing import Any

MOST_DENSE_CELLS = 500
"""Up to so many cells contact areas are a matrix, beyond a list of pairs."""
PHI_STEP = 1 / 8000
"""Packed fields are whole multiples of this: |φ| < 4.09 in 16 bits, with an error of 6e-5."""


@dataclass(frozen=True, slots=True)
class Variable:
    """How one variable is stored; `kind` is a netCDF type, or `str`."""

    dims: tuple[str, ...]
    kind: Any
    units: str | None
    text: str
    extra: tuple[tuple[str, str], ...] = ()

    @property
    def attributes(self) -> dict[str, str]:
        """CF attributes."""
        units = {} if self.units is None else {"units": self.units}
        return units | {"long_name": self.text} | dict(self.extra)


PER_CELL = ("time", "cell")
LABELS = {
    "cell": Variable(("cell",), str, None, "name of the cell"),
    "neighbour": Variable(("neighbour",), str, None, "name of the neighbouring cell"),
    "axis": Variable(("axis",), str, None, "axis of space"),
    "principal": Variable(("principal",), "i4", "1", "principal axis, the longest first"),
    "parent": Variable(("cell",), str, None, "name of the mother cell"),
}
"""Names and what belongs to them."""

PER_TIME = {
    "time": Variable(("time",), "f8", "1", "in silico time", (("axis", "T"),)),
    "step": Variable(("time",), "i8", "1", "number of steps taken"),
    "stage": Variable(("time",), str, None, "stage of the protocol"),
    "events": Variable(("time",), str, None, "divisions, removals, changes since the save before"),
    "rms_speed": Variable(("time",), "f8", "um", "root mean square of the cells' speed, per time"),
    "n_aggregates": Variable(("time",), "i4", "1", "number of aggregates of cells in contact"),
    "single_cells": Variable(("time",), "i4", "1", "number of cells without contact"),
    "largest_aggregate": Variable(("time",), "i4", "1", "number of cells of the largest aggregate"),
    "sorting_index": Variable(
        ("time",), "f8", "1", "share of the contacts that are between cells of the same type"
    ),
    "radius_of_gyration": Variable(
        ("time",), "f8", "um", "radius of gyration of the largest aggregate"
    ),
    "roundness": Variable(
        ("time",), "f8", "1", "shortest over longest semi-axis of the largest aggregate"
    ),
    "aggregate_sphericity": Variable(
        ("time",), "f8", "1",
        "surface of a ball of the largest aggregate's volume over its exposed surface"
    ),
    "aggregate": Variable(PER_CELL, "f8", "1", "number of the cell's aggregate, 0 the largest"),
    "radial_position": Variable(
        PER_CELL, "f8", "um", "distance from the centre of the cell's aggregate"
    ),
    "exposed_fraction": Variable(
        PER_CELL, "f8", "1", "share of the cell's surface that touches no other cell"
    ),
    "type": Variable(PER_CELL, str, None, "type of the cell"),
    "volume": Variable(PER_CELL, "f8", "um3", "volume, integral of phi"),
    "target_volume": Variable(PER_CELL, "f8", "um3", "target volume V(t)"),
    "core_volume": Variable(PER_CELL, "f8", "um3", "volume of the lattice points with phi > 1/2"),
    "enclosed_volume": Variable(PER_CELL, "f8", "um3", "volume enclosed by the surface phi = 1/2"),
    "surface_area": Variable(PER_CELL, "f8", "um2", "area of the surface phi = 1/2"),
    "sphericity": Variable(
        PER_CELL, "f8", "1", "surface of a ball of the enclosed volume over the surface area"
    ),
    "irregularity": Variable(
        PER_CELL, "f8", "1", "surface area^(1/2) / enclosed volume^(1/3) (eta of Fig. S4)"
    ),
    "centroid": Variable((*PER_CELL, "axis"), "f8", "um", "centroid"),
    "speed": Variable(
        PER_CELL, "f8", "um", "mean speed of the centroid, per time, over the last 10 time units "
        "or since the save before"
    ),
    "semi_axes": Variable(
        (*PER_CELL, "principal"), "f8", "um", "semi-axes of the ellipsoid of equal second moments"
    ),
    "principal_axes": Variable(
        (*PER_CELL, "principal", "axis"), "f8", "1", "unit vectors along the semi-axes"
    ),
    "box_low": Variable((*PER_CELL, "axis"), "f8", "um", "first lattice point of the cell's box"),
    "box_high": Variable((*PER_CELL, "axis"), "f8", "um", "last lattice point of the cell's box"),
    "face_peak": Variable(
        PER_CELL, "f8", "1", "largest |phi| so far at the faces of the cell's box or band"
    ),
    "lost_volume": Variable(
        PER_CELL, "f8", "um3", "integral of phi cut off by moving the box or band so far"
    ),
}  # fmt: skip
"""What every save holds, along time."""

CONTACT_MATRIX = {
    "contact_area": Variable(
        ("time", "cell", "neighbour"), "f4", "um2", "contact area, 0 where cells do not touch"
    ),
}
CONTACT_LIST = {
    "contact_time": Variable(("contact",), "i4", "1", "index into time"),
    "contact_cell": Variable(("contact",), "i4", "1", "index into cell"),
    "contact_neighbour": Variable(("contact",), "i4", "1", "index into cell, above contact_cell"),
    "contact_pair_area": Variable(("contact",), "f4", "um2", "contact area of the pair"),
}
FIELDS = {
    "row_size": Variable(
        ("box",), "i8", "1", "values of this box", (("sample_dimension", "sample"),)
    ),
    "box_time": Variable(("box",), "i4", "1", "index into time", (("instance_dimension", "time"),)),
    "box_cell": Variable(("box",), "i4", "1", "index into cell", (("instance_dimension", "cell"),)),
    "box_origin": Variable(
        ("box", "axis"), "i8", "1",
        "lattice position of the first value; times spacing_um it is in um"
    ),
    "box_shape": Variable(("box", "axis"), "i4", "1", "points per axis, z fastest"),
    "phi": Variable(("sample",), "f4", "1", "phase field"),
}  # fmt: skip
"""The fields, as a CF contiguous ragged array of boxes."""

LABEL_IMAGE = {
    "label_size": Variable(
        ("image",), "i8", "1", "values of this label image", (("sample_dimension", "voxel"),)
    ),
    "label_time": Variable(("image",), "i4", "1", "index into time"),
    "label_origin": Variable(("image", "axis"), "i8", "1", "lattice position of the first value"),
    "label_shape": Variable(("image", "axis"), "i4", "1", "points per axis, z fastest"),
    "label": Variable(("voxel",), "i4", "1", "1 + index into cell; 0 where there is no cell"),
}
"""The label images, as a CF contiguous ragged array."""

ALL = LABELS | PER_TIME | CONTACT_MATRIX | CONTACT_LIST | FIELDS | LABEL_IMAGE
