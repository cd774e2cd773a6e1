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


def start_fields(
    scene: Scene, cells: Iterable[Cell]
) -> Iterator[tuple[NDArray[np.int64], NDArray[np.floating]]]:
    """Origin and field of each of these cells of a scene, one after the other.

    Raises
    ------
    ValueError
        A cell starts outside of the confinement, or is too small for the lattice.
    """
    scale, spacing = scene.physics.interface_scale, scene.numerics.spacing
    for cell in cells:
        origin, phi = lattice_field(cell.shape, cell.name, scale, spacing, cell.start_volume)
        _check_inside(cell, share_outside(scene.confinement, origin, phi, spacing))
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
