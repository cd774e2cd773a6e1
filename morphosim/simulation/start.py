"""Fields of the cells at the start of a scene."""

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from morphosim.geometry.phase_field import lattice_field, share_outside
from morphosim.scene.cell import Cell
from morphosim.scene.scene import Scene

OUTSIDE_ALLOWED = 0.5
"""A cell may start with at most this share of its volume beyond the confinement."""


def cell_columns(cells: Sequence[Cell]) -> dict[str, Any]:
    """What the cells of a scene start with, by column of the cell table."""
    return {
        "name": [cell.name for cell in cells],
        "parent": [cell.parent for cell in cells],
        "own_tension": [np.nan if cell.gamma is None else cell.gamma for cell in cells],
        "frozen": [cell.frozen for cell in cells],
        "target": [cell.target_volume(0.0) for cell in cells],
    }


class StartFields:
    """Origin and field of each of some cells of a scene, made while they are iterated over.

    Attributes
    ----------
    outside : float
        Largest share of ∫ φ beyond the confinement of those made so far, frozen cells left out: see
        `stability.start_rate`.

    Raises
    ------
    ValueError
        A cell starts outside of the confinement, or is too small for the lattice.
    """

    def __init__(self, scene: Scene, cells: Iterable[Cell]) -> None:
        self.outside = 0.0
        self._scene, self._cells = scene, cells

    def __iter__(self) -> Iterator[tuple[NDArray[np.int64], NDArray[np.floating]]]:
        scene = self._scene
        scale, spacing = scene.physics.interface_scale, scene.numerics.spacing
        for cell in self._cells:
            origin, phi = lattice_field(cell.shape, cell.name, scale, spacing, cell.start_volume)
            outside = share_outside(scene.confinement, origin, phi, spacing)
            _check_inside(cell, outside)
            if not cell.frozen:
                self.outside = max(self.outside, outside)
            yield origin, phi


def _check_inside(cell: Cell, outside: float) -> None:
    """Raise ValueError if most of a cell lies beyond the confinement."""
    if outside > OUTSIDE_ALLOWED:
        message = (
            f"cell {cell.name!r} starts with {100 * outside:.0f} % of its volume outside of the "
            f"confinement; at most {100 * OUTSIDE_ALLOWED:.0f} % is allowed. Move the cell, or "
            "enlarge the confinement"
        )
        raise ValueError(message)
