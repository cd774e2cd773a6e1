"""The arrays that kernels share, grouped by what they describe.

Cells are numbered 0 … N-1. Pools are flat arrays in which each cell owns a stretch. Lattice
positions are integers; a position in µm is the lattice position times the spacing.
"""

from typing import Any, NamedTuple

import numpy as np


class Boxes(NamedTuple):
    """Where each cell's box lies on the lattice, and its values in the pools; see `rows`."""

    origin: np.ndarray
    """(N, 3) int64, lattice position of the first point."""
    shape: np.ndarray
    """(N, 3) int64, points per axis; z runs fastest."""
    start: np.ndarray
    """(N,) int64, first index in the pools of fields: where the cell's stretch begins."""
    row_start: np.ndarray
    """(N,) int64, number of its first row; row (x, y) has ny x + y more."""
    low: np.ndarray
    """(rows,) int16, first point of each row in the band."""
    high: np.ndarray
    """(rows,) int16, and the last but one; no more than `low` if there is none."""
    place: np.ndarray
    """(rows,) int32, where point z = 0 of the row is, or would be, from `start` on."""


class Room(NamedTuple):
    """Work arrays of each thread, for the largest box; all overwritten."""

    frames: np.ndarray
    """(threads, frames, points) of `frames`; 0 where no cell is at work."""
    stretches: np.ndarray
    """(threads, stretches, points), in the order of the pools."""
    blocks: np.ndarray
    """(threads, 2, blocks) int32; see `rows.list_blocks`."""
    spans: np.ndarray
    """(threads, N_SPANS, rows) int16; see `rows`."""
    found: np.ndarray
    """(threads, planes, 2) int32; see `boxes.survey`."""
    measured: np.ndarray
    """(threads, N_SURVEYED) float64."""


class Shares(NamedTuple):
    """How threads share a list of work; see `sharing`."""

    threads: int
    bounds: np.ndarray
    """(pieces + 1,) int64, ranges of the list."""
    taken: np.ndarray
    """(1,) int64, number of pieces that have been taken."""


class Columns(NamedTuple):
    """Sums on the accumulation columns that exist: W × W rows along z, as long as cells overlap."""

    cover_start: np.ndarray
    """(N,) int64, first index of each cell in `cover`."""
    cover: np.ndarray
    """(K, 3) int64, for each column under each cell's frame, x slowest: the column's first index
    in the pools or -1 where none exists, its length, and where the frame's first z lies in it."""
    felt: np.ndarray
    """(N,) bool, whether there is any column under each cell's frame."""
    background: Any
    """R of walls by column, such as g_e φ_e², or None without walls."""
    field: Any
    """(F, points) ψ of space by column, or None; they are the last of the potentials."""
    repulsion: Any
    """Σ g φ² + background by column; None if nothing repels."""
    potential: Any
    """Σ φ by column and type, then `field`; None without attraction by type and field."""


class ColumnLists(NamedTuple):
    """Which cells lie over which column."""

    start: np.ndarray
    """(A,) int64, first index of each column in the pools."""
    length: np.ndarray
    """(A,) int64, points along z."""
    corner: np.ndarray
    """(A, 3) int64, lattice position of its first point."""
    cell_start: np.ndarray
    """(A + 1,) int64, compressed rows of `cells`."""
    cells: np.ndarray
    """int64, cells over each column."""


class Interaction(NamedTuple):
    """Strengths of what cells do to each other, in the type of the fields."""

    g: Any
    """Scalar, repulsion between cells."""
    types: np.ndarray
    """(N,) int64, type of each cell."""
    pull: np.ndarray
    """(K, K), pull[j, i] is the attraction of type i by type j; the last are those of
    `Columns.field`, if there is any, to which no cell belongs."""


class Pairs(NamedTuple):
    """Pairs whose attraction differs from that of their types: σ_ji minus the types' value."""

    start: np.ndarray
    """(N + 1,) int64, compressed rows by the cell that is pulled."""
    cell: np.ndarray
    """int64, the cell that pulls."""
    weight: np.ndarray
    """The difference in σ, in the type of the fields."""
    frame_start: np.ndarray
    """(N,) int64, where the frame of each pulled cell starts in the pool of these potentials; -1
    for cells that no such pair pulls."""


class Stencil(NamedTuple):
    """Weights of the central differences of a point 0, 1, 2, 3 steps away.

    The spacing is in them. Weights that an order does not have are None.
    """

    c1: Any
    """First derivative."""
    c2: Any
    c3: Any
    l0: Any
    """Second derivative."""
    l1: Any
    l2: Any
    l3: Any


class Scheme(NamedTuple):
    """(lhs - γΔ) φⁿ⁺¹ = a0 φⁿ + a1 Fⁿ + Hⁿ and Hⁿ⁺¹ = b0 φⁿ + b1 Fⁿ; see `numerics.schemes`.

    Iterations start from e0 φⁿ + e1 (Hⁿ + Fⁿ).
    """

    lhs: Any
    a0: Any
    a1: Any
    b0: Any
    b1: Any
    e0: Any
    e1: Any


class Linearisation(NamedTuple):
    """Numbers of a step of the scheme "linearised"; see `linearised`."""

    lhs: np.ndarray
    """(N,) τ/δt (1 + 2r) / (1 + r), or τ/δt of cells without history, in the type of the fields."""
    rate: Any
    """τ/δt, likewise."""
    spread: Any
    """s, the stabilisation, likewise."""
    stiffness: np.ndarray
    """(N,) float64, - ∂p/∂v h³: what one more of Σ φ takes off the pressure."""


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
    """(N,) surface tension γ, times the mobility."""
    well: np.ndarray
    """(N,) 4 γ c."""
    pressure: np.ndarray
    """(N,) p of p |∇φ|: the volume constraint and the like."""
    drift: Any
    """(N, 3) d of d·∇φ: motility and the like; None without."""
    points: Any
    """(N,) records with the values of a force at each point; see `points`. None without."""
    fresh: np.ndarray
    """(N,) bool, whether the cell has no history and makes a first-order start."""
    mobility: Any
    """(N, 1) τ of the scheme over that of the cell, by which F is multiplied: a cell's equation is
    divided by its own τ. None where τ is one number."""
    n_iterations: np.ndarray
    """(N,) int64, Chebyshev iterations of the step."""
    weights: np.ndarray
    """(N, most iterations) weights of the iterations; see `chebyshev`."""


class Limits(NamedTuple):
    """Thresholds of the survey after each step, in the type of the fields."""

    tolerance: Any
    """The band is where |φ| exceeds this."""
    runaway: Any
    """|φ| beyond this is a divergence."""
    half: Any
    """1/2."""
