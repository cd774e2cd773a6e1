"""How stiff a force of second derivatives of φ is that is taken beside γΔφ."""

from morphosim.numerics.chebyshev import largest_eigenvalue
from morphosim.physics.term import Conditions

FREE = 1 / 3
"""Share of γΔφ that may be explicit beside an implicit γΔφ and needs no S: φⁿ⁺¹ = -φⁿ in Eq. 9
gives 3 f = 4 τ/δt + 4 S + γ k²."""
FLATTEST = 1e-6
"""Square of a slope, 1/µm², below which a surface faces nowhere: the steepest is c/8."""


def explicit_rate(share: float, conditions: Conditions) -> float:
    """Rate of the finest waves along one direction, where it is more than γΔφ makes up for.

    Parameters
    ----------
    share : float
        Second derivatives by that direction are taken so many times γ, explicitly.
    conditions : Conditions
    """
    if conditions.linearised:  # which has `Term.stiffening`
        return 0.0
    numerics = conditions.numerics
    beyond = share - (FREE if numerics.scheme != "euler" else 0.0)
    finest = largest_eigenvalue(numerics.order, numerics.spacing, conditions.interface_scale)
    return float(conditions.tensions.max()) * max(beyond, 0.0) * finest / 3
