"""How far centroids move, and how fast."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from morphosim._shown import short_repr

Real = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Positions:
    """Where N cells are at one time.

    Attributes
    ----------
    time : float
        *In silico* time.
    cells : sequence of N texts or whole numbers
        What tells the cells apart at all times: their names, or numbers of their own.
    centroids : (N, 3) float64
        µm.
    """

    time: float
    cells: Sequence[str] | NDArray[Any]
    centroids: Real

    __repr__ = short_repr

    def distance(self, before: "Positions") -> Real:
        """(N,) distance of each cell from where it was before, µm; NaN where it was not there."""
        return _distance(before.of(self.cells), self.centroids)

    def speed(self, before: "Positions") -> Real:
        """(N,) mean speed since then, µm per *in silico* time; NaN where a cell was not there."""
        return np.asarray(self.distance(before) / (self.time - before.time))

    def of(self, cells: Sequence[str] | NDArray[Any]) -> Real:
        """(M, 3) centroids of these cells; NaN where there is no such cell here."""
        known, wanted = np.asarray(self.cells), np.asarray(cells)
        if np.array_equal(known, wanted):  # nothing has divided: the most frequent case
            return self.centroids
        found = np.full((len(wanted), 3), np.nan)
        _, here, there = np.intersect1d(known, wanted, assume_unique=True, return_indices=True)
        found[there] = self.centroids[here]
        return found


def root_mean_square(speeds: Real) -> float:
    """Root mean square of those speeds, or distances, that are known; NaN if none is."""
    known = speeds[np.isfinite(speeds)]
    return float(np.sqrt(np.mean(known**2))) if len(known) else np.nan


def trajectory(position: Real, times: Real) -> tuple[Real, Real, Real]:
    """Motion along saves; NaN before and after a cell.

    Parameters
    ----------
    position : (T, …, 3), µm
    times : (T,)

    Returns
    -------
    displacement : (T, …) distance from the first position, µm
    path : (T, …) length of the way since then, µm
    speed : (T, …) mean speed since the save before, µm per *in silico* time
    """
    there = np.isfinite(position).all(axis=-1)
    first = np.take_along_axis(position, there.argmax(axis=0)[None, ..., None], axis=0)
    steps = np.full(there.shape, np.nan)
    steps[1:] = _distance(position[:-1], position[1:])
    path = np.where(there, np.cumsum(np.nan_to_num(steps), axis=0), np.nan)
    lapse = np.diff(times, prepend=np.nan).reshape(-1, *[1] * (there.ndim - 1))
    return _distance(first, position), path, steps / lapse


def _distance(before: Real, now: Real) -> Real:
    return np.asarray(np.linalg.norm(now - before, axis=-1))
