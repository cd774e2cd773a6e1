"""What must stay the same for a run to go on: a scene's physics, numerics, walls and stages."""

import json
from collections.abc import Mapping
from contextlib import suppress
from hashlib import sha256
from typing import Any

import numpy as np
from numpy.typing import NDArray

from morphosim.geometry.confinement import CONFINEMENTS
from morphosim.physics.parameters import Physics
from morphosim.scene.arrays import set_apart
from morphosim.scene.kinds import table_of
from morphosim.scene.scene import Scene
from morphosim.scene.stage_tables import stage_table
from morphosim.scene.tables import numerics_table, physics_table
from morphosim.scene.term_tables import term_table
from morphosim.scene.values import plain


def settings(scene: Scene) -> dict[str, Any]:
    """What must stay the same for a run to go on as if it had never stopped.

    Walls and stages are digests of what a file says of them; what no file can say is left out.
    """
    numerics = numerics_table(scene.numerics)
    del numerics["threads"]
    said: dict[str, Any] = {"on_vanish": scene.on_vanish}
    with suppress(ValueError, TypeError):
        walls = scene.confinement
        table = walls and table_of(walls, CONFINEMENTS, "confinement")
        said["confinement"] = _digest(table, "confinement")
    for k, stage in enumerate(scene.stages):
        with suppress(ValueError, TypeError):
            row = stage_table(stage)
            physics = _without_places(row.get("physics", {}))
            said[f"stages[{k}]"] = _digest(row | {"physics": physics}, "stage")
    physics = _without_places(physics_table(scene.physics) | _terms(scene.physics))
    return {"physics": physics, "numerics": numerics, "scene": said}


def _without_places(physics: Mapping[str, Any]) -> dict[str, Any]:
    """Physics whose terms are named by their class alone; its file may move."""
    terms = physics.get("terms", ())
    named = [term | {"use": term["use"].rpartition(":")[2]} for term in terms]
    return dict(physics) | ({"terms": named} if named else {})


def _terms(physics: Physics) -> dict[str, Any]:
    """Tables of the terms that a file can say, with digests of their arrays."""
    tables = []
    for term in physics.terms:
        with suppress(ValueError):
            tables.append(
                {
                    key: _digest(value, key) if isinstance(value, np.ndarray) else value
                    for key, value in term_table(term).items()
                }
            )
    return {"terms": tables} if physics.terms else {}


def _digest(table: Any, key: str) -> str:
    """Text that is another one if any value is."""
    arrays: dict[str, NDArray[Any]] = {}
    text = json.dumps(plain(set_apart(table, "", key, arrays)), sort_keys=True)
    found = sha256(text.encode())
    for array in arrays.values():
        found.update(np.ascontiguousarray(array).tobytes())
    return found.hexdigest()[:16]
