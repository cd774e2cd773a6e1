"""A simulation at one time, whole: all that its next step depends on besides the scene."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from morphosim._files import guarded, replacing

FORMAT = 1
"""Version of the file; others are refused."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Snapshot:
    """State of a simulation.

    Attributes
    ----------
    names : names of the cells that are alive, in the order of the arrays
    steps : steps taken
    fresh : whether the next step has no history
    stage : stage of the protocol
    removed : (time, name) of cells that vanished and were taken out
    settings : physics and numerics, as a scene file says them
    arrays : what `Engine.contents` gives
    """

    names: tuple[str, ...]
    steps: int
    fresh: bool
    stage: str
    removed: tuple[tuple[float, str], ...]
    settings: Mapping[str, Any]
    arrays: Mapping[str, NDArray[Any]]

    def write(self, path: Path) -> None:
        """Write to an .npz file, which appears whole or not at all."""
        facts = {
            "format": FORMAT, "names": self.names, "steps": self.steps, "fresh": self.fresh,
            "stage": self.stage, "removed": self.removed, "settings": self.settings,
        }  # fmt: skip
        with replacing(path) as partial, partial.open("wb") as file:
            np.savez(file, facts=np.array(json.dumps(facts)), **self.arrays)  # type: ignore[arg-type]

    @classmethod
    def read(cls, path: Path) -> "Snapshot":
        """Read what `write` wrote; ValueError if it is damaged or of another version."""
        arrays = guarded(path, lambda: _arrays(path))
        facts = json.loads(str(arrays.pop("facts")))
        if facts.pop("format") != FORMAT:
            message = f"{path} is of another version of the package; go on with that version"
            raise ValueError(message)
        facts["names"] = tuple(facts["names"])
        facts["removed"] = tuple((time, name) for time, name in facts["removed"])
        return cls(**facts, arrays=arrays)


def _arrays(path: Path) -> dict[str, NDArray[Any]]:
    with path.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
        return {name: file[name] for name in file.files}
