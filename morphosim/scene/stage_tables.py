"""Stages and events as tables of a scene file.

A stage is a table of the fields of `Stage`; `end` and each event or rule are tables with a `kind`
and the fields of its class.
"""

from collections.abc import Callable, Mapping
from dataclasses import fields
from typing import Any

from morphosim import _validate
from morphosim.scene.events import CellChange, Differentiation, Division, PhysicsChange, Removal
from morphosim.scene.stages import Duration, QuasiSteady, Stage, Steady

ENDS: dict[str, type] = {"duration": Duration, "steady": Steady, "quasi-steady": QuasiSteady}
EVENTS: dict[str, type] = {
    "division": Division,
    "removal": Removal,
    "differentiation": Differentiation,
    "cells": CellChange,
    "physics": PhysicsChange,
}
Convert = Callable[[Any], Any]


def stage_of(table: Mapping[str, Any], where: str, physics: Convert) -> Stage:
    """Stage from its table; `physics` turns a table of physics into keywords of `Physics`."""
    _validate.keys(where, table, _validate.names_of(Stage))
    if "name" not in table or "end" not in table:
        message = f"{where}: a stage needs a name and an end"
        raise ValueError(message)
    return Stage(
        name=table["name"],
        end=_built(table["end"], ENDS, f"{where}.end"),
        limit=table.get("limit"),
        physics=physics(table.get("physics", {})),
        events=_events(table, "events", where, physics),
        rules=_events(table, "rules", where, physics),
        **{key: table[key] for key in ("rules_every",) if key in table},
    )


def _events(table: Mapping[str, Any], key: str, where: str, physics: Convert) -> list[Any]:
    """Events or rules of a stage."""
    rows = table.get(key, [])
    return [_event(row, f"{where}.{key}[{k}]", physics) for k, row in enumerate(rows)]


def _event(table: Mapping[str, Any], where: str, physics: Convert) -> Any:
    if isinstance(table, Mapping) and table.get("kind") == "physics":
        table = dict(table) | {"values": physics(table.get("values", {}))}
    return _built(table, EVENTS, where)


def _built(table: Any, kinds: Mapping[str, type], where: str) -> Any:
    """Object of the class that `kind` names."""
    if not isinstance(table, Mapping) or "kind" not in table:
        message = f"{where} = {table!r}: expected a table with a kind out of {list(kinds)}"
        raise ValueError(message)
    _validate.choice(f"{where}.kind", table["kind"], kinds)
    values = {key: value for key, value in table.items() if key != "kind"}
    kind = kinds[table["kind"]]
    _validate.keys(where, values, _validate.names_of(kind))
    try:
        return kind(**values)
    except TypeError as error:
        message = f"{where}: {error}"
        raise ValueError(message) from error


def stage_table(stage: Stage, physics: Convert) -> dict[str, Any]:
    """Table of a stage; `physics` turns keywords of `Physics` into a table.

    Raises
    ------
    ValueError
        An end or event is not one that a file can say.
    """
    table: dict[str, Any] = {"name": stage.name, "end": _said(stage.end, ENDS, stage)}
    if stage.limit is not None:
        table["limit"] = stage.limit
    if stage.physics:
        table["physics"] = physics(stage.physics)
    for key in ("events", "rules"):
        if getattr(stage, key):
            table[key] = [_event_table(event, stage, physics) for event in getattr(stage, key)]
    if stage.rules:
        table["rules_every"] = stage.rules_every
    return table


def _event_table(event: Any, stage: Stage, physics: Convert) -> dict[str, Any]:
    """Table of an event or rule."""
    row = _said(event, EVENTS, stage)
    if row["kind"] == "physics":
        row["values"] = physics(row["values"])
    return row


def _said(item: Any, kinds: Mapping[str, type], stage: Stage) -> dict[str, Any]:
    """Table of an end or an event."""
    found = [name for name, kind in kinds.items() if type(item) is kind]
    values = {f.name: getattr(item, f.name) for f in fields(item)} if found else {}
    inner = [v for value in values.values() if isinstance(value, Mapping) for v in value.values()]
    if not found or any(map(callable, (*values.values(), *inner))):
        message = f"stage {stage.name!r}: {item!r} cannot be written to a scene file"
        raise ValueError(message)
    return {"kind": found[0]} | {k: v for k, v in values.items() if v is not None}
