"""Objects as tables of a scene file; see `objects`. Fields of `PhysicsValues` are known too."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from morphosim.scene import objects
from morphosim.scene.objects import Manner
from morphosim.scene.tables import physics_said, physics_values
from morphosim.scene.target import PhysicsValues

_PHYSICS = Manner(PhysicsValues, physics_values, physics_said)


def object_of(table: Any, kinds: Mapping[str, type], where: str, folder: Path = Path()) -> Any:
    """Object that a table says; see `objects.object_of`."""
    return objects.object_of(table, kinds, where, folder, _PHYSICS)


def table_of(item: Any, kinds: Mapping[str, type], where: str) -> dict[str, Any]:
    """Table that says an object; see `objects.table_of`."""
    return objects.table_of(item, kinds, where, _PHYSICS)
