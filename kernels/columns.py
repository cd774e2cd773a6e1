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
from morphosim.kernels.frames import HALO, clear_row, copy_row, frame_index, strides
from morphosim.kernels.rows import (
    BLOCK,
    NEW_HIGH,
    NEW_LOW,
    add_ends,
    fetch,
    list_spans,
    listed,
    reach,
    row_number,
    row_place,
    row_span,
    write_block,
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
def add_points(phi, source, count, g, repulsion, target, potential, target_potential):
    """Add g φ² and φ of so many points."""
    for k in range(np.uint64(max(count, 0))):
        value = phi[np.uint64(source) + k]
        repulsion[np.uint64(target) + k] += value * value * g  # as in `rows.add_ends`
        if potential is not None:
            potential[np.uint64(target_potential) + k] += value


@inline_kernel()
def add_span(phi, source, count, g, repulsion, target, potential, target_potential):
    """Add g φ² and φ of a span."""
    last = count - BLOCK
    if last < 0:  # of a ghost cell, of which a part is known
        add_points(phi, source, count, g, repulsion, target, potential, target_potential)
        return
    add_ends(repulsion, target, last, g, phi, source, 2)
    if potential is not None:
        add_ends(potential, target_potential, last, phi.dtype.type(1), phi, source, 1)
    if last > BLOCK:
        add_points(
            phi, source + BLOCK, last - BLOCK, g, repulsion, target + BLOCK, potential,
            target_potential + BLOCK,
        )  # fmt: skip


@kernel()
def add_cell(i, corner, length, phi, boxes, g, repulsion, first, potential, potential_first):
    """Add the band of cell i to the column whose lower corner is `corner`."""
    ox, oy, oz = boxes.origin[i, 0], boxes.origin[i, 1], boxes.origin[i, 2]
    nx, ny = boxes.shape[i, 0], boxes.shape[i, 1]
    y0, y1 = max(corner[1], oy), min(corner[1] + WIDTH, oy + ny)
    for x in range(max(corner[0], ox), min(corner[0] + WIDTH, ox + nx)):
        row = row_number(x - ox, y0 - oy, i, boxes)
        line = row_of(x, y0) * length + oz - corner[2]
        for _ in range(y0, y1):
            low, high = np.int64(boxes.low[row]), np.int64(boxes.high[row])
            offset, source = line + low, boxes.start[i] + boxes.place[row] + low
            next_plane = min(row + ny, boxes.low.shape[0] - 1)
            ahead = boxes.start[i] + boxes.place[next_plane] + boxes.low[next_plane]
            fetch(phi, ahead)
            fetch(phi, ahead + BLOCK)
            if low < high:
                add_span(
                    phi, source, high - low, g, repulsion, first + offset, potential,
                    potential_first + offset,
                )  # fmt: skip
            row += 1
            line += length


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
def clear_block(values, p):
    """Set a block to 0."""
    for j in range(np.uint64(BLOCK)):
        values[np.uint64(p) + j] = 0


@inline_kernel()
def read_block(first, z, sums, own_g, phi, p, repulsion, q):
    """R of one block: the column's sum less the cell's own g φ²; 0 where there is no column."""
    if first >= 0:
        write_block(repulsion, q, phi.dtype.type(1), sums, first + z, own_g, phi, p, 2)
    else:
        clear_block(repulsion, q)


@inline_kernel()
def read_own(first, z, weight, own_weight, potential, phi, p, psi):
    """ψ of one block of a frame by the cell's own type: σ Σ φ less the cell's own share."""
    if potential is None:
        clear_block(psi, p)
    elif first >= 0:
        write_block(psi, p, weight, potential, first + z, -own_weight, phi, p, 1)
    else:
        clear_block(psi, p)


@kernel()
def add_scaled(weight, sums, first, count, psi, p):
    """Add σ Σ φ of another type, or of pairs, along a row."""
    for k in range(np.uint64(count)):
        psi[np.uint64(p) + k] += weight * sums[np.uint64(first) + k]


@kernel()
def add_others(own, pull, points, potential, first, count, psi, p):
    """Add σ Σ φ of all other types along a row; it begins at `first` in the sums of the first."""
    if potential is None:
        return
    for t in range(pull.shape[0]):
        if t != own and pull[t, own] != 0:
            add_scaled(pull[t, own], potential, first + t * points, count, psi, p)


@inline_kernel()
def span_read(x, y, i, boxes, whole, spans):
    """Points of row (x, y) of the frame where stencils read ψ."""
    if whole:
        return np.int64(-HALO), boxes.shape[i, 2] + HALO
    k = listed(x, y, boxes.shape[i, 1])
    return np.int64(spans[NEW_LOW, k]), np.int64(spans[NEW_HIGH, k])


@kernel()
def gather(
    i, boxes, whole, interaction, columns, pairs_start, pair_potential, phi, repulsion, psi, spans
):  # fmt: skip
    """Repulsion R and attraction potential ψ felt by cell i.

    Parameters
    ----------
    i : int
    boxes, interaction, columns : Boxes, Interaction, Columns
    whole : bool, for stencils on the whole box, not only on the band
    pairs_start : (N,) where frames start in `pair_potential`, or None
    pair_potential : 1-D pool of `accumulate_pairs`, or None
    phi : frame of the field, 0 in the halo
    repulsion : stretch, overwritten
    psi : frame, overwritten where stencils read; None without attraction
    spans : (N_SPANS, rows), overwritten
    """
    ox, oy = boxes.origin[i, 0] - HALO, boxes.origin[i, 1] - HALO
    nx, ny, nz = boxes.shape[i, 0], boxes.shape[i, 1], boxes.shape[i, 2]
    sx, sy = strides(i, boxes)
    own, cover, n_types = interaction.types[i], columns.cover, interaction.pull.shape[0]
    pull = interaction.pull[own, own]
    columns_y = ((oy + ny + 2 * HALO - 1) >> SHIFT) - (oy >> SHIFT) + 1
    pulled = pair_potential is not None and pairs_start[i] >= 0
    zero, one = phi.dtype.type(0), phi.dtype.type(1)
    if psi is not None and not whole:
        list_spans(i, boxes, True, spans)
        reach(i, boxes, spans)
    for x in range(-HALO, nx + HALO):
        lx = ox + HALO + x
        column = columns.cover_start[i] + ((lx >> SHIFT) - (ox >> SHIFT)) * columns_y
        for y in range(-HALO, ny + HALO):
            r0, r1, p0, p1 = np.int64(0), np.int64(0), np.int64(0), np.int64(0)
            share, place = zero, np.int64(0)
            if 0 <= x < nx and 0 <= y < ny:
                r0, r1 = row_span(x, y, i, boxes)
                share = one if r0 < r1 else zero
                if whole:
                    r0, r1 = np.int64(0), nz
                place = row_place(x, y, i, boxes) - boxes.start[i]
            if psi is not None:
                p0, p1 = span_read(x, y, i, boxes, whole, spans)
            if r0 >= r1 and p0 >= p1:
                continue
            ly = oy + HALO + y
            k = column + (ly >> SHIFT) - (oy >> SHIFT)
            first, length, line = cover[k, 0], cover[k, 1], frame_index(x, y, 0, sx, sy)
            z = row_of(lx, ly) * length + cover[k, 2] + HALO
            own_g = -share * interaction.g
            if first >= 0:
                ahead = first + z + WIDTH * length  # the same row of the next plane
                if r0 < r1:
                    fetch(columns.repulsion, ahead + r0)
                    fetch(columns.repulsion, ahead + r1)
                if psi is not None and p0 < p1:
                    fetch(columns.potential, ahead + p0)
                    fetch(columns.potential, ahead + p0 + BLOCK)
                    fetch(columns.potential, ahead + p1)
            if r0 < r1:
                for at in range(r0 + BLOCK, r1 - BLOCK, BLOCK):
                    read_block(
                        first, z + at, columns.repulsion, own_g, phi, line + at, repulsion,
                        place + at,
                    )  # fmt: skip
                for at in (r0, r1 - BLOCK):
                    read_block(
                        first, z + at, columns.repulsion, own_g, phi, line + at, repulsion,
                        place + at,
                    )  # fmt: skip
            if psi is not None and p0 < p1:
                own_first = first * n_types + own * ROWS * length if first >= 0 else first
                for at in range(p0 + BLOCK, p1 - BLOCK, BLOCK):
                    read_own(
                        own_first, z + at, pull, share * pull, columns.potential, phi, line + at,
                        psi,
                    )  # fmt: skip
                for at in (p0, p1 - BLOCK):
                    read_own(
                        own_first, z + at, pull, share * pull, columns.potential, phi, line + at,
                        psi,
                    )  # fmt: skip
                if n_types > 1 and first >= 0:
                    add_others(
                        own, interaction.pull, ROWS * length, columns.potential,
                        first * n_types + z + p0, p1 - p0, psi, line + p0,
                    )  # fmt: skip
                if pair_potential is not None and pulled:
                    add_scaled(
                        one, pair_potential, pairs_start[i] + line + p0, p1 - p0, psi, line + p0
                    )
