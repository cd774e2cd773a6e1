"""Weights of central differences, as the kernels take them."""

import numpy as np

from morphosim.kernels.layout import Stencil
from morphosim.numerics.stencils import stencil_weights


def make_stencil(
    order: int | str, spacing: float, dtype: np.dtype, interface_scale: float = 1.0
) -> Stencil:
    """Stencil for a lattice spacing in µm and fields of this type; see `stencil_weights`."""
    odd, even = stencil_weights(order, spacing * interface_scale)
    first = [dtype.type(w / spacing) for w in odd]
    second = [dtype.type(w / spacing**2) for w in even]
    absent = [None] * (3 - len(odd))
    return Stencil(*first, *absent, *second, *absent)
