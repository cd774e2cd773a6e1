"""The end of a stage of a saved run, as the quality control looks at it."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from morphosim.importers.lineage import celegans_contact_areas

if TYPE_CHECKING:
    import xarray as xr

    from morphosim.cell_field import CellField


@dataclass(frozen=True)
class StageEnd:
    """The saves of one stage; `places` are their numbers in the run."""

    run: "xr.Dataset"
    places: NDArray[np.int64]

    @property
    def time(self) -> float:
        """Time that the stage has lasted for, from the save before it."""
        times = self.run["time"].values
        return float(times[self.places[-1]] - times[max(self.places[0] - 1, 0)])

    def centroids(self, names: Sequence[str], place: int = -1) -> NDArray[np.float64]:
        """Centroids (N, 3), µm, at the stage's end or at another of its saves."""
        order = [list(self.run["cell"].values).index(name) for name in names]
        return np.asarray(self.run["centroid"][self.places[place]].values[order])

    def missing(self, names: Sequence[str]) -> list[str]:
        """Those of these cells that are not there at the stage's end."""
        known = set(self.run["cell"].values)
        return [n for n in names if n not in known or np.isnan(self.centroids([n])).any()]

    def fields(self) -> "list[CellField]":
        """Fields of all cells at the stage's end."""
        from morphosim.runs.saved_fields import load_fields

        return load_fields(self.run, int(self.places[-1]))

    def area(self, pair: tuple[str, str]) -> float:
        """Contact area of a pair, µm²."""
        areas = self.run["contact_area"][self.places[-1]]
        return float(areas.sel(cell=pair[0], neighbour=pair[1]))

    def voxel_area(self, pair: tuple[str, str]) -> float:
        """Contact area of a pair as microscopy measures it, µm²."""
        return self._voxel_areas.get(frozenset(pair), 0.0)

    @cached_property
    def _voxel_areas(self) -> dict[frozenset[str], float]:
        from morphosim.measure.voxel_contacts import voxel_contact_areas

        areas = voxel_contact_areas(self.fields(), self.run.attrs["spacing_um"])
        return {frozenset(pair): area for pair, area in areas.items()}

    def differences(self) -> dict[str, float]:
        """(S_sim - S_exp) / S_exp of the five contacts of four cells, by "cell-cell"."""
        wanted = celegans_contact_areas()
        return {"-".join(p): self.area(p) / area - 1 for p, area in wanted.items()}
