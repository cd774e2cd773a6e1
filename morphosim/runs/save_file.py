"""One save as a netCDF file."""

import json
import platform
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from morphosim._parts import Joined, Made
from morphosim.measure.label_image import label_image
from morphosim.measure.variable import Variable
from morphosim.period import Period
from morphosim.provenance import processor, versions
from morphosim.runs.measured_state import MeasuredState, variables
from morphosim.runs.merge import MATRIX, Save, shortened
from morphosim.runs.netcdf_variables import PackedPhi, Values, write_lazy, write_variables
from morphosim.runs.observed import Observed
from morphosim.runs.schema import (
    CONTACT_MATRIX,
    COORDINATES,
    GROUPS,
    MOST_DENSE_CELLS,
    PARENT,
)
from morphosim.scene.arrays import listed
from morphosim.scene.tables import numerics_table, physics_in_file


@dataclass(frozen=True, slots=True, kw_only=True)
class Contents:
    """What is to be saved of a state.

    Attributes
    ----------
    attributes : of the file
    root, groups : values of variables; in the root those that are measured, and names
    """

    attributes: Mapping[str, Any]
    root: Values
    groups: Mapping[str, Values]

    @classmethod
    def of(cls, state: MeasuredState, fields: str, labels: bool) -> "Contents":
        """Measure a state; its fields, of which no copy is held, must stay until they are written.

        Raises
        ------
        VariableError
            A variable cannot be measured.
        """
        root = _names(state) | {name: value[None] for name, value in state.table.items()}
        groups: dict[str, Values] = {}
        if len(state.names) <= MOST_DENSE_CELLS:
            root[MATRIX] = _matrix(state)[None]
        else:
            groups["contacts"] = _pairs(state)
        if fields != "none":
            groups["fields"] = _fields(state, fields == "packed")
        if labels:
            groups["labels"] = _labels(state)
        return cls(attributes=provenance(state.simulation), root=root, groups=groups)

    @property
    def parts(self) -> Iterator[tuple[str, Mapping[str, Variable], Values]]:
        """Name of each group, the root being "", with its variables and their values."""
        yield "", COORDINATES | PARENT | variables() | CONTACT_MATRIX, self.root
        for name, values in self.groups.items():
            yield name, GROUPS[name], values

    @property
    def lazy(self) -> dict[str, Any]:
        """Values of the lazy variables, by group/name."""
        return {
            f"{group}/{name}": values[name] for group, declared, values in self.parts
            for name in values if declared[name].lazy
        }  # fmt: skip

    def as_read(self, path: Path) -> Save:
        """What reading the file will give; no pass over the fields, nor over the file."""
        tables: dict[str, Any] = {}
        stored: dict[str, Variable] = {}
        lengths: dict[str, int] = {}
        for group, declared, values in self.parts:
            tables[group] = {}
            for name, given in values.items():
                variable, kind = declared[name], declared[name].kind
                if variable.lazy:
                    kind, lengths[name] = given.dtype, given.shape[0]
                elif kind is str:
                    tables[group][name] = shortened(np.asarray(given))
                else:
                    tables[group][name] = np.array(given, kind)
                kind = kind if kind is str else np.dtype(kind)
                stored[name] = Variable.stored(variable.dims, kind, variable.attributes)
        attributes = {
            name: said if isinstance(said, str) else np.asarray(said)[()]
            for name, said in self.attributes.items()
        }
        return Save.of(path, tables, stored, lengths=lengths, attributes=attributes)


def write_save(path: Path, contents: Contents) -> None:
    """Write the netCDF file of a save.

    It is put together in memory, where HDF5 meets no full disk, which it may not survive; the
    fields take as much there as in the file, where they are compressed.

    Raises
    ------
    OSError, RuntimeError
        The file cannot be written; see `_files.replacing`.
    """
    import netCDF4

    with netCDF4.Dataset(path, "w", format="NETCDF4", diskless=True, persist=True) as file:
        file.setncatts(contents.attributes)
        for name, declared, values in contents.parts:
            write_variables(file.createGroup(name) if name else file, declared, values)
    if contents.lazy:
        _add(path, contents.lazy, contents.attributes["threads"])


def _add(path: Path, lazy: Mapping[str, Any], threads: int) -> None:
    """Write the lazy variables of a file."""
    import h5py

    image = BytesIO(path.read_bytes())
    with h5py.File(image, "r+") as file:
        for name, values in lazy.items():
            write_lazy(file[name], values, threads)
    with path.open("wb") as target:
        target.write(image.getbuffer())


def provenance(simulation: Observed) -> dict[str, Any]:
    """Attributes that say what made a run: scene, physics, numerics, versions, machine, end."""
    scene = simulation.scene
    return {
        "Conventions": "CF-1.11",
        "title": f"MorphoSim run of {scene.name}",
        "source": f"morphosim {versions()['morphosim']} on {platform.platform()}",
        "scene": scene.name,
        "spacing_um": scene.numerics.spacing,
        "dt": scene.numerics.dt,
        "seed": scene.numerics.seed,
        "physics": json.dumps(listed(physics_in_file(simulation.physics))),
        "numerics": json.dumps(numerics_table(scene.numerics)),
        "S": simulation.S,
        "confinement": repr(scene.confinement),
        **({"period_um": json.dumps(list(scene.period))} if any(scene.period) else {}),
        "versions": json.dumps(versions()),
        "machine": processor(),
        "threads": simulation.threads,
        "duration": scene.duration,
        "error": simulation.error,
        "stopped": simulation.stopped,
        "finished": int(simulation.finished),
        **simulation.identity.attributes,
    }


def _names(state: MeasuredState) -> Values:
    return {
        "cell": state.names, "neighbour": state.names, "axis": list("xyz"),
        "principal": np.arange(3), "parent": [state.simulation.parents],
    }  # fmt: skip


def _matrix(state: MeasuredState) -> NDArray[np.float32]:
    areas = np.zeros((len(state.names), len(state.names)), np.float32)
    i, j = state.shapes.contacts.T
    areas[i, j] = areas[j, i] = state.shapes.contact_area
    return areas


def _pairs(state: MeasuredState) -> Values:
    contacts = state.shapes.contacts
    return {
        "contact_time": np.zeros(len(contacts), np.int32),
        "contact_cell": contacts[:, 0],
        "contact_neighbour": contacts[:, 1],
        "contact_pair_area": state.shapes.contact_area,
    }


def _fields(state: MeasuredState, packed: bool) -> Values:
    origin, shape = state.boxes
    sizes = shape.prod(axis=1)
    phi = Joined(Made(lambda field: field.phi.reshape(-1), state.fields), sizes)
    return {
        "row_size": sizes,
        "box_time": np.zeros(len(sizes), np.int32),
        "box_cell": np.arange(len(sizes)),
        "box_origin": origin,
        "box_shape": shape,
        "phi": PackedPhi(phi) if packed else phi,
    }


def _labels(state: MeasuredState) -> Values:
    scene = state.simulation.scene
    period = Period.of(scene.period, scene.numerics.spacing)
    origin, labels = label_image(state.fields, period=period)
    return {
        "label_size": [labels.size],
        "label_time": [0],
        "label_origin": origin[None],
        "label_shape": [labels.shape],
        "label": labels.ravel(),
    }
