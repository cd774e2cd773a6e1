"""The implicit step on the narrow band: Chebyshev iterations of (lhs - γΔ) u = r, no transforms.

One iteration is u ← u + ω (r - lhs u + γΔu). The 1/ω of a step's iterations are the roots of a
Chebyshev polynomial, so that together they reduce every error (`numerics.chebyshev`). Outside of
the band u is 0.
"""

import numpy as np

from morphosim.kernels._jit import kernel
from morphosim.kernels.frames import run, strides
from morphosim.kernels.stencils import weighted_neighbours


@kernel()
def iterate_plane(low, high, source, target, rhs, sx, sy, own, diffusion, weight, stencil):
    """`iterate` along one run of the frames; `own` is 1 - ω (lhs - 3 γ l0), `diffusion` is ω γ."""
    l1, l2, l3 = stencil.l1, stencil.l2, stencil.l3
    sz = np.uint64(1)
    for p in range(low, high):
        around = weighted_neighbours(source, p, sx, sy, sz, l1, l2, l3)
        target[p] = weight * rhs[p] + own * source[p] + diffusion * around


@kernel()
def iterate(i, boxes, source, target, rhs, stencil, lhs, gamma, weight, one):
    """One iteration over cell i: target = source + ω (rhs - lhs source + γΔ source).

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
        iterate_plane(
            low, high, source, target, rhs, np.uint64(sx), np.uint64(sy), own, diffusion, weight,
            stencil,
        )  # fmt: skip
