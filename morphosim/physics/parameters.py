"""Physical parameters of a scene (paper §2, Supplementary Note 2)."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

from morphosim import _validate
from morphosim.physics.attraction import Attraction

VOLUME_CONSTRAINTS = ("relative", "absolute", "none")
_DEFAULT_M = {"relative": 8.0, "absolute": 0.0016, "none": 0.0}


@dataclass(frozen=True, slots=True, kw_only=True)
class Physics:
    """What acts on the cells. Lengths in µm, time *in silico* (paper §2.1).

    A term that a scene does not have is absent: it costs neither time nor memory.

    Attributes
    ----------
    tau : float
        Ambient viscosity τ (Eq. 5).
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

    Raises
    ------
    ValueError
        A parameter is negative, not finite, or (τ, γ, c) zero; the message names it.
    """

    tau: float = 2.62
    gamma: float = 0.25
    c: float = 2.0
    volume_constraint: str = "relative"
    M: float | None = None
    g: float = 1.6
    g_e: float = 16.0
    sigma: Attraction | float = field(default_factory=Attraction)
    kappa: float = 0.0
    kappa_by_type: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in ("tau", "gamma", "c"):
            _validate.number(f"physics.{name}", getattr(self, name), above=0)
        _validate.choice("physics.volume_constraint", self.volume_constraint, VOLUME_CONSTRAINTS)
        if self.M is not None:
            _validate.number("physics.M", self.M, least=0)
        for name in ("g", "g_e", "kappa"):
            _validate.number(f"physics.{name}", getattr(self, name), least=0)
        _validate.instance("physics.kappa_by_type", self.kappa_by_type, Mapping)
        for kind, kappa in self.kappa_by_type.items():
            _validate.number(f"physics.kappa_by_type[{kind!r}]", kappa, least=0)
        if not isinstance(self.sigma, Attraction):
            value = _validate.number("physics.sigma", self.sigma, least=0)
            object.__setattr__(self, "sigma", Attraction(default=value))

    @property
    def volume_strength(self) -> float:
        """`M` or its default; 0 where the volume is not constrained."""
        default = _DEFAULT_M[self.volume_constraint]
        return default if self.M is None or self.volume_constraint == "none" else self.M

    @property
    def attraction(self) -> Attraction:
        """`sigma` as an `Attraction`."""
        assert isinstance(self.sigma, Attraction)
        return self.sigma

    def check_types(self, types: Sequence[str]) -> None:
        """Raise ValueError if `kappa_by_type` names a type that is not one of these."""
        for kind in self.kappa_by_type:
            _validate.choice("type in physics.kappa_by_type", kind, types)

    def among(self, names: Sequence[str], types: Collection[str]) -> "Physics":
        """Copy that says nothing of other cells and types than these."""
        kappa = {kind: value for kind, value in self.kappa_by_type.items() if kind in types}
        return replace(self, sigma=self.attraction.among(names, types), kappa_by_type=kappa)

    def motility(self, kind: str) -> float:
        """κ of cells of a type."""
        return self.kappa_by_type.get(kind, self.kappa)

    @property
    def interface_scale(self) -> float:
        """√(c/2) in 1/µm: the interface is (1 + tanh(√(c/2) d)) / 2."""
        return float((self.c / 2) ** 0.5)
