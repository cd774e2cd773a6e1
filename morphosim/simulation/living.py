"""The cells that are alive, as a simulation shows them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import overload

import numpy as np

from morphosim._shown import listed
from morphosim.cell_table import CellTable
from morphosim.scene.cell import VolumeFunction, volume_at
from morphosim.simulation.volumes import VolumeFunctions


@dataclass(frozen=True, slots=True, kw_only=True)
class LivingCell:
    """A cell at the present time.

    Attributes
    ----------
    name, type, parent : str
        See `Cell`.
    gamma : float or None
        Its own surface tension; None where it has that of the physics.
    frozen : bool
    volume : float or function of time
        Target volume, µm³.
    """

    name: str
    type: str
    parent: str
    gamma: float | None
    frozen: bool
    volume: float | VolumeFunction

    def target_volume(self, time: float) -> float:
        """V(t) in µm³."""
        return volume_at(self.name, self.volume, time)


class LivingCells(Sequence[LivingCell]):
    """All of them, each made when it is looked at."""

    def __init__(
        self, cells: CellTable, volumes: VolumeFunctions, target: Callable[[int], float]
    ) -> None:
        self._cells, self._volumes, self._target = cells, volumes, target

    def __repr__(self) -> str:
        return f"<{len(self)} living: {listed(self._cells.names)}>"

    def __len__(self) -> int:
        return len(self._cells)

    @overload
    def __getitem__(self, i: int) -> LivingCell: ...
    @overload
    def __getitem__(self, i: slice) -> Sequence[LivingCell]: ...
    def __getitem__(self, i: int | slice) -> LivingCell | Sequence[LivingCell]:
        if isinstance(i, slice):
            return [self[k] for k in range(len(self))[i]]
        row, cells = range(len(self))[i], self._cells
        name, own = cells["name"][row], float(cells["own_tension"][row])
        function = self._volumes.get(name)
        return LivingCell(
            name=name,
            type=cells.kinds[cells["kind"][row]],
            parent=cells["parent"][row],
            gamma=None if np.isnan(own) else own,
            frozen=bool(cells["frozen"][row]),
            volume=self._target(row) if function is None else function,
        )
