"""What must stay the same for a run to go on: a scene's cells, physics, numerics, walls, stages."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from hashlib import sha256
from typing import Any

import numpy as np

from morphosim.geometry.confinement import CONFINEMENTS
from morphosim.geometry.shapes import SHAPES, PowerCell
from morphosim.scene.cell import Cell, VolumeCourse
from morphosim.scene.kinds import table_of
from morphosim.scene.scene import Scene
from morphosim.scene.stage_tables import stage_table
from morphosim.scene.tables import numerics_table, physics_table
from morphosim.scene.term_tables import term_table
from morphosim.scene.values import dataclass_table, plain

LONGEST = 12
"""Longer arrays, and those of other numbers than finite ones, are told by their digests."""
ABSENT = "not there"


def settings(scene: Scene) -> dict[str, Any]:
    """What must stay the same for a run to go on as if it had never stopped.

    As a scene file says it, cells by their names, with digests for its arrays. What no file can say
    is left out, as are the places of classes and functions, which may move.
    """
    numerics = numerics_table(scene.numerics)
    del numerics["threads"]
    said: dict[str, Any] = {
        "physics": physics_table(scene.physics), "numerics": numerics,
        "on_vanish": scene.on_vanish, "cells": {cell.name: _cell(cell) for cell in scene.cells},
        "stages": [_or_nothing(stage_table, stage) for stage in scene.stages],
    }  # fmt: skip
    if scene.physics.terms:
        terms = [_or_nothing(term_table, term) for term in scene.physics.terms]
        said["physics"] = said["physics"] | {"terms": terms}
    if any(scene.period):
        said["period"] = list(scene.period)
    if scene.confinement is not None:
        walls = scene.confinement
        said["confinement"] = _or_nothing(table_of, walls, CONFINEMENTS, "confinement")
    return dict(_told(said))


def first_difference(had: Any, has: Any, key: str = "") -> tuple[str, str, str] | None:
    """Where two settings differ first: dotted key, and in words what one had, the other has."""
    return next(_differences(had, has, key), None)


def _differences(had: Any, has: Any, key: str) -> Iterator[tuple[str, str, str]]:
    if isinstance(had, Mapping) and isinstance(has, Mapping):
        for name in sorted(had.keys() | has.keys()):
            inner = f"{key}.{name}" if key else name
            yield from _differences(had.get(name, ABSENT), has.get(name, ABSENT), inner)
    elif isinstance(had, list) and isinstance(has, list) and len(had) == len(has):
        for k, (before, now) in enumerate(zip(had, has, strict=True)):
            yield from _differences(before, now, f"{key}[{k}]")
    elif had != has and not (had != had and has != has):  # NaN is the same as NaN
        yield key, _short(had), _short(has)


def _short(value: Any) -> str:
    """Value for an error; tables and long lists are not shown."""
    if value == ABSENT:
        return ABSENT
    if isinstance(value, Mapping):
        return "it"
    return f"a list of {len(value)}" if isinstance(value, list) and len(value) > 3 else repr(value)


def _cell(cell: Cell) -> dict[str, Any]:
    """What a cell starts with."""
    shape = cell.shape.point if isinstance(cell.shape, PowerCell) else cell.shape
    volume: Any = None
    if isinstance(cell.volume, VolumeCourse):
        volume = dataclass_table(cell.volume)
    elif not callable(cell.volume):
        volume = cell.target_volume(0.0)
    return {
        "type": cell.type, "gamma": cell.gamma, "frozen": cell.frozen, "parent": cell.parent,
        "volume": volume,
        "shape": _or_nothing(table_of, shape, SHAPES, "shape"),
    }  # fmt: skip


def _or_nothing(table: Callable[..., Any], *arguments: Any) -> Any:
    """Table of an object; None if no file can say it."""
    with suppress(ValueError, TypeError):
        return table(*arguments)
    return None


def _told(value: Any) -> Any:
    """Value as JSON can hold it."""
    if isinstance(value, np.ndarray) and not _is_short(value):
        found = sha256(f"{value.dtype.str} {value.shape} ".encode())
        found.update(np.ascontiguousarray(value).tobytes())
        return f"an array with digest {found.hexdigest()[:16]}"
    if isinstance(value, Mapping):
        return {
            name: item.rpartition(":")[2] if name == "use" else _told(item)
            for name, item in value.items()
        }
    if isinstance(value, tuple | list):
        return [_told(item) for item in value]
    return plain(value)


def _is_short(value: np.ndarray) -> bool:
    """Whether the numbers of an array are told one by one."""
    kind = value.dtype in (np.float64, np.int64)
    return kind and 0 < value.size <= LONGEST and bool(np.isfinite(value).all())
