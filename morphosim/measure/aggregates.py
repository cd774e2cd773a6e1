"""How cells hang together and how their types sort: figures of whole aggregates."""

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from morphosim.measure.measurement import Measurement
from morphosim.measure.variable import PER_CELL, PER_TIME, measured

Real = NDArray[np.float64]
Integers = NDArray[np.int64]


class Aggregates:
    """Aggregates of N cells: cells in contact, and those in contact with these.

    Parameters
    ----------
    cells : Measurement
        Of these cells.
    types : sequence of N texts
        Their types.
    """

    def __init__(self, cells: Measurement, types: Sequence[str]) -> None:
        self.cells, self.types = cells, types

    @measured(dims=PER_CELL, units="1", text="number of the cell's aggregate, 0 the largest")
    def aggregate(self) -> Integers:
        """(N,) number of each cell's aggregate; 0 is the one of most cells, then by size."""
        return _components(len(self.types), self.cells.contacts)

    @measured(dims=PER_CELL, units="um", text="distance from the centre of the cell's aggregate")
    def radial_position(self) -> Real:
        """(N,) distance of a cell's centroid from its aggregate's centre of mass, µm."""
        centres = _centres(self.cells, self.aggregate)
        return np.asarray(np.linalg.norm(self.cells.centroid - centres[self.aggregate], axis=1))

    @measured(dims=PER_TIME, units="1", text="number of aggregates of cells in contact", kind="i4")
    def n_aggregates(self) -> int:
        """Number of aggregates."""
        return len(self._sizes)

    @measured(dims=PER_TIME, units="1", text="number of cells without contact", kind="i4")
    def single_cells(self) -> int:
        """Number of single cells among them."""
        return int(np.count_nonzero(self._sizes == 1))

    @measured(dims=PER_TIME, units="1", text="number of cells of the largest aggregate", kind="i4")
    def largest_aggregate(self) -> int:
        """Number of cells of the largest."""
        return int(self._sizes[0])

    @measured(
        dims=PER_TIME, units="1",
        text="share of the contacts that are between cells of the same type",
    )  # fmt: skip
    def sorting_index(self) -> float:
        """Share of the contacts that are between cells of the same type; NaN without contacts."""
        kinds = np.asarray(self.types)[self.cells.contacts]
        return float((kinds[:, 0] == kinds[:, 1]).mean()) if len(kinds) else np.nan

    @measured(dims=PER_TIME, units="um", text="radius of gyration of the largest aggregate")
    def radius_of_gyration(self) -> float:
        """Radius of gyration of the largest, µm; √(3/5) R for a ball of radius R."""
        return float(np.sqrt((self._semi_axes**2).sum() / 5))

    @measured(
        dims=PER_TIME, units="1",
        text="shortest over longest semi-axis of the largest aggregate",
    )  # fmt: skip
    def roundness(self) -> float:
        """Shortest over longest semi-axis of the ellipsoid of the largest one's second moments.

        1 for a ball, 0.55 for half of one.
        """
        with np.errstate(invalid="ignore", divide="ignore"):
            return float(self._semi_axes[0] / self._semi_axes[-1])

    @measured(
        dims=PER_TIME, units="1",
        text="surface of a ball of the largest aggregate's volume over its exposed surface",
    )  # fmt: skip
    def aggregate_sphericity(self) -> float:
        """Surface of a ball of the largest one's volume over its exposed surface.

        Cells that bulge out make it less than 1.
        """
        volume = self.cells.enclosed_volume[self._largest].sum()
        exposed = self.cells.exposed_fraction * self.cells.surface_area
        with np.errstate(invalid="ignore", divide="ignore"):
            ball = np.pi ** (1 / 3) * (6 * volume) ** (2 / 3)
            return float(ball / exposed[self._largest].sum())

    @cached_property
    def _sizes(self) -> Integers:
        """Cells of each aggregate."""
        return np.bincount(self.aggregate)

    @cached_property
    def _largest(self) -> NDArray[np.bool_]:
        """(N,) whether a cell is of the largest."""
        return np.asarray(self.aggregate == 0)

    @cached_property
    def _semi_axes(self) -> Real:
        """(3,) semi-axes of the largest, the shortest first, µm."""
        return _semi_axes(self.cells, self._largest)


def _components(count: int, contacts: Integers) -> Integers:
    """Number of each cell's aggregate, in the order of size, then of its first cell."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    graph = coo_array((np.ones(len(contacts)), contacts.T), shape=(count, count))
    found, members = connected_components(graph, directed=False)
    rank = np.empty(found, np.int64)
    rank[np.argsort(-np.bincount(members), kind="stable")] = np.arange(found)
    return np.asarray(rank[members])


def _centres(measured: Measurement, members: Integers) -> Real:
    """Centre of mass of each aggregate; cells without volume or a known place do not count."""
    known = (measured.volume > 0) & np.isfinite(measured.centroid).all(axis=1)
    weight = np.where(known, measured.volume, 0)
    place = np.where(known[:, None], measured.centroid, 0)
    sums = np.stack([np.bincount(members, weight * place[:, axis]) for axis in range(3)], axis=1)
    with np.errstate(invalid="ignore"):
        return np.asarray(sums / np.bincount(members, weight)[:, None])


def _semi_axes(measured: Measurement, chosen: NDArray[np.bool_]) -> Real:
    """Semi-axes of the ellipsoid of some cells' second moments, the shortest first, µm."""
    known = np.isfinite(measured.centroid) & np.isfinite(measured.semi_axes)
    chosen = chosen & (measured.enclosed_volume > 0) & known.all(axis=1)
    if not chosen.any():
        return np.full(3, np.nan)
    weight = measured.enclosed_volume[chosen] / measured.enclosed_volume[chosen].sum()
    place = measured.centroid[chosen]
    place = place - weight @ place
    own = measured.principal_axes[chosen] * measured.semi_axes[chosen][:, :, None] / np.sqrt(5)
    moments = np.einsum("n,ni,nj->ij", weight, place, place)
    moments += np.einsum("n,nki,nkj->ij", weight, own, own)
    return np.asarray(np.sqrt(5 * np.maximum(np.linalg.eigvalsh(moments), 0)))
