"""The implicit step of one box: (a + γ k²) φ̂ = r̂ by cosine transforms (DCT-II, orthonormal).

The transforms here are products with dense cosine matrices, done by BLAS. A box is transformed by
three products, each of which transforms the first axis and moves it to the end:
(x, y, z) → (y, z, k) → (z, k, l) → (k, l, m). Two work arrays take turns.
"""

import numpy as np

from morphosim.kernels._jit import kernel


@kernel()
def rotate_product(source, target, n, rest, matrix):
    """target[rest, k] = Σ_x source[x, rest] matrix[x, k] on flat arrays of n · rest points."""
    size = n * rest
    np.dot(source[:size].reshape(n, rest).T, matrix, target[:size].reshape(rest, n))


@kernel()
def cosine_matrix(cosines, n, inverse):
    """View of the n × n matrix [x, k] of the transform, or [k, x] of its inverse."""
    first = cosines.matrix_index[n] + (n * n if inverse else 0)
    return cosines.matrices[first : first + n * n].reshape(n, n)


@kernel()
def transform(source, target, nx, ny, nz, cosines, inverse):
    """DCT-II along all axes, or its inverse; overwrites both arrays, the result is in `target`."""
    rotate_product(source, target, nx, ny * nz, cosine_matrix(cosines, nx, inverse))
    rotate_product(target, source, ny, nz * nx, cosine_matrix(cosines, ny, inverse))
    rotate_product(source, target, nz, nx * ny, cosine_matrix(cosines, nz, inverse))


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
def multiply_by_symbol(spectrum, nx, ny, nz, cosines, factor):
    """Multiply by factor · (λx + λy + λz); with factor = -γ this is γΔ."""
    symbols, index = cosines.symbols, cosines.symbol_index
    for x in range(nx):
        for y in range(ny):
            base = symbols[index[nx] + x] + symbols[index[ny] + y]
            row = np.uint64((x * ny + y) * nz)
            first = np.uint64(index[nz])
            for z in range(np.uint64(nz)):
                spectrum[row + z] *= factor * (base + symbols[first + z])


@kernel()
def helmholtz_solve(work, other, nx, ny, nz, cosines, lhs, gamma):
    """Work = (lhs - γΔ)⁻¹ work with Neumann faces; `other` is work space."""
    transform(work, other, nx, ny, nz, cosines, False)
    divide_by_symbol(other, nx, ny, nz, cosines, lhs, gamma)
    transform(other, work, nx, ny, nz, cosines, True)


@kernel()
def laplacian(work, other, nx, ny, nz, cosines, gamma):
    """Work = γΔ work with Neumann faces; `other` is work space."""
    transform(work, other, nx, ny, nz, cosines, False)
    multiply_by_symbol(other, nx, ny, nz, cosines, -gamma)
    transform(other, work, nx, ny, nz, cosines, True)
