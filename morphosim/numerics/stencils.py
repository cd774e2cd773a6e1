"""Weights of central differences: of an order, or fitted to the interface.

Orders are exact for polynomials, which no interface is. The weights "fitted" have the three points
of the sixth order and are exact to the second degree; what is left of their freedom makes the error
least for φ = (1 + tanh(z / w)) / 2 of several widths w about that of the double well, √(2/c), in
all directions. As the spacing goes to 0 they become those of the sixth order.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from morphosim.kernels.stencils import COEFFICIENTS, LAPLACIAN_COEFFICIENTS

Weights = tuple[float, ...]
Floats = NDArray[np.float64]
WIDTHS = np.linspace(0.75, 1.2, 10)
"""Of interfaces at rest, pressed and drawn out, in √(2/c)."""
COSINES = (np.arange(10) + 0.5) / 10
"""Of the angles between the axis of the differences and z: all directions alike."""
FAR = 8.0
"""Where a profile ends, in its widths."""
POINTS = 200
FINEST = 0.05
"""Spacing, in widths, below which rounding would tell; the sixth order is as good there."""


def stencil_weights(order: int | str, fineness: float) -> tuple[Weights, Weights]:
    """Weights of the first derivative, times 1/h, and of the second, times 1/h².

    Parameters
    ----------
    order : {2, 4, 6, "fitted"}
    fineness : float
        Lattice spacing h over the width of the interface, h √(c/2). Fitted weights depend on it.

    Returns
    -------
    first : of the points 1, 2, 3 steps away; they are odd
    second : of the points 0, 1, 2, 3 steps away
    """
    if isinstance(order, str):
        if fineness >= FINEST:
            return _fitted(fineness)
        order = 6
    return COEFFICIENTS[order], LAPLACIAN_COEFFICIENTS[order]


@lru_cache(maxsize=16)
def _fitted(h: float) -> tuple[Weights, Weights]:
    """Fitted weights for a spacing in widths of the interface."""
    place, width, cosine = np.meshgrid(np.linspace(-FAR, FAR, POINTS), WIDTHS, COSINES)
    step = h * cosine / width

    def profile(steps: int) -> Floats:
        return np.asarray(0.5 * (1 + np.tanh(place + steps * step)))

    phi = profile(0)
    slope = 2 * phi * (1 - phi) * step
    curvature = 2 * slope * (1 - 2 * phi) * step
    odd = [profile(m) - profile(-m) for m in (1, 2, 3)]
    even = [profile(m) + profile(-m) - 2 * phi for m in (1, 2, 3)]
    c2, c3 = _least_squares(odd, (2, 3), slope - odd[0] / 2)
    l2, l3 = _least_squares(even, (4, 9), curvature - even[0])
    l1 = 1 - 4 * l2 - 9 * l3
    return (0.5 - 2 * c2 - 3 * c3, c2, c3), (-2 * (l1 + l2 + l3), l1, l2, l3)


def _least_squares(
    terms: list[Floats], powers: tuple[int, int], wanted: Floats
) -> tuple[float, float]:
    """Weights of the last two terms, where the first has what makes polynomials exact."""
    first, *others = terms
    a, b = (term - power * first for term, power in zip(others, powers, strict=True))
    aa, ab, bb, aw, bw = (float(np.sum(x)) for x in (a * a, a * b, b * b, a * wanted, b * wanted))
    determinant = aa * bb - ab * ab
    return (aw * bb - bw * ab) / determinant, (bw * aa - aw * ab) / determinant
