"""What the form holds, and the scene that it says."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from morphosim import _validate
from morphosim.app.changes import (
    attraction_matrix,
    changed_attraction,
    renamed,
    retyped,
    with_values,
    without_shell,
)
from morphosim.app.source import Source
from morphosim.app.store import Store
from morphosim.numerics.parameters import OWN_SOLVERS, PRESETS, WALLS, Numerics
from morphosim.scene.cell import Cell, VolumeCourse
from morphosim.scene.scene import Scene
from morphosim.scene.stability import chosen_S

OWN = "as the scene says"
"""The preset that changes nothing."""
PRESET_NAMES = (OWN, *PRESETS)
MANY = 200
"""From so many cells between walls on, a run tells S and the form does not: it depends on how far
they reach into the walls, and to see that takes some 10 ms a cell and preset."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """All that the form says of a run; numbers may be texts, as they were typed.

    What is empty, "" or (), is as the source says it, or as the preset has it.

    Attributes
    ----------
    source : Source
    names : of the cells at the start, in the scene's order
    sigma : rows of the attraction matrix, [j][i] the pull of cell j on cell i
    duration, save_every : *in silico* time
    types, volumes, tensions : of each cell: type, target volume (µm³), surface tension γ
    gamma : surface tension γ of cells that have none of their own
    preset : one of `PRESET_NAMES`
    dt, S, walls : see `Numerics`
    tolerance : see `Numerics`; where it is empty, steps are fixed
    shell : whether the scene's confinement is kept
    name : of the run, a folder to make
    """

    source: Source
    names: Sequence[str]
    sigma: Sequence[Sequence[Any]]
    duration: Any
    save_every: Any
    types: Sequence[str] = ()
    volumes: Sequence[Any] = ()
    tensions: Sequence[Any] = ()
    gamma: Any = ""
    preset: str = OWN
    dt: Any = ""
    tolerance: Any = ""
    S: Any = ""
    walls: str = ""
    shell: bool = True
    name: str = "run"

    def scene(self, store: Store) -> Scene:
        """Scene to simulate.

        Raises
        ------
        ValueError, OSError, ImportError
            As the engine words them.
        """
        original = self.source.read(store)
        scene = self._with_cells(original)
        scene = scene.with_physics(sigma=changed_attraction(scene, self._matrix(scene.names)))
        scene = replace(
            scene,
            numerics=self._numerics(original.numerics),
            duration=_validate.parsed_number("time", self.duration, above=0),
            save_every=_validate.parsed_number("saving interval", self.save_every, above=0),
            name=self.name,
        )
        return scene if self.shell else without_shell(scene)

    def _with_cells(self, scene: Scene) -> Scene:
        """Scene with the names, types, target volumes and tensions of the form."""
        scene = renamed(scene, [str(name).strip() for name in self.names])
        if self.types:
            scene = retyped(scene, [str(kind).strip() for kind in self.types])
        for key, entries in (("volume", self.volumes), ("gamma", self.tensions)):
            scene = with_values(scene, key, entries) if entries else scene
        if _is_empty(self.gamma):
            return scene
        gamma = _validate.parsed_number("surface tension γ", self.gamma, above=0)
        return scene.with_physics(gamma=gamma)

    def _matrix(self, names: Sequence[str]) -> NDArray[np.float64]:
        """Attraction matrix as numbers; the diagonal is 0."""
        if [len(row) for row in self.sigma] != [len(names)] * len(names):
            message = f"the attraction matrix does not have {len(names)} rows and columns"
            raise ValueError(message)
        matrix = np.zeros((len(names), len(names)))
        for j, row in enumerate(self.sigma):
            for i, entry in enumerate(row):
                if i != j:
                    what = f"attraction from {names[j]!r} to {names[i]!r}"
                    matrix[j, i] = _validate.parsed_number(what, entry, least=0)
        return matrix

    def _numerics(self, own: Numerics) -> Numerics:
        """Numerics of the preset, with what is given besides."""
        _validate.choice("preset", self.preset, PRESET_NAMES)
        given: dict[str, Any] = {"tolerance": None}
        if not _is_empty(self.tolerance):
            given["tolerance"] = _validate.parsed_number("tolerance", self.tolerance, above=0)
        if not _is_empty(self.dt):
            given["dt"] = _validate.parsed_number("time step δt", self.dt, above=0)
        if not _is_empty(self.S):
            given["S"] = _validate.parsed_number("S", self.S, least=0)
        if self.walls:
            _validate.choice("walls", self.walls, WALLS)
            given["walls"] = self.walls
        return replace(preset_numerics(self.preset, own), **given)


def _is_empty(entry: Any) -> bool:
    return str(entry).strip() == ""


def preset_numerics(preset: str, own: Numerics) -> Numerics:
    """Numerics of a preset of the form, for a scene that has its `own`."""
    if preset == OWN:
        return own
    return Numerics.preset(preset, threads=own.threads, seed=own.seed)


def preset_of(numerics: Numerics) -> str:
    """Name of the preset that has these numerics, on whatever lattice; "" if none has."""
    kept = {key: getattr(numerics, key) for key in ("spacing", "threads", "seed")}
    found = (name for name in PRESETS if Numerics(**(PRESETS[name] | kept)) == numerics)
    return next(found, "")


def with_preset(scene: Scene, preset: str) -> Scene:
    """Scene with a preset as the form would give it."""
    return replace(scene, numerics=preset_numerics(preset, scene.numerics))


def facts(scene: Scene, rough: bool = False) -> dict[str, Any]:
    """What the form shows of a scene, whose target volumes may be `rough` ones of a quick look."""
    return {
        "name": scene.name,
        "description": scene.description,
        "cells": [_cell_facts(cell, rough) for cell in scene.cells],
        "sigma": np.round(attraction_matrix(scene), 9).tolist(),
        "gamma": exact(scene.physics.gamma),
        "duration": exact(scene.duration),
        "save_every": exact(scene.save_every),
        "numerics": {name: _numerics_facts(scene, name) for name in PRESET_NAMES},
        "has_shell": scene.confinement is not None,
        "stages": [stage.name for stage in scene.stages],
    }


def _cell_facts(cell: Cell, rough: bool) -> dict[str, str]:
    """Entries of a cell in the form, and what its empty ones mean."""
    volume = f"{'≈ ' if rough else ''}{cell.target_volume(0.0):.1f}"
    if isinstance(cell.volume, VolumeCourse):
        volume += f" … {cell.volume.volumes[-1]:.1f}"
    elif callable(cell.volume):
        volume += " …"
    gamma = "" if cell.gamma is None else exact(cell.gamma)
    return {
        "name": cell.name, "type": cell.type, "volume": "", "gamma": "",
        "own_volume": volume, "own_gamma": gamma,
    }  # fmt: skip


def _numerics_facts(scene: Scene, preset: str) -> dict[str, str]:
    """What a preset means for a scene; `text` in one line."""
    numerics = preset_numerics(preset, scene.numerics)
    solver = "" if numerics.scheme in OWN_SOLVERS else f"solver {numerics.solver}"
    tolerance = "" if numerics.tolerance is None else exact(numerics.tolerance)
    found = {
        "dt": exact(numerics.dt), "tolerance": tolerance, "S": S_text(scene, numerics),
        "walls": numerics.walls,
    }  # fmt: skip
    parts = [
        f"scheme {numerics.scheme}", solver, f"lattice {numerics.spacing:.3g} µm",
        numerics.step_text, f"S = {found['S']}",
        f"{numerics.walls} walls",
    ]  # fmt: skip
    return found | {"text": " · ".join(part for part in parts if part)}


def S_text(scene: Scene, numerics: Numerics) -> str:
    """S that a scene has with these numerics."""
    if numerics.S is not None:
        return exact(numerics.S)
    if scene.confinement is not None and len(scene.cells) >= MANY:
        return "chosen"
    try:
        return f"{chosen_S(replace(scene, numerics=numerics)):.2g} (chosen)"
    except ValueError:  # this lattice does not resolve a cell; a run with it says so
        return "chosen"


def exact(value: float) -> str:
    """Shortest text that says a number, and that alone."""
    return repr(float(value)).removesuffix(".0")
