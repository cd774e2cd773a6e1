"""Surfaces that meet where cells touch, for pictures."""

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from morphosim.cell_field import CellField
from morphosim.measure.contacts import common
from morphosim.measure.surfaces import SURFACE, Surface

Reals = NDArray[np.float32]
EDGE = 0.2
"""Of φ, over which the edge of a contact is rounded."""
SMOOTHINGS = 10
IN_AND_OUT = (0.5, -0.53)
"""How far vertices go to the middle of those around them, and back so that volumes stay: Taubin
1995, doi:10.1145/218380.218473."""


def joined(fields: Iterable[CellField], chosen: Iterable[int] | None = None) -> Iterator[CellField]:
    """The same cells, sharing out what they fill together: {Σφ > 1/2}, to the largest φ each.

    All of them, or those at the chosen places among them.

    Cells that touch without attraction come to rest where φ is some 0.32 in both, so that their
    surfaces φ = 1/2 stay about a lattice step apart; those that attract each other overlap a
    little. The fields that are returned have their surfaces 1/2 halfway, where φ is the same in
    both, wherever there is contact area, and where they were on all other surface. Cells that are
    nowhere above 1/2 stay so.
    """
    cells = [CellField(f.name, f.origin, _finite(f.phi)) for f in fields]
    low = np.array([cell.origin for cell in cells]).reshape(-1, 3)
    high = low + np.array([cell.phi.shape for cell in cells]).reshape(-1, 3)
    for k in range(len(cells)) if chosen is None else chosen:
        near = (low < high[k]).all(axis=1) & (high > low[k]).all(axis=1)
        near[k] = False
        yield _joined(cells[k], [cells[other] for other in np.flatnonzero(near)])


def smoothed(surface: Surface) -> Surface:
    """Without the steps of the lattice at edges of contacts. Volumes stay."""
    from scipy.sparse import coo_array

    count, sides = len(surface.vertices), np.roll(surface.faces, -1, axis=1)
    places = surface.faces.ravel(), sides.ravel()
    around = coo_array((np.ones(len(places[0])), places), shape=(count, count)).tocsr()
    neighbours = np.maximum(around.sum(axis=1), 1)[:, None]
    vertices = surface.vertices
    for share in IN_AND_OUT * SMOOTHINGS:
        vertices = vertices + share * (around @ vertices / neighbours - vertices)
    return replace(surface, vertices=vertices)


def _joined(cell: CellField, others: list[CellField]) -> CellField:
    if cell.phi.max(initial=0) <= SURFACE:
        return cell
    total = CellField(cell.name, cell.origin, cell.phi.copy())
    largest = CellField(cell.name, cell.origin, np.zeros_like(cell.phi))
    for other in others:
        for so_far, take in ((total, np.add), (largest, np.maximum)):
            mine, theirs = common(so_far, other)
            take(mine, theirs, out=mine)
    return replace(cell, phi=_smaller(total.phi, SURFACE + cell.phi - largest.phi))


def _smaller(a: Reals, b: Reals) -> Reals:
    """Minimum of both, rounded where they differ by less than `EDGE`."""
    near = np.maximum(1 - np.abs(a - b) / EDGE, 0)
    return np.asarray(np.minimum(a, b) - near**2 * (EDGE / 4))


def _finite(phi: NDArray[np.floating]) -> Reals:
    """φ from 0 up; what is no number is outside."""
    finite = np.nan_to_num(phi, nan=0.0, posinf=0.0, neginf=0.0)
    return np.asarray(np.maximum(finite, 0), np.float32)
