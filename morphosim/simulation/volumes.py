"""Target volumes that are functions of time."""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from morphosim import _validate
from morphosim.cell_table import CellTable
from morphosim.scene.cell import VolumeCourse, VolumeFunction, volume_at
from morphosim.scene.values import build, dataclass_table


class VolumeFunctions:
    """V(t) of the cells whose target volume is a function; others cost nothing.

    Parameters
    ----------
    functions : by name of the cell
    """

    def __init__(self, functions: Mapping[str, VolumeFunction]) -> None:
        self._functions = dict(functions)

    @property
    def functions(self) -> dict[str, VolumeFunction]:
        """Functions by name of the cell."""
        return dict(self._functions)

    def get(self, name: str) -> VolumeFunction | None:
        """Function of a cell, if it has one."""
        return self._functions.get(name)

    def set(self, name: str, volume: float | VolumeFunction) -> None:
        """Take over a cell's new target volume."""
        if callable(volume):
            self._functions[name] = volume
        else:
            self.forget([name])

    def forget(self, names: Iterable[str]) -> None:
        """Drop the functions of cells."""
        for name in names:
            self._functions.pop(name, None)

    def fill(self, targets: NDArray[np.float64], cells: CellTable, time: float) -> None:
        """Set those of the target volumes (N,) of all cells that are functions.

        Raises
        ------
        ValueError
            A function gives a volume that is not positive and finite.
        """
        if self._functions:
            targets[cells.rows(self._functions)] = [
                volume_at(name, function, time) for name, function in self._functions.items()
            ]

    def said(self) -> dict[str, dict[str, Any] | None]:
        """What a checkpoint says of them."""
        return {
            name: dataclass_table(function) if isinstance(function, VolumeCourse) else None
            for name, function in self._functions.items()
        }

    @classmethod
    def of(cls, said: Mapping[str, Any], known: Mapping[str, VolumeFunction]) -> "VolumeFunctions":
        """Functions that a checkpoint says; those that no file can say are looked up in `known`."""
        functions: dict[str, VolumeFunction] = {}
        for name, table in said.items():
            if table is not None:
                functions[name] = build(VolumeCourse, table, f"cell {name!r}: volume")
            else:
                _validate.choice(
                    "cell of the saved state, whose volume is a function,", name, known
                )
                functions[name] = known[name]
        return cls(functions)
