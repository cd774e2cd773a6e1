"""Time integration: coefficients of the schemes (Eq. 6, 8, 9, Supplementary Note 2).

Every implicit scheme here is (lhs - γΔ) φⁿ⁺¹ = a0 φⁿ + a1 Fⁿ + Hⁿ with Hⁿ⁺¹ = b0 φⁿ + b1 Fⁿ, so
that one history array H carries all that Eq. 9 needs of φⁿ⁻¹ and Fⁿ⁻¹.

The "band" solver iterates towards φⁿ⁺¹ from e0 φⁿ + e1 (Hⁿ + Fⁿ). With history that is
2 φⁿ - φⁿ⁻¹ + (Fⁿ - Fⁿ⁻¹) / (τ / 2δt + S), close to the extrapolation 2 φⁿ - φⁿ⁻¹, and costs no
memory. Without history it is φⁿ, and takes more iterations. Explicit Euler is one iteration of
weight δt/τ from φⁿ with lhs = 0 and the right-hand side F.
"""

import numpy as np

from morphosim.numerics.chebyshev import largest_eigenvalue
from morphosim.numerics.parameters import Numerics

SHARES = {"bdf2": 0.75, "imex1": 0.5, "linearised": 1.05}
"""S per rate of what is explicit, by scheme; "euler" has no S."""
SHIFT = 0.4
"""∫ φ''² / ∫ φ'² in c, of the interface's profile: what -Δ is for a shift of it, and what an
explicit double well adds to S, in γ c."""
SOLVED_ORDER = 2
"""Order of the Laplacian that "linearised" takes implicitly, in its iterations. Forces have that of
the numerics: a higher one gains nothing here, and takes more iterations of twice the work."""
LEFT = 0.3
"""Share ε of u that these iterations may leave. Of D, which is implicit at each point, forces at
the extrapolation have the explicit part: φⁿ⁺¹ = -φⁿ does not grow if 4 D > 3 (1 + ε) D."""


def stabilisation(rate: float, dt: float, tau: float, scheme: str = "bdf2") -> float:
    """Least S with which what is taken explicitly does not flip φ from step to step and grow.

    φⁿ⁺¹ = -φⁿ in Eq. 9, or in Eq. 8, with the force -f φ and no diffusion gives ¾ f - τ/δt, or
    ½ f - τ/δt. "linearised" extrapolates as Eq. 9 does; what it takes implicitly is no part of f.

    Parameters
    ----------
    rate : float
        f: explicit forces relax φ at the rate f / τ, see `scene.stability`.
    dt, tau : float
        Step δt and viscosity τ.
    scheme : str
        See `Numerics`; 0 for "euler", which has no S.
    """
    return max(0.0, SHARES[scheme] * rate - tau / dt) if scheme in SHARES else 0.0


def used_S(numerics: Numerics, tau: float, rate: float, dt: float | None = None) -> float:
    """S of a step, by default of δt: what the numerics say, else what the explicit rate needs."""
    if numerics.S is not None:
        return numerics.S
    return stabilisation(rate, numerics.dt if dt is None else dt, tau, numerics.scheme)


def diffusion(
    numerics: Numerics, c: float, tau: float, rate: float, dt: float, tension: float,
    stiffening: float = 0.0,
) -> float:  # fmt: skip
    """Diffusion s of "linearised", which takes -(γ + s) Δ implicitly.

    The tail of an interface is damped as by S. It is no less than what the finest waves need, of
    which the Laplacian of the forces makes more than that of the iterations: with Λ and Λ₂ for -Δ
    by the two, and ε for what these leave (`LEFT`), φⁿ⁺¹ = -φⁿ does not grow if
    4 (γ + s) Λ₂ > 3 (1 + ε) (1 + χ) γ Λ.

    Parameters
    ----------
    numerics : Numerics
    c : float
        Strength of the double well.
    tau, rate, dt : float
        See `used_S`.
    tension : float
        γ, the largest of the cells.
    stiffening : float
        χ, by which other terms raise γΔ.
    """
    forces, solved = (
        largest_eigenvalue(order, numerics.spacing, np.sqrt(c / 2))
        for order in (numerics.order, SOLVED_ORDER)
    )
    least = tension * (0.75 * (1 + LEFT) * (1 + stiffening) * forces / solved - 1)
    return max(used_S(numerics, tau, rate, dt) / (2 * c), least)


def coefficients(numerics: Numerics, tau: float, S: float, first: bool) -> dict[str, float]:
    """lhs, a0, a1, b0, b1, e0, e1 of one step.

    Parameters
    ----------
    numerics : Numerics
    tau : float
        Viscosity τ.
    S : float
        Stabilisation, see `used_S`.
    first : bool
        Whether the scheme has no history yet; "bdf2" then takes a step by Eq. 8.
    """
    rate = tau / numerics.dt
    if numerics.scheme == "euler":
        return {"lhs": 0.0, "a0": 0.0, "a1": 1.0, "b0": 0.0, "b1": 0.0, "e0": 1.0, "e1": 0.0}
    if numerics.scheme == "linearised":
        lhs = rate if first else 1.5 * rate
        return {"lhs": lhs} | dict.fromkeys(("a0", "a1", "b0", "b1", "e0", "e1"), 0.0)
    history = {"b0": -(rate / 2 + S), "b1": -1.0}
    if numerics.scheme == "bdf2" and not first:
        extrapolation = {"e0": 2.0, "e1": 1 / (rate / 2 + S)}
        return {"lhs": 1.5 * rate + S, "a0": 2 * rate + 2 * S, "a1": 2.0} | history | extrapolation
    if numerics.scheme == "bdf2" and numerics.start_S is not None:
        S = numerics.start_S
    return {"lhs": rate + S, "a0": rate + S, "a1": 1.0, "e0": 1.0, "e1": 0.0} | history
