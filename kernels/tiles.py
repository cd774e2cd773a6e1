"""Sums over cells on sparse tiles of the lattice.

The cells' sums Σ g φ² (repulsion) and Σ φ per cell type (attraction) are accumulated on tiles of
8 × 8 × 16 lattice points. A tile exists only where boxes of two cells meet or a confinement acts,
so memory follows the cells. Each tile is summed by one thread in the order of its cell list: the
result does not depend on the number of threads. A cell takes its own share off when it reads.
"""

import numpy as np
from numba import prange

from morphosim.kernels._jit import kernel, parallel_kernel

SHIFTS = (3, 3, 4)
TILE_SHAPE = (1 << SHIFTS[0], 1 << SHIFTS[1], 1 << SHIFTS[2])
TILE_POINTS = TILE_SHAPE[0] * TILE_SHAPE[1] * TILE_SHAPE[2]


@kernel()
def enumerate_covered(origin, counts, cover_start, tiles):
    """Tile coordinates under each box, x slowest; tiles is (total, 3) int64."""
    for i in range(origin.shape[0]):
        k = cover_start[i]
        for tx in range(counts[i, 0]):
            for ty in range(counts[i, 1]):
                for tz in range(counts[i, 2]):
                    tiles[k, 0] = (origin[i, 0] >> SHIFTS[0]) + tx
                    tiles[k, 1] = (origin[i, 1] >> SHIFTS[1]) + ty
                    tiles[k, 2] = (origin[i, 2] >> SHIFTS[2]) + tz
                    k += 1


@kernel()
def add_row(phi, source, count, g, repulsion, target, potential, target_potential):
    """Add g φ² and φ of one stretch of a row."""
    for k in range(np.uint64(count)):
        value = phi[source + k]
        repulsion[target + k] += g * value * value
        if potential is not None:
            potential[target_potential + k] += value


@kernel()
def add_cell(
    x0, y0, z0, origin, shape, phi, start, spans, row_start, g, repulsion, first,
    potential, potential_first,
):  # fmt: skip
    """Add one cell, its box at `origin`, to the tile whose lower corner is (x0, y0, z0)."""
    ox, oy, oz = origin
    nx, ny, nz = shape
    for x in range(max(x0, ox), min(x0 + TILE_SHAPE[0], ox + nx)):
        for y in range(max(y0, oy), min(y0 + TILE_SHAPE[1], oy + ny)):
            line = (x - ox) * ny + (y - oy)
            low = max(z0, oz + spans[row_start + line, 0])
            high = min(z0 + TILE_SHAPE[2], oz + spans[row_start + line, 1])
            if low < high:
                offset = ((x - x0) * TILE_SHAPE[1] + (y - y0)) * TILE_SHAPE[2] + low - z0
                add_row(
                    phi, np.uint64(start + line * nz + low - oz), high - low, g,
                    repulsion, np.uint64(first + offset),
                    potential, np.uint64(potential_first + offset),
                )  # fmt: skip


@kernel()
def clear_tile(slot, n_types, background, repulsion, potential):
    """Start a tile's sums: the confinement's share, or nothing."""
    first = slot * TILE_POINTS
    if background is not None:
        repulsion[first : first + TILE_POINTS] = background[first : first + TILE_POINTS]
    else:
        repulsion[first : first + TILE_POINTS] = 0
    if potential is not None:
        potential[first * n_types : (first + TILE_POINTS) * n_types] = 0


@kernel()
def sum_tile(a, lists, phi, boxes, types, n_types, g, background, repulsion, potential):
    """Sum all cells over active tile `a`."""
    slot = lists.slot[a]
    clear_tile(slot, n_types, background, repulsion, potential)
    origin, shape = boxes.origin, boxes.shape
    for k in range(lists.cell_start[a], lists.cell_start[a + 1]):
        i = lists.cells[k]
        add_cell(
            lists.corner[a, 0], lists.corner[a, 1], lists.corner[a, 2],
            (origin[i, 0], origin[i, 1], origin[i, 2]), (shape[i, 0], shape[i, 1], shape[i, 2]),
            phi, boxes.start[i], boxes.spans, boxes.row_start[i], g,
            repulsion, slot * TILE_POINTS,
            potential, (slot * n_types + types[i]) * TILE_POINTS,
        )  # fmt: skip


@parallel_kernel()
def accumulate(lists, phi, boxes, interaction, tiles):
    """Sum all cells on the active tiles: `tiles.repulsion` and `tiles.potential`.

    Parameters
    ----------
    lists : TileLists
    phi : 1-D pool of the cells' fields
    boxes : Boxes
    interaction : Interaction
    tiles : Tiles
    """
    for worker in prange(lists.bounds.shape[0] - 1):
        for a in range(lists.bounds[worker], lists.bounds[worker + 1]):
            sum_tile(
                a, lists, phi, boxes, interaction.types, interaction.pull.shape[0],
                interaction.g, tiles.background, tiles.repulsion, tiles.potential,
            )  # fmt: skip


@kernel()
def copy_row(source, first, count, target, q):
    """target[q:] = source[first:] for `count` points."""
    for k in range(np.uint64(count)):
        target[q + k] = source[first + k]


@kernel()
def add_scaled_row(source, first, count, weight, target, q):
    """target[q:] += weight source[first:] for `count` points."""
    for k in range(np.uint64(count)):
        target[q + k] += weight * source[first + k]


@kernel()
def remove_own(phi, p, count, g, weight, repulsion, psi, q):
    """Take the cell's own g φ² and σ φ off a stretch of a row."""
    for k in range(np.uint64(count)):
        value = phi[p + k]
        repulsion[q + k] -= g * value * value
        if psi is not None:
            psi[q + k] -= weight * value


@kernel()
def gather_row(
    column, tiles_z, corner, oz, nz, line, low, high, start, own, g, pull, phi, cover,
    tile_repulsion, tile_potential, repulsion, psi,
):  # fmt: skip
    """Read one row of a box from the tiles under it, less the cell's own share on [low, high).

    `column` is where the row's tiles start in `cover`, `corner` the row's place within a tile.
    """
    n_types = pull.shape[0]
    for k in range(tiles_z):
        slot = cover[column + k]
        if slot < 0:
            continue
        tile_z = ((oz >> SHIFTS[2]) + k) << SHIFTS[2]
        z0 = max(oz, tile_z)
        z1 = min(oz + nz, tile_z + TILE_SHAPE[2])
        q = line * nz + z0 - oz
        offset = corner + z0 - tile_z
        first = np.uint64(slot * TILE_POINTS + offset)
        copy_row(tile_repulsion, first, z1 - z0, repulsion, np.uint64(q))
        if tile_potential is not None:
            for t in range(n_types):
                if pull[t, own] != 0:
                    first = np.uint64((slot * n_types + t) * TILE_POINTS + offset)
                    add_scaled_row(tile_potential, first, z1 - z0, pull[t, own], psi, np.uint64(q))
        z0 = max(z0, low)
        z1 = min(z1, high)
        if z0 < z1:
            q = line * nz + z0 - oz
            mine = psi
            if tile_potential is None:
                mine = None
            remove_own(
                phi, np.uint64(start + q), z1 - z0, g, pull[own, own],
                repulsion, mine, np.uint64(q),
            )  # fmt: skip


@kernel()
def gather(i, phi, boxes, interaction, tiles, pair_potential, repulsion, psi):
    """Repulsion R and attraction potential ψ felt by cell i, in its box.

    Parameters
    ----------
    i : int
    phi : 1-D pool
    boxes, interaction, tiles : Boxes, Interaction, Tiles
    pair_potential : 1-D pool of `accumulate_pairs`, or None
    repulsion, psi : 1-D, box of the cell, overwritten; psi is None without attraction
    """
    ox, oy, oz = boxes.origin[i, 0], boxes.origin[i, 1], boxes.origin[i, 2]
    nx, ny, nz = boxes.shape[i, 0], boxes.shape[i, 1], boxes.shape[i, 2]
    start, spans, row_start = boxes.start[i], boxes.spans, boxes.row_start[i]
    own, pull, g = interaction.types[i], interaction.pull, interaction.g
    cover, tile_repulsion, tile_potential = tiles.cover, tiles.repulsion, tiles.potential
    size = nx * ny * nz
    repulsion[:size] = 0
    if psi is not None:
        if pair_potential is not None:
            psi[:size] = pair_potential[start : start + size]
        else:
            psi[:size] = 0
    tiles_y = ((oy + ny - 1) >> SHIFTS[1]) - (oy >> SHIFTS[1]) + 1
    tiles_z = ((oz + nz - 1) >> SHIFTS[2]) - (oz >> SHIFTS[2]) + 1
    for x in range(ox, ox + nx):
        tile_x = (x >> SHIFTS[0]) - (ox >> SHIFTS[0])
        for y in range(oy, oy + ny):
            line = (x - ox) * ny + y - oy
            tile = tile_x * tiles_y + (y >> SHIFTS[1]) - (oy >> SHIFTS[1])
            corner = ((x % TILE_SHAPE[0]) * TILE_SHAPE[1] + y % TILE_SHAPE[1]) * TILE_SHAPE[2]
            low = oz + spans[row_start + line, 0]
            high = oz + spans[row_start + line, 1]
            gather_row(
                tiles.cover_start[i] + tile * tiles_z, tiles_z, corner, oz, nz, line, low, high,
                start, own, g, pull, phi, cover, tile_repulsion, tile_potential, repulsion, psi,
            )  # fmt: skip
