"""Attraction σ between cells: one value, by type, of sisters, or by pair (Eq. 4 of the paper)."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import permutations
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from morphosim import _validate
from morphosim._shown import short_repr
from morphosim.physics.term import Concern, Conditions, Environment, Term

Pair = tuple[str, str]
STRONGEST = {"long": 11.0, "short": 15.0}
"""Largest σ / γ that was stable at δt = 2, and at any δt; at 16, cells of γ = 1/64 fail at any."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Attraction(Term):
    """- ∇φ_i·∇ψ_i with ψ_i = Σ_j σ_ji φ_j (Eq. 4): cell j pulls on cell i with σ[j, i].

    σ need not be symmetric.

    The most specific statement holds: a pair of cells, else `sisters`, else a pair of types, else
    `default`.

    Attributes
    ----------
    default : float
        σ between any two cells.
    sisters : float, optional
        σ between cells of the same known parent; by default they are as any two cells.
    types : mapping of (type j, type i) to float
        σ by cell type. Where only one order of two types is given it holds for both.
    pairs : mapping of (cell j, cell i) to float
        σ of single pairs. Where only one order of two cells is given it holds for both.

    Raises
    ------
    ValueError
        A value is negative or not finite.

    Examples
    --------
    >>> Attraction(default=0.5, pairs={("ABpl", "E"): 0.0}).matrix(["ABpl", "E", "MS"])
    array([[0. , 0. , 0.5],
           [0. , 0. , 0.5],
           [0.5, 0.5, 0. ]])
    """

    default: float = 0.0
    sisters: float | None = None
    types: Mapping[Pair, float] = field(default_factory=dict)
    pairs: Mapping[Pair, float] = field(default_factory=dict)

    drifts = False
    label = "attraction"

    __repr__ = short_repr

    def __post_init__(self) -> None:
        _validate.number("sigma.default", self.default, least=0)
        if self.sisters is not None:
            _validate.number("sigma.sisters", self.sisters, least=0)
        for label, table in (("types", self.types), ("pairs", self.pairs)):
            _validate.instance(f"sigma.{label}", table, Mapping)
            for key, value in table.items():
                if not isinstance(key, tuple) or len(key) != 2:
                    message = f"sigma.{label} has the key {_validate.brief(key)}; expected a pair "
                    raise ValueError(f"{message}of names")
                for name in key:
                    _validate.label(f"sigma.{label}: name", name, empty=label == "types")
                _validate.number(f"sigma.{label}[{key[0]!r}, {key[1]!r}]", value, least=0)

    @classmethod
    def from_matrix(cls, names: Sequence[str], matrix: ArrayLike) -> "Attraction":
        """Attraction given as a full (N, N) matrix, matrix[j, i] the pull of j on i.

        The most frequent value becomes the default, the others pairs; the diagonal is ignored.

        Raises
        ------
        ValueError
            The matrix is not square, its size is not that of `names`, or an entry is negative.
        """
        names = _validate.labels("names", names)
        _validate.unique("cell name", names)
        sigma = _validate.array("sigma", matrix, (len(names), len(names)))
        others = ~np.eye(len(names), dtype=bool)
        for j, i in np.argwhere(others & (sigma < 0)):
            _validate.number(f"sigma[{j}, {i}]", sigma[j, i], least=0)
        off_diagonal = sigma[others]
        values, counts = np.unique(off_diagonal, return_counts=True)
        default = float(values[np.argmax(counts)]) if values.size else 0.0
        pairs = {
            (names[j], names[i]): float(sigma[j, i])
            for j, i in np.argwhere(sigma != default)
            if j != i
        }
        asymmetric = {(i, j): default for j, i in pairs if (i, j) not in pairs}
        return cls(default=default, pairs=pairs | asymmetric)

    @property
    def extent(self) -> tuple[float, float]:
        """Smallest and largest σ that is stated."""
        sisters = [] if self.sisters is None else [self.sisters]
        values = [self.default, *sisters, *self.types.values(), *self.pairs.values()]
        return float(min(values)), float(max(values))

    def strongest(self, types: Sequence[str]) -> float:
        """Largest σ by type, for cells of these types, of sisters, now or to come, or of a pair."""
        by_type = float(self.type_matrix(sorted(set(types))).max())
        return max([by_type, self.sisters or 0.0, *self.pairs.values()])

    def of_types(self, j: str, i: str) -> float:
        """σ between cells of type j (pulling) and type i (pulled)."""
        return self.types.get((j, i), self.types.get((i, j), self.default))

    def type_matrix(self, types: Sequence[str]) -> NDArray[np.float64]:
        """(K, K) σ by type, [j, i]."""
        return np.array([[self.of_types(j, i) for i in types] for j in types])

    @property
    def stated(self) -> set[str]:
        """Names of the cells in `pairs`."""
        return {name for pair in self.pairs for name in pair}

    @property
    def needs_parents(self) -> bool:
        """Whether `exceptions` looks at the cells' mothers."""
        return self.sisters is not None

    def exceptions(
        self, rows: Mapping[str, int], parents: Sequence[str] | None = None
    ) -> dict[tuple[int, int], float]:
        """σ by (j, i), rows of cells, of all pairs whose σ their types do not tell.

        These are the stated pairs and, where `sisters` is given, cells of the same parent; ""
        is no parent.

        Parameters
        ----------
        rows : rows of living cells by name, at least of those in `stated`
        parents : names of the mothers of all N cells, optional
        """
        found: dict[tuple[int, int], float] = {}
        if self.sisters is not None and parents is not None:
            found = dict.fromkeys(_sister_pairs(parents), self.sisters)
        reversed_pairs = {(i, j): value for (j, i), value in self.pairs.items()}
        for (j, i), value in (reversed_pairs | dict(self.pairs)).items():
            if i != j and j in rows and i in rows:
                found[rows[j], rows[i]] = value
        return found

    def matrix(
        self,
        names: Sequence[str],
        types: Sequence[str] | None = None,
        parents: Sequence[str] | None = None,
    ) -> NDArray[np.float64]:
        """Full (N, N) matrix σ[j, i] for cells with these names, types and parents; diagonal 0."""
        kinds = types if types is not None else [""] * len(names)
        sigma = np.array([[self.of_types(j, i) for i in kinds] for j in kinds])
        rows = {name: row for row, name in enumerate(names)}
        for (j, i), value in self.exceptions(rows, parents).items():
            sigma[j, i] = value
        np.fill_diagonal(sigma, 0.0)
        return sigma

    def among(self, names: Collection[str], types: Collection[str]) -> Self:
        """Copy that says nothing of other cells and types than these."""
        kept_types = {pair: v for pair, v in self.types.items() if {*pair} <= {*types}}
        kept_pairs = {pair: v for pair, v in self.pairs.items() if {*pair} <= {*names}}
        return replace(self, types=kept_types, pairs=kept_pairs)

    @property
    def present(self) -> bool:
        """Whether any cell may pull on another."""
        stated = (self.default, self.sisters, *self.types.values(), *self.pairs.values())
        return any(stated)

    def surround(self, environment: Environment) -> None:
        """Add to ψ."""
        if environment.attraction is not None:
            message = "there are two attractions; state all of it as one physics.sigma"
            raise ValueError(message)
        environment.attraction = self

    def explicit_rate(self, conditions: Conditions) -> float:
        """2 σ k |∇φ| at k = √(2c), of two cells: of account when linearised, where no more is."""
        if not conditions.linearised or not (conditions.several or conditions.staged):
            return 0.0
        return 2 * self.strongest(conditions.types) * conditions.interface_scale**2

    def concern(self, conditions: Conditions) -> Concern | None:
        """Cells that tear each other apart."""
        strongest = self.strongest(conditions.types)
        softest = float(conditions.tensions.min())
        limit = STRONGEST["long" if conditions.numerics.dt > 1 else "short"]
        if not (conditions.several or conditions.staged) or strongest <= limit * softest:
            return None
        return Concern(
            strongest / (limit * softest),
            f"physics.sigma = {strongest:g} is more than {limit:g} times the surface tension "
            f"{softest:g}: cells may tear each other apart. Take a weaker sigma or a larger gamma",
        )

    def check(self, names: Collection[str], types: Collection[str]) -> None:
        """Raise ValueError if a pair names a cell or a type that does not exist."""
        for j, i in self.pairs:
            if i == j:
                message = f"sigma.pairs[{j!r}, {i!r}]: a cell does not attract itself"
                raise ValueError(message)
            _validate.choice(f"cell in sigma.pairs[{j!r}, {i!r}]", j, names)
            _validate.choice(f"cell in sigma.pairs[{j!r}, {i!r}]", i, names)
        known = sorted(set(types))
        for j, i in self.types:
            _validate.choice(f"type in sigma.types[{j!r}, {i!r}]", j, known)
            _validate.choice(f"type in sigma.types[{j!r}, {i!r}]", i, known)


def _sister_pairs(parents: Sequence[str]) -> list[tuple[int, int]]:
    """Both orders of all pairs of cells that have the same parent."""
    families: dict[str, list[int]] = {}
    for cell, parent in enumerate(parents):
        if parent:
            families.setdefault(parent, []).append(cell)
    return [pair for cells in families.values() for pair in permutations(cells, 2)]
