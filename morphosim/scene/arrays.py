"""Arrays of a scene file: they lie in an .npz file beside it, and it names them "file.npz:key"."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from morphosim import _validate
from morphosim._files import guarded, is_file, replacing

ARRAY = ("dtype", "shape", "values")
"""Keys of the table of an array."""


def array_of(value: Any, folder: Path, where: str) -> NDArray[Any]:
    """Array as it is, of lists of numbers, as of `listed`, or named as "file.npz:key".

    Raises
    ------
    FileNotFoundError
        There is no such file in `folder`.
    ValueError
        The file is damaged or has no such array, or the lists are none of numbers.
    """
    if isinstance(value, np.ndarray):
        return value
    if isinstance(value, Mapping):
        return _of_table(value, where)
    if not isinstance(value, str):
        return _validate.array(where, value, None)
    name, _, key = value.partition(":")
    path = folder / name
    if not is_file(path):
        message = f"{where} = {_validate.brief(value)}: there is no such file in {folder}"
        raise FileNotFoundError(message)
    with _validate.told_of(where):
        known, array = guarded(path, lambda: _entry(path, key))
    _validate.choice(f"{where}: array in {name}", key, known)
    return np.asarray(array)


def _of_table(table: Mapping[str, Any], where: str) -> NDArray[Any]:
    """Array that `listed` has made a table of."""
    _validate.keys(where, table, ARRAY, ARRAY)
    try:
        array = np.array(table["values"], np.dtype(table["dtype"])).reshape(table["shape"])
    except (TypeError, ValueError, OverflowError, MemoryError, RecursionError) as error:
        message = f"{where} = {_validate.brief(table)} says no array ({error})"
        raise ValueError(message) from error
    if array.dtype.hasobject:
        message = f"{where}: an array of objects; a file can hold arrays of numbers"
        raise ValueError(message)
    return array


def _entry(path: Path, key: str) -> tuple[list[str], Any]:
    """Names in an .npz file, and the array of one of them if it is there."""
    with path.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
        return file.files, file[key] if key in file.files else None


def listed(value: Any) -> Any:
    """Value with lists for its arrays, of which `array_of` makes the same arrays."""
    if isinstance(value, np.ndarray):
        values = value.tolist()
        if value.dtype == np.float64 and value.size and np.isfinite(value).all():
            return values
        return {"dtype": value.dtype.str, "shape": list(value.shape), "values": values}
    if isinstance(value, dict):
        return {key: listed(item) for key, item in value.items()}
    if isinstance(value, list):
        return [listed(item) for item in value]
    return value


def set_apart(value: Any, archive: str, key: str, arrays: dict[str, NDArray[Any]]) -> Any:
    """What a file says of a value: its arrays go into `arrays`, and are named "archive:key".

    Of several arrays in one table each has the name of its field in its key too.
    """
    if isinstance(value, np.ndarray):
        arrays[key] = value
        return f"{archive}:{key}"
    if isinstance(value, list):
        return [set_apart(v, archive, f"{key}_{k}", arrays) for k, v in enumerate(value)]
    if isinstance(value, dict):
        alone = sum(isinstance(v, np.ndarray) for v in value.values()) == 1
        return {
            name: set_apart(
                v, archive, key if alone and isinstance(v, np.ndarray) else f"{key}_{name}", arrays
            )
            for name, v in value.items()
        }
    return value


def write_arrays(path: Path, arrays: dict[str, NDArray[Any]]) -> None:
    """Write an .npz file, whole or not at all."""
    with replacing(path) as partial, partial.open("wb") as file:
        np.savez_compressed(file, **arrays)  # type: ignore[arg-type]
