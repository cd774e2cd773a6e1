"""The arrays that kernels share, grouped by what they describe.

Cells are numbered 0 … N-1. Pools are flat arrays in which each cell owns a stretch. Lattice
positions are integers; a position in µm is the lattice position times the spacing.
"""

from typing import Any, NamedTuple

import numpy as np


class Boxes(NamedTuple):
    """Where each cell's box lies, on the lattice and in the pools."""

    origin: np.ndarray
    """(N, 3) int64, lattice position of the first point."""
    shape: np.ndarray
    """(N, 3) int64, points per axis; z runs fastest."""
    start: np.ndarray
    """(N,) int64, first index in the pools of fields."""
    row_start: np.ndarray
    """(N,) int64, first index in `spans`."""
    spans: np.ndarray
    """(rows, 2) int32, the band [z0, z1) of each row (x, y); z0 >= z1 where it is empty."""


class Tiles(NamedTuple):
    """Sums over cells on the tiles that exist; one slot holds one tile."""

    cover_start: np.ndarray
    """(N,) int64, first index of each cell in `cover`."""
    cover: np.ndarray
    """int64, slot of each tile under each box, x slowest; -1 where no tile exists."""
    background: Any
    """g_e φ_e² by slot, or None without confinement."""
    repulsion: Any
    """Σ g φ² + background by slot; None if nothing repels."""
    potential: Any
    """Σ φ by slot and type; None without attraction by type."""


class TileLists(NamedTuple):
    """Which cells lie over which active tile, and how threads share the tiles."""

    bounds: np.ndarray
    """(threads + 1,) int64, ranges of active tiles."""
    slot: np.ndarray
    """(A,) int64, slot of each active tile."""
    corner: np.ndarray
    """(A, 3) int64, lattice position of its first point."""
    cell_start: np.ndarray
    """(A + 1,) int64, compressed rows of `cells`."""
    cells: np.ndarray
    """int64, cells over each tile."""


class Interaction(NamedTuple):
    """Strengths of what cells do to each other, in the type of the fields."""

    g: Any
    """Scalar, repulsion between cells."""
    types: np.ndarray
    """(N,) int64, type of each cell."""
    pull: np.ndarray
    """(K, K), pull[j, i] is the attraction of type i by type j."""


class Pairs(NamedTuple):
    """Pairs whose attraction differs from that of their types: σ_ji minus the types' value."""

    start: np.ndarray
    """(N + 1,) int64, compressed rows by the cell that is pulled."""
    cell: np.ndarray
    """int64, the cell that pulls."""
    weight: np.ndarray
    """The difference in σ, in the type of the fields."""


class Stencil(NamedTuple):
    """Gradient stencil; weights already divided by the spacing."""

    radius: int
    edge: Any
    """Scalar, weight of the second-order stencil, used within `radius` of the faces of a box."""
    c1: Any
    c2: Any
    """Scalar, or None for order 2."""
    c3: Any
    """Scalar, or None for orders 2 and 4."""


class Scheme(NamedTuple):
    """(lhs - γΔ) φⁿ⁺¹ = a0 φⁿ + a1 Fⁿ + Hⁿ and Hⁿ⁺¹ = b0 φⁿ + b1 Fⁿ."""

    lhs: Any
    a0: Any
    a1: Any
    b0: Any
    b1: Any


class Cosines(NamedTuple):
    """Cosine matrices and eigenvalues of -Δ for all box sizes in use."""

    matrix_index: np.ndarray
    """int64, by size n: where its two n × n matrices (forward, inverse) start."""
    matrices: np.ndarray
    symbol_index: np.ndarray
    """int64, by size n: where its n eigenvalues start."""
    symbols: np.ndarray


class CellTerms(NamedTuple):
    """Per-cell numbers of one step, in the type of the fields."""

    gamma: np.ndarray
    """(N,) surface tension γ."""
    well: np.ndarray
    """(N,) 4 γ c."""
    pressure: np.ndarray
    """(N,) factor of |∇φ|: the volume constraint."""
    drift: Any
    """(N, 3) factor of ∇φ: -κ √δt u, or None without noise."""


class Limits(NamedTuple):
    """Thresholds of the survey after each step, in the type of the fields."""

    tolerance: Any
    """The band is where |φ| exceeds this."""
    runaway: Any
    """|φ| beyond this is a divergence."""
    half: Any
    """1/2."""
