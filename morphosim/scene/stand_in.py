"""A few small cells in place of a scene's own, of which a simulation calls the same kernels.

Nothing here knows a kernel. What decides which kernels are called, and with what, is the scene's
own: the terms that act, how steps are solved, what confines cells. Only the cells are few and grow
fast, and lattice and steps are such that they take next to nothing.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from hashlib import sha256
from typing import Any

import numpy as np
from numpy.typing import NDArray

from morphosim.geometry.confinement import Confinement
from morphosim.geometry.shapes import Sphere
from morphosim.physics.parameters import Physics
from morphosim.scene.cell import Cell
from morphosim.scene.fingerprint import settings
from morphosim.scene.scene import Scene
from morphosim.scene.tables import physics_table

SPACING, DT, RADIUS = 1.0, 0.2, 2.8
"""Of the lattice and the cells, µm, and of steps."""
APART, GROWTH = 1.6, 4.0
"""Distance between neighbours in radii, and target volume in volumes at the start."""
REPEATS = 40
"""Lattice steps after which space repeats, where it does in the scene."""
FEW = 2
"""Cells at least, if the scene has so many."""
GRID, WIDEST = 41, 1000.0
"""Points along each axis, up to so many µm from the origin, of which the deepest is taken."""


@dataclass(frozen=True, slots=True)
class StandIn:
    """A scene of few small cells, and what it shall go through.

    Attributes
    ----------
    scene : Scene
        Without stages.
    daughters : names of two cells into which the first one divides; None if none does
    courses : sequence of Physics
        What holds in turn, after the division.
    ruled : bool
        Whether rules act, which may go by chance.
    """

    scene: Scene
    daughters: tuple[str, str] | None
    courses: Sequence[Physics]
    ruled: bool

    @property
    def digest(self) -> str:
        """The same for the same kernels; "" where forces of a user's own may be other ones."""
        if any(physics.terms for physics in self.courses):
            return ""
        said = settings(self.scene)
        said["cells"] = list(said["cells"].values())
        tables = [physics_table(physics) for physics in self.courses]
        divides = self.daughters is not None
        outline = _outline([said, tables, divides, self.ruled])
        return sha256(repr(outline).encode()).hexdigest()


def stand_in(scene: Scene) -> StandIn:
    """What calls the kernels that a scene calls."""
    courses = scene.courses
    chosen = _chosen(scene)
    names, types = [cell.name for cell in chosen], {cell.type for cell in chosen}
    daughters = _daughters(courses, names) if any(s.divides for s in scene.stages) else None
    small = replace(
        scene, cells=_small(chosen, _deepest(scene.confinement)), stages=(), duration=100.0,
        physics=scene.physics.among(names, types), save_every=100.0, name="", description="",
        period=[REPEATS * SPACING * (length > 0) for length in scene.period],
        numerics=replace(
            scene.numerics, spacing=SPACING, dt=DT, allow_coarse=True, threads=1, seed=0
        ),
    )  # fmt: skip
    alive = [*names[1:], *daughters] if daughters else names
    forms = {_form(physics): physics.among(alive, types) for physics in reversed(courses)}
    ruled = any(stage.rules for stage in scene.stages)
    return StandIn(small, daughters, list(forms.values())[::-1], ruled)


def _chosen(scene: Scene) -> list[Cell]:
    """The first cells, two of those whose pair is named, and one of each kind."""
    stated = scene.physics.attraction.stated
    paired = [cell for cell in scene.cells if cell.name in stated]
    kinds = {(c.type, c.gamma is None, c.frozen): c for c in reversed(scene.cells)}
    chosen = [*scene.cells[:FEW], *paired[:FEW], *list(kinds.values())[:FEW]]
    return list({cell.name: cell for cell in chosen}.values())


def _small(cells: Sequence[Cell], middle: NDArray[np.float64]) -> list[Cell]:
    """These cells as small balls in a row, which grow."""
    places = np.tile(middle, (len(cells), 1))
    places[:, 0] += APART * RADIUS * (np.arange(len(cells)) - (len(cells) - 1) / 2)
    small = []
    for cell, place in zip(cells, places.tolist(), strict=True):
        ball = Sphere(center=place, radius=RADIUS)
        small.append(replace(cell, shape=ball, volume=GROWTH * ball.volume, parent=""))
    return small


def _daughters(courses: Sequence[Physics], names: Sequence[str]) -> tuple[str, str]:
    """Names of two cells that come by division: a pair that is named, if there is one."""
    pairs = (pair for physics in courses for pair in physics.attraction.pairs)
    free = (pair for pair in pairs if not set(pair) & set(names))
    return next(free, ("daughter 1", "daughter 2"))


def _form(physics: Physics) -> tuple[object, ...]:
    """What may decide about kernels: which terms act, and in what ways cells attract."""
    sigma = physics.attraction
    terms = [(type(term), term.point is not None) for term in physics.active_terms]
    return (*terms, bool(sigma.pairs), bool(sigma.types), sigma.sisters is not None)


def _outline(value: Any) -> Any:
    """What is said without its numbers, of which only 0 may decide about kernels, and names."""
    if isinstance(value, Mapping):
        return {key: _outline(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return list(dict.fromkeys(repr(_outline(item)) for item in value))
    return value != 0 if isinstance(value, float) else value


def _deepest(confinement: Confinement | None) -> NDArray[np.float64]:
    """Place that is farthest from the walls of a confinement; without one the origin."""
    if confinement is None:
        return np.zeros(3)
    low, high = (np.clip(corner, -WIDEST, WIDEST) for corner in confinement.bounds())
    axes = [np.linspace(a, b, GRID) for a, b in zip(low, high, strict=True)]
    depth = np.broadcast_to(
        confinement.depth(*np.meshgrid(*axes, indexing="ij", sparse=True)), (GRID,) * 3
    )
    best = np.unravel_index(int(np.argmax(depth)), depth.shape)
    return np.array([axis[k] for axis, k in zip(axes, best, strict=True)])
