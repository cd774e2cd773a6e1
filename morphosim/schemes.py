"""Time integration: coefficients of the schemes (Eq. 6, 8, 9, Supplementary Note 2).

Every implicit scheme here is (lhs - γΔ) φⁿ⁺¹ = a0 φⁿ + a1 Fⁿ + Hⁿ with Hⁿ⁺¹ = b0 φⁿ + b1 Fⁿ, so
that one history array H carries all that Eq. 9 needs of φⁿ⁻¹ and Fⁿ⁻¹.

The "band" solver sweeps towards φⁿ⁺¹ from e0 φⁿ + e1 (Hⁿ + Fⁿ). With history that is
2 φⁿ - φⁿ⁻¹ + (Fⁿ - Fⁿ⁻¹) / (τ / 2δt + S), close to the extrapolation 2 φⁿ - φⁿ⁻¹, and costs no
memory. Without history it is φⁿ, and takes more sweeps. Explicit Euler is one sweep of weight δt/τ
from φⁿ with lhs = 0 and the right-hand side F.
"""

import numpy as np
from numpy.typing import NDArray

from morphosim.kernels.stencils import LAPLACIAN_COEFFICIENTS
from morphosim.numerics import Numerics

CONVERGENCE = 0.6
"""Least reduction of every error by the sweeps of a step."""
MORE_WITHOUT_HISTORY = 2
"""Sweeps in addition, where there is no history to start from."""


def coefficients(numerics: Numerics, tau: float, first: bool) -> dict[str, float]:
    """lhs, a0, a1, b0, b1, e0, e1 of one step.

    Parameters
    ----------
    numerics : Numerics
    tau : float
        Viscosity τ.
    first : bool
        Whether the scheme has no history yet; "bdf2" then takes a step by Eq. 8.
    """
    rate, S = tau / numerics.dt, numerics.S
    if numerics.scheme == "euler":
        return {"lhs": 0.0, "a0": 0.0, "a1": 1.0, "b0": 0.0, "b1": 0.0, "e0": 1.0, "e1": 0.0}
    history = {"b0": -(rate / 2 + S), "b1": -1.0}
    if numerics.scheme == "bdf2" and not first:
        extrapolation = {"e0": 2.0, "e1": 1 / (rate / 2 + S)}
        return {"lhs": 1.5 * rate + S, "a0": 2 * rate + 2 * S, "a1": 2.0} | history | extrapolation
    if numerics.scheme == "bdf2" and numerics.start_S is not None:
        S = numerics.start_S
    return {"lhs": rate + S, "a0": rate + S, "a1": 1.0, "e0": 1.0, "e1": 0.0} | history


def largest_eigenvalue(order: int, spacing: float) -> float:
    """Largest eigenvalue of -Δ by the stencil of this order, in three dimensions."""
    weights = LAPLACIAN_COEFFICIENTS[order]
    alternating = sum(w * (-1) ** m for m, w in enumerate(weights[1:], 1))
    return float(-3 * (weights[0] + 2 * alternating) / spacing**2)


def sweep_roots(lhs: float, interface: float, top: float, sweeps: int) -> NDArray[np.float64]:
    """Roots λ of the error polynomial Π (1 - a/λ) of the sweeps over eigenvalues a of lhs - γΔ.

    It is the Chebyshev polynomial of an interval that ends at lhs + `top` and begins such that its
    first root is lhs + `interface`: the eigenvalue of what the sweeps mostly correct, a moving
    interface. There the error vanishes; elsewhere it is reduced at least by `CONVERGENCE`.

    Parameters
    ----------
    lhs : float
    interface : float
        γ k² of the interface; with its tail exp(-√(2c) d), about γ c.
    top : float
        Largest eigenvalue of -γΔ.
    sweeps : int
        Least number of roots; more are taken where they are needed.
    """
    high = lhs + top
    while True:
        share = 0.5 * (1 - np.cos(0.5 * np.pi / sweeps))
        low = (lhs + interface - share * high) / (1 - share)
        if low > 0:
            middle, half = 0.5 * (high + low), 0.5 * (high - low)
            if np.cosh(sweeps * np.arccosh(middle / half)) >= 1 / CONVERGENCE:
                angles = np.pi * (np.arange(sweeps) + 0.5) / sweeps
                return np.asarray(middle - half * np.cos(angles))
        sweeps += 1
