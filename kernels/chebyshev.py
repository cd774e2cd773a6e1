"""The implicit step on the narrow band: Chebyshev iterations of (lhs - γΔ) u = r, no transforms.

One iteration is u ← u + ω (r - lhs u + γΔu). The 1/ω of a step's iterations are the roots of a
Chebyshev polynomial, so that together they reduce every error (`numerics.chebyshev`). Outside of
the band u is 0.
"""

import numpy as np

from morphosim.kernels._jit import kernel
from morphosim.kernels.frames import strides
from morphosim.kernels.rows import BLOCK, FRAME, STRETCH
from morphosim.kernels.stencils import weighted_neighbours


@kernel()
def iterate_blocks(
    blocks, n, where, source, target, rhs, sx, sy, own, diffusion, weight, stencil
):  # fmt: skip
    """`iterate`; `own` is 1 - ω (lhs - 3 γ l0), `diffusion` is ω γ."""
    l1, l2, l3 = stencil.l1, stencil.l2, stencil.l3
    sz = np.uint64(1)
    for k in range(n):
        first, place = np.uint64(blocks[FRAME, k]), np.uint64(blocks[STRETCH, k])
        goal = np.uint64(blocks[where, k])
        for j in range(np.uint64(BLOCK)):
            around = weighted_neighbours(source, first + j, sx, sy, sz, l1, l2, l3)
            target[goal + j] = (
                weight * rhs[place + j] + own * source[first + j] + diffusion * around
            )


@kernel()
def iterate(i, boxes, blocks, n, where, source, target, rhs, stencil, lhs, gamma, weight, one):
    """One iteration over cell i: target = source + ω (rhs - lhs source + γΔ source).

    Parameters
    ----------
    i : int
    boxes, stencil : Boxes, Stencil
    blocks, n : those of the band
    where : `FRAME` or `STRETCH`, in what order the target is
    source : frame
    target : frame, or stretch; overwritten on the band
    rhs : stretch
    lhs, gamma, weight, one : scalars in the type of the fields: lhs, γ, ω, 1
    """
    sx, sy = strides(i, boxes)
    diffusion = weight * gamma
    own = one - weight * lhs + (diffusion + diffusion + diffusion) * stencil.l0
    iterate_blocks(
        blocks, n, where, source, target, rhs, np.uint64(sx), np.uint64(sy), own, diffusion, weight,
        stencil,
    )  # fmt: skip
