"""Central differences on flat, row-major arrays.

All indices are unsigned: an unsigned index needs no check for negative wrap-around, which would
keep the loops from being vectorised.
"""

import numpy as np

from morphosim.kernels._jit import inline_kernel

COEFFICIENTS = {
    2: (1 / 2,),
    4: (2 / 3, -1 / 12),
    6: (3 / 4, -3 / 20, 1 / 60),
}
"""First-derivative weights of the points 1, 2, 3 steps away, by order; times 1/h."""

LAPLACIAN_COEFFICIENTS = {
    2: (-2.0, 1.0),
    4: (-5 / 2, 4 / 3, -1 / 12),
    6: (-49 / 18, 3 / 2, -3 / 20, 1 / 90),
}
"""Second-derivative weights of the points 0, 1, 2, 3 steps away, by order; times 1/h²."""


@inline_kernel()
def derivative(field, index, stride, c1, c2, c3):
    """First derivative of `field` at `index` along the axis of `stride`.

    `c2` and `c3` are None for stencils that do not have them; the branches then vanish.
    """
    value = c1 * (field[index + stride] - field[index - stride])
    if c2 is not None:
        value += c2 * (field[index + stride + stride] - field[index - stride - stride])
    if c3 is not None:
        three = stride + stride + stride
        value += c3 * (field[index + three] - field[index - three])
    return value


@inline_kernel()
def around(field, index, sx, sy, sz):
    """Sum of `field` at the six points that are one such step away from `index`."""
    return (
        (field[index + sx] + field[index - sx])
        + (field[index + sy] + field[index - sy])
        + (field[index + sz] + field[index - sz])
    )


@inline_kernel()
def weighted_neighbours(field, index, sx, sy, sz, l1, l2, l3):
    """The part of Δ `field` at `index` that its neighbours make; 3 `l0` times itself is the rest.

    `l2` and `l3` are None for stencils that do not have them.
    """
    value = l1 * around(field, index, sx, sy, sz)
    if l2 is not None:
        value += l2 * around(field, index, sx + sx, sy + sy, sz + sz)
    if l3 is not None:
        value += l3 * around(field, index, sx + sx + sx, sy + sy + sy, sz + sz + sz)
    return value


@inline_kernel()
def second_derivative(field, index, stride, l0, l1, l2, l3):
    """Second derivative of `field` at `index` along the axis of `stride`.

    `l2` and `l3` are None for stencils that do not have them.
    """
    value = l0 * field[index] + l1 * (field[index + stride] + field[index - stride])
    if l2 is not None:
        two = stride + stride
        value += l2 * (field[index + two] + field[index - two])
    if l3 is not None:
        three = stride + stride + stride
        value += l3 * (field[index + three] + field[index - three])
    return value


@inline_kernel()
def corners(field, index, s, t):
    """Those of the same sign less those of different signs, of the four points s and t away."""
    return (field[index + s + t] + field[index - s - t]) - (
        field[index + s - t] + field[index - s + t]
    )


@inline_kernel()
def mixed_derivative(field, index, s, t, l1, l2, l3):
    """Derivative of `field` at `index` by the axes of two strides.

    The points (k, k) and its like give it with an error of k² e₂ + k⁴ e₄ + …, as the points k do
    for a second derivative; so the weights that cancel these errors there do so here, over 4.
    """
    value = l1 * corners(field, index, s, t)
    if l2 is not None:
        value += l2 * corners(field, index, s + s, t + t)
    if l3 is not None:
        value += l3 * corners(field, index, s + s + s, t + t + t)
    return value * np.float32(0.25)


@inline_kernel()
def second_derivatives(field, index, sx, sy, stencil):
    """Second derivatives of `field` at `index`, by xx, yy, zz, xy, xz, yz."""
    sz, l0, l1, l2, l3 = np.uint64(1), stencil.l0, stencil.l1, stencil.l2, stencil.l3
    return (
        second_derivative(field, index, sx, l0, l1, l2, l3),
        second_derivative(field, index, sy, l0, l1, l2, l3),
        second_derivative(field, index, sz, l0, l1, l2, l3),
        mixed_derivative(field, index, sx, sy, l1, l2, l3),
        mixed_derivative(field, index, sx, sz, l1, l2, l3),
        mixed_derivative(field, index, sy, sz, l1, l2, l3),
    )
