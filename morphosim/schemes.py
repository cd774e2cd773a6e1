"""Time integration: coefficients of the schemes (Eq. 6, 8, 9, Supplementary Note 2).

Every implicit scheme here is (lhs - γΔ) φⁿ⁺¹ = a0 φⁿ + a1 Fⁿ + Hⁿ with Hⁿ⁺¹ = b0 φⁿ + b1 Fⁿ, so
that one history array H carries all that Eq. 9 needs of φⁿ⁻¹ and Fⁿ⁻¹.
"""

from morphosim.numerics import Numerics


def coefficients(numerics: Numerics, tau: float, first: bool) -> dict[str, float]:
    """lhs, a0, a1, b0, b1 of one step.

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
        return {"lhs": 0.0, "a0": 1.0, "a1": 1 / rate, "b0": 0.0, "b1": 0.0}
    history = {"b0": -(rate / 2 + S), "b1": -1.0}
    if numerics.scheme == "bdf2" and not first:
        return {"lhs": 1.5 * rate + S, "a0": 2 * rate + 2 * S, "a1": 2.0} | history
    if numerics.scheme == "bdf2" and numerics.start_S is not None:
        S = numerics.start_S
    return {"lhs": rate + S, "a0": rate + S, "a1": 1.0} | history
