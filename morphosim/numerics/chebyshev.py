"""Chebyshev iterations towards the solution of (lhs - γΔ) φ = rhs: their number and weights."""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from morphosim.numerics.stencils import stencil_weights

CONVERGENCE = 0.6
"""Share of any error that the iterations of a step may leave."""
MORE_WITHOUT_HISTORY = 2
"""Iterations in addition, where there is no history to start from."""


@lru_cache(maxsize=64)
def largest_eigenvalue(order: int | str, spacing: float, interface_scale: float = 1.0) -> float:
    """Largest eigenvalue of -Δ by the stencil of this order, in three dimensions."""
    _, weights = stencil_weights(order, spacing * interface_scale)
    alternating = sum(w * (-1) ** m for m, w in enumerate(weights[1:], 1))
    return float(-3 * (weights[0] + 2 * alternating) / spacing**2)


def chebyshev_roots(
    lhs: float, interface: float, top: float, sweeps: int, left: float = CONVERGENCE
) -> NDArray[np.float64]:
    """Roots λ of the iterations' error polynomial Π (1 - a/λ) over eigenvalues a of lhs - γΔ.

    It is the Chebyshev polynomial of an interval that ends at lhs + `top` and begins such that its
    first root is lhs + `interface`: the eigenvalue of what iterations mostly correct, a moving
    interface. There the error vanishes; elsewhere no more than the share `left` is left.

    Parameters
    ----------
    lhs : float
    interface : float
        γ k² of the interface; with its tail exp(-√(2c) d), about γ c.
    top : float
        Largest eigenvalue of -γΔ.
    sweeps : int
        Least number of roots; more are taken where they are needed.
    left : float
    """
    high = lhs + top
    while True:
        share = 0.5 * (1 - np.cos(0.5 * np.pi / sweeps))
        low = (lhs + interface - share * high) / (1 - share)
        if low > 0:
            middle, half = 0.5 * (high + low), 0.5 * (high - low)
            if np.cosh(sweeps * np.arccosh(middle / half)) >= 1 / left:
                angles = np.pi * (np.arange(sweeps) + 0.5) / sweeps
                return np.asarray(middle - half * np.cos(angles))
        sweeps += 1
