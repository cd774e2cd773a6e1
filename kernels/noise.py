"""Counter-based Gaussian numbers: the same cell, step and seed give the same numbers.

Philox4x32-10 (Salmon, Moraes, Dror & Shaw 2011, doi:10.1145/2063384.2063405) with Box-Muller.
"""

import math

import numpy as np

from morphosim.kernels._jit import kernel

_M0 = np.uint64(0xD2511F53)
_M1 = np.uint64(0xCD9E8D57)
_W0 = np.uint64(0x9E3779B9)
_W1 = np.uint64(0xBB67AE85)
_LOW = np.uint64(0xFFFFFFFF)
_BITS = np.uint64(32)


@kernel()
def philox(c0, c1, c2, c3, k0, k1):
    """Ten rounds of Philox4x32; all arguments and results are uint64 below 2³²."""
    for _ in range(10):
        p0 = _M0 * c0
        p1 = _M1 * c2
        c0, c1, c2, c3 = (p1 >> _BITS) ^ c1 ^ k0, p1 & _LOW, (p0 >> _BITS) ^ c3 ^ k1, p0 & _LOW
        k0 = (k0 + _W0) & _LOW
        k1 = (k1 + _W1) & _LOW
    return c0, c1, c2, c3


@kernel()
def normal_vectors(seed, step, cells, out):
    """Three standard normal numbers per cell.

    Parameters
    ----------
    seed, step : uint64
    cells : (N,) uint64, identifiers of the cells
    out : (N, 3) float64, overwritten
    """
    scale = 1.0 / 4294967296.0
    for i in range(cells.shape[0]):
        r = philox(
            cells[i] & _LOW, cells[i] >> _BITS, step & _LOW, step >> _BITS,
            seed & _LOW, seed >> _BITS,
        )  # fmt: skip
        radius = math.sqrt(-2.0 * math.log((r[0] + 0.5) * scale))
        angle = 2.0 * math.pi * (r[1] + 0.5) * scale
        out[i, 0] = radius * math.cos(angle)
        out[i, 1] = radius * math.sin(angle)
        radius = math.sqrt(-2.0 * math.log((r[2] + 0.5) * scale))
        out[i, 2] = radius * math.cos(2.0 * math.pi * (r[3] + 0.5) * scale)
