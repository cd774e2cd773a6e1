"""Rows: which of their points a cell's narrow band has, and where these lie in the pools.

A row is all points of a box with the same x and y. The band has one span [low, high) of it, of at
least `BLOCK` points, or nothing. A solver that works on the band alone keeps the spans one after
the other, x slowest: the stretch of the cell. Others keep the whole box, and its rows.

Spans are worked on in blocks of `BLOCK` points: loops of known length have no remainder, and a
cell's blocks are one list. The last block of a span ends where the span ends, so some points may
be worked on twice. What is done there must write the same both times.
"""

import numpy as np
from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic, overload

from morphosim.kernels._jit import inline_kernel, kernel
from morphosim.kernels.frames import HALO, frame_index, strides

BLOCK = 16
"""Points of a block: a cache line of single precision."""
FRAME, STRETCH = 0, 1
"""Rows of a list of blocks: where each begins in the cell's frame and in its stretch."""
OLD_LOW, OLD_HIGH, LOW, HIGH, NEW_LOW, NEW_HIGH, N_SPANS = 0, 1, 2, 3, 4, 5, 6
"""Rows of a thread's `spans`: the band as it is, what was found of it, and what it is to be."""
RIM = 2
"""Lattice steps that the band reaches beyond what exceeds the tolerance, along rows and across."""
MARGIN = 2 * HALO
"""Empty planes around the box in such lists."""


def whole_rows(shape):
    """Row tables of boxes (N, 3) that are kept whole, all of them in the band; not a kernel.

    Returns
    -------
    row_start, low, high, place : see `layout.Boxes`
    """
    counts = shape[:, 0] * shape[:, 1]
    row_start = np.cumsum(counts) - counts
    length = np.repeat(shape[:, 2], counts)
    place = (np.arange(len(length)) - np.repeat(row_start, counts)) * length
    return (
        row_start,
        np.zeros(len(length), np.int16),
        length.astype(np.int16),
        place.astype(np.int32),
    )


@inline_kernel()
def row_number(x, y, i, boxes):
    """Number of row (x, y) of cell i's box."""
    return boxes.row_start[i] + x * boxes.shape[i, 1] + y


@inline_kernel()
def row_span(x, y, i, boxes):
    """Points [low, high) of row (x, y) in the band; low >= high if there are none."""
    row = row_number(x, y, i, boxes)
    return np.int64(boxes.low[row]), np.int64(boxes.high[row])


@inline_kernel()
def row_place(x, y, i, boxes):
    """Index in the pools of point z = 0 of row (x, y), be it in the band or not."""
    return boxes.start[i] + boxes.place[row_number(x, y, i, boxes)]


@inline_kernel()
def n_blocks(low, high):
    """Blocks of a span."""
    return max(high - low + BLOCK - 1, 0) // BLOCK


@inline_kernel()
def block(k, low, high):
    """First point of the k-th block of a span."""
    return min(low + k * BLOCK, high - BLOCK)


@kernel()
def list_blocks(i, boxes, whole, blocks):
    """List the blocks of cell i's band, or of its whole box.

    Parameters
    ----------
    blocks : (2, room) int32; its rows are `FRAME` and `STRETCH`

    Returns
    -------
    int : number of blocks
    """
    sx, sy = strides(i, boxes)
    n = 0
    for x in range(boxes.shape[i, 0]):
        row, goal = row_number(x, 0, i, boxes), frame_index(x, 0, 0, sx, sy)
        for _ in range(boxes.shape[i, 1]):
            low, high = np.int64(boxes.low[row]), np.int64(boxes.high[row])
            if whole:
                low, high = np.int64(0), boxes.shape[i, 2]
            place = np.int64(boxes.place[row])
            for k in range(n_blocks(low, high)):
                z = block(k, low, high)
                blocks[FRAME, n], blocks[STRETCH, n] = goal + z, place + z
                n += 1
            row += 1
            goal += sy
    return n


@kernel()
def load(pool, first, blocks, n, frame):
    """Copy a cell's stretch, which begins at `first` in a pool, into its frame."""
    for k in range(n):
        source, goal = np.uint64(first + blocks[STRETCH, k]), np.uint64(blocks[FRAME, k])
        for j in range(np.uint64(BLOCK)):
            frame[goal + j] = pool[source + j]


@kernel()
def wipe(blocks, n, frame):
    """Set a frame to 0 again, where a cell's blocks are."""
    for k in range(n):
        goal = np.uint64(blocks[FRAME, k])
        for j in range(np.uint64(BLOCK)):
            frame[goal + j] = 0


@inline_kernel()
def copy_block(source, first, target, goal):
    """Copy a block."""
    for j in range(np.uint64(BLOCK)):
        target[np.uint64(goal) + j] = source[np.uint64(first) + j]


@inline_kernel()
def copy_span(source, first, target, goal, count):
    """Copy a span, of at least a block: most have no blocks but the first and the last."""
    for at in range(BLOCK, count - BLOCK, BLOCK):
        copy_block(source, first + at, target, goal + at)
    copy_block(source, first, target, goal)
    copy_block(source, first + count - BLOCK, target, goal + count - BLOCK)


WORD = ir.IntType(32)


def _vector(context, real):
    """Type of a block in LLVM."""
    return ir.VectorType(context.get_value_type(real), BLOCK)


def _spread_out(builder, number, vector):
    """Block of one number."""
    single = builder.insert_element(ir.Constant(vector, ir.Undefined), number, WORD(0))
    everywhere = ir.Constant(ir.VectorType(WORD, BLOCK), [0] * BLOCK)
    return builder.shuffle_vector(single, ir.Constant(vector, ir.Undefined), everywhere)


def _pointer(context, builder, kind, values, first):
    """Where a block of an array begins."""
    array = context.make_array(kind)(context, builder, values)
    at = builder.gep(array.data, [first])
    return builder.bitcast(at, _vector(context, kind.dtype).as_pointer())


@intrinsic
def _scan(typing_context, values, first, level):
    """See `beyond`: one comparison of a whole block, and two counts of zero bits."""
    real, align = values.dtype, values.dtype.bitwidth // 8

    def generate(context, builder, signature, arguments):
        vector = _vector(context, real)
        at = _pointer(context, builder, values, arguments[0], arguments[1])
        found, level = builder.load(at, align=align), arguments[2]
        above = builder.fcmp_ordered(">", found, _spread_out(builder, level, vector))
        below = builder.fcmp_ordered("<", found, _spread_out(builder, builder.fneg(level), vector))
        bits = builder.bitcast(builder.or_(above, below), ir.IntType(BLOCK))
        mask = builder.zext(bits, WORD)
        low = builder.cttz(builder.or_(mask, WORD(1 << BLOCK)), ir.IntType(1)(1))
        high = builder.sub(WORD(32), builder.ctlz(mask, ir.IntType(1)(0)))
        wide = [builder.zext(value, ir.IntType(64)) for value in (low, high)]
        return context.make_tuple(builder, signature.return_type, wide)

    return types.UniTuple(types.int64, 2)(values, types.uint64, real), generate


def beyond(values, first, level):
    """First and last but one of a block's points with |value| > level; `BLOCK` and 0 if none is."""
    found = np.flatnonzero(np.abs(values[int(first) : int(first) + BLOCK]) > level)
    return (int(found[0]), int(found[-1]) + 1) if len(found) else (BLOCK, 0)


@overload(beyond, jit_options={"forceinline": True})
def _beyond_of_block(values, first, level):
    return lambda values, first, level: _scan(values, np.uint64(first), values.dtype.type(level))


def _power(builder, part, power):
    """Block, or its square if `power` is 2."""
    square = builder.fmul(part, part, flags=("contract",))
    is_square = builder.icmp_signed("==", power, ir.Constant(power.type, 2))
    return builder.select(is_square, square, part)


def _sum(builder, x, part, weight, power):
    """Block x + weight part^power."""
    product = builder.fmul(_power(builder, part, power), weight, flags=("contract",))
    return builder.fadd(x, product, flags=("contract",))


@intrinsic
def _write_block(typing_context, target, goal, a, x, at_x, b, y, at_y, power):
    """See `write_block`: vectors, which LLVM does not make of so short a loop."""
    real, at, align = target.dtype, types.uint64, target.dtype.bitwidth // 8

    def generate(context, builder, signature, arguments):
        goal, at_x, at_y = (
            _pointer(context, builder, signature.args[k], arguments[k], arguments[k + 1])
            for k in (0, 3, 6)
        )
        vector = _vector(context, real)
        a, b = (_spread_out(builder, arguments[k], vector) for k in (2, 5))
        x = builder.fmul(builder.load(at_x, align=align), a, flags=("contract",))
        total = _sum(builder, x, builder.load(at_y, align=align), b, arguments[8])
        builder.store(total, goal, align=align)

    return types.void(target, at, real, x, at, real, y, at, types.int64), generate


def write_block(target, goal, a, x, at_x, b, y, at_y, power):
    """Write a x + b y, or a x + b y² where `power` is 2.

    Parameters
    ----------
    target, goal : 1-D array, and where the block begins in it
    a, b : numbers in the type of the fields
    x, at_x, y, at_y : 1-D arrays, and where the blocks begin in them; x may be the target
    """
    other = y[int(at_y) : int(at_y) + BLOCK] ** power
    target[int(goal) : int(goal) + BLOCK] = a * x[int(at_x) : int(at_x) + BLOCK] + b * other


@overload(write_block, jit_options={"forceinline": True})
def _typed_write_block(target, goal, a, x, at_x, b, y, at_y, power):
    def written(target, goal, a, x, at_x, b, y, at_y, power):
        real = target.dtype.type
        _write_block(
            target, np.uint64(goal), real(a), x, np.uint64(at_x), real(b), y, np.uint64(at_y),
            np.int64(power),
        )  # fmt: skip

    return written


@intrinsic
def _add_ends(typing_context, target, goal, last, b, y, at_y, power):
    """See `add_ends`."""
    real, at, align = target.dtype, types.uint64, target.dtype.bitwidth // 8

    def generate(context, builder, signature, arguments):
        vector = _vector(context, real)
        b = _spread_out(builder, arguments[3], vector)
        sums, goals = [], []
        for first in (True, False):
            goal, at_y = arguments[1], arguments[5]
            if not first:
                goal, at_y = builder.add(goal, arguments[2]), builder.add(at_y, arguments[2])
            goals.append(_pointer(context, builder, target, arguments[0], goal))
            part = builder.load(_pointer(context, builder, y, arguments[4], at_y), align=align)
            before = builder.load(goals[-1], align=align)
            sums.append(_sum(builder, before, part, b, arguments[6]))
        for k in (1, 0):
            builder.store(sums[k], goals[k], align=align)

    return types.void(target, at, at, real, y, at, types.int64), generate


def add_ends(target, goal, last, b, y, at_y, power):
    """Add b y, or b y² where `power` is 2, to the first and the last block of a span.

    They may overlap. Both are read before they are written: to read what has just been written in
    part is slow.

    Parameters
    ----------
    target, goal : 1-D array, and where the span begins in it
    last : from there to where its last block begins
    b : number in the type of the fields
    y, at_y : 1-D array, and where the span begins in it
    """
    count = int(last) + BLOCK
    ends = np.r_[: min(BLOCK, int(last)), int(last) : count]
    target[int(goal) + ends] += b * y[int(at_y) + ends] ** power


@overload(add_ends, jit_options={"forceinline": True})
def _typed_add_ends(target, goal, last, b, y, at_y, power):
    def added(target, goal, last, b, y, at_y, power):
        real = target.dtype.type
        _add_ends(
            target, np.uint64(goal), np.uint64(last), real(b), y, np.uint64(at_y), np.int64(power)
        )

    return added


@inline_kernel()
def listed(x, y, ny):
    """Place of row (x, y) in a thread's `spans`, around which there are empty ones."""
    return (x + MARGIN) * (ny + 2 * HALO) + y + HALO


@inline_kernel()
def n_listed(nx, ny):
    """Length of such a list."""
    return (nx + 2 * MARGIN) * (ny + 2 * HALO)


@kernel()
def list_spans(i, boxes, widened, spans):
    """Write the band of cell i into `spans` OLD_LOW and OLD_HIGH; and by HALO wider, LOW and HIGH.

    The latter only if `widened`.
    """
    nx, ny, nz = boxes.shape[i, 0], boxes.shape[i, 1], boxes.shape[i, 2]
    low, high, least, most = spans[OLD_LOW], spans[OLD_HIGH], spans[LOW], spans[HIGH]
    for k in range(np.uint64(n_listed(nx, ny))):
        low[k], high[k] = nz, 0
        if widened:
            least[k], most[k] = nz, 0
    for x in range(nx):
        first, goal = np.uint64(row_number(x, 0, i, boxes)), np.uint64(listed(x, 0, ny))
        for y in range(np.uint64(ny)):
            z0, z1 = boxes.low[first + y], boxes.high[first + y]
            there = z0 < z1
            low[goal + y] = z0 if there else nz
            high[goal + y] = z1 if there else 0
            if widened:
                least[goal + y] = z0 - HALO if there else nz
                most[goal + y] = z1 + HALO if there else 0


@inline_kernel()
def least_of(values, k, far):
    """Smallest of the values around place k that a stencil reads, up to `HALO` away."""
    a, b = (
        min(values[k - np.uint64(1)], values[k + np.uint64(1)]),
        min(values[k - far], values[k + far]),
    )
    for n in range(2, HALO + 1):
        up, across = np.uint64(n), np.uint64(n) * far
        a = min(a, values[k - up], values[k + up])
        b = min(b, values[k - across], values[k + across])
    return min(a, b)


@inline_kernel()
def most_of(values, k, far):
    """Likewise the largest."""
    a, b = (
        max(values[k - np.uint64(1)], values[k + np.uint64(1)]),
        max(values[k - far], values[k + far]),
    )
    for n in range(2, HALO + 1):
        up, across = np.uint64(n), np.uint64(n) * far
        a = max(a, values[k - up], values[k + up])
        b = max(b, values[k - across], values[k + across])
    return max(a, b)


@kernel()
def spread(first, count, far, low, high, own_low, own_high, least, most):
    """Points of so many rows that stencils read, from those that they work on."""
    for k in range(first, first + np.uint64(count)):
        least[k] = min(own_low[k], least_of(low, k, far))
        most[k] = max(own_high[k], most_of(high, k, far))


@kernel()
def reach(i, boxes, spans):
    """Write the points of each row that stencils on the band read into NEW_LOW and NEW_HIGH.

    `list_spans` has written the others.
    """
    nx, far = boxes.shape[i, 0] + 2 * HALO, boxes.shape[i, 1] + 2 * HALO
    spread(
        np.uint64(listed(-HALO, -HALO, boxes.shape[i, 1])), nx * far, np.uint64(far),
        spans[OLD_LOW], spans[OLD_HIGH], spans[LOW], spans[HIGH], spans[NEW_LOW], spans[NEW_HIGH],
    )  # fmt: skip


@kernel()
def covered(i, boxes, spans):
    """Points whose neighbours along x, y and z are all in the band, into NEW_LOW and NEW_HIGH."""
    nx, ny = boxes.shape[i, 0], boxes.shape[i, 1]
    low, high, least, most = spans[OLD_LOW], spans[OLD_HIGH], spans[NEW_LOW], spans[NEW_HIGH]
    up, far = np.uint64(1), np.uint64(ny + 2 * HALO)
    for x in range(nx):
        first = np.uint64(listed(x, 0, ny))
        for k in range(first, first + np.uint64(ny)):
            least[k] = max(low[k] + 1, low[k - up], low[k + up], low[k - far], low[k + far])
            most[k] = min(high[k] - 1, high[k - up], high[k + up], high[k - far], high[k + far])


@inline_kernel()
def nearest_low(low, k, far):
    """Least of `low` two lattice steps from row k, and of that one step from it less one."""
    one, two, across = np.uint64(1), np.uint64(2), far + far
    near = min(low[k - one], low[k + one], low[k - far], low[k + far])
    beyond_ = min(
        min(low[k - two], low[k + two], low[k - across], low[k + across]),
        min(low[k - far - one], low[k - far + one], low[k + far - one], low[k + far + one]),
    )  # fmt: skip
    return min(near - 1, beyond_)


@inline_kernel()
def nearest_high(high, k, far):
    """Likewise the largest of `high`, and one more."""
    one, two, across = np.uint64(1), np.uint64(2), far + far
    near = max(high[k - one], high[k + one], high[k - far], high[k + far])
    beyond_ = max(
        max(high[k - two], high[k + two], high[k - across], high[k + across]),
        max(high[k - far - one], high[k - far + one], high[k + far - one], high[k + far + one]),
    )  # fmt: skip
    return max(near + 1, beyond_) if near > 0 else beyond_


@kernel()
def widen(i, boxes, spans):
    """Spans of the band, with all points up to `RIM` lattice steps from LOW to HIGH; or a block.

    They go into NEW_LOW and NEW_HIGH; where there are none, both are 0. Returns the number of
    points.
    """
    nx, ny, nz = boxes.shape[i, 0], boxes.shape[i, 1], boxes.shape[i, 2]
    total = np.int64(0)
    for x in range(nx):
        total += widen_plane(
            np.uint64(listed(x, 0, ny)), ny, nz, np.uint64(ny + 2 * HALO), spans[LOW], spans[HIGH],
            spans[NEW_LOW], spans[NEW_HIGH],
        )  # fmt: skip
    return total


@kernel()
def widen_plane(first, ny, nz, far, low, high, new_low, new_high):
    """`widen` of one plane."""
    total = np.int64(0)
    for k in range(first, first + np.uint64(ny)):
        z0, z1 = nearest_low(low, k, far), nearest_high(high, k, far)
        if low[k] < high[k]:
            z0, z1 = min(z0, low[k] - RIM), max(z1, high[k] + RIM)
        z0, z1 = max(z0, 0), min(z1, nz)
        count = max(z1 - z0, 0)
        length = max(count, BLOCK) if count > 0 else 0
        z0 = min(max(z0 - (length - count) // 2, 0), nz - length) if count > 0 else 0
        new_low[k], new_high[k] = z0, z0 + length
        total += length
    return total


@kernel()
def stay(i, boxes, spans):
    """Leave the band as it is: OLD_LOW and OLD_HIGH go into NEW_LOW and NEW_HIGH."""
    low, high, new_low, new_high = spans[OLD_LOW], spans[OLD_HIGH], spans[NEW_LOW], spans[NEW_HIGH]
    for k in range(np.uint64(n_listed(boxes.shape[i, 0], boxes.shape[i, 1]))):
        there = low[k] < high[k]
        new_low[k], new_high[k] = low[k] if there else 0, high[k] if there else 0


@kernel()
def settle_rows(i, boxes, spans):
    """Make NEW_LOW and NEW_HIGH the band of cell i, whose spans follow one another."""
    ny = boxes.shape[i, 1]
    place = np.int64(0)
    for x in range(boxes.shape[i, 0]):
        first, source = row_number(x, 0, i, boxes), listed(x, 0, ny)
        for y in range(ny):
            low, high = spans[NEW_LOW, source + y], spans[NEW_HIGH, source + y]
            boxes.low[first + y], boxes.high[first + y] = low, high
            boxes.place[first + y] = place - low
            place += high - low


PREFETCH = "llvm.prefetch"
"""The name that all versions of LLVM know, whatever they call pointers."""


@intrinsic
def _fetch(typing_context, values, first):
    """See `fetch`."""

    def generate(context, builder, signature, arguments):
        array = context.make_array(values)(context, builder, arguments[0])
        at = builder.gep(array.data, [arguments[1]])
        pointer = builder.bitcast(at, ir.IntType(8).as_pointer())
        kind = ir.FunctionType(ir.VoidType(), [pointer.type, WORD, WORD, WORD])
        function = builder.module.globals.get(PREFETCH) or ir.Function(
            builder.module, kind, PREFETCH
        )
        builder.call(function, [pointer, WORD(0), WORD(3), WORD(1)])

    return types.void(values, types.uint64), generate


def fetch(values, first):
    """Ask for the cache line of a value that will be read soon; it may lie beyond the array.

    Where there is no array, nothing is asked for.
    """


@overload(fetch, jit_options={"forceinline": True})
def _typed_fetch(values, first):
    if isinstance(values, types.NoneType):
        return lambda values, first: None
    return lambda values, first: _fetch(values, np.uint64(first))
