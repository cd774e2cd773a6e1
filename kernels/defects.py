"""How far a cell is from where it should be: its lag in time, and what stencils and walls leave.

A cell's place is nine lengths in µm: its centroid, and its shape as second moments without their
trace. An error e of the place obeys the linearised motion, e' = J e + source, as velocities do:
J is taken as the rate at which the cell's own velocity changes. See `engine.accuracy`.
"""

import math

import numpy as np
from numba import prange

from morphosim.kernels._jit import choose, entry, inline_kernel, kernel, parallel_kernel
from morphosim.kernels.columns import SHIFT, gather, row_of
from morphosim.kernels.frames import HALO, clear, frame_index, mirror, strides
from morphosim.kernels.rows import list_blocks, load, row_place, row_span, wipe
from morphosim.kernels.sharing import offer, turns
from morphosim.kernels.stencils import derivative, weighted_neighbours

PLACE = 9
"""Lengths of a place: the centroid, and the shape's xx, yy, zz, xy, xz, yz."""
(
    STEP, BORN, TIME, GAP, FORCE, DECAY, MEASURED, WAY, WALL, N_CLOCK,
) = range(10)  # fmt: skip
"""What is known of a cell: the step and the time at which its history began; time of the last look,
and from the one before to it; velocity to which the force would bring it; by what share velocities
have changed since its defects were measured, and when that was; way moved, µm; error by walls, µm.
"""
LEAST_SPEED = 1e-6
"""µm per time: slower is rest, of which no rate is taken."""
MOST_CHANGE = 20.0
"""Of velocities, from one look to the next."""
SETTLING = 4.0
"""A cell's velocity is its force's after so many lags."""
RARELY = 32
"""Most steps between two looks at a cell."""


@inline_kernel()
def row_sums(values, first, low, count):
    """Σ φ, Σ φ z and Σ φ z z of so many points of one row, from z = low on."""
    total = along = square = 0.0
    for k in range(np.uint64(count)):
        value, place = np.float64(values[first + k]), np.float64(np.int32(k) + np.int32(low))
        total += value
        along += value * place
        square += value * place * place
    return total, along, square


@kernel()
def find_place(i, phi, boxes, spacing, out):
    """Place of cell i, out (PLACE,), µm."""
    all_, sx, sy, sz = 0.0, 0.0, 0.0, 0.0
    xx, yy, zz, xy, xz, yz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for x in range(boxes.shape[i, 0]):
        for y in range(boxes.shape[i, 1]):
            low, high = row_span(x, y, i, boxes)
            first = np.uint64(row_place(x, y, i, boxes) + low)
            total, along, square = row_sums(phi, first, low, max(high - low, 0))
            all_ += total
            sx, sy, sz = sx + total * x, sy + total * y, sz + along
            xx, yy, zz = xx + total * x * x, yy + total * y * y, zz + square
            xy, xz, yz = xy + total * x * y, xz + along * x, yz + along * y
    all_ = max(all_, 1e-30)
    radius = (3 * all_ / (4 * math.pi)) ** (1 / 3)
    scale = 5 * spacing / (2 * math.sqrt(3.0) * radius)
    cx, cy, cz = sx / all_, sy / all_, sz / all_
    out[0] = (boxes.origin[i, 0] + cx) * spacing
    out[1] = (boxes.origin[i, 1] + cy) * spacing
    out[2] = (boxes.origin[i, 2] + cz) * spacing
    xx, yy, zz = xx / all_ - cx * cx, yy / all_ - cy * cy, zz / all_ - cz * cz
    mean = (xx + yy + zz) / 3
    out[3], out[4], out[5] = scale * (xx - mean), scale * (yy - mean), scale * (zz - mean)
    scale *= math.sqrt(2.0)
    out[6] = scale * (xy / all_ - cx * cy)
    out[7] = scale * (xz / all_ - cx * cz)
    out[8] = scale * (yz / all_ - cy * cz)


@parallel_kernel()
def begin(shares, order, begins, phi, boxes, spacing, step, time, place, speed, clock):
    """Begin the history of the cells that `begins` names: they have no velocity yet."""
    offer(shares)
    for _ in prange(shares.threads):
        for k in turns(shares):
            i = order[k]
            if begins[i]:
                find_place(i, phi, boxes, spacing, place[i])
                speed[i] = 0
                clock[i, STEP], clock[i, BORN], clock[i, TIME] = step, time, time
                clock[i, GAP], clock[i, FORCE], clock[i, DECAY] = 0, 0, 1
                clock[i, MEASURED] = time


@inline_kernel()
def change(now, before):
    """Ratio of two velocities; 1 at rest."""
    ratio = (now + LEAST_SPEED) / (before + LEAST_SPEED)
    return min(max(ratio, 1 / MOST_CHANGE), MOST_CHANGE)


@kernel()
def follow(i, here, gap, time, lags, place, speed, errors, clock):
    """Carry on the errors of cell i, which is at `here` now."""
    lag, start_lag, drag, curve = lags[i, 0], lags[i, 1], lags[i, 2], lags[i, 3]
    first = clock[i, GAP] == 0
    between = 0.5 * (gap + clock[i, GAP])
    now = before = force = way = changed = 0.0
    for k in range(PLACE):
        velocity = (here[k] - place[i, k]) / gap
        now += velocity * velocity
        before += speed[i, k] * speed[i, k]
        pushed = velocity + lag * (velocity - speed[i, k]) / between
        force += pushed * pushed
        changed += (velocity - speed[i, k]) * (velocity - speed[i, k])
        if k < 3:
            way += velocity * velocity * gap * gap
    now, before, force = math.sqrt(now), math.sqrt(before), math.sqrt(force)
    slow = fast = 1.0
    if first:
        force = now
        if start_lag > 0:
            lapse = gap / start_lag
            force = now / max(1 - (1 - math.exp(-lapse)) / lapse, 1e-3)
        lag, curve = start_lag, 0.0
    elif time - clock[i, BORN] > SETTLING * lag:
        slow = fast = change(now, before)
    else:
        fast = min(change(force, clock[i, FORCE]), 1.0)
    lag += curve * min(math.sqrt(changed) / (max(now, LEAST_SPEED) * between), 1 / gap)
    for k in range(PLACE):
        velocity = (here[k] - place[i, k]) / gap
        source = -lag * (velocity - speed[i, k]) - drag * velocity * gap
        errors[i, 0, k] = slow * errors[i, 0, k] + math.sqrt(slow) * source
        errors[i, 1, k] = fast * errors[i, 1, k] + math.sqrt(fast) * source
        place[i, k], speed[i, k] = here[k], velocity
    clock[i, TIME], clock[i, GAP], clock[i, FORCE] = time, gap, force
    clock[i, DECAY] *= slow
    clock[i, WAY] += math.sqrt(way)


@inline_kernel()
def interval(age):
    """Steps from one look at a cell to the next, by its age in steps: a power of 2."""
    steps = 1
    while steps < RARELY and 8 * steps <= age:
        steps *= 2
    return steps


@parallel_kernel()
def look(
    shares, order, phi, boxes, spacing, step, time, lags, places, place, speed, errors, clock
):  # fmt: skip
    """Look at where cells are, and carry on their errors in time.

    Parameters
    ----------
    shares, order : cells, and how threads share them
    phi, boxes : the fields
    spacing : float, µm
    step, time : of the present state
    lags : (N, 4) lag L of velocities, that of the first step, the share by which time is slow, and
        what a rate of change adds to L
    places : (threads, PLACE), overwritten
    place, speed : (N, PLACE) last places and velocities, updated
    errors : (N, 2, PLACE) errors, by the slow and by the fast of two rates, µm, updated
    clock : (N, N_CLOCK), updated
    """
    offer(shares)
    for worker in prange(shares.threads):
        here = places[worker]
        for k in turns(shares):
            i = order[k]
            gap = time - clock[i, TIME]
            if gap > 0 and step % interval(step - np.int64(clock[i, STEP])) == 0:
                find_place(i, phi, boxes, spacing, here)
                follow(i, here, gap, time, lags, place, speed, errors, clock)


@inline_kernel()
def gradient(field, p, sx, sy, weights, k):
    """∇ of a frame at point p, by the stencil in row k of `weights`."""
    c1, c2, c3 = weights[k, 1], weights[k, 2], weights[k, 3]
    return (
        derivative(field, p, sx, c1, c2, c3),
        derivative(field, p, sy, c1, c2, c3),
        derivative(field, p, np.uint64(1), c1, c2, c3),
    )


@inline_kernel()
def gradient_force(phi, psi, p, sx, sy, weights, k, pressure, dx, dy, dz):
    """The part of the force that gradients make: - ∇φ·∇ψ + p |∇φ| + ∇φ·d."""
    gx, gy, gz = gradient(phi, p, sx, sy, weights, k)
    total = pressure * np.sqrt(gx * gx + gy * gy + gz * gz)
    if psi is not None:
        ux, uy, uz = gradient(psi, p, sx, sy, weights, k)
        total -= gx * ux + gy * uy + gz * uz
    if dx is not None:
        total += gx * dx + gy * dy + gz * dz
    return total


@inline_kernel()
def row_defects(first, z, count, phi, psi, sx, sy, weights, gamma, pressure, dx, dy, dz, out):
    """Σ and Σ z of defects along one row of a frame from z on, and of φ; out (4,).

    Rows are summed in the type of the fields, without which the loop would not be vectorised.
    """
    l0, l1, l2, l3 = weights[2, 0], weights[2, 1], weights[2, 2], weights[2, 3]
    zero, one = phi.dtype.type(0), phi.dtype.type(1)
    total, along, mass, mass_along, place = zero, zero, zero, zero, phi.dtype.type(z)
    for p in range(first, first + np.uint64(count)):
        value = phi[p]
        defect = gradient_force(phi, psi, p, sx, sy, weights, 0, pressure, dx, dy, dz)
        defect -= gradient_force(phi, psi, p, sx, sy, weights, 1, pressure, dx, dy, dz)
        around = weighted_neighbours(phi, p, sx, sy, np.uint64(1), l1, l2, l3)
        defect += gamma * (around + (l0 + l0 + l0) * value)
        total += defect
        along += defect * place
        mass += value
        mass_along += value * place
        place += one
    out[0], out[1], out[2], out[3] = total, along, mass, mass_along


@inline_kernel()
def add_defects(i, boxes, whole, phi, psi, weights, gamma, pressure, dx, dy, dz, out):
    """Sums and first moments of cell i's force by one stencil less that by another, and of φ.

    out (12,), in lattice steps from the first point of the box; the last four are scratch.
    """
    sx, sy = strides(i, boxes)
    out[:] = 0
    for x in range(boxes.shape[i, 0]):
        for y in range(boxes.shape[i, 1]):
            low, high = row_span(x, y, i, boxes)
            if whole:
                low, high = np.int64(0), boxes.shape[i, 2]
            row_defects(
                np.uint64(frame_index(x, y, low, sx, sy)), low, max(high - low, 0), phi, psi,
                np.uint64(sx), np.uint64(sy), weights, gamma, pressure, dx, dy, dz, out[8:],
            )  # fmt: skip
            for k in range(2):
                total, along = out[8 + 2 * k], out[9 + 2 * k]
                out[4 * k] += total
                out[4 * k + 1] += total * x
                out[4 * k + 2] += total * y
                out[4 * k + 3] += along


@inline_kernel()
def pressed_by_walls(i, boxes, columns, walls, phi):
    """How one-sided walls press cell i: |Σ φ R ∇φ| / Σ |φ R ∇φ|; 0 without walls."""
    ox, oy = boxes.origin[i, 0] - HALO, boxes.origin[i, 1] - HALO
    sx, sy = strides(i, boxes)
    ux, uy, one = np.uint64(sx), np.uint64(sy), np.uint64(1)
    columns_y = ((oy + boxes.shape[i, 1] + 2 * HALO - 1) >> SHIFT) - (oy >> SHIFT) + 1
    px = py = pz = whole = 0.0
    for x in range(boxes.shape[i, 0]):
        lx = ox + HALO + x
        column = columns.cover_start[i] + ((lx >> SHIFT) - (ox >> SHIFT)) * columns_y
        for y in range(boxes.shape[i, 1]):
            ly = oy + HALO + y
            k = column + (ly >> SHIFT) - (oy >> SHIFT)
            start, length = columns.cover[k, 0], columns.cover[k, 1]
            if start < 0:
                continue
            wall = start + row_of(lx, ly) * length + columns.cover[k, 2] + HALO
            first = frame_index(x, y, 0, sx, sy)
            low, high = row_span(x, y, i, boxes)
            for z in range(low, high):
                p = np.uint64(first + z)
                weight = phi[p] * walls[np.uint64(wall + z)]
                gx = phi[p + ux] - phi[p - ux]
                gy = phi[p + uy] - phi[p - uy]
                gz = phi[p + one] - phi[p - one]
                px += weight * gx
                py += weight * gy
                pz += weight * gz
                whole += abs(weight) * math.sqrt(gx * gx + gy * gy + gz * gz)
    return math.sqrt(px * px + py * py + pz * pz) / max(whole, 1e-9)


@inline_kernel()
def add_up(i, time, rate, sums, defect, drift, clock):
    """Carry on the error in space of cell i, of whose defect these are the `sums`."""
    lapse, decay = time - clock[i, MEASURED], clock[i, DECAY]
    first, mass = clock[i, MEASURED] == clock[i, BORN], max(sums[4], 1e-30)
    for k in range(3):
        now = rate * (sums[k + 1] - sums[0] * sums[k + 5] / mass) / mass
        before = now if first else defect[i, k] * decay
        drift[i, k] = drift[i, k] * decay + 0.5 * (before + now) * lapse
        defect[i, k] = now
    clock[i, MEASURED], clock[i, DECAY] = time, 1.0


@inline_kernel()
def measure_cell(
    i, phi, boxes, whole, gamma, pressure, push, interaction, columns, pairs_start, pair_potential,
    work, weights, rate, wall_error, time, sums, defect, drift, clock, use_psi, walls,
):  # fmt: skip
    """`measure_defects` of cell i."""
    frames, felt, blocks = work.frames[0], work.stretches[0, 0], work.blocks[0]
    field, psi = frames[0], choose(frames[1], use_psi)
    n = list_blocks(i, boxes, whole, blocks)
    if whole:
        clear(i, boxes, field)
    load(phi, boxes.start[i], blocks, n, field)
    if use_psi is not None:
        if columns.felt[i]:
            gather(
                i, boxes, whole, interaction, columns, pairs_start, pair_potential, field, felt,
                psi, work.spans[0],
            )  # fmt: skip
        else:
            clear(i, boxes, psi)
    if walls is not None:
        clock[i, WALL] = wall_error * pressed_by_walls(i, boxes, columns, walls, field)
    if whole:
        mirror(i, boxes, field)
    add_defects(
        i, boxes, whole, field, psi, weights, gamma, pressure, entry(push, i, 0), entry(push, i, 1),
        entry(push, i, 2), sums,
    )  # fmt: skip
    wipe(blocks, n, field)
    add_up(i, time, rate, sums, defect, drift, clock)


@kernel()
def measure_defects(
    order, due, phi, boxes, whole, gamma, pressure, push, interaction, columns, pairs_start,
    pair_potential, work, weights, rates, wall_errors, time, sums, defect, drift, clock, use_psi,
    walls,
):  # fmt: skip
    """Measure what stencils and walls do wrong, and carry on the errors in space.

    On one thread, as it is rare, and with all that it calls inlined: Numba optimises what is called
    once more with each caller, and of sums as long as these the last bit would depend on whether
    they have just been compiled or come from the cache.

    Parameters
    ----------
    order : cells that are stepped
    due : (N,) bool, cells to look at
    phi, boxes, interaction, columns : see `layout`; columns are None where nothing acts
    gamma, pressure : (N,); push : (N, 3) d of d·∇φ, or None; see `CellTerms`
    whole : bool, whether fields are known beyond the band
    pairs_start, pair_potential : see `columns.gather`
    work : Room
    weights : (3, 4) two first derivatives, and the difference of two second ones, of the points 0
        to 3 steps away
    rates : (N,) velocity, µm per time, that a force of 1 makes over one lattice step
    wall_errors : (N,) µm by which the lattice misplaces a wall for each cell
    sums : (threads, 12), overwritten
    defect, drift : (N, 3) velocities by defects, and errors in space, updated
    clock : (N, N_CLOCK), updated
    use_psi : True, or None where there is no such physics
    walls : R of walls by column, or None where they are not one-sided
    """
    for i in order:
        if due[i]:
            measure_cell(
                i, phi, boxes, whole, gamma[i], pressure[i], push, interaction, columns,
                pairs_start, pair_potential, work, weights, rates[i], wall_errors[i], time,
                sums[0], defect, drift, clock, use_psi, walls,
            )  # fmt: skip
