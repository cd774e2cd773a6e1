"""Sums over cells on sparse tiles of the lattice.

The cells' sums Σ g φ² (repulsion) and Σ φ per cell type (attraction) are accumulated on tiles of
4 × 4 × 32 lattice points. A tile exists only where boxes of two cells meet or a confinement acts,
so memory follows the cells. Each tile is summed by one thread in the order of its cell list: the
result does not depend on the number of threads. A cell takes its own share off when it reads.
"""

import numpy as np
from numba import prange

from morphosim.kernels._jit import inline_kernel, kernel, parallel_kernel

SHIFTS = (2, 2, 5)
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


@inline_kernel()
def add_row(phi, source, count, g, repulsion, target, potential, target_potential):
    """Add g φ² and φ of one stretch of a row."""
    for k in range(np.uint64(count)):
        value = phi[source + k]
        repulsion[target + k] += g * value * value
        if potential is not None:
            potential[target_potential + k] += value


@inline_kernel()
def add_cell(
    x0, y0, z0, origin, shape, phi, start, spans, row_start, g, repulsion, first,
    potential, potential_first,
):  # fmt: skip
    """Add one cell, its box at `origin`, to the tile whose lower corner is (x0, y0, z0).

    Rows whose band is empty are left out, here and in `gather`.
    """
    ox, oy, oz = origin
    nx, ny, nz = shape
    low = max(z0, oz)
    count = min(z0 + TILE_SHAPE[2], oz + nz) - low
    for x in range(max(x0, ox), min(x0 + TILE_SHAPE[0], ox + nx)):
        for y in range(max(y0, oy), min(y0 + TILE_SHAPE[1], oy + ny)):
            line = (x - ox) * ny + (y - oy)
            if spans[row_start + line, 0] < spans[row_start + line, 1]:
                offset = ((x - x0) * TILE_SHAPE[1] + (y - y0)) * TILE_SHAPE[2] + low - z0
                add_row(
                    phi, np.uint64(start + line * nz + low - oz), count, g,
                    repulsion, np.uint64(first + offset),
                    potential, np.uint64(potential_first + offset),
                )  # fmt: skip


@inline_kernel()
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


@inline_kernel()
def read_repulsion(tile, first, phi, p, count, own_g, repulsion, q):
    """R along a stretch of a row: the tile's sum less the cell's own g φ²."""
    for k in range(np.uint64(count)):
        repulsion[q + k] = tile[first + k] - own_g * phi[p + k] * phi[p + k]


@inline_kernel()
def read_potential(tile, first, phi, p, count, weight, own_weight, psi, q):
    """Add σ Σ φ to ψ along a stretch of a row, less the cell's own share."""
    for k in range(np.uint64(count)):
        psi[q + k] += weight * tile[first + k] - own_weight * phi[p + k]


@inline_kernel()
def gather_row(
    column, tiles_z, corner, oz, nz, line, start, own, g, share, pull, phi, cover,
    tile_repulsion, tile_potential, repulsion, psi,
):  # fmt: skip
    """Read one row of a box from the tiles under it.

    `column` is where the row's tiles start in `cover`, `corner` the row's place within a tile;
    `share` tells whether the cell itself is in the sums of this row.
    """
    n_types = pull.shape[0]
    mine = phi.dtype.type(share)
    for k in range(tiles_z):
        slot = cover[column + k]
        if slot < 0:
            continue
        tile_z = ((oz >> SHIFTS[2]) + k) << SHIFTS[2]
        z0 = max(oz, tile_z)
        count = min(oz + nz, tile_z + TILE_SHAPE[2]) - z0
        q = np.uint64(line * nz + z0 - oz)
        p = np.uint64(start) + q
        offset = corner + z0 - tile_z
        first = np.uint64(slot * TILE_POINTS + offset)
        read_repulsion(tile_repulsion, first, phi, p, count, mine * g, repulsion, q)
        if tile_potential is not None:
            for t in range(n_types):
                weight = pull[t, own]
                if weight != 0:
                    own_weight = weight * phi.dtype.type(share and t == own)
                    first = np.uint64((slot * n_types + t) * TILE_POINTS + offset)
                    read_potential(tile_potential, first, phi, p, count, weight, own_weight, psi, q)


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
            share = spans[row_start + line, 0] < spans[row_start + line, 1]
            gather_row(
                tiles.cover_start[i] + tile * tiles_z, tiles_z, corner, oz, nz, line, start,
                own, g, share, pull, phi, cover, tile_repulsion, tile_potential,
                repulsion, psi,
            )  # fmt: skip
