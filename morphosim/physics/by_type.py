"""One number for all cells, and others for cells of some types."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from morphosim import _validate
from morphosim.cell_table import CellTable


@dataclass(frozen=True, slots=True)
class ByType:
    """A parameter that may differ between cell types.

    Attributes
    ----------
    name : str
        What errors call it; the other values are `name`_by_type.
    usual : float
    others : mapping from cell type to float
        Values of cells of these types, instead of `usual`.
    """

    name: str
    usual: float
    others: Mapping[str, float]

    def validate(self, **bounds: Any) -> None:
        """Raise ValueError or TypeError unless all are finite numbers within the bounds."""
        _validate.number(self.name, self.usual, **bounds)
        _validate.instance(f"{self.name}_by_type", self.others, Mapping)
        for kind, value in self.others.items():
            _validate.label(f"{self.name}_by_type: type", kind, empty=True)
            _validate.number(f"{self.name}_by_type[{kind!r}]", value, **bounds)

    def check(self, types: Collection[str]) -> None:
        """Raise ValueError if it names a type that is not one of these."""
        for kind in self.others:
            _validate.choice(f"type in {self.name}_by_type", kind, types)

    def among(self, types: Collection[str]) -> dict[str, float]:
        """`others` of these types."""
        return {kind: value for kind, value in self.others.items() if kind in types}

    def of(self, kind: str) -> float:
        """Value of cells of a type."""
        return self.others.get(kind, self.usual)

    def of_each(self, cells: CellTable) -> NDArray[np.float64]:
        """(N,) value of each cell."""
        by_kind = np.array([self.of(kind) for kind in cells.kinds])
        return np.asarray(by_kind[cells["kind"]], np.float64)

    def largest(self, types: Collection[str]) -> float:
        """Largest size of the value among cells of these types."""
        return max(abs(self.of(kind)) for kind in types)

    def smallest(self, types: Collection[str]) -> float:
        """Smallest value of cells of these types."""
        return min(self.of(kind) for kind in types)

    @property
    def acts(self) -> bool:
        """Whether any value is not 0."""
        return self.usual != 0 or any(self.others.values())
