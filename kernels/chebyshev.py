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
def plane_sweep(low, high, source, target, rhs, sx, sy, own, diffusion, weight, stencil):
    """`sweep` along one run of the frames; `own` is 1 - ω (lhs - 3 γ l0), `diffusion` is ω γ."""
    l1, l2, l3 = stencil.l1, stencil.l2, stencil.l3
    sz = np.uint64(1)
    for p in range(low, high):
        around = weighted_neighbours(source, p, sx, sy, sz, l1, l2, l3)
        target[p] = weight * rhs[p] + own * source[p] + diffusion * around


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
    diffusion = weight * gamma
    own = one - weight * lhs + (diffusion + diffusion + diffusion) * stencil.l0
    for x in range(boxes.shape[i, 0]):
        low, high = run(x, i, boxes, False, sx, sy)
        plane_sweep(
            low, high, source, target, rhs, np.uint64(sx), np.uint64(sy), own, diffusion, weight,
            stencil,
        )  # fmt: skip
