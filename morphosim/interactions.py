"""From a scene's attraction to what kernels need: σ by type, and the pairs that differ."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from morphosim.attraction import Attraction
from morphosim.kernels.layout import Interaction, Pairs


class Interactions:
    """Types, σ by type and exceptional pairs of a list of cells.

    Where σ by type is one value, all cells count as one type: one accumulated field serves all.

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
    ) -> None:
        kind: np.dtype[Any] = np.dtype(dtype)
        known = sorted(set(types))
        pull = attraction.type_matrix(known)
        index = np.searchsorted(known, types).astype(np.int64)
        if (pull == pull[0, 0]).all():
            pull, index = pull[:1, :1], np.zeros(len(types), np.int64)
        self.interaction = Interaction(g=kind.type(g), types=index, pull=pull.astype(kind))
        self.n_fields = len(pull) if pull.any() else 0
        self.pairs = _pairs(attraction, names, pull, index, kind)

    @property
    def attracts(self) -> bool:
        """Whether any cell pulls on another."""
        return self.n_fields > 0 or self.pairs is not None


def _pairs(
    attraction: Attraction,
    names: Sequence[str],
    pull: NDArray[np.float64],
    types: NDArray[np.int64],
    dtype: np.dtype,
) -> Pairs | None:
    number = {name: i for i, name in enumerate(names)}
    rows: list[tuple[int, int, float]] = []
    for j, i in attraction.stated_pairs():
        if j not in number or i not in number or j == i:
            continue
        value = attraction.of_pair(j, i)
        assert value is not None
        weight = value - pull[types[number[j]], types[number[i]]]
        if weight != 0:
            rows.append((number[i], number[j], weight))
    if not rows:
        return None
    rows.sort()
    pulled = np.array([i for i, _, _ in rows])
    return Pairs(
        start=np.searchsorted(pulled, np.arange(len(names) + 1)).astype(np.int64),
        cell=np.array([j for _, j, _ in rows], np.int64),
        weight=np.array([w for _, _, w in rows], dtype),
        frame_start=np.full(len(names), -1),
    )
