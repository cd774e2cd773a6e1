"""Weights of central differences, as the kernels take them."""

import numpy as np

from morphosim.kernels.layout import Stencil
from morphosim.kernels.stencils import COEFFICIENTS, LAPLACIAN_COEFFICIENTS


def make_stencil(order: int, spacing: float, dtype: np.dtype) -> Stencil:
    """Stencil of an order, for a lattice spacing in µm and fields of this type."""
    first = [dtype.type(w / spacing) for w in COEFFICIENTS[order]]
    second = [dtype.type(w / spacing**2) for w in LAPLACIAN_COEFFICIENTS[order]]
    absent = [None] * (3 - order // 2)
    return Stencil(*first, *absent, *second, *absent)
