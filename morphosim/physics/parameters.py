"""Physical parameters of a scene (paper §2, Supplementary Note 2)."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Self

from morphosim import _validate
from morphosim._shown import listed, short_repr
from morphosim.cell_table import Column
from morphosim.physics.attraction import Attraction
from morphosim.physics.by_type import ByType
from morphosim.physics.confinement_repulsion import ConfinementRepulsion
from morphosim.physics.motility import Motility
from morphosim.physics.repulsion import Repulsion
from morphosim.physics.surface_tension import SurfaceTension
from morphosim.physics.term import Term
from morphosim.physics.volume_constraint import VolumeConstraint


@dataclass(frozen=True, slots=True, kw_only=True)
class Physics:
    """What acts on the cells. Lengths in µm, time *in silico* (paper §2.1).

    A term that a scene does not have is absent: it costs neither time nor memory.

    Attributes
    ----------
    tau : float
        Ambient viscosity τ (Eq. 5).
    tau_by_type : mapping from cell type to float
        τ of cells of these types, instead of `tau`.
    gamma : float
        Surface tension γ (Eq. 1); a `Cell` may have its own.
    c : float
        Strength of the double well (Eq. 1). The interface is φ = (1 + tanh(√(c/2) d)) / 2 with
        d the depth in µm.
    volume_constraint : {"relative", "absolute", "none"}
        Pressure M (1 - v/V) of Eq. 10 (M is M' there), M (V - v) of Eq. 2, or none.
    M : float
        Strength of the volume constraint; by default 8 (relative) or 0.0016 (absolute, per µm³).
    g, g_e : float
        Repulsion between cells and by the confinement (Eq. 3).
    sigma : Attraction or float
        Attraction σ between cells (Eq. 4); a number holds for all pairs.
    kappa : float
        Strength κ of the motility noise (Eq. 11, S3). As published, a free cell's mean-square
        displacement along an axis is (κ δt/τ)² t: it depends on δt.
    kappa_by_type : mapping from cell type to float
        κ of cells of these types, instead of `kappa`.
    terms : sequence of Term
        Further force terms, such as your own; see `physics.term`.

    Raises
    ------
    ValueError
        A parameter is negative, not finite, or (τ, γ, c) zero; the message names it.
    """

    tau: float = 2.62
    tau_by_type: Mapping[str, float] = field(default_factory=dict)
    gamma: float = 0.25
    c: float = 2.0
    volume_constraint: str = "relative"
    M: float | None = None
    g: float = 1.6
    g_e: float = 16.0
    sigma: Attraction | float = field(default_factory=Attraction)
    kappa: float = 0.0
    kappa_by_type: Mapping[str, float] = field(default_factory=dict)
    terms: Sequence[Term] = ()

    __repr__ = short_repr

    def __post_init__(self) -> None:
        self.viscosity.validate(above=0)
        if not isinstance(self.sigma, Attraction):
            value = _validate.number("physics.sigma", self.sigma, least=0)
            object.__setattr__(self, "sigma", Attraction(default=value))
        terms = _validate.several("physics.terms", self.terms, "force terms")
        for k, term in enumerate(terms):
            _validate.instance(f"physics.terms[{k}]", term, Term)
        object.__setattr__(self, "terms", terms)
        self._check_columns()  # and each of `all_terms` its own parameters

    def _check_columns(self) -> None:
        """Raise ValueError if two terms have a column of the same name, or one is shared."""
        owners: dict[str, Term] = {}
        for term in self.active_terms:
            for column in term.columns:
                if column.name in owners:
                    message = (
                        f"the force terms {owners[column.name].name} and {term.name} both have a "
                        f"column {column.name!r}; give one of them another name (`columns` may be "
                        "a property, where two terms are of one class)"
                    )
                    raise ValueError(message)
                if column.shared and not column.aimed and term in self.terms:
                    message = (
                        f"force term {term.name}: column {column.name!r} is shared; only columns "
                        "of the engine are"
                    )
                    raise ValueError(message)
                owners[column.name] = term

    @property
    def all_terms(self) -> tuple[Term, ...]:
        """The terms of the sum F (Eq. S2, S3), in the order in which they are added."""
        return (
            self.surface_tension,
            self.constraint,
            Repulsion(g=self.g),
            ConfinementRepulsion(g_e=self.g_e),
            self.attraction,
            Motility(kappa=self.kappa, kappa_by_type=self.kappa_by_type),
            *self.terms,
        )

    @property
    def active_terms(self) -> tuple[Term, ...]:
        """Those that act."""
        return tuple(term for term in self.all_terms if term.present)

    @property
    def columns(self) -> tuple[Column, ...]:
        """What the terms that act keep of each cell."""
        return tuple(column for term in self.active_terms for column in term.columns)

    @property
    def summary(self) -> str:
        """The main parameters in one line."""
        weakest, strongest = self.attraction.extent
        parts = [
            f"γ = {self.gamma:.3g}",
            f"c = {self.c:.3g}",
            f"σ = {weakest:.3g}" + (f" to {strongest:.3g}" if strongest > weakest else ""),
            f"κ = {self.kappa:.3g}" if self.kappa else "",
            listed([term.name for term in self.terms]),
        ]
        return ", ".join(part for part in parts if part)

    @property
    def viscosity(self) -> ByType:
        """τ, by type."""
        return ByType("physics.tau", self.tau, self.tau_by_type)

    @property
    def surface_tension(self) -> SurfaceTension:
        """`gamma` and `c` as a term."""
        return SurfaceTension(gamma=self.gamma, c=self.c)

    @property
    def constraint(self) -> VolumeConstraint:
        """`volume_constraint` and `M` as a term."""
        return VolumeConstraint(kind=self.volume_constraint, M=self.M)

    @property
    def attraction(self) -> Attraction:
        """`sigma` as an `Attraction`."""
        assert isinstance(self.sigma, Attraction)
        return self.sigma

    @property
    def volume_strength(self) -> float:
        """`M` or its default; 0 where the volume is not constrained."""
        return self.constraint.strength

    def check(self, names: Collection[str], types: Collection[str]) -> None:
        """Raise ValueError if a term names a cell or a type that is not one of these."""
        self.viscosity.check(types)
        for term in self.all_terms:
            term.check(names, types)

    def among(self, names: Collection[str], types: Collection[str]) -> Self:
        """Copy that says nothing of other cells and types than these."""
        kappa = {kind: value for kind, value in self.kappa_by_type.items() if kind in types}
        return replace(
            self, sigma=self.attraction.among(names, types), kappa_by_type=kappa,
            terms=[term.among(names, types) for term in self.terms],
            tau_by_type=self.viscosity.among(types),
        )  # fmt: skip

    @property
    def interface_scale(self) -> float:
        """√(c/2) in 1/µm: the interface is (1 + tanh(√(c/2) d)) / 2."""
        return float((self.c / 2) ** 0.5)
