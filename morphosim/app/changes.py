"""What the form changes of a scene; whatever it does not touch stays as it is."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from morphosim import _validate
from morphosim.geometry.phase_field import lattice_field
from morphosim.geometry.shapes import Field, PowerCell
from morphosim.physics.attraction import Attraction
from morphosim.scene.scene import Scene


def renamed(scene: Scene, names: Sequence[str]) -> Scene:
    """Scene whose cells have other names, in the scene's order."""
    _check_count("names", names, scene)
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


def retyped(scene: Scene, types: Sequence[str]) -> Scene:
    """Scene whose cells have other types, and whose physics say nothing of types that are gone."""
    _check_count("types", types, scene)
    if list(types) == scene.types:
        return scene
    cells = [replace(cell, type=kind) for cell, kind in zip(scene.cells, types, strict=True)]
    known = {*types, *(kind for stage in scene.stages for kind in stage.makes)}
    physics = scene.physics.among(scene.possible_names, known)
    return replace(scene, cells=cells, physics=physics)


def with_values(scene: Scene, key: str, entries: Sequence[Any]) -> Scene:
    """Scene whose cells have other target volumes ("volume") or tensions ("gamma").

    An empty entry is that of the scene, which may be a function of time.
    """
    _check_count(f"values of {key}", entries, scene)
    cells = list(scene.cells)
    for k, entry in enumerate(entries):
        if str(entry).strip():
            name = f"cell {cells[k].name!r}: {key}"
            value: Any = _validate.parsed_number(name, entry, above=0)
            cells[k] = replace(cells[k], **{key: value})
    return replace(scene, cells=cells)


def _check_count(what: str, entries: Sequence[Any], scene: Scene) -> None:
    if len(entries) != len(scene.cells):
        message = f"{len(entries)} {what} for {len(scene.cells)} cells; expected one for each"
        raise ValueError(message)


def attraction_matrix(scene: Scene, types: Sequence[str] | None = None) -> NDArray[np.float64]:
    """Attraction σ[j, i] of the cells of a scene, perhaps if they had other types."""
    kinds = scene.types if types is None else types
    return scene.physics.attraction.matrix(scene.names, kinds, scene.parents)


def changed_attraction(scene: Scene, matrix: NDArray[np.float64]) -> Attraction:
    """Attraction of a scene, in which those pairs are stated whose σ differs from the matrix.

    What holds by type and for sisters goes on to hold for all others, and for cells to come.
    """
    attraction = scene.physics.attraction
    pairs = dict(attraction.pairs)
    changed = ~np.isclose(matrix, attraction_matrix(scene), rtol=0, atol=1e-9)
    for j, i in np.argwhere(changed).tolist():
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
