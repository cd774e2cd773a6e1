"""From the results of all members to one Dataset."""

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from morphosim.sweeps.axes import Plan
from morphosim.sweeps.store import ABSENT, Store

if TYPE_CHECKING:
    import xarray as xr

FACTS = {
    "error": {"long_name": "why the member has no figures; empty where it has"},
    "warning": {"long_name": "what is expected to be unstable"},
    "seconds": {"long_name": "wall time that the member took", "units": "s"},
}
"""What every member has, besides its figures."""
RESERVED = ("time", "cell", "neighbour", "axis", "end_time", "sample", "replicate", "seed", *FACTS)
"""Names that an axis cannot have."""


def assembled(store: Store, plan: Plan, lost: Mapping[int, str]) -> "xr.Dataset":
    """Dataset with the dimensions of the plan, of all results there are.

    Parameters
    ----------
    store : of the scan
    plan : Plan
    lost : mapping from number of a member to why it has no result
    """
    import xarray as xr

    sizes = plan.sizes
    number = int(np.prod(list(sizes.values())))
    finished = store.finished()
    tables = [store.read(k) if k in finished else None for k in range(number)]
    facts = [
        {"error": lost.get(k, ABSENT), "warning": "", "seconds": np.nan} if t is None else t.attrs
        for k, t in enumerate(tables)
    ]
    result = xr.Dataset(coords=plan.coordinates())
    for name, attributes in FACTS.items():
        values = np.array([fact[name] for fact in facts], dtype=None if name == "seconds" else "O")
        result[name] = (list(sizes), values.reshape(list(sizes.values())), attributes)
    return result.merge(_figures(tables, sizes))


def _figures(tables: "Sequence[xr.Dataset | None]", sizes: Mapping[str, int]) -> "xr.Dataset":
    """Figures of all members on common coordinates; what is missing is NaN or an empty text."""
    import xarray as xr

    present = [table for table in tables if table is not None and table.data_vars]
    labels = {str(dim): _union(t[dim].values for t in present if dim in t.coords)
              for dim in dict.fromkeys(d for t in present for d in t.dims)
              if any(dim in t.coords for t in present)}  # fmt: skip
    result = xr.Dataset(coords=labels)
    for name in dict.fromkeys(str(n) for table in present for n in table.data_vars):
        own = [None if t is None or name not in t else t[name] for t in tables]
        result[name] = _stacked(name, own, labels, sizes)
    return result


def _union(parts: Iterable[NDArray[Any]]) -> NDArray[Any]:
    """Labels of all members: numbers in order, texts by first appearance."""
    found = list(dict.fromkeys(value for part in parts for value in part.tolist()))
    if all(isinstance(value, int | float) for value in found):
        found.sort()
    return np.array(found, dtype=object if any(isinstance(v, str) for v in found) else None)


def _stacked(
    name: str,
    members: "Sequence[xr.DataArray | None]",
    labels: Mapping[str, NDArray[Any]],
    sizes: Mapping[str, int],
) -> Any:
    """Dimensions, values and attributes of one figure of all members."""
    first = next(array for array in members if array is not None)
    on_labels = [
        None if array is None
        else _filled(array).reindex({d: labels[str(d)] for d in array.dims if str(d) in labels},
                                    fill_value="" if _is_text(array) else np.nan)
        for array in members
    ]  # fmt: skip
    shapes = {(array.dims, array.shape) for array in on_labels if array is not None}
    if len(shapes) > 1:
        message = (
            f"figure {name!r} differs in shape between members: {sorted(map(str, shapes))}; give "
            "its dimensions coordinates, or return a number"
        )
        raise ValueError(message)
    (shape,) = (shape for _, shape in shapes)
    blank = np.full(shape, "", dtype=object) if _is_text(first) else np.full(shape, np.nan)
    values = np.array([blank if array is None else array.values for array in on_labels])
    dims = [*sizes, *(str(d) for d in first.dims)]
    return dims, values.reshape([*sizes.values(), *shape]), first.attrs


def _is_text(array: "xr.DataArray") -> bool:
    return array.dtype.kind in "OUST"


def _filled(array: "xr.DataArray") -> "xr.DataArray":
    """Figure as texts or as floating-point numbers, which can say that there is none."""
    if _is_text(array):
        return array.astype(object)
    return array if array.dtype.kind == "f" else array.astype(float)
