"""A run of known numbers as a Dataset, made from simulations without any file.

Two cells "a" and "b" at t = 0 and 10; "b" has become "b1" and "b2" at t = 20 and 26, "a" has
changed its type by then.
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import xarray as xr
from xarray.backends import BackendArray
from xarray.core import indexing

from morphosim import Cell, Numerics, Scene, Simulation, Sphere
from morphosim.cell_field import CellField
from morphosim.measure.contacts import contact_areas
from morphosim.measure.label_image import label_image
from morphosim.measure.surfaces import cell_surface

NAMES = ["a", "b", "b1", "b2"]
PARENTS = ["", "", "b", "b"]
H = 0.5


@dataclass
class Save:
    """What a simulation says at one time."""

    time: float
    fields: dict[str, CellField]
    types: dict[str, str]
    values: dict[str, dict[str, Any]]
    contacts: dict[tuple[str, str], float]


@dataclass
class Run:
    """A Dataset, the saves it was made of, and the slices of `phi` that were read of it."""

    data: xr.Dataset
    saves: list[Save]
    reads: list[slice] = field(default_factory=list)


class Counted(BackendArray):
    """Array that notes which slices are read."""

    def __init__(self, values: np.ndarray, reads: list[slice]) -> None:
        self.values, self.reads = values, reads
        self.shape, self.dtype = values.shape, values.dtype

    def __getitem__(self, key: indexing.ExplicitIndexer) -> Any:
        return indexing.explicit_indexing_adapter(
            key, self.shape, indexing.IndexingSupport.BASIC, self._read
        )

    def _read(self, key: tuple) -> np.ndarray:
        self.reads.append(key[0])
        return self.values[key]


def simulated() -> list[Save]:
    """The four saves."""
    first = _simulation({"a": (0.0, "soft"), "b": (5.2, "stiff")})
    second = _simulation({"a": (0.0, "stiff"), "b1": (5.2, "stiff"), "b2": (10.8, "")})
    saves = []
    for simulation, start, stops in ((first, 0.0, (0, 10)), (second, 20.0, (0, 6))):
        for stop in stops:
            if stop:
                simulation.run(until=stop)
            saves.append(_saved(simulation, start + stop))
    return saves


def _simulation(cells: dict[str, tuple[float, str]]) -> Simulation:
    return Simulation(
        Scene(
            cells=[
                Cell(name=name, shape=Sphere(center=(x, 0.3, -4), radius=3), type=kind)
                for name, (x, kind) in cells.items()
            ],
            numerics=Numerics(threads=1, spacing=H),
        )
    )


def _saved(simulation: Simulation, time: float) -> Save:
    fields = [CellField(f.name, f.origin.copy(), f.phi.copy()) for f in simulation.fields]
    surfaces = [cell_surface(f, H) for f in fields]
    columns = {
        "volume": simulation.volumes,
        "centroid": simulation.centroids,
        "box_low": [f.origin * H for f in fields],
        "surface_area": [s.area for s in surfaces],
        "semi_axes": [np.sort(np.ptp(s.vertices, axis=0) / 2)[::-1] for s in surfaces],
    }
    names = [f.name for f in fields]
    return Save(
        time,
        dict(zip(names, fields, strict=True)),
        {cell.name: cell.type for cell in simulation.cells},
        {k: dict(zip(names, np.array(v), strict=True)) for k, v in columns.items()},
        contact_areas(fields, H),
    )


def make_run(saves: list[Save]) -> Run:
    """The Dataset of these saves, with `phi` as an array that notes what is read."""
    reads: list[slice] = []
    boxes = [(t, f) for t, save in enumerate(saves) for f in save.fields.values()]
    phi = np.concatenate([f.phi.ravel() for _, f in boxes])
    lazy = indexing.LazilyIndexedArray(Counted(phi, reads))
    ragged = {
        "row_size": ("box", [f.phi.size for _, f in boxes]),
        "box_time": ("box", np.array([t for t, _ in boxes], np.int32)),
        "box_cell": ("box", np.array([NAMES.index(f.name) for _, f in boxes], np.int32)),
        "box_origin": (("box", "axis"), [f.origin for _, f in boxes]),
        "box_shape": (("box", "axis"), [f.phi.shape for _, f in boxes]),
        "phi": ("sample", lazy),
    }
    coordinates = {
        "time": [save.time for save in saves], "cell": NAMES, "neighbour": NAMES,
        "axis": list("xyz"), "principal": [0, 1, 2],
    }  # fmt: skip
    data = xr.Dataset(ragged | _table(saves), coordinates, {"spacing_um": H, "title": "by hand"})
    return Run(data, saves, reads)


def _table(saves: list[Save]) -> dict[str, Any]:
    """Variables per time and cell; NaN and "" where a cell is not there."""
    shapes = {
        "volume": (), "centroid": ("axis",), "box_low": ("axis",), "surface_area": (),
        "semi_axes": ("principal",),
    }  # fmt: skip
    table: dict[str, Any] = {
        name: (("time", "cell", *rest), np.full((len(saves), 4, *[3] * len(rest)), np.nan))
        for name, rest in shapes.items()
    }
    table["type"] = ("time", "cell"), np.full((len(saves), 4), "", object)
    table["contact_area"] = ("time", "cell", "neighbour"), np.zeros((len(saves), 4, 4), np.float32)
    for t, save in enumerate(saves):
        for name, of_cells in (save.values | {"type": save.types}).items():
            for cell, value in of_cells.items():
                table[name][1][t, NAMES.index(cell)] = value
        for (a, b), area in save.contacts.items():
            i, j = NAMES.index(a), NAMES.index(b)
            table["contact_area"][1][t, [i, j], [j, i]] = area
    return table | {
        "parent": ("cell", np.array(PARENTS, object)),
        "step": ("time", np.arange(len(saves)) * 5),
        "stage": ("time", np.array(["grow"] * len(saves), object)),
    }


def with_contact_list(data: xr.Dataset) -> xr.Dataset:
    """The same run with its contacts as a list."""
    areas = data["contact_area"].values
    t, i, j = np.nonzero(np.triu(areas))
    listed = {"time": t, "cell": i, "neighbour": j, "pair_area": areas[t, i, j]}
    rest = data.drop_vars(["contact_area", "neighbour"])
    return rest.assign({f"contact_{name}": ("contact", v) for name, v in listed.items()})


def images_only(run: Run) -> xr.Dataset:
    """The same run with label images, and without fields."""
    origins, images = [], []
    for save in run.saves:
        origin, labels = label_image(list(save.fields.values()))
        place = np.array([0, *(NAMES.index(name) + 1 for name in save.fields)])
        origins.append(origin)
        images.append(place[labels].astype(np.int32))
    ragged = ["row_size", "box_time", "box_cell", "box_origin", "box_shape", "phi"]
    return run.data.drop_vars(ragged).assign(
        label_size=("image", [image.size for image in images]),
        label_time=("image", np.arange(len(images))),
        label_origin=(("image", "axis"), origins),
        label_shape=(("image", "axis"), [image.shape for image in images]),
        label=("voxel", np.concatenate([image.ravel() for image in images])),
    )
