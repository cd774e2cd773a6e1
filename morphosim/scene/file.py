"""Scene files: TOML that says the same as the Python classes.

Arrays (masks, fields) lie in an .npz file beside the TOML file, named as "file.npz:key". A scene's
table is the content of its file, with the arrays themselves in it.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from morphosim import _validate
from morphosim._files import toml_table, write_text
from morphosim.geometry.confinement import CONFINEMENTS
from morphosim.geometry.shapes import SHAPES, Point, PowerCell
from morphosim.scene.arrays import set_apart, write_arrays
from morphosim.scene.cell import Cell
from morphosim.scene.kinds import object_of, table_of
from morphosim.scene.populations import POPULATIONS
from morphosim.scene.scene import Scene, power_cells
from morphosim.scene.stage_tables import stage_of, stage_table
from morphosim.scene.tables import (
    cell_of,
    cell_values,
    numerics_of,
    numerics_table,
    physics_in_file,
    physics_of,
)
from morphosim.scene.values import plain

_SCALARS = (
    "name", "description", "duration", "save_every", "save_fields", "save_labels", "on_vanish",
    "period",
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
    _override(table, overrides or {})
    return scene_of({"name": path.stem} | table, path.parent)


def overridden(scene: Scene, overrides: Mapping[str, Any]) -> Scene:
    """Copy of a scene with values replaced as `load_scene` replaces those of its file.

    Raises
    ------
    ValueError
        A file cannot say the scene, or a key or value is not allowed.
    """
    table = scene_table(scene)
    _override(table, overrides)
    return scene_of(table)


def _override(table: dict[str, Any], overrides: Mapping[str, Any]) -> None:
    """Replace values of a scene's table: whole tables, then a preset, then single values."""
    _validate.instance("overrides", overrides, Mapping)
    for key in overrides:
        _validate.label("key of a value to set", key, empty=True)
    for key in sorted(overrides, key=lambda key: (key.count("."), key != "numerics.preset")):
        if key == "numerics.preset":  # replaces what the table says of accuracy and speed
            kept = table.get("numerics", {})
            _validate.instance("numerics", kept, Mapping)
            table["numerics"] = {k: v for k, v in kept.items() if k in ("threads", "seed")}
        _replace(table, key, overrides[key])


def _replace(table: dict[str, Any], key: str, value: Any) -> None:
    """Set a value by its dotted key; a number counts in a list, from 0."""
    *parents, last = key.split(".")
    place: Any = table
    for parent in parents:
        place = _inside(place, parent, key)
    if isinstance(place, list):
        place[_number_in(place, last, key)] = value
    else:
        place[last] = value


def _inside(place: Any, name: str, key: str) -> Any:
    """Table or list of this name, or number, in another; ValueError if there is none."""
    if isinstance(place, dict):
        found = place.setdefault(name, {})
    else:
        found = place[_number_in(place, name, key)]
    if not isinstance(found, dict | list):
        message = f"cannot set {key!r}: {name!r} is not a table"
        raise ValueError(message)
    return found


def _number_in(place: list[Any], name: str, key: str) -> int:
    """Number of an item of a list; ValueError if there is none."""
    if name.isdecimal() and len(name) < 10 and int(name) < len(place):
        return int(name)
    shown = _validate.brief(name, 40)
    message = f"cannot set {key!r}: there is no {shown} in a list of {len(place)}"
    raise ValueError(message)


def scene_of(table: Mapping[str, Any], folder: Path = Path()) -> Scene:
    """Scene from its table; array files that it names are looked up in `folder`.

    Raises
    ------
    FileNotFoundError
        An array file does not exist.
    ValueError
        A key is not known, or a value is not allowed.
    """
    _validate.keys("the scene", table, (*_SCALARS, *_TABLES))
    confinement = confinement_of(table, folder)
    numerics = numerics_of(table.get("numerics", {}))
    cells = _cells(table.get("cells", []), confinement, numerics.seed, folder)
    return Scene(
        cells=cells,
        physics=physics_of(table.get("physics", {}), [cell.name for cell in cells], folder),
        numerics=numerics,
        confinement=confinement,
        stages=[
            stage_of(row, f"stages[{k}]", folder)
            for k, row in enumerate(_validate.several("stages", table.get("stages", []), "tables"))
        ],
        **{key: table[key] for key in _SCALARS if key in table},
    )


def _cells(said: Any, confinement: Any, seed: int, folder: Path) -> Sequence[Cell]:
    """Cells from a list of their tables, or from the table of a population."""
    if isinstance(said, Mapping):
        population = object_of(said, POPULATIONS, "cells", folder)
        if not callable(getattr(population, "cells", None)):
            message = f"cells.use = {said['use']!r} has no method cells(confinement, seed)"
            raise ValueError(message)
        return _validate.several("cells", population.cells(confinement, seed), "cells")
    _check_rows(said)
    shapes = _shapes(said, confinement, folder)
    return [cell_of(row, shape) for row, shape in zip(said, shapes, strict=True)]


def _check_rows(rows: Any) -> None:
    """Raise ValueError or TypeError unless these are tables of cells with names."""
    for k, row in enumerate(_validate.several("cells", rows, "tables")):
        _validate.keys(f"cells[{k}]", row, _validate.names_of(Cell), ("name",))
        _validate.label(f"cells[{k}].name", row["name"])


def confinement_of(table: Mapping[str, Any], folder: Path = Path()) -> Any:
    """Confinement alone, from a scene's table; None in open space.

    Raises
    ------
    FileNotFoundError
        An array file that it names is not in `folder`.
    ValueError
        A key or value is not allowed, or a function or class cannot be imported.
    """
    said = table.get("confinement")
    return None if said is None else object_of(said, CONFINEMENTS, "confinement", folder)


def _shapes(rows: list[dict[str, Any]], confinement: Any, folder: Path) -> list[Any]:
    """Shapes of all cells; those given as points become cells of one power partition."""
    shapes = [
        object_of(row.get("shape"), SHAPES, f"cell {row['name']!r}: shape", folder) for row in rows
    ]
    points = [k for k, shape in enumerate(shapes) if isinstance(shape, Point)]
    if points:
        cells = power_cells(
            [rows[k]["name"] for k in points],
            [shapes[k].position for k in points],
            [_start_volume(rows[k], shapes[k]) for k in points],
            confinement,
        )
        for k, cell in zip(points, cells, strict=True):
            shapes[k] = cell
    return shapes


def _start_volume(row: Mapping[str, Any], point: Point) -> float:
    """Volume at which a point's cell starts: the point's, else the cell's target."""
    volume = row.get("volume") if point.volume is None else point.volume
    if not isinstance(volume, int | float):
        message = (
            f"cell {row['name']!r}: a shape of kind 'point' needs a volume, its own or the cell's"
        )
        raise ValueError(message)
    return volume


def save_scene(scene: Scene, path: str | Path) -> None:
    """Write a scene file, and beside it an .npz file with its arrays if it has any.

    Both appear whole or not at all.

    Raises
    ------
    ValueError
        The scene holds what a file cannot say: a volume function, a function or an object that no
        module and no script has by name, or a part of a power partition.
    """
    import tomli_w

    path = Path(path)
    arrays: dict[str, NDArray[Any]] = {}
    table = _stored(scene_table(scene), f"{path.stem}.npz", arrays)
    if arrays:
        write_arrays(path.with_suffix(".npz"), arrays)
    write_text(path, tomli_w.dumps(table))


def _stored(table: dict[str, Any], archive: str, arrays: dict[str, NDArray[Any]]) -> dict[str, Any]:
    """Table as it is written: its arrays go into `arrays`, and are named as of an archive."""
    cells = [
        row | {"shape": set_apart(row["shape"], archive, f"cell_{k}", arrays)}
        for k, row in enumerate(table["cells"])
    ]
    return {
        key: cells if key == "cells" else set_apart(value, archive, key, arrays)
        for key, value in table.items()
    }


def scene_table(scene: Scene) -> dict[str, Any]:
    """Table of a scene: what its file says, with the arrays themselves in it.

    Raises
    ------
    ValueError
        See `save_scene`.
    """
    _check_partitions(scene)
    table: dict[str, Any] = {key: plain(getattr(scene, key)) for key in _SCALARS}
    if not any(scene.period):
        del table["period"]
    table["physics"] = physics_in_file(scene.physics)
    table["numerics"] = plain(numerics_table(scene.numerics))
    if scene.confinement is not None:
        table["confinement"] = table_of(scene.confinement, CONFINEMENTS, "confinement")
    table["cells"] = [_cell_table(cell) for cell in scene.cells]
    if scene.stages:
        table["stages"] = [stage_table(stage) for stage in scene.stages]
    return table


def _check_partitions(scene: Scene) -> None:
    """Raise ValueError if a partition has lost cells: a file would divide space anew."""
    shapes = [cell.shape for cell in scene.cells if isinstance(cell.shape, PowerCell)]
    if shapes and len(shapes) != len(shapes[0].partition.points):
        message = (
            f"the scene holds {len(shapes)} of {len(shapes[0].partition.points)} cells of a power "
            "partition; a scene file can only say all of them"
        )
        raise ValueError(message)


def _cell_table(cell: Cell) -> dict[str, Any]:
    shape = cell.shape.point if isinstance(cell.shape, PowerCell) else cell.shape
    said = table_of(shape, SHAPES, f"cell {cell.name!r}: shape")
    return plain(cell_values(cell)) | {"shape": said}  # type: ignore[no-any-return]
