"""Scene files: TOML that says the same as the Python classes.

Arrays (masks, fields) lie in an .npz file beside the TOML file, named as "file.npz:key".
"""

import importlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from morphosim import _validate
from morphosim._files import guarded, replacing, toml_table
from morphosim.geometry.confinement import BoxWalls, EllipsoidShell, FunctionWalls, MaskWalls
from morphosim.geometry.shapes import Ellipsoid, Field, Mask, PowerCell, Sphere
from morphosim.scene.cell import Cell
from morphosim.scene.scene import Scene, power_cells
from morphosim.scene.stage_tables import stage_of, stage_table
from morphosim.scene.tables import (
    build,
    cell_of,
    cell_values,
    numerics_of,
    numerics_table,
    physics_of,
    physics_said,
    physics_table,
    physics_values,
    plain,
)

SHAPES: dict[str, type] = {"sphere": Sphere, "ellipsoid": Ellipsoid, "mask": Mask, "field": Field}
CONFINEMENTS: dict[str, type] = {
    "ellipsoid": EllipsoidShell,
    "box": BoxWalls,
    "mask": MaskWalls,
    "function": FunctionWalls,
}
_ARRAYS = ("mask", "phi", "inside")
_SCALARS = (
    "name", "description", "duration", "save_every", "save_fields", "save_labels", "on_vanish",
)  # fmt: skip
_TABLES = ("physics", "numerics", "confinement", "cells", "stages")


def load_scene(path: str | Path, overrides: Mapping[str, Any] | None = None) -> Scene:
    """Read a scene file.

    Parameters
    ----------
    path : path of a TOML file
    overrides : mapping, optional
        Values by dotted key, such as {"physics.gamma": 0.3}, that replace those of the file;
        "numerics.preset" replaces all of the file's numerics but threads and seed.

    Raises
    ------
    FileNotFoundError
        The file, or an array file that it names, does not exist.
    ValueError
        The file is not TOML, has a key that is not known, or a value that is not allowed.
    """
    path = Path(path)
    table = toml_table(path, "scene file")
    given = overrides or {}
    for key in sorted(given, key=_depth):
        _override(table, key, given[key])
    return scene_from_table({"name": path.stem} | table, path.parent)


def _depth(key: str) -> tuple[int, bool]:
    """Order of overrides: whole tables, then a preset, then single values."""
    return key.count("."), key != "numerics.preset"


def _override(table: dict[str, Any], key: str, value: Any) -> None:
    if key == "numerics.preset":  # replaces what the file says of accuracy and speed
        kept = table.get("numerics", {})
        _validate.instance("numerics", kept, Mapping)
        table["numerics"] = {k: v for k, v in kept.items() if k in ("threads", "seed")}
    *parents, last = key.split(".")
    for parent in parents:
        table = table.setdefault(parent, {})
        if not isinstance(table, dict):
            message = f"cannot set {key}: {parent} is not a table"
            raise ValueError(message)
    table[last] = value


def scene_from_table(table: Mapping[str, Any], folder: Path) -> Scene:
    """Scene from the content of a scene file; array files are looked up in `folder`."""
    _validate.keys("the scene", table, (*_SCALARS, *_TABLES))
    rows = table.get("cells", [])
    _validate.instance("cells", rows, list)
    for k, row in enumerate(rows):
        _validate.keys(f"cells[{k}]", row, _validate.names_of(Cell))
        if "name" not in row:
            message = f"cells[{k}] has no 'name'; every cell needs one"
            raise ValueError(message)
    confinement = confinement_of(table, folder)
    shapes = _shapes(rows, confinement, folder)
    return Scene(
        cells=[cell_of(row, shape) for row, shape in zip(rows, shapes, strict=True)],
        physics=physics_of(table.get("physics", {}), [row.get("name") for row in rows]),
        numerics=numerics_of(table.get("numerics", {})),
        confinement=confinement,
        stages=[
            stage_of(row, f"stages[{k}]", physics_values)
            for k, row in enumerate(table.get("stages", []))
        ],
        **{key: table[key] for key in _SCALARS if key in table},
    )


def _typed(
    table: Mapping[str, Any] | None, kinds: Mapping[str, type], where: str, folder: Path
) -> Any:
    """Object named by `kind`, with arrays and functions looked up."""
    known = [*kinds, "none" if kinds is CONFINEMENTS else "point"]
    if not isinstance(table, Mapping) or "kind" not in table:
        message = f"{where} = {table!r}: expected a table with a kind out of {known}"
        raise ValueError(message)
    _validate.choice(f"{where}.kind", table["kind"], known)
    values = {
        key: _array(value, folder, f"{where}.{key}") if key in _ARRAYS else value
        for key, value in table.items()
        if key != "kind"
    }
    if isinstance(values.get("function"), str):
        values["function"] = _function(values["function"], where)
    return build(kinds[table["kind"]], values, where)


def _array(value: Any, folder: Path, where: str) -> Any:
    """Array given in the file, or as "file.npz:key"."""
    if not isinstance(value, str):
        return _validate.array(where, value, (None, None, None))
    name, _, key = value.partition(":")
    path = folder / name
    if not path.exists():
        message = f"{where} = {value!r}: {path} does not exist"
        raise FileNotFoundError(message)
    known, array = guarded(path, lambda: _entry(path, key))
    _validate.choice(f"{where}: array in {name}", key, known)
    return array


def _entry(path: Path, key: str) -> tuple[list[str], Any]:
    """Names in an .npz file, and the array of one of them if it is there."""
    with path.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
        return file.files, file[key] if key in file.files else None


def _function(value: str, where: str) -> Callable[..., Any]:
    """Function given as "module:name"."""
    module, _, name = value.partition(":")
    try:
        return getattr(importlib.import_module(module), name)  # type: ignore[no-any-return]
    except (ImportError, AttributeError, ValueError) as error:
        message = f"{where}.function = {value!r} cannot be loaded as module:name ({error})"
        raise ValueError(message) from error


def confinement_of(scene: Mapping[str, Any], folder: Path) -> Any:
    """Confinement alone, from the content of a scene file; None in open space.

    Raises
    ------
    FileNotFoundError
        An array file that it names is not in `folder`.
    ValueError
        A key or value is not allowed, or a function cannot be imported.
    """
    table = scene.get("confinement")
    if table is None:
        return None
    if isinstance(table, Mapping) and table.get("kind") == "none":
        _validate.keys("confinement of kind 'none'", table, ("kind",))
        return None
    return _typed(table, CONFINEMENTS, "confinement", folder)


def _shapes(rows: list[dict[str, Any]], confinement: Any, folder: Path) -> list[Any]:
    """Shapes of all cells; those of kind "point" share a power partition."""
    points = [row for row in rows if _kind(row) == "point"]
    partition: Iterator[PowerCell] = iter(())
    if points:
        for row in points:
            _validate.keys(
                f"cell {row['name']!r}: shape", row["shape"], ("kind", "position", "volume")
            )
            if not isinstance(_start_volume(row), int | float):
                message = (
                    f"cell {row['name']!r}: a shape of kind 'point' needs a volume, its own or "
                    "the cell's"
                )
                raise ValueError(message)
        partition = iter(
            power_cells(
                [row["name"] for row in points],
                [row["shape"].get("position") for row in points],
                [_start_volume(row) for row in points],
                confinement,
            )
        )
    return [
        next(partition)
        if _kind(row) == "point"
        else _typed(row.get("shape"), SHAPES, f"cell {row.get('name')!r}: shape", folder)
        for row in rows
    ]


def _start_volume(row: Mapping[str, Any]) -> Any:
    """Volume at which a point's cell starts: the shape's, else the cell's target."""
    return row["shape"].get("volume", row.get("volume"))


def _kind(row: Mapping[str, Any]) -> Any:
    shape = row.get("shape")
    return shape.get("kind") if isinstance(shape, Mapping) else None


def save_scene(scene: Scene, path: str | Path) -> None:
    """Write a scene file, and beside it an .npz file with its arrays if it has any.

    Both appear whole or not at all.

    Raises
    ------
    ValueError
        The scene holds a function (volume or confinement), or an object of another class, that a
        file cannot say.
    """
    import tomli_w

    path = Path(path)
    _check_partitions(scene)
    arrays: dict[str, np.ndarray] = {}
    archive = f"{path.stem}.npz"
    table = {key: getattr(scene, key) for key in _SCALARS}
    table["physics"] = physics_table(scene.physics)
    table["numerics"] = numerics_table(scene.numerics)
    if scene.confinement is not None:
        table["confinement"] = _typed_table(
            scene.confinement, CONFINEMENTS, arrays, archive, "confinement"
        )
    table["cells"] = [
        _cell_table(cell, arrays, archive, f"cell_{k}") for k, cell in enumerate(scene.cells)
    ]
    if scene.stages:
        table["stages"] = [stage_table(stage, physics_said) for stage in scene.stages]
    if arrays:
        with replacing(path.with_name(archive)) as partial, partial.open("wb") as file:
            np.savez_compressed(file, **arrays)  # type: ignore[arg-type]
    with replacing(path) as partial:
        partial.write_text(tomli_w.dumps(plain(table)), encoding="utf-8")


def _check_partitions(scene: Scene) -> None:
    """Raise ValueError if a partition has lost cells: a file would divide space anew."""
    shapes = [cell.shape for cell in scene.cells if isinstance(cell.shape, PowerCell)]
    if shapes and len(shapes) != len(shapes[0].partition.points):
        message = (
            f"the scene holds {len(shapes)} of {len(shapes[0].partition.points)} cells of a power "
            "partition; a scene file can only say all of them"
        )
        raise ValueError(message)


def _typed_table(
    item: Any, kinds: Mapping[str, type], arrays: dict[str, np.ndarray], archive: str, key: str
) -> dict[str, Any]:
    """Table of a shape or confinement; its array goes into `arrays` under `key`."""
    kind = next((name for name, cls in kinds.items() if cls is type(item)), "")
    if not kind:
        message = f"{item!r} cannot be written to a scene file; it can say {[*kinds]}"
        raise ValueError(message)
    table: dict[str, Any] = {"kind": kind}
    for f in fields(item):
        value = getattr(item, f.name)
        if f.name in _ARRAYS:
            arrays[key] = value
            value = f"{archive}:{key}"
        elif callable(value):
            value = _function_name(value)
        table[f.name] = plain(value)
    return table


def _function_name(function: Callable[..., Any]) -> str:
    name = f"{function.__module__}:{function.__qualname__}"
    if "<" in name or function.__module__ == "__main__":
        message = f"{function!r} cannot be written to a scene file; use a function of a module"
        raise ValueError(message)
    return name


def _cell_table(
    cell: Cell, arrays: dict[str, np.ndarray], archive: str, key: str
) -> dict[str, Any]:
    """Table of a cell; its array goes into `arrays` under `key`."""
    table = cell_values(cell)
    if isinstance(cell.shape, PowerCell):
        position = cell.shape.partition.points[cell.shape.cell]
        table["shape"] = {
            "kind": "point", "position": position, "volume": cell.shape.volume,
        }  # fmt: skip
    else:
        table["shape"] = _typed_table(cell.shape, SHAPES, arrays, archive, key)
    return table
