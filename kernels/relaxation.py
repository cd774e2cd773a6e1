"""The implicit step on the band: sweeps towards (lhs - γΔ) u = r, no transforms.

A sweep is u ← u + ω (r - lhs u + γΔu). The weights 1/ω of the sweeps of a step are the roots of a
Chebyshev polynomial, so that together they reduce every error (`schemes.sweep_roots`). Outside of
the band u is 0.
"""

import numpy as np

from morphosim.kernels._jit import kernel
from morphosim.kernels.frames import run, strides
from morphosim.kernels.stencils import weighted_neighbours


@kernel()
def plane_sweep(low, high, source, target, rhs, sx, sy, own, l1, l2, l3, weight):
    """`sweep` along one run of the frames; `own` is 1 - ω (lhs - 3 γ l0), l1 … l3 hold ω γ."""
    sz = np.uint64(1)
    for p in range(low, high):
        target[p] = (
            weight * rhs[p]
            + own * source[p]
            + weighted_neighbours(source, p, sx, sy, sz, l1, l2, l3)
        )  # fmt: skip


@kernel()
def scaled(factor, weight):
    """Product, or None."""
    if weight is None:
        return None
    return factor * weight


@kernel()
def sweep(i, boxes, source, target, rhs, stencil, lhs, gamma, weight, one):
    """One sweep over cell i: target = source + ω (rhs - lhs source + γΔ source).

    Parameters
    ----------
    i : int
    boxes, stencil : Boxes, Stencil
    source, target, rhs : frames; `target` is overwritten on the band
    lhs, gamma, weight, one : scalars in the type of the fields: lhs, γ, ω, 1
    """
    sx, sy = strides(i, boxes)
    factor = weight * gamma
    own = one - weight * lhs + (factor + factor + factor) * stencil.l0
    l1, l2, l3 = (
        scaled(factor, stencil.l1), scaled(factor, stencil.l2), scaled(factor, stencil.l3)
    )  # fmt: skip
    for x in range(boxes.shape[i, 0]):
        low, high = run(x, i, boxes, False, sx, sy)
        plane_sweep(
            low, high, source, target, rhs, np.uint64(sx), np.uint64(sy), own, l1, l2, l3, weight
        )
