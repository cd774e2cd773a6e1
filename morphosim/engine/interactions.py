"""What kernels need to know of repulsion and attraction: g, σ by type, and pairs that differ."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from morphosim.cell_table import CellTable
from morphosim.kernels.layout import Interaction, Pairs
from morphosim.physics.term import Pull


class Interactions:
    """Types, σ by type and exceptional pairs of the cells of a table.

    Where σ by type is one value, and potentials of space are as strong for all, all cells count as
    one type: one accumulated field serves all.
    Sisters and stated pairs are exceptional if their σ is not that of their types.

    Parameters
    ----------
    attraction : Pull or None
    g : float
        Repulsion between cells (Eq. 3).
    fields : sequence of (types,)
        Strength of each potential of space by type; each counts as a type that pulls on others.
    cells : CellTable
    everyone : CellTable
        All cells of the simulation, whose types count; on one rank the same.
    dtype : of the fields

    Attributes
    ----------
    interaction : Interaction
    n_fields : int
        Number of accumulated potentials; 0 where no type attracts another.
    pairs : Pairs or None
    """

    def __init__(
        self, attraction: Pull | None, g: float, fields: Sequence[Sequence[float]],
        cells: CellTable, everyone: CellTable, dtype: DTypeLike,
    ) -> None:  # fmt: skip
        real: np.dtype[Any] = np.dtype(dtype)
        kinds = everyone.present_kinds
        place = np.zeros(len(everyone.kinds), np.int64)
        place[kinds] = np.arange(len(kinds))
        index = place[cells["kind"]]
        names = [everyone.kinds[kind] for kind in kinds]
        nothing = np.zeros((len(names), len(names)))
        pull = nothing if attraction is None else attraction.type_matrix(names)
        strengths = np.array(fields, float).reshape(len(fields), len(names))
        if (pull == pull[0, 0]).all() and (strengths == strengths[:, :1]).all():
            pull, strengths = pull[:1, :1], strengths[:, :1]
            index = np.zeros(len(cells), np.int64)
        pull = np.pad(pull, (0, len(fields)))
        pull[len(pull) - len(fields) :, : strengths.shape[1]] = strengths
        self.interaction = Interaction(g=real.type(g), types=index, pull=pull.astype(real))
        self.n_fields = len(pull) if pull.any() else 0
        self._types, self._dtype = index, real
        self._differing = _differing(_exceptions(attraction, cells), pull, index)
        self.pairs = _compressed(self._differing, len(index), real) if self._differing else None

    def repeat(self, owner: NDArray[np.int64]) -> None:
        """Count images of cells (M,), which come after all cells, as these where they act."""
        n = len(self._types)
        types = np.concatenate([self._types, self._types[owner]])
        self.interaction = self.interaction._replace(types=types)
        if self._differing:
            seen: dict[int, list[int]] = {}
            for place, j in enumerate(owner.tolist()):
                seen.setdefault(j, [j]).append(n + place)
            rows = [(i, k, w) for i, j, w in self._differing for k in seen.get(j, [j])]
            self.pairs = _compressed(rows, n, self._dtype)

    @property
    def attracts(self) -> bool:
        """Whether any cell pulls on another."""
        return self.n_fields > 0 or self.pairs is not None


def _exceptions(attraction: Pull | None, cells: CellTable) -> dict[tuple[int, int], float]:
    """σ of pairs that is not told by types, by rows; looks at the cells that are stated alone."""
    if attraction is None:
        return {}
    rows = {name: cells.row(name) for name in attraction.stated if cells.has(name)}
    parents = cells["parent"].tolist() if attraction.needs_parents else None
    return attraction.exceptions(rows, parents)


def _differing(
    exceptions: Mapping[tuple[int, int], float],
    pull: NDArray[np.float64],
    types: NDArray[np.int64],
) -> list[tuple[int, int, float]]:
    """Pulled cell, cell that pulls, and by what σ differs from that of their types; sorted."""
    weights = {(i, j): value - pull[types[j], types[i]] for (j, i), value in exceptions.items()}
    return sorted((i, j, weight) for (i, j), weight in weights.items() if weight != 0)


def _compressed(rows: Sequence[tuple[int, int, float]], count: int, dtype: np.dtype) -> Pairs:
    """Pairs by the cell that is pulled, of so many cells."""
    pulled = np.array([i for i, _, _ in rows])
    return Pairs(
        start=np.searchsorted(pulled, np.arange(count + 1)).astype(np.int64),
        cell=np.array([j for _, j, _ in rows], np.int64),
        weight=np.array([w for _, _, w in rows], dtype),
        frame_start=np.full(count, -1),
    )
