"""Cells that a scene file says as a whole: the table `[cells]` in place of a list of cells.

Another kind is a dataclass with `cells(confinement, seed)` and a row of `POPULATIONS`.
"""

from collections.abc import Sequence
from typing import Any, Protocol

from morphosim.geometry.confinement import Confinement
from morphosim.scene.cell import Cell
from morphosim.scene.columnar_layer import ColumnarLayer
from morphosim.scene.random_packing import Aggregate


class Population(Protocol):
    """What a scene file needs to know of a population."""

    def cells(self, confinement: Confinement | None, seed: int) -> Sequence[Cell]:
        """Cells within a confinement; `seed` is that of the scene's numerics."""


POPULATIONS: dict[str, type[Any]] = {"aggregate": Aggregate, "columns": ColumnarLayer}
"""Classes by the `kind` that a scene file names them by."""
