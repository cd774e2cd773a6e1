"""The implicit step of one box: (a + γ k²) φ̂ = r̂ by cosine transforms (DCT-II, orthonormal).

The transforms here are products with dense cosine matrices, done by BLAS. `transform` takes the
axes (x, y, z) to (k_z, k_y, k_x): applied again with the inverse matrices it restores their order.
Products are cut into blocks, because OpenBLAS multiplies small matrices (M N K up to 10⁶) without
packing them first, at about twice the speed.
"""

import numpy as np

from morphosim.kernels._jit import kernel

SMALL_PRODUCT = 1_000_000
COLUMNS = 64


@kernel()
def cosine_matrix(cosines, n, inverse):
    """View of the n × n matrix [x, k] of the transform, or [k, x] of its inverse."""
    first = cosines.matrix_index[n] + (n * n if inverse else 0)
    return cosines.matrices[first : first + n * n].reshape(n, n)


@kernel()
def transform_last(source, target, rows, n, matrix):
    """Transform the last axis: (rows, n) to (rows, k)."""
    a = source[: rows * n].reshape(rows, n)
    b = target[: rows * n].reshape(rows, n)
    step = max(16, SMALL_PRODUCT // (n * n) // 16 * 16)
    for r in range(0, rows, step):
        np.dot(a[r : r + step], matrix, b[r : r + step])


@kernel()
def transform_middle(source, target, slabs, n, m, matrix):
    """Transform the middle axis and swap it with the last: (slabs, n, m) to (slabs, m, k)."""
    a = source[: slabs * n * m].reshape(slabs, n, m)
    b = target[: slabs * n * m].reshape(slabs, m, n)
    for s in range(slabs):
        np.dot(a[s].T, matrix, b[s])


@kernel()
def transform_first(source, target, n, rest, matrix, spare):
    """Transform the first axis and move it to the end: (n, rest) to (rest, k)."""
    b = target[: rest * n].reshape(rest, n)
    for r in range(0, rest, COLUMNS):
        width = min(COLUMNS, rest - r)
        block = spare[: n * width].reshape(n, width)
        for x in range(n):
            for k in range(width):
                block[x, k] = source[x * rest + r + k]
        np.dot(block.T, matrix, b[r : r + width])


@kernel()
def transform(source, target, nx, ny, nz, cosines, inverse, spare):
    """DCT-II or its inverse along all axes: (x, y, z) in `source` to (z, y, x) in `target`.

    Overwrites both arrays; `spare` holds at least COLUMNS times the longest axis.
    """
    transform_last(source, target, nx * ny, nz, cosine_matrix(cosines, nz, inverse))
    transform_middle(target, source, nx, ny, nz, cosine_matrix(cosines, ny, inverse))
    transform_first(source, target, nx, nz * ny, cosine_matrix(cosines, nx, inverse), spare)


@kernel()
def divide_by_symbol(spectrum, nx, ny, nz, cosines, lhs, gamma):
    """Divide by lhs + γ (λx + λy + λz), the symbol of lhs - γΔ."""
    symbols, index = cosines.symbols, cosines.symbol_index
    for x in range(nx):
        for y in range(ny):
            base = lhs + gamma * (symbols[index[nx] + x] + symbols[index[ny] + y])
            row = np.uint64((x * ny + y) * nz)
            first = np.uint64(index[nz])
            for z in range(np.uint64(nz)):
                spectrum[row + z] /= base + gamma * symbols[first + z]


@kernel()
def helmholtz_solve(work, other, spare, nx, ny, nz, cosines, lhs, gamma):
    """Replace `work` by (lhs - γΔ)⁻¹ of it, with Neumann faces.

    Parameters
    ----------
    work : 1-D, box of nx × ny × nz points, replaced by the solution
    other : 1-D, as long as `work`, overwritten
    spare : 1-D, at least COLUMNS times the longest axis, overwritten
    cosines : Cosines
    lhs, gamma : scalars in the type of the fields
    """
    transform(work, other, nx, ny, nz, cosines, False, spare)
    divide_by_symbol(other, nz, ny, nx, cosines, lhs, gamma)
    transform(other, work, nz, ny, nx, cosines, True, spare)
