"""What the files of runs hold besides measured variables: names, contacts, fields, label images."""

from morphosim.measure.variable import Variable

MOST_DENSE_CELLS = 500
"""Up to so many cells contact areas are a matrix, beyond a list of pairs."""
PHI_STEP = 1 / 8000
"""Packed fields are whole multiples of this: |φ| < 4.09 in 16 bits, with an error of 6e-5."""

COORDINATES = {
    "cell": Variable(("cell",), str, None, "name of the cell"),
    "neighbour": Variable(("neighbour",), str, None, "name of the neighbouring cell"),
    "axis": Variable(("axis",), str, None, "axis of space"),
    "principal": Variable(("principal",), "i4", "1", "principal axis, the longest first"),
}
PARENT = {"parent": Variable(("time", "cell"), str, None, "name of the mother cell")}
"""Along `cell` alone in a run. In a save all that is measured is along `time`, so that plain xarray
can tell how to put saves together: `open_mfdataset` with combine="nested", concat_dim="time",
join="outer"."""

CONTACT = "of phi = 0.34 of each cell where phi of the other is at least 0.2, mean of both"

CONTACT_MATRIX = {
    "contact_area": Variable(
        ("time", "cell", "neighbour"), "f4", "um2", f"contact area: {CONTACT}; 0 without contact"
    ),
}
CONTACT_LIST = {
    "contact_time": Variable(("contact",), "i4", "1", "index into time", index="time"),
    "contact_cell": Variable(("contact",), "i4", "1", "index into cell", index="cell"),
    "contact_neighbour": Variable(
        ("contact",), "i4", "1", "index into cell, above contact_cell", index="cell"
    ),
    "contact_pair_area": Variable(
        ("contact",), "f4", "um2", f"contact area of the pair: {CONTACT}"
    ),
}
FIELDS = {
    "row_size": Variable(
        ("box",), "i8", "1", "values of this box", (("sample_dimension", "sample"),)
    ),
    "box_time": Variable(
        ("box",), "i4", "1", "index into time", (("instance_dimension", "time"),), index="time"
    ),
    "box_cell": Variable(
        ("box",), "i4", "1", "index into cell", (("instance_dimension", "cell"),), index="cell"
    ),
    "box_origin": Variable(
        ("box", "axis"), "i8", "1",
        "lattice position of the first value; times spacing_um it is in um"
    ),
    "box_shape": Variable(("box", "axis"), "i4", "1", "points per axis, z fastest"),
    "phi": Variable(("sample",), "f4", "1", "phase field", lazy=True),
}  # fmt: skip
"""The fields, as a CF contiguous ragged array of boxes."""

LABEL_IMAGE = {
    "label_size": Variable(
        ("image",), "i8", "1", "values of this label image", (("sample_dimension", "voxel"),)
    ),
    "label_time": Variable(("image",), "i4", "1", "index into time", index="time"),
    "label_origin": Variable(("image", "axis"), "i8", "1", "lattice position of the first value"),
    "label_shape": Variable(("image", "axis"), "i4", "1", "points per axis, z fastest"),
    "label": Variable(
        ("voxel",), "i4", "1", "1 + index into cell; 0 where there is no cell", lazy=True
    ),
}
"""The label images, as a CF contiguous ragged array."""

GROUPS = {"contacts": CONTACT_LIST, "fields": FIELDS, "labels": LABEL_IMAGE}
"""What has another length in every save, by the group of the file that holds it."""
IN_GROUPS = CONTACT_LIST | FIELDS | LABEL_IMAGE


def names_in_files() -> set[str]:
    """Names of all these variables, and of dimensions in groups, which nothing else may have."""
    dimensions = (variable.dims for variable in IN_GROUPS.values())
    return set(COORDINATES | PARENT | CONTACT_MATRIX | IN_GROUPS).union(*dimensions)
