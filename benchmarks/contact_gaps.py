"""How far apart the surfaces φ = 1/2 of cells in contact are, and where their fields are the same.

Run as `python benchmarks/contact_gaps.py RUN [TIME]` on a saved run.
"""

import argparse

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates
from scipy.spatial import KDTree

from morphosim import open_run
from morphosim.cell_field import CellField
from morphosim.measure.contacts import NEIGHBOUR_LEVEL, SURFACE_LEVEL, contact_areas
from morphosim.measure.surfaces import SURFACE, cell_surface
from morphosim.runs.saved_fields import load_fields, spacing, time_index

Points = NDArray[np.float64]


def value(field: CellField, points: Points, h: float) -> Points:
    """φ at points in µm."""
    return map_coordinates(field.phi, (points / h - field.origin).T, order=1, cval=0.0)


def gap(a: CellField, b: CellField, h: float) -> tuple[float, float]:
    """Median over the contact on a's side: gap in µm (negative: overlap), and φ halfway."""
    outer, inner = (
        [cell_surface(field, h, level).vertices for field in (a, b)]
        for level in (SURFACE_LEVEL, SURFACE)
    )
    contact = outer[0][value(b, outer[0], h) >= NEIGHBOUR_LEVEL]
    _, nearest = KDTree(outer[1]).query(contact)
    halfway = value(a, (contact + outer[1][nearest]) / 2, h)
    facing = inner[0][KDTree(contact).query(inner[0])[0] < h]
    apart = KDTree(inner[1]).query(facing)[0]
    apart[value(b, facing, h) > SURFACE] *= -1
    return float(np.median(apart)), float(np.median(halfway))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("run")
    parser.add_argument("time", nargs="?", type=float)
    options = parser.parse_args()
    with open_run(options.run) as run:
        h, fields = spacing(run), load_fields(run, time_index(run, options.time))
    cells = {field.name: field for field in fields}
    print(f"{'':16s} {'area, µm²':>10s} {'gap, µm':>9s} {'φ halfway':>10s}")
    for (one, other), area in contact_areas(fields, h).items():
        apart, halfway = gap(cells[one], cells[other], h)
        print(f"{one + ' ' + other:16s} {area:10.1f} {apart:9.2f} {halfway:10.2f}")


if __name__ == "__main__":
    main()
