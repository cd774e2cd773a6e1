"""Stages as tables of a scene file: the fields of `Stage`, with tables of its end and events."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from morphosim import _validate
from morphosim.scene.ends import ENDS
from morphosim.scene.events import EVENTS
from morphosim.scene.kinds import object_of, table_of
from morphosim.scene.stages import Stage
from morphosim.scene.tables import physics_said, physics_values
from morphosim.scene.values import plain


def stage_of(table: Mapping[str, Any], where: str, folder: Path = Path()) -> Stage:
    """Stage from its table; array files are looked up in `folder`.

    Raises
    ------
    FileNotFoundError
        An array file does not exist.
    ValueError
        A key or value is not allowed, or name or end is missing.
    """
    _validate.keys(where, table, _validate.names_of(Stage), ("name", "end"))

    def events(key: str) -> list[Any]:
        rows = _validate.several(f"{where}.{key}", table.get(key, []), "tables")
        return [object_of(row, EVENTS, f"{where}.{key}[{k}]", folder) for k, row in enumerate(rows)]

    return Stage(
        name=table["name"],
        end=object_of(table["end"], ENDS, f"{where}.end", folder),
        limit=table.get("limit"),
        physics=physics_values(table.get("physics", {}), folder, where),
        events=events("events"),
        rules=events("rules"),
        **{key: table[key] for key in ("rules_every",) if key in table},
    )


def stage_table(stage: Stage) -> dict[str, Any]:
    """Table of a stage; its arrays are arrays.

    Raises
    ------
    ValueError
        An end or event is not one that a file can say.
    """
    where = f"stage {stage.name!r}"
    table: dict[str, Any] = {"name": stage.name, "end": table_of(stage.end, ENDS, where)}
    if stage.limit is not None:
        table["limit"] = plain(stage.limit)
    if stage.physics:
        table["physics"] = physics_said(stage.physics)
    for key in ("events", "rules"):
        if getattr(stage, key):
            table[key] = [table_of(event, EVENTS, where) for event in getattr(stage, key)]
    if stage.rules:
        table["rules_every"] = plain(stage.rules_every)
    return table
