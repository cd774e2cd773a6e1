"""What the form holds, and the scene that it says."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from morphosim import _validate
from morphosim.app.store import Store
from morphosim.geometry.phase_field import lattice_field
from morphosim.geometry.shapes import Field, PowerCell
from morphosim.importers.matlab.name_table import NameTable, read_name_table
from morphosim.library.built_in import built_in_scene
from morphosim.numerics.parameters import PRESETS, Numerics
from morphosim.physics.attraction import Attraction
from morphosim.scene.scene import Scene
from morphosim.scene.stability import stabilised

KINDS = ("built-in", "matlab", "labels")
OWN = "as the scene says"
"""The preset that changes nothing."""
PRESET_NAMES = (OWN, *PRESETS)
IMPORTED_DURATION, IMPORTED_SAVE_EVERY = 15000.0, 500.0
"""What the form proposes for imported cells: the published example's time, 30 saves."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Source:
    """Where a scene comes from; files are named as below the folder, "" is none.

    Attributes
    ----------
    kind : {"built-in", "matlab", "labels"}
    scene : name of a built-in scene
    masks, table, shell : files of the published program, see `import_matlab`; without `shell` its
        eggshell is taken
    image : label image, see `import_labels`; with `table`, whose names are those of its labels in
        rising order
    spacing : voxel in µm, one number or three; "" where the image says it
    """

    kind: str = "built-in"
    scene: str = "celegans-8"
    masks: str = ""
    table: str = ""
    shell: str = ""
    image: str = ""
    spacing: str = ""

    def read(self, store: Store, volumes: str = "surface") -> Scene:
        """Scene as it is there, before anything is changed.

        Parameters
        ----------
        store : Store
        volumes : target volumes of cells of a label image, see `import_labels`: to look at the
            scene "ball" is there at once, to run it "surface" is right

        Raises
        ------
        ValueError, OSError, ImportError
            As the engine's readers word them; or a file that is needed is not chosen.
        """
        _validate.choice("source", self.kind, KINDS)
        if self.kind == "built-in":
            return built_in_scene(self.scene)
        scene = self._of_masks(store) if self.kind == "matlab" else self._of_labels(store, volumes)
        return replace(scene, duration=IMPORTED_DURATION, save_every=IMPORTED_SAVE_EVERY)

    def _of_masks(self, store: Store) -> Scene:
        from morphosim.importers.matlab.scene import import_matlab

        return import_matlab(
            store.path(_chosen("file of masks (.mat)", self.masks)),
            store.path(_chosen("table of names and attraction", self.table)),
            shell=store.path(self.shell) if self.shell else None,
            spacing=float(_spacing(self.spacing or "0.5", 1)[0]),
        )

    def _of_labels(self, store: Store, volumes: str) -> Scene:
        from morphosim.importers.labels.scene import import_labels

        image = store.path(_chosen("label image (.tif)", self.image))
        spacing = _spacing(self.spacing, 1, 3) if self.spacing.strip() else None
        if spacing is not None and len(spacing) == 1:
            spacing = np.repeat(spacing, 3)
        scene = import_labels(image, spacing=spacing, confinement="image", volumes=volumes)
        if not self.table:
            return scene
        return _with_table(scene, read_name_table(store.path(self.table)), self.table)


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """All that the form says of a run; numbers may be texts, as they were typed.

    Attributes
    ----------
    source : Source
    names : of the cells at the start, in the scene's order
    sigma : rows of the attraction matrix, [j][i] the pull of cell j on cell i
    duration, save_every, dt : *in silico* time
    preset : one of `PRESET_NAMES`
    shell : whether the scene's confinement is kept
    name : of the run, a folder to make
    """

    source: Source
    names: Sequence[str]
    sigma: Sequence[Sequence[Any]]
    duration: Any
    save_every: Any
    dt: Any
    preset: str = OWN
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
        scene = _renamed(original, [str(name).strip() for name in self.names])
        sigma = changed_attraction(scene, self._matrix(scene.names))
        numerics = self._numerics(scene.numerics)
        scene = replace(
            scene.with_physics(sigma=sigma),
            numerics=numerics,
            duration=_validate.parsed_number("time", self.duration, above=0),
            save_every=_validate.parsed_number("saving interval", self.save_every, above=0),
            name=self.name,
        )
        if not self.shell:
            return without_shell(scene)
        return scene if numerics == original.numerics else stabilised(scene)

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
        _validate.choice("preset", self.preset, PRESET_NAMES)
        dt = _validate.parsed_number("time step δt", self.dt, above=0)
        if self.preset == OWN:
            return replace(own, dt=dt)
        return Numerics.preset(self.preset, threads=own.threads, seed=own.seed, dt=dt)


def facts(scene: Scene) -> dict[str, Any]:
    """What the form shows of a scene."""
    sigma = scene.physics.attraction.matrix(scene.names, scene.types, scene.parents)
    return {
        "name": scene.name,
        "description": scene.description,
        "cells": [
            {"name": c.name, "type": c.type, "volume": round(c.target_volume(0.0), 1)}
            for c in scene.cells
        ],
        "sigma": np.round(sigma, 9).tolist(),
        "duration": scene.duration,
        "save_every": scene.save_every,
        "dt": scene.numerics.dt,
        "dts": {OWN: scene.numerics.dt} | {n: Numerics.preset(n).dt for n in PRESETS},
        "has_shell": scene.confinement is not None,
        "stages": [stage.name for stage in scene.stages],
    }


def changed_attraction(scene: Scene, matrix: NDArray[np.float64]) -> Attraction:
    """Attraction of a scene, in which those pairs are stated whose σ differs from the matrix.

    What holds by type and for sisters goes on to hold for all others, and for cells to come.
    """
    attraction = scene.physics.attraction
    before = attraction.matrix(scene.names, scene.types, scene.parents)
    pairs = dict(attraction.pairs)
    for j, i in np.argwhere(~np.isclose(matrix, before, rtol=0, atol=1e-9)).tolist():
        for a, b in ((j, i), (i, j)):  # one order alone would hold for both
            pairs[scene.names[a], scene.names[b]] = float(matrix[a, b])
    return replace(attraction, pairs=pairs)


def without_shell(scene: Scene) -> Scene:
    """Scene in open space, whose cells start as they do within the shell.

    Cells that divide the shell among themselves would have another start without it.
    """
    spacing, scale = scene.numerics.spacing, scene.physics.interface_scale
    cells = list(scene.cells)
    for k, cell in enumerate(cells):
        if isinstance(cell.shape, PowerCell):
            origin, phi = lattice_field(cell.shape, cell.name, scale, spacing)
            field = Field(phi=phi, origin=origin * spacing, spacing=spacing)
            cells[k] = replace(cell, shape=field, volume=cell.volume or cell.shape.volume)
    return replace(scene, cells=cells, confinement=None)


def _chosen(what: str, name: str) -> str:
    if not name:
        message = f"no {what} is chosen; choose or upload one"
        raise ValueError(message)
    return name


def _spacing(text: str, *counts: int) -> NDArray[np.float64]:
    """Numbers of a text, one or three."""
    entries = re.split(r"[\s,;x×]+", text.strip())
    if len(entries) not in counts:
        message = f"voxel = {text!r}; expected {' or '.join(map(str, counts))} numbers in µm"
        raise ValueError(message)
    return np.array([_validate.parsed_number("voxel", entry, above=0) for entry in entries])


def _with_table(scene: Scene, table: NameTable, where: str) -> Scene:
    """Scene whose cells have the names, attraction and volumes of a table, in its order."""
    if len(table.names) != len(scene.cells):
        message = (
            f"{where} has {len(table.names)} names, but the image has {len(scene.cells)} labels; "
            "expected one name for each label, in rising order"
        )
        raise ValueError(message)
    cells = [
        replace(cell, name=name, volume=table.volumes.get(name, cell.volume))
        for cell, name in zip(scene.cells, table.names, strict=True)
    ]
    sigma = Attraction.from_matrix(table.names, table.sigma)
    return replace(scene, cells=cells, physics=replace(scene.physics, sigma=sigma))


def _renamed(scene: Scene, names: Sequence[str]) -> Scene:
    """Scene whose cells have other names, in the scene's order."""
    if len(names) != len(scene.cells):
        message = f"{len(names)} names for {len(scene.cells)} cells; expected one for each"
        raise ValueError(message)
    if names == scene.names:
        return scene
    _validate.unique("cell name", names)
    if scene.stages:
        message = (
            f"names of scene {scene.name!r} cannot be changed: its stages tell cells by name; "
            "leave them as they are"
        )
        raise ValueError(message)
    new = dict(zip(scene.names, names, strict=True))
    attraction = scene.physics.attraction
    pairs = {(new[j], new[i]): value for (j, i), value in attraction.pairs.items()}
    cells = [
        replace(cell, name=new[cell.name], parent=new.get(cell.parent, cell.parent))
        for cell in scene.cells
    ]
    physics = replace(scene.physics, sigma=replace(attraction, pairs=pairs))
    return replace(scene, cells=cells, physics=physics)
