"""Cosine transforms of boxes: tables for the matrix kernels, and library backends.

All use the orthonormal DCT-II, whose basis has Neumann faces half a step beyond the outer points.
"""

from typing import Any, Protocol

import numpy as np
from numpy.typing import DTypeLike, NDArray

from morphosim.kernels.layout import Cosines
from morphosim.numerics.parameters import Numerics
from morphosim.numerics.stencils import stencil_weights


def eigenvalues(n: int, numerics: Numerics) -> NDArray[np.float64]:
    """Eigenvalues λ_k >= 0 of -d²/dx² on n points, by `Numerics.laplacian`; k = π m / (n h)."""
    angle = np.pi * np.arange(n) / n
    if numerics.laplacian == "exact":
        return (angle / numerics.spacing) ** 2
    _, weights = stencil_weights(numerics.order, numerics.spacing)
    symbol = weights[0] + 2 * sum(w * np.cos(m * angle) for m, w in enumerate(weights[1:], 1))
    return np.asarray(-symbol / numerics.spacing**2)


def transform_cost(shape: NDArray[np.int64]) -> NDArray[np.float64]:
    """(N,) relative work of transforms of boxes of these shapes (N, 3); it grows with the axes."""
    return np.asarray(shape.prod(axis=1) * (200.0 + shape.sum(axis=1)))


class CosineTables:
    """Cosine matrices and eigenvalues by box size, made when a size first occurs."""

    def __init__(self, numerics: Numerics, dtype: DTypeLike) -> None:
        self._numerics, self._dtype = numerics, np.dtype(dtype)
        self._symbols: dict[int, NDArray[np.floating]] = {}
        self.arrays = self._pack()

    def require(self, sizes: NDArray[np.integer]) -> Cosines:
        """Tables that hold all these sizes."""
        numerics = self._numerics
        missing = {int(n) for n in np.unique(sizes)} - self._symbols.keys()
        if missing:
            for n in missing:
                self._symbols[n] = eigenvalues(n, numerics).astype(self._dtype)
            self.arrays = self._pack()
        return self.arrays

    def symbol(self, n: int) -> NDArray[np.floating]:
        """Eigenvalues for n points."""
        return self._symbols[n]

    def _pack(self) -> Cosines:
        sizes = sorted(self._symbols)
        index = np.full(max(sizes, default=0) + 1, -1, dtype=np.int64)
        symbol_index = index.copy()
        index[sizes] = np.cumsum([0] + [2 * n * n for n in sizes])[:-1]
        symbol_index[sizes] = np.cumsum([0, *sizes])[:-1]
        matrices = [np.zeros(0)]
        for n in sizes:
            inverse = cosine_matrix(n)
            matrices += [inverse.T.ravel(), inverse.ravel()]
        return Cosines(
            matrix_index=index,
            matrices=np.concatenate(matrices).astype(self._dtype),
            symbol_index=symbol_index,
            symbols=np.concatenate([np.zeros(0), *(self._symbols[n] for n in sizes)]).astype(
                self._dtype
            ),
        )


def cosine_matrix(n: int) -> NDArray[np.float64]:
    """Orthonormal DCT-II as an n × n matrix [k, x]."""
    k = np.arange(n)[:, None]
    x = np.arange(n)[None, :]
    matrix = np.sqrt(2 / n) * np.cos(np.pi * k * (x + 0.5) / n)
    matrix[0] *= np.sqrt(0.5)
    return np.asarray(matrix)


class BoxTransform(Protocol):
    """A library's transform of one box."""

    def forward(self, box: NDArray[np.floating]) -> NDArray[np.floating]:
        """DCT-II along all axes."""

    def inverse(self, box: NDArray[np.floating]) -> NDArray[np.floating]:
        """Inverse of `forward`."""


class SciPyTransform:
    """scipy.fft, one thread per box."""

    def __init__(self) -> None:
        from scipy.fft import dctn, idctn

        self._dctn, self._idctn = dctn, idctn

    def forward(self, box: NDArray[np.floating]) -> NDArray[np.floating]:
        """DCT-II along all axes; may overwrite `box`."""
        return np.asarray(self._dctn(box, norm="ortho", overwrite_x=True))

    def inverse(self, box: NDArray[np.floating]) -> NDArray[np.floating]:
        """Inverse of `forward`; may overwrite `box`."""
        return np.asarray(self._idctn(box, norm="ortho", overwrite_x=True))


class FFTWTransform:
    """pyFFTW, one pair of plans per box shape, made when the shape first occurs."""

    def __init__(self, dtype: DTypeLike) -> None:
        self._dtype = np.dtype(dtype)
        self._plans: dict[tuple[tuple[int, ...], str], Any] = {}

    def _apply(self, box: NDArray[np.floating], kind: str) -> NDArray[np.floating]:
        import pyfftw

        key = (box.shape, kind)
        if key not in self._plans:
            data = np.empty(box.shape, self._dtype)
            self._plans[key] = pyfftw.FFTW(
                data, data, axes=(0, 1, 2), direction=[kind] * 3,
                flags=("FFTW_ESTIMATE", "FFTW_UNALIGNED"),
            )  # fmt: skip
        self._plans[key](input_array=box, output_array=box)
        return box

    def forward(self, box: NDArray[np.floating]) -> NDArray[np.floating]:
        """DCT-II along all axes, in place, not normalised."""
        return self._apply(box, "FFTW_REDFT10")

    def inverse(self, box: NDArray[np.floating]) -> NDArray[np.floating]:
        """Inverse of `forward`, in place."""
        box = self._apply(box, "FFTW_REDFT01")
        box *= box.dtype.type(1 / (8 * box.size))
        return box
