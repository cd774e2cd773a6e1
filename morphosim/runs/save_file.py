"""One save as a netCDF file."""

import json
import platform
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import fields as dataclass_fields
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from morphosim.measure.aggregates import aggregates
from morphosim.measure.label_image import label_image
from morphosim.measure.measurement import Measurement
from morphosim.provenance import processor, versions
from morphosim.runs.observed import Observed
from morphosim.runs.schema import (
    CONTACT_LIST,
    CONTACT_MATRIX,
    FIELDS,
    LABEL_IMAGE,
    LABELS,
    MOST_DENSE_CELLS,
    PER_TIME,
    PHI_STEP,
    Variable,
)
from morphosim.scene.tables import numerics_table, physics_table

Values = dict[str, Any]
CHUNK = 1 << 15
"""Values per chunk of compressed fields."""


def write_save(
    path: Path,
    simulation: Observed,
    measured: Measurement,
    speeds: NDArray[np.float64],
    events: str,
    fields: str,
    labels: bool,
) -> None:
    """Write the netCDF file of the present state, in one go.

    Raises
    ------
    OSError
        The file cannot be written.
    """
    import netCDF4

    try:
        with netCDF4.Dataset(path, "w", format="NETCDF4", diskless=True, persist=True) as file:
            _write(file, simulation, measured, speeds, events, fields, labels)
    except (RuntimeError, OSError) as error:  # they do not say what the system told HDF5
        free = shutil.disk_usage(path.parent).free
        what = getattr(error, "strerror", None) or error
        message = (
            f"the netCDF library reports {str(what)!r}, and {free / 1e6:.1f} MB are free there"
        )
        raise OSError(message) from error


def _write(
    file: Any,
    simulation: Observed,
    measured: Measurement,
    speeds: NDArray[np.float64],
    events: str,
    fields: str,
    labels: bool,
) -> None:
    file.setncatts(provenance(simulation))
    dense = len(simulation.names) <= MOST_DENSE_CELLS
    values = _names(simulation) | _table(simulation, measured, speeds, events)
    if dense:
        values |= {"contact_area": _matrix(measured, len(simulation.names))[None]}
    _fill(file, LABELS | PER_TIME | CONTACT_MATRIX, values)
    if not dense:
        _fill(file.createGroup("contacts"), CONTACT_LIST, _pairs(measured))
    if fields != "none":
        _fill(file.createGroup("fields"), FIELDS, _fields(simulation, fields == "packed"))
    if labels:
        _fill(file.createGroup("labels"), LABEL_IMAGE, _labels(simulation))


def provenance(simulation: Observed) -> dict[str, Any]:
    """Attributes that say what made a run: scene, physics, numerics, versions, machine, end."""
    scene = simulation.scene
    return {
        "Conventions": "CF-1.11",
        "title": f"MorphoSim run of {scene.name}",
        "source": f"morphosim {version('morphosim')} on {platform.platform()}",
        "scene": scene.name,
        "spacing_um": scene.numerics.spacing,
        "dt": scene.numerics.dt,
        "seed": scene.numerics.seed,
        "physics": json.dumps(physics_table(simulation.physics)),
        "numerics": json.dumps(numerics_table(scene.numerics)),
        "confinement": repr(scene.confinement),
        "versions": json.dumps(versions()),
        "machine": processor(),
        "threads": simulation.threads,
        "duration": scene.duration,
        "error": simulation.error,
        "finished": int(simulation.finished),
    }


def step_of(path: Path) -> int:
    """Steps taken at a save."""
    import netCDF4

    with netCDF4.Dataset(path) as file:
        return int(file["step"][0])


def _names(simulation: Observed) -> Values:
    return {
        "cell": simulation.names, "neighbour": simulation.names, "axis": list("xyz"),
        "principal": np.arange(3), "parent": simulation.parents,
    }  # fmt: skip


def _table(
    simulation: Observed, measured: Measurement, speeds: NDArray[np.float64], events: str
) -> Values:
    """Values of `PER_TIME`."""
    spacing = simulation.scene.numerics.spacing
    origin, shape = _boxes(simulation)
    low = origin * spacing
    moved = speeds[np.isfinite(speeds)]
    values = {
        "time": simulation.time,
        "step": simulation.steps,
        "rms_speed": np.sqrt(np.mean(moved**2)) if len(moved) else np.nan,
        "volume": simulation.volumes,
        "target_volume": _targets(simulation),
        "core_volume": simulation.core_volumes,
        "centroid": measured.centroid,
        "speed": speeds,
        "box_low": low,
        "box_high": low + (shape - 1) * spacing,
        "face_peak": simulation.face_peak,
        "lost_volume": simulation.lost_volume,
    } | {
        name: getattr(measured, name)
        for name in (
            "enclosed_volume", "surface_area", "sphericity", "irregularity",
            "exposed_fraction", "semi_axes", "principal_axes",
        )
    }  # fmt: skip
    types = simulation.types
    grouped = aggregates(measured, types)
    values |= {f.name: getattr(grouped, f.name) for f in dataclass_fields(grouped)}
    rows = {name: np.asarray(value)[None] for name, value in values.items()}
    return rows | {"stage": [simulation.stage], "events": [events], "type": [types]}


def _targets(simulation: Observed) -> NDArray[np.float64]:
    """Target volumes; NaN where a volume function fails, which has then ended the run."""
    try:
        return simulation.targets
    except (TypeError, ValueError):
        return np.full(len(simulation.names), np.nan)


def _matrix(measured: Measurement, count: int) -> NDArray[np.float32]:
    areas = np.zeros((count, count), np.float32)
    i, j = measured.contacts.T
    areas[i, j] = areas[j, i] = measured.contact_area
    return areas


def _pairs(measured: Measurement) -> Values:
    return {
        "contact_time": np.zeros(len(measured.contacts), np.int32),
        "contact_cell": measured.contacts[:, 0],
        "contact_neighbour": measured.contacts[:, 1],
        "contact_pair_area": measured.contact_area,
    }


def _fields(simulation: Observed, packed: bool) -> Values:
    origin, shape = _boxes(simulation)
    sizes = shape.prod(axis=1)
    kind = np.int16 if packed else simulation.fields[0].phi.dtype
    phi, ends = np.empty(sizes.sum(), kind), np.cumsum(sizes)
    for field, size, end in zip(simulation.fields, sizes.tolist(), ends.tolist(), strict=True):
        box = field.phi.ravel()
        phi[end - size : end] = pack_phi(box) if packed else box
    return {
        "row_size": sizes,
        "box_time": np.zeros(len(sizes), np.int32),
        "box_cell": np.arange(len(sizes)),
        "box_origin": origin,
        "box_shape": shape,
        "phi": phi,
    }


def _boxes(simulation: Observed) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Origin and shape of each cell's box, (N, 3) both, lattice points."""
    fields = list(simulation.fields)
    return np.array([f.origin for f in fields]), np.array([f.phi.shape for f in fields])


def _labels(simulation: Observed) -> Values:
    origin, labels = label_image(simulation.fields)
    return {
        "label_size": [labels.size],
        "label_time": [0],
        "label_origin": origin[None],
        "label_shape": [labels.shape],
        "label": labels.ravel(),
    }


def _fill(group: Any, variables: Mapping[str, Variable], values: Values) -> None:
    """Write those variables of a group that have values, with their dimensions."""
    for name, given in values.items():
        value = np.asarray(given)
        if variables[name].kind is str:
            write_texts(group, name, variables[name], value)
        else:
            kind = value.dtype if name == "phi" else variables[name].kind
            create(group, name, variables[name], value.shape, kind)[:] = value


def create(group: Any, name: str, variable: Variable, shape: tuple[int, ...], kind: Any) -> Any:
    """Add one variable to a netCDF group, compressed where that pays; values are written raw.

    A phase field of whole numbers takes the values of `pack_phi`.
    """
    _require(group, variable.dims, shape)
    options: dict[str, Any] = {}
    if np.prod(shape) > CHUNK // 8:
        chunks = [min(n, CHUNK) for n in shape]
        if variable.dims[0] == "time":  # one time is what is read at once
            chunks[0] = max(1, min(chunks[0], CHUNK // int(np.prod(shape[1:]))))
        options = {"zlib": True, "complevel": 1, "shuffle": True, "chunksizes": chunks}
    attributes: dict[str, Any] = dict(variable.attributes)
    if name == "phi" and np.dtype(kind).kind == "i":
        attributes["scale_factor"] = np.float32(PHI_STEP)
    created = group.createVariable(name, kind, variable.dims, **options)
    created.set_auto_maskandscale(False)
    created.setncatts(attributes)
    return created


def write_texts(group: Any, name: str, variable: Variable, value: NDArray[Any]) -> None:
    """Add one variable of texts, as CF's arrays of characters.

    Strings of variable length crash the HDF5 library when one file is open twice.
    """
    texts = np.char.encode(value.astype(str), "utf-8")
    length = max(texts.dtype.itemsize, 1)
    dims = (*variable.dims, f"text{length}")
    _require(group, dims, (*value.shape, length))
    created = group.createVariable(name, "S1", dims, zlib=value.size > CHUNK // 8)
    created.setncatts(variable.attributes | {"_Encoding": "utf-8"})
    created.set_auto_chartostring(False)
    characters = np.ascontiguousarray(texts.astype(f"S{length}")).view("S1")
    created[:] = characters.reshape(*value.shape, length)


def _require(group: Any, dims: Sequence[str], shape: Sequence[int]) -> None:
    for dimension, size in zip(dims, shape, strict=True):
        if dimension not in group.dimensions:
            group.createDimension(dimension, size)


def pack_phi(phi: NDArray[np.floating]) -> NDArray[np.int16]:
    """Phase field as whole multiples of `PHI_STEP`."""
    return np.rint(phi * phi.dtype.type(1 / PHI_STEP)).astype(np.int16)
