"""From a scene's attraction to what kernels need: σ by type, and the pairs that differ."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from morphosim.kernels.layout import Interaction, Pairs
from morphosim.physics.attraction import Attraction


class Interactions:
    """Types, σ by type and exceptional pairs of a list of cells.

    Where σ by type is one value, all cells count as one type: one accumulated field serves all.
    Sisters and stated pairs are exceptional if their σ is not that of their types.

    Parameters
    ----------
    attraction : Attraction
    g : float
        Repulsion between cells (Eq. 3).
    names, types : of the N cells
    dtype : of the fields
    parents : of the N cells, optional
        Names of their mothers, "" where not known; by default none has sisters.
    society : types of all cells, optional
        By default those of the N cells.

    Attributes
    ----------
    interaction : Interaction
    n_fields : int
        Number of accumulated potentials; 0 where no type attracts another.
    pairs : Pairs or None
    """

    def __init__(
        self,
        attraction: Attraction,
        g: float,
        names: Sequence[str],
        types: Sequence[str],
        dtype: DTypeLike,
        parents: Sequence[str] | None = None,
        society: Sequence[str] | None = None,
    ) -> None:
        kind: np.dtype[Any] = np.dtype(dtype)
        known = sorted(set(types if society is None else society))
        pull = attraction.type_matrix(known)
        index = np.searchsorted(known, types).astype(np.int64)
        if (pull == pull[0, 0]).all():
            pull, index = pull[:1, :1], np.zeros(len(types), np.int64)
        self.interaction = Interaction(g=kind.type(g), types=index, pull=pull.astype(kind))
        self.n_fields = len(pull) if pull.any() else 0
        self.pairs = _pairs(attraction.exceptions(names, parents), pull, index, kind)

    @property
    def attracts(self) -> bool:
        """Whether any cell pulls on another."""
        return self.n_fields > 0 or self.pairs is not None


def _pairs(
    exceptions: Mapping[tuple[int, int], float],
    pull: NDArray[np.float64],
    types: NDArray[np.int64],
    dtype: np.dtype,
) -> Pairs | None:
    weights = {(i, j): value - pull[types[j], types[i]] for (j, i), value in exceptions.items()}
    rows = sorted((i, j, weight) for (i, j), weight in weights.items() if weight != 0)
    if not rows:
        return None
    pulled = np.array([i for i, _, _ in rows])
    return Pairs(
        start=np.searchsorted(pulled, np.arange(len(types) + 1)).astype(np.int64),
        cell=np.array([j for _, j, _ in rows], np.int64),
        weight=np.array([w for _, _, w in rows], dtype),
        frame_start=np.full(len(types), -1),
    )
