"""How strongly a confinement repels at lattice points: g_e φ_e² of Eq. 3.

A hard wall is 0 or 1 from one lattice point to the next, so on the lattice its place is uncertain
by half a spacing. `numerics.walls = "resolved"` replaces it by a logistic wall that the lattice can
resolve, shifted so that it repels as the hard one does: behind a hard wall φ decays over
ℓ = √(γ/g_e), so from inside φ appears to vanish at ℓ behind the wall. For a logistic wall
g_e / (1 + exp((z - s)/a)), z > 0 behind the wall, the solution of γ φ'' = g_e φ_e² φ is a
hypergeometric function, and φ appears to vanish at s - a (2γ_E + ψ(ν) + ψ(1 + ν)), ν = a/ℓ, with
Euler's constant γ_E and the digamma function ψ. Equating the two gives the shift s.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from morphosim.confinement import Confinement
from morphosim.numerics import Numerics
from morphosim.physics import Physics

Floats = NDArray[np.float64]
Repulsion = Callable[[Floats, Floats, Floats], Floats]
DIFFUSENESS = 0.3
"""a of the logistic wall, in lattice spacings."""


def wall_repulsion(confinement: Confinement, physics: Physics, numerics: Numerics) -> Repulsion:
    """g_e φ_e² as a function of points in µm.

    Walls that are soft in themselves (`width` > 0, images, functions) are taken as they are.
    """
    g_e = physics.g_e
    if numerics.walls == "stepped" or getattr(confinement, "width", None) != 0:
        return lambda x, y, z: np.asarray(g_e * confinement.field(x, y, z) ** 2)
    diffuseness = DIFFUSENESS * numerics.spacing
    shift = matching_shift(diffuseness, float(np.sqrt(physics.gamma / g_e)))

    def resolved(x: Floats, y: Floats, z: Floats) -> Floats:
        from scipy.special import expit

        depth = distance(confinement, x, y, z, 0.5 * numerics.spacing)
        return np.asarray(g_e * expit(-(depth + shift) / diffuseness))

    return resolved


def matching_shift(diffuseness: float, decay: float) -> float:
    """How far behind the hard wall the logistic one lies to repel alike, µm.

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
