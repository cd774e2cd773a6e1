"""How cells hang together and how their types sort: figures of whole aggregates."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from morphosim.measure.measurement import Measurement

Real = NDArray[np.float64]
Integers = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Aggregates:
    """Aggregates of N cells: cells in contact, and those in contact with these.

    Attributes
    ----------
    aggregate : (N,) int64
        Number of each cell's aggregate; 0 is the one of most cells, then in the order of size.
    radial_position : (N,) float64
        Distance of a cell's centroid from the centre of mass of its aggregate, µm.
    n_aggregates, single_cells, largest_aggregate : int
        Aggregates, single cells among them, and cells of the largest.
    sorting_index : float
        Share of the contacts that are between cells of the same type; NaN without contacts.
    radius_of_gyration : float
        Of the largest aggregate, µm; √(3/5) R for a ball of radius R.
    roundness : float
        Shortest over longest semi-axis of the ellipsoid of the largest aggregate's second moments:
        1 for a ball, 0.55 for half of one.
    aggregate_sphericity : float
        Surface of a ball of the largest aggregate's volume over its exposed surface. Cells that
        bulge out make it less than 1.
    """

    aggregate: Integers
    radial_position: Real
    n_aggregates: int
    single_cells: int
    largest_aggregate: int
    sorting_index: float
    radius_of_gyration: float
    roundness: float
    aggregate_sphericity: float


def aggregates(measured: Measurement, types: Sequence[str]) -> Aggregates:
    """Aggregates of measured cells of these N types."""
    members = _components(len(types), measured.contacts)
    sizes, centres = np.bincount(members), _centres(measured, members)
    exposed = measured.exposed_fraction * measured.surface_area
    largest = members == 0
    axes = _semi_axes(measured, largest)
    kinds = np.asarray(types)[measured.contacts]
    with np.errstate(invalid="ignore", divide="ignore"):
        return Aggregates(
            aggregate=members,
            radial_position=np.linalg.norm(measured.centroid - centres[members], axis=1),
            n_aggregates=len(sizes),
            single_cells=int(np.count_nonzero(sizes == 1)),
            largest_aggregate=int(sizes[0]),
            sorting_index=float((kinds[:, 0] == kinds[:, 1]).mean()) if len(kinds) else np.nan,
            radius_of_gyration=float(np.sqrt((axes**2).sum() / 5)),
            roundness=float(axes[0] / axes[-1]),
            aggregate_sphericity=float(
                np.pi ** (1 / 3)
                * (6 * measured.enclosed_volume[largest].sum()) ** (2 / 3)
                / exposed[largest].sum()
            ),
        )


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
    """Centre of mass of each aggregate; cells without volume do not count."""
    weight = np.where(measured.volume > 0, measured.volume, 0)
    place = np.nan_to_num(measured.centroid)
    sums = np.stack([np.bincount(members, weight * place[:, axis]) for axis in range(3)], axis=1)
    with np.errstate(invalid="ignore"):
        return np.asarray(sums / np.bincount(members, weight)[:, None])


def _semi_axes(measured: Measurement, chosen: NDArray[np.bool_]) -> Real:
    """Semi-axes of the ellipsoid of some cells' second moments, the shortest first, µm."""
    solid = measured.enclosed_volume > 0
    chosen = chosen & solid & np.isfinite(measured.semi_axes).all(axis=1)
    if not chosen.any():
        return np.full(3, np.nan)
    weight = measured.enclosed_volume[chosen] / measured.enclosed_volume[chosen].sum()
    place = measured.centroid[chosen]
    place = place - weight @ place
    own = measured.principal_axes[chosen] * measured.semi_axes[chosen][:, :, None] / np.sqrt(5)
    moments = np.einsum("n,ni,nj->ij", weight, place, place)
    moments += np.einsum("n,nki,nkj->ij", weight, own, own)
    return np.asarray(np.sqrt(5 * np.maximum(np.linalg.eigvalsh(moments), 0)))
