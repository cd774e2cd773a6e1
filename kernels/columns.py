"""Sums over cells on sparse accumulation columns of the lattice.

The cells' sums Σ g φ² (repulsion) and Σ φ per cell type (attraction) are accumulated on columns of
8 × 8 rows along z. A column reaches as far as the frames over it hang together and exists only
where two of them meet or walls act, so memory follows the cells, and each row of a frame lies in
one column. Each column is summed by one thread in the order of its cell list: the result
does not depend on the number of threads. A cell takes its own share off when it reads.
"""

import numpy as np
from numba import prange

from morphosim.kernels._jit import inline_kernel, kernel, parallel_kernel
from morphosim.kernels.frames import (
    HALO,
    band_rows,
    clear_row,
    copy_row,
    frame_index,
    reach,
    strides,
)
from morphosim.kernels.sharing import offer, turns

SHIFT = 3
WIDTH = 1 << SHIFT
"""Rows of a column along x and y."""
ROWS = WIDTH * WIDTH


@inline_kernel()
def row_of(x, y):
    """Number of the row at lattice position (x, y) within its column."""
    return (x % WIDTH) * WIDTH + y % WIDTH


@inline_kernel()
def add_row(phi, source, count, g, repulsion, target, potential, target_potential):
    """Add g φ² and φ of one row."""
    for k in range(np.uint64(count)):
        value = phi[source + k]
        repulsion[target + k] += g * value * value
        if potential is not None:
            potential[target_potential + k] += value


@kernel()
def add_cell(i, corner, length, phi, boxes, g, repulsion, first, potential, potential_first):
    """Add the band of cell i to the column whose lower corner is `corner`."""
    ox, oy, oz = boxes.origin[i, 0], boxes.origin[i, 1], boxes.origin[i, 2]
    nx, ny, nz = boxes.shape[i, 0], boxes.shape[i, 1], boxes.shape[i, 2]
    for x in range(max(corner[0], ox), min(corner[0] + WIDTH, ox + nx)):
        y0, y1 = band_rows(x - ox, i, boxes, False)
        for y in range(max(corner[1], oy + y0), min(corner[1] + WIDTH, oy + y1)):
            offset = row_of(x, y) * length + oz - corner[2]
            add_row(
                phi, np.uint64(boxes.start[i] + ((x - ox) * ny + y - oy) * nz), nz, g,
                repulsion, np.uint64(first + offset),
                potential, np.uint64(potential_first + offset),
            )  # fmt: skip


@kernel()
def lay_tiles(tiles, slots, depth, out):
    """Columns made of tiles, one column after the other.

    Parameters
    ----------
    tiles : (K, ROWS, TILE) values
    slots : (T,) the tile of each place, from the bottom of the first column up; -1: zeros
    depth : (C,) tiles of each column
    out : 1-D, overwritten with the columns (ROWS, depth × TILE)
    """
    size, values = tiles.shape[2], tiles.ravel()
    place = first = 0
    for n in depth:
        length = n * size
        for k in range(n):
            slot = slots[place + k]
            for row in range(ROWS):
                goal = np.uint64(first + row * length + k * size)
                if slot >= 0:
                    copy_row(values, np.uint64((slot * ROWS + row) * size), out, goal, size)
                else:
                    clear_row(out, goal, size)
        place += n
        first += ROWS * length


@inline_kernel()
def clear_column(first, points, n_types, background, field, repulsion, potential):
    """Start a column's sums: the shares of walls and of space, or nothing."""
    if background is not None:
        copy_row(background, np.uint64(first), repulsion, np.uint64(first), points)
    else:
        repulsion[first : first + points] = 0
    if potential is not None:
        last = (first + points) * n_types
        potential[first * n_types : last] = 0
        if field is not None:
            for k in range(field.shape[0]):
                goal = last - (field.shape[0] - k) * points
                copy_row(field[k], np.uint64(first), potential, np.uint64(goal), points)


@kernel()
def sum_column(
    a, lists, phi, boxes, types, n_types, g, background, field, repulsion, potential
):  # fmt: skip
    """Sum all cells over column `a`."""
    first, length = lists.start[a], lists.length[a]
    points = ROWS * length
    clear_column(first, points, n_types, background, field, repulsion, potential)
    for k in range(lists.cell_start[a], lists.cell_start[a + 1]):
        i = lists.cells[k]
        add_cell(
            i, lists.corner[a], length, phi, boxes, g, repulsion, first,
            potential, first * n_types + types[i] * points,
        )  # fmt: skip


@parallel_kernel()
def accumulate(shares, lists, phi, boxes, interaction, columns):
    """Sum all cells on the columns: `columns.repulsion` and `columns.potential`.

    Parameters
    ----------
    shares : Shares of the columns
    lists : ColumnLists
    phi : 1-D pool of the cells' fields
    boxes : Boxes
    interaction : Interaction
    columns : Columns
    """
    offer(shares)
    for _ in prange(shares.threads):
        for a in turns(shares):
            sum_column(
                a, lists, phi, boxes, interaction.types, interaction.pull.shape[0],
                interaction.g, columns.background, columns.field, columns.repulsion,
                columns.potential,
            )  # fmt: skip


@inline_kernel()
def read_repulsion(sums, first, phi, p, count, own_g, repulsion):
    """R along a row: the column's sum less the cell's own g φ²."""
    for k in range(np.uint64(count)):
        repulsion[p + k] = sums[first + k] - own_g * phi[p + k] * phi[p + k]


@inline_kernel()
def read_own_potential(sums, first, phi, p, count, weight, own_weight, psi):
    """ψ along a row by the cell's own type: σ Σ φ less the cell's own share."""
    for k in range(np.uint64(count)):
        psi[p + k] = weight * sums[first + k] - own_weight * phi[p + k]


@inline_kernel()
def add_potential(sums, first, p, count, weight, psi):
    """Add σ Σ φ of another type, or of pairs."""
    for k in range(np.uint64(count)):
        psi[p + k] += weight * sums[first + k]


@inline_kernel()
def read_psi(first, length, z, row, count, own, share, pull, potential, phi, p, psi):
    """ψ by cell types along one row of a frame, from row `row` of its column.

    The column starts at `first` in the pools and is `length` long; the frame's row begins at its
    z-th point. `share` is 1 if the cell itself is in the sums of this row, else 0.
    """
    if potential is None:
        clear_row(psi, p, count)
    else:
        n_types = pull.shape[0]
        place = first * n_types + row * length + z
        source = np.uint64(place + own * ROWS * length)
        weight = pull[own, own]
        read_own_potential(potential, source, phi, p, count, weight, share * weight, psi)
        for t in range(n_types):
            weight = pull[t, own]
            if t != own and weight != 0:
                source = np.uint64(place + t * ROWS * length)
                add_potential(potential, source, p, count, weight, psi)


@kernel()
def gather(i, boxes, whole, interaction, columns, pairs_start, pair_potential, phi, repulsion, psi):
    """Repulsion R and attraction potential ψ felt by cell i, in its frame.

    Parameters
    ----------
    i : int
    boxes, interaction, columns : Boxes, Interaction, Columns
    whole : bool, for stencils on the whole box, not only on the band
    pairs_start : (N,) where frames start in `pair_potential`, or None
    pair_potential : 1-D pool of `accumulate_pairs`, or None
    phi : frame of the field, 0 in the halo
    repulsion, psi : frames, overwritten where they are read; psi is None without attraction
    """
    ox, oy = boxes.origin[i, 0] - HALO, boxes.origin[i, 1] - HALO
    nx, ny = boxes.shape[i, 0], boxes.shape[i, 1]
    sx, sy = strides(i, boxes)
    own, cover, g = interaction.types[i], columns.cover, interaction.g
    columns_y = ((oy + ny + 2 * HALO - 1) >> SHIFT) - (oy >> SHIFT) + 1
    pulled = pair_potential is not None and pairs_start[i] >= 0
    for x in range(-HALO, nx + HALO):
        low, high = reach(x, i, boxes, whole)
        y0, y1 = np.int64(0), np.int64(0)
        w0, w1 = y0, y1
        if 0 <= x < nx:
            y0, y1 = band_rows(x, i, boxes, False)
            w0, w1 = band_rows(x, i, boxes, whole)
        lx = ox + HALO + x
        column = columns.cover_start[i] + ((lx >> SHIFT) - (ox >> SHIFT)) * columns_y
        for y in range(low, high):
            ly = oy + HALO + y
            k = column + (ly >> SHIFT) - (oy >> SHIFT)
            first, length, z = cover[k, 0], cover[k, 1], cover[k, 2]
            row, share = row_of(lx, ly), phi.dtype.type(y0 <= y < y1)
            p = np.uint64(frame_index(x, y, -HALO, sx, sy))
            if w0 <= y < w1:
                if first >= 0:
                    source = np.uint64(first + row * length + z)
                    read_repulsion(columns.repulsion, source, phi, p, sy, share * g, repulsion)
                else:
                    clear_row(repulsion, p, sy)
            if psi is not None:
                if first >= 0:
                    read_psi(
                        first, length, z, row, sy, own, share, interaction.pull,
                        columns.potential, phi, p, psi,
                    )  # fmt: skip
                else:
                    clear_row(psi, p, sy)
                if pair_potential is not None and pulled:
                    source = np.uint64(pairs_start[i]) + p
                    add_potential(pair_potential, source, p, sy, phi.dtype.type(1), psi)
