"""What must stay the same for a run to go on: a scene's physics, numerics, walls and stages."""

import json
from contextlib import suppress
from hashlib import sha256
from typing import Any

import numpy as np

from morphosim.scene.file import CONFINEMENTS, _typed_table
from morphosim.scene.scene import Scene
from morphosim.scene.stage_tables import stage_table
from morphosim.scene.tables import numerics_table, physics_said, physics_table, plain


def settings(scene: Scene) -> dict[str, Any]:
    """What must stay the same for a run to go on as if it had never stopped.

    Walls and stages are digests of what a file says of them; what no file can say is left out.
    """
    numerics = numerics_table(scene.numerics)
    del numerics["threads"]
    said: dict[str, Any] = {"on_vanish": scene.on_vanish}
    with suppress(ValueError, TypeError):
        arrays: dict[str, np.ndarray] = {}
        walls = scene.confinement
        table = walls and _typed_table(walls, CONFINEMENTS, arrays, "", "confinement")
        said["confinement"] = _digest(table, *arrays.values())
    for k, stage in enumerate(scene.stages):
        with suppress(ValueError, TypeError):
            said[f"stages[{k}]"] = _digest(stage_table(stage, physics_said))
    return {"physics": physics_table(scene.physics), "numerics": numerics, "scene": said}


def _digest(table: Any, *arrays: np.ndarray) -> str:
    """Text that is another one if any value is."""
    found = sha256(json.dumps(plain(table), sort_keys=True).encode())
    for array in arrays:
        found.update(np.ascontiguousarray(array).tobytes())
    return found.hexdigest()[:16]
