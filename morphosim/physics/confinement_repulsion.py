"""How strongly a confinement repels at lattice points: g_e φ_e² of Eq. 3.

A hard wall is 0 or 1 from one lattice point to the next, so on the lattice its place is uncertain
by half a spacing. `numerics.walls = "resolved"` replaces it by a wall that the lattice resolves and
that repels alike. Behind a hard wall φ decays over ℓ = √(γ/g_e), so from inside φ appears to vanish
at ℓ behind the wall. The resolved wall is logistic, g' / (1 + exp((s - z)/a)) with z > 0 behind the
hard wall. There the solution of γ φ'' = w φ is a hypergeometric function, and φ appears to vanish
at s - a (2γ_E + ψ(ν) + ψ(1 + ν)), ν = a/ℓ', ℓ' = √(γ/g'), with Euler's constant γ_E and the
digamma function ψ. The shift s equates the two. As ℓ' does not matter then, it is at least half a
spacing, as a stronger wall needs a larger S; or a quarter, where walls are taken implicitly. The
match leaves out other forces: a cell squeezed so hard that its pressure M' (1 - v/V) is not small
against g' is let further out than by a hard wall, and one that begins beyond the wall comes back at
another speed. At half a spacing that is half of the embryo's error. γ is that of the cells' mean;
where cells differ, the wall of the others is off by some 0.1 µm.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from morphosim import _validate
from morphosim.geometry.confinement import Confinement
from morphosim.numerics.parameters import Numerics
from morphosim.physics.term import Conditions, Environment, Term

Floats = NDArray[np.float64]
Repulsion = Callable[[Floats, Floats, Floats], Floats]
DIFFUSENESS = 0.3
"""a of the logistic wall, in lattice spacings."""
STRONGEST = {"explicit": 4.0, "implicit": 16.0}
"""g' at most of a resolved wall, in γ/h²; by how the scheme takes it."""
SIGNIFICANT = 9
"""Digits of the mean surface tension that count, so that its rounding makes no new wall."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ConfinementRepulsion(Term):
    """- g_e φ φ_e², φ_e the confinement: 0 inside, 1 outside (Eq. 3).

    Attributes
    ----------
    g_e : float
        Strength.
    """

    g_e: float

    drifts = False
    label = "walls"

    def __post_init__(self) -> None:
        _validate.number("physics.g_e", self.g_e, least=0)

    @property
    def present(self) -> bool:
        """Whether walls repel."""
        return self.g_e > 0

    def surround(self, environment: Environment) -> None:
        """Add g_e φ_e² to R."""
        walls, numerics = environment.confinement, environment.numerics
        if walls is not None:
            gamma = float(f"{environment.tension:.{SIGNIFICANT}g}")
            function = wall_repulsion(walls, self.g_e, gamma, numerics)
            most = wall_strength(walls, self.g_e, gamma, numerics)
            environment.add_wall(self, function, walls, gamma, most=most)

    def explicit_rate(self, conditions: Conditions) -> float:
        """g_e φ_e² at most."""
        walls, numerics = conditions.confinement, conditions.numerics
        if walls is None or conditions.linearised:
            return 0.0
        return wall_strength(walls, self.g_e, conditions.mean_tension, numerics)


def wall_repulsion(
    confinement: Confinement, g_e: float, gamma: float, numerics: Numerics
) -> Repulsion:
    """g_e φ_e² as a function of points in µm.

    Walls that are soft in themselves (`width` > 0, images, functions) are taken as they are.

    Parameters
    ----------
    confinement : Confinement
    g_e : float
        Repulsion (Eq. 3).
    gamma : float
        Surface tension, the mean of the cells.
    numerics : Numerics
    """
    if not is_resolved(confinement, numerics):
        return lambda x, y, z: np.asarray(g_e * confinement.field(x, y, z) ** 2)
    strength = wall_strength(confinement, g_e, gamma, numerics)
    diffuseness = DIFFUSENESS * numerics.spacing
    hard, resolved_decay = (float(np.sqrt(gamma / g)) for g in (g_e, strength))
    shift = hard - resolved_decay + matching_shift(diffuseness, resolved_decay)

    def resolved(x: Floats, y: Floats, z: Floats) -> Floats:
        from scipy.special import expit

        depth = distance(confinement, x, y, z, 0.5 * numerics.spacing)
        return np.asarray(strength * expit(-(depth + shift) / diffuseness))

    return resolved


def is_resolved(confinement: Confinement, numerics: Numerics) -> bool:
    """Whether a hard wall is replaced by one that the lattice resolves."""
    return numerics.walls == "resolved" and getattr(confinement, "width", None) == 0


def wall_strength(confinement: Confinement, g_e: float, gamma: float, numerics: Numerics) -> float:
    """What g_e φ_e² is at most on the lattice: g', where the wall is resolved."""
    if not is_resolved(confinement, numerics):
        return g_e
    taken = "implicit" if numerics.scheme == "linearised" else "explicit"
    return min(g_e, STRONGEST[taken] * gamma / numerics.spacing**2)


def matching_shift(diffuseness: float, decay: float) -> float:
    """Place s of a logistic wall behind a hard one of the same strength that repels alike, µm.

    Parameters
    ----------
    diffuseness : a, µm
    decay : ℓ = √(γ/g_e), µm
    """
    from scipy.special import digamma

    ratio = diffuseness / decay
    return float(decay + diffuseness * (2 * np.euler_gamma + digamma(ratio) + digamma(1 + ratio)))


def distance(confinement: Confinement, x: Floats, y: Floats, z: Floats, step: float) -> Floats:
    """Distance to the wall to first order, depth / |∇depth|, positive inside, µm.

    The gradient is a central difference over 2 `step`; where it vanishes, deep inside, depth
    itself stands in.
    """
    depth = confinement.depth(x, y, z)
    ahead = (x + step, y, z), (x, y + step, z), (x, y, z + step)
    behind = (x - step, y, z), (x, y - step, z), (x, y, z - step)
    squares = sum(
        (confinement.depth(*p) - confinement.depth(*q)) ** 2
        for p, q in zip(ahead, behind, strict=True)
    )
    slope = np.sqrt(squares) / (2 * step)
    return np.asarray(depth / np.where(slope > 0.1, slope, 1.0))
