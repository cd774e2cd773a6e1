"""The tree of a lineage, and what a simulation asks it."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from morphosim import _validate
from morphosim._shown import short_repr

Vector = tuple[float, float, float]
AXES = ("table", "measured")
"""Where the axis of a division may come from."""


class Split(NamedTuple):
    """How a cell divides."""

    axis: NDArray[np.float64]
    """Unit vector (3,) from the second daughter to the first."""
    fraction: float
    """Share of the mother's volume that the first daughter gets."""
    daughters: tuple[str, str]


@dataclass(frozen=True, slots=True, kw_only=True)
class LineageCell:
    """One row of a lineage table; what only a dividing cell has is None in others."""

    name: str
    parent: str | None
    """None for a cell that the lineage starts with."""
    founder: str
    generation: int
    """Number of divisions since the founder."""
    volume: float
    """Volume for a simulation, µm³: daughters add up to their mother."""
    stated_volume: float | None
    """Volume as the table states it, µm³."""
    daughters: tuple[str, ...] = ()
    """Two names, or none if the cell does not divide."""
    group: int | None = None
    """Number of the group that it divides with."""
    fraction: float | None = None
    axis: Vector | None = None
    """Unit vector from the second daughter to the first, by the table."""
    measured_axis: Vector | None = None
    """The same, as measured."""
    measured_n: int | None = None
    """Number of embryos measured."""
    measured_r: float | None = None
    """How far they agree: length of the mean of their unit vectors, at most 1."""
    division_min: float | None = None
    """Time at which it divides, minutes."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DivisionGroup:
    """Cells that divide together."""

    number: int
    mothers: tuple[str, ...]
    founder: str | None
    """Founder of the mothers; None if they have several."""
    cells_after: int
    """Number of cells of the embryo after this division."""
    time: float | None
    """Time of the division, minutes (see `Lineage.groups`); None if the table has no times."""

    __repr__ = short_repr


@dataclass(frozen=True, slots=True, kw_only=True)
class Lineage:
    """Cells by name, in the order of their table; `read_lineage` makes and checks it."""

    cells: Mapping[str, LineageCell]
    division_groups: tuple[DivisionGroup, ...]

    __repr__ = short_repr

    @property
    def roots(self) -> list[str]:
        """Cells that the lineage starts with."""
        return [cell.name for cell in self.cells.values() if cell.parent is None]

    def cell(self, name: str) -> LineageCell:
        """All that is known of a cell; ValueError if there is none of this name."""
        _validate.choice("cell of the lineage", name, self.cells)
        return self.cells[name]

    def volume(self, name: str) -> float:
        """Volume for a simulation, µm³.

        It is the volume of the first cell, shared down the tree by the fraction of each division,
        so that daughters add up to their mother and have the ratio of the volumes stated.
        """
        return self.cell(name).volume

    def founder(self, name: str) -> str:
        """Founder of a cell: one of the table, or else the cell that the lineage starts with."""
        return self.cell(name).founder

    def division(self, name: str, axis: Literal["table", "measured"] = "table") -> Split:
        """How a cell divides.

        Parameters
        ----------
        name
            The mother.
        axis
            "table": the columns `axis_x`, `axis_y` and `axis_z`; "measured": `measured_axis_x`,
            and so on.

        Raises
        ------
        ValueError
            There is no such cell, it does not divide, or it has no axis of this kind.
        """
        _validate.choice("axis", axis, AXES)
        cell = self.cell(name)
        if len(cell.daughters) != 2 or cell.fraction is None:
            message = f"cell {name!r} does not divide in this lineage; see Lineage.groups()"
            raise ValueError(message)
        vector = cell.axis if axis == "table" else cell.measured_axis
        if vector is None:
            message = f"cell {name!r} has no {axis} axis; try the other of {', '.join(AXES)}"
            raise ValueError(message)
        first, second = cell.daughters
        return Split(np.array(vector), cell.fraction, (first, second))

    def groups(self) -> list[DivisionGroup]:
        """Divisions in their order.

        The time of a group follows the paper's rule: the shortest cell cycle of its cells, after
        the division of the group their mothers are in.
        """
        return list(self.division_groups)

    def descendants(self, name: str) -> list[str]:
        """All cells that come of a cell, generation by generation, without itself."""
        found = list(self.cell(name).daughters)
        for daughter in found:  # grows while it is walked
            found.extend(self.cells[daughter].daughters)
        return found
