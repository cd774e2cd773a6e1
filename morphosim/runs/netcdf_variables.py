"""Variables in netCDF files: how they are stored, and how a file describes them."""

import zlib
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from morphosim._parts import InParts
from morphosim.measure.variable import Variable
from morphosim.runs.schema import PHI_STEP

try:
    from isal import isal_zlib

    deflate = isal_zlib.compress
except ImportError:  # it is not made for every processor
    deflate = zlib.compress

Values = dict[str, Any]
CHUNK = 1 << 15
"""Values per chunk of compressed fields."""
LEVEL = 1
"""Of compression: the quickest."""
BATCH = 64
"""Chunks that are compressed before they are written."""
ENCODING, SCALE, FILL = "_Encoding", "scale_factor", "_FillValue"
"""Attributes that say how values are stored, and nothing of what they are."""
PACKED_PHI = {"dtype": "int16", SCALE: np.float32(PHI_STEP), FILL: np.int16(-(1 << 15))}
"""How xarray says that a phase field is packed; no field has the value that stands for none."""


def write_variables(group: Any, variables: Mapping[str, Variable], values: Values) -> None:
    """Write those variables of a group that have values, with their dimensions.

    Those that are lazy are only created; `write_lazy` writes them.
    """
    for name, given in values.items():
        variable = variables[name]
        if variable.kind is str:
            write_texts(group, name, variable, np.asarray(given))
        elif variable.lazy:
            create(group, name, variable, given.shape, given.dtype)
        else:
            value = np.asarray(given)
            create(group, name, variable, value.shape, variable.kind)[:] = value


def write_lazy(dataset: Any, values: InParts, threads: int) -> None:
    """Write values, of which not all need be held at once, to what `create` has made: h5py has it.

    The chunks are compressed here and not by the HDF5 library: into the same format, which any
    program reads by HDF5's own filters, but on several threads, and where there is ISA-L for the
    processor in a quarter of the time.
    """
    if dataset.chunks is None:
        dataset[:] = values[:]
        return
    (size,) = dataset.chunks

    def compressed(start: int) -> bytes:
        return deflated(values[start : start + size], size)

    starts = range(0, values.shape[0], size)
    with ThreadPoolExecutor(threads) as pool:
        each = pool.map if threads > 1 else map
        for first in range(0, len(starts), BATCH):
            batch = starts[first : first + BATCH]
            for start, chunk in zip(batch, each(compressed, batch), strict=True):
                dataset.id.write_direct_chunk((start,), chunk)


def deflated(chunk: NDArray[Any], size: int) -> bytes:
    """Chunk of so many values as HDF5's filters "shuffle" and "deflate" make it."""
    if len(chunk) < size:  # the last one: chunks are whole in a file
        chunk = np.append(chunk, np.zeros(size - len(chunk), chunk.dtype))
    bytes_of_a_weight_together = chunk.view(np.uint8).reshape(size, -1).T
    return bytes(deflate(bytes_of_a_weight_together.tobytes(), LEVEL))


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
        options = {"zlib": True, "complevel": LEVEL, "shuffle": True, "chunksizes": chunks}
    attributes = variable.attributes
    if name == "phi" and np.dtype(kind).kind == "i":
        attributes[SCALE], options["fill_value"] = PACKED_PHI[SCALE], PACKED_PHI[FILL]
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
    created.setncatts(variable.attributes | {ENCODING: "utf-8"})
    created.set_auto_chartostring(False)
    characters = np.ascontiguousarray(texts.astype(f"S{length}")).view("S1")
    created[:] = characters.reshape(*value.shape, length)


def _require(group: Any, dims: Sequence[str], shape: Sequence[int]) -> None:
    for dimension, size in zip(dims, shape, strict=True):
        if dimension not in group.dimensions:
            group.createDimension(dimension, size)


class PackedPhi:
    """A phase field as whole numbers, packed as far as it is used; see `pack_phi`."""

    dtype = np.dtype(np.int16)

    def __init__(self, phi: InParts) -> None:
        self._phi, self.shape = phi, phi.shape

    def __getitem__(self, part: slice) -> NDArray[np.int16]:
        return pack_phi(self._phi[part])


def pack_phi(phi: NDArray[np.floating]) -> NDArray[np.int16]:
    """Phase field as whole multiples of `PHI_STEP`."""
    steps = phi * phi.dtype.type(1 / PHI_STEP)
    return np.rint(steps, out=steps).astype(np.int16)


def stored_variables(path: Path) -> dict[str, Variable]:
    """Variables of the root of a file."""
    import netCDF4

    with netCDF4.Dataset(path) as file:
        return {name: described(variable) for name, variable in file.variables.items()}


def described(variable: Any) -> Variable:
    """What a file says of one of its netCDF variables, whatever has written it."""
    attributes = {name: variable.getncattr(name) for name in variable.ncattrs()}
    characters = ENCODING in attributes
    for name in (ENCODING, SCALE, FILL):
        attributes.pop(name, None)
    dims = variable.dimensions[:-1] if characters else variable.dimensions
    return Variable.stored(dims, str if characters else variable.dtype, attributes)
