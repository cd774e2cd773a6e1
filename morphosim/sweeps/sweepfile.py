"""Sweep files: TOML that says what `sweep` is told."""

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from morphosim import _validate
from morphosim._files import toml_table
from morphosim.library.built_in import scene_names
from morphosim.sweeps.axes import Axis, Range

_KEYS = (
    "scene", "axes", "figures", "replicates", "samples", "sampling", "sample_seed", "overrides",
    "keep",
)  # fmt: skip
_AXIS, _RANGE = ("values", "sets"), ("low", "high", "log", "sets")


def read_sweep(path: str | Path) -> dict[str, Any]:
    """Keywords of `sweep` from a file.

    Scene files, and modules of figures ("module:name"), are looked up in the file's folder.

    Raises
    ------
    FileNotFoundError
        The file does not exist.
    ValueError
        It is not TOML, lacks a scene or axes, or has a key that is not known.
    """
    path = Path(path)
    table = toml_table(path, "sweep file")
    _validate.keys(f"the sweep file {path}", table, _KEYS)
    for key in ("scene", "axes"):
        if key not in table:
            message = f"{path} has no {key!r}; a sweep file needs a scene and axes"
            raise ValueError(message)
    _validate.text("scene", table["scene"])
    for key in ("axes", "overrides"):
        _validate.instance(key, table.get(key, {}), Mapping)
    sys.path.insert(0, str(path.parent.resolve()))
    return table | {
        "scene": _scene(table["scene"], path.parent),
        "axes": dict(_axes(table["axes"])),
        "overrides": dict(_leaves(table.get("overrides", {}))),
    }


def _scene(text: str, folder: Path) -> str:
    """Name of a built-in scene, or path that is looked up in a folder."""
    return text if text in scene_names() else str(folder / text)


def _axes(table: Mapping[str, Any], above: str = "") -> Any:
    """Name and axis of all axes; `physics.gamma = ...` and `"physics.gamma" = ...` are the same."""
    for key, value in table.items():
        name = above + key
        if not isinstance(value, Mapping):
            yield name, value
        elif "values" in value:
            _validate.keys(f"axis {name!r}", value, _AXIS)
            yield name, Axis(**value)
        elif "low" in value or "high" in value:
            yield name, _range(name, value)
        else:
            yield from _axes(value, f"{name}.")


def _range(name: str, table: Mapping[str, Any]) -> Range:
    _validate.keys(f"axis {name!r}", table, _RANGE)
    for key in ("low", "high"):
        if key not in table:
            message = f"axis {name!r} = {dict(table)} has no {key!r}; a range needs low and high"
            raise ValueError(message)
    return Range(**table)


def _leaves(table: Mapping[str, Any], above: str = "") -> Any:
    """Dotted key and value of everything in nested tables.

    A table of a quoted key that has dots, or one with a kind, is a value: it replaces the scene's.
    """
    for key, value in table.items():
        if isinstance(value, Mapping) and "." not in key and "kind" not in value:
            yield from _leaves(value, f"{above}{key}.")
        else:
            yield above + key, value
