"""Variables of MAT-files, from v4 to v7.3 (HDF5)."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from morphosim._files import check_file, guarded, listed
from morphosim._isolated import isolated


def read_mat(path: Path, wanted: Sequence[str], also: Sequence[str] = ()) -> dict[str, Any]:
    """Those of the variables that are there; cell arrays become lists, in MATLAB's order.

    Raises ValueError unless one of `wanted` is there.
    """
    check_file(path, (".mat",))
    with path.open("rb") as file:
        start = file.read(1024)
    is_hdf5 = start.find(b"\x89HDF\r\n\x1a\n") in (0, 512)
    read = _read_hdf5 if is_hdf5 else _read_classic
    names, found = guarded(path, lambda: isolated(read, path.absolute(), (*wanted, *also)))
    if not any(name in found for name in wanted):
        message = f"{path} has no variable {' or '.join(wanted)}; it holds {listed(names)}"
        raise ValueError(message)
    return found


def _read_classic(path: Path, wanted: Iterable[str]) -> tuple[list[str], dict[str, Any]]:
    """Names of all variables, and those wanted, of a MAT-file before v7.3."""
    from scipy.io import loadmat, whosmat

    names = [str(name) for name, _, _ in whosmat(path)]
    found = loadmat(path, variable_names=[name for name in wanted if name in names])
    return names, {
        name: list(value.ravel(order="F")) if value.dtype == object else value
        for name, value in found.items()
        if name in names
    }


def _read_hdf5(path: Path, wanted: Iterable[str]) -> tuple[list[str], dict[str, Any]]:
    """Names of all variables, and those wanted, of a MAT-file v7.3."""
    import h5py

    with h5py.File(path, "r") as file:
        names = [name for name in file if not name.startswith("#")]
        return names, {name: _hdf5_value(h5py, file, name) for name in wanted if name in names}


def _hdf5_value(h5py: Any, file: Any, name: str) -> Any:
    """One variable; a cell array is a dataset of references to datasets."""
    item = file[name]
    if not isinstance(item, h5py.Dataset) or h5py.check_ref_dtype(item.dtype) is None:
        return _hdf5_array(item)
    return [_hdf5_array(file[reference]) for reference in item[()].ravel()]


def _hdf5_array(item: Any) -> NDArray[Any] | None:
    """Array in MATLAB's order of axes (HDF5 has them reversed); None for a struct."""
    if not hasattr(item, "dtype"):
        return None
    if item.attrs.get("MATLAB_empty", 0):
        return np.empty(tuple(int(n) for n in item[()]))
    return np.asarray(item[()]).T
