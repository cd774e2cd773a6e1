"""How near a step comes to the limits of the machine: time, flops and bytes of each of its phases.

Run as `python benchmarks/roofline.py`. All is of one thread, in microseconds per cell and step.

Limits. What the machine can do is measured in the same process, the best of many rounds: the peak
of single-precision multiply-adds, and the speed of copies, read and written, in arrays that are
together as large as a thread's work arrays ("frames": cache), as the scene's pools and columns
("pools": a cache that all share, or memory, as their size has it), and as memory only can hold. A
phase takes at least as long as its flops at the peak, its bytes from and to pools at the speed of
pools, and its bytes from and to work arrays at the speed of frames; the largest of them is its
limit.

Time. A serial function does what the step kernels do for each cell, up to a given stage. A phase is
the difference of two of them, each the lower quartile of rounds in which all have their turn; the
state is restored in between. "in cache" is the same of one cell again and again (of one column for
the sums over cells), with coefficients that leave the cell as it is: what is more in "us" is what
it costs to have the state of all cells elsewhere. The sum of the phases is printed beside the time
of a real step.

Work. Points are those that the loops run over, counted with the kernels' own ranges; the last block
of a span may hold points of the one before again. Flops per point are counted by hand below: a sum,
difference or product is one, a square root, a comparison or a move none. The peak counts two for a
multiply-add, so what is not one cannot reach it. What a phase reads or writes of a pool or work
array counts once for each; what a stencil reads again counts once. Copies write half of what they
move, so a phase that mostly reads may come out beyond 100 %.
"""

import time
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import Any

import numba
import numpy as np
from _common import arguments, packed_scene, print_table, report

from morphosim import Simulation
from morphosim.kernels._jit import kernel
from morphosim.kernels.boxes import BAND
from morphosim.kernels.chebyshev import iterate
from morphosim.kernels.columns import ROWS, SHIFT, gather, sum_column
from morphosim.kernels.forces import right_hand_side
from morphosim.kernels.frames import HALO, clear, mirror
from morphosim.kernels.helmholtz import helmholtz_solve
from morphosim.kernels.layout import CellTerms, Scheme
from morphosim.kernels.rows import (
    BLOCK,
    FRAME,
    NEW_HIGH,
    NEW_LOW,
    STRETCH,
    list_blocks,
    list_spans,
    listed,
    load,
    n_blocks,
    reach,
    row_span,
    wipe,
)
from morphosim.kernels.step import (
    MEMORY,
    PHI,
    PSI,
    RESULT,
    RHS,
    START,
    R,
    accept_band,
    accept_box,
    keep_history,
)

DERIVATIVE = 8
"""Sixth order: 3 differences, 3 products, 2 sums (`derivative`)."""
FORCE = 3 * DERIVATIVE + 6 + 3 * (DERIVATIVE + 2) + 6 + 2
"""∇φ; p |∇φ| (4 products, 2 sums); ∇φ·∇ψ (per axis ∂ψ, a product, a difference); the well (3
products, 3 differences); φ R (a product, a difference) (`force`, without drift)."""
RIGHT_HAND_SIDE = FORCE + 4 + 3
"""F; a0 φ + a1 F + H; b0 φ + b1 F (`blocks_right_hand_side`)."""
START_OF_ITERATIONS = 4
"""e0 φ + e1 (H + F)."""
ITERATION = 3 * 5 + 5 + 5
"""Three sums of six neighbours; their weights (3 products, 2 sums); the rest (3 products, 2 sums)
(`weighted_neighbours`, `iterate_blocks`)."""
READ = 3
"""R and ψ: two products and a difference each (`read_block`, `read_own`)."""
ADD = 3 + 1
"""R: g φ φ and a sum; Σ φ: a sum (`add_points`)."""
SURVEY = 1 + 4
"""φ² and four sums (`row_sums`)."""
DIVIDE = 3
"""A product, a sum, a division (`divide_by_symbol`)."""
STEPS, CHAINS, CHAIN_POINTS = 16, 8, 1024
"""Multiply-adds one after the other, of so many independent ones, at each of so many points."""
LARGE = 64_000_000
"""Bytes of an array that no cache holds."""
AGAIN, ADD_AGAIN = 20, 3
"""How often one cell, and one column, is taken again."""
SETTLING = 20
"""Steps before the timing."""
QUARTILE = 0.25
"""Of the rounds. Phases are differences, which medians spoil where other programs take turns on
the machine: its fast state is then left out of some of them."""

PHASES = {
    "band": ("load", "gather", "force", "iterations", "accept"),
    "dct": ("load", "gather", "force", "transform", "accept"),
}
"""Phases after "accumulate", in the order of the stages of `band_stages`, `transform_stages`."""
IN_BAND, WORKED, REACH, ADDED, REPELLED, PULLED, N_COUNTED = 0, 1, 2, 3, 4, 5, 6
"""Points of a cell: of its band, or box; of the blocks; that stencils read; that are added to
columns; that read R; that read ψ (from a column, in both cases)."""


@numba.njit(error_model="numpy", fastmath={"contract"}, nogil=True)
def multiply_add(x, out, c, repeats):
    """Fill the pipes with independent multiply-adds; not re-associated, which would merge them."""
    for _ in range(repeats):
        for j in range(np.uint64(x.shape[0])):
            v = x[j]
            p0, p1, p2, p3 = v, v + c[1], v + c[2], v + c[3]
            p4, p5, p6, p7 = v + c[4], v + c[5], v + c[6], v + c[7]
            for _ in range(STEPS):
                p0 = p0 * v + c[0]
                p1 = p1 * v + c[0]
                p2 = p2 * v + c[0]
                p3 = p3 * v + c[0]
                p4 = p4 * v + c[0]
                p5 = p5 * v + c[0]
                p6 = p6 * v + c[0]
                p7 = p7 * v + c[0]
            out[j] = ((p0 + p1) + (p2 + p3)) + ((p4 + p5) + (p6 + p7))


@kernel()
def copy(source, target, repeats):
    """Copy as the kernels do; NumPy's stores go past the caches when arrays are large."""
    for _ in range(repeats):
        for k in range(np.uint64(source.shape[0])):
            target[k] = source[k]


@kernel()
def band_stages(
    stage, cells, phi, history, boxes, terms, interaction, columns, frames, stretches, blocks,
    spans, stencil, scheme, limits, measured, surveys, room, lost,
):  # fmt: skip
    """What `step_band` does, up to a stage: 1 load, 2 gather, 3 force, 4 iterations, 5 accept.

    To load is to list the blocks, and to wipe the frames in the end, too.
    """
    one = limits.half + limits.half
    for k in range(cells.shape[0]):
        i = cells[k]
        n = list_blocks(i, boxes, False, blocks)
        load(phi, boxes.start[i], blocks, n, frames[PHI])
        if stage >= 2:
            gather(
                i, boxes, False, interaction, columns, None, None, frames[PHI], stretches[R],
                frames[PSI], spans,
            )  # fmt: skip
        if stage >= 3:
            right_hand_side(
                i, boxes, blocks, n, terms, terms.drift, frames[PHI], frames[PSI], stretches[R],
                history, stretches[RHS], stretches[MEMORY], frames[START], stencil, scheme,
                limits.half, True,
            )  # fmt: skip
        if stage >= 4:
            last = terms.n_iterations[i] - 1
            for s in range(last + 1):
                source = START if s % 2 == 0 else PHI
                target, where = frames[START + PHI - source], FRAME
                if s == last:
                    target, where = stretches[RESULT], STRETCH
                iterate(
                    i, boxes, blocks, n, where, frames[source], target, stretches[RHS], stencil,
                    scheme.lhs, terms.gamma[i], terms.weights[i, s], one,
                )  # fmt: skip
        wipe(blocks, n, frames[PHI])
        wipe(blocks, n, frames[START])
        if stage >= 5:
            accept_band(
                i, phi, history, stretches[RESULT], stretches[MEMORY], boxes, room[i], limits,
                spans, measured, surveys, lost,
            )  # fmt: skip


@kernel()
def transform_stages(
    stage, cells, phi, history, boxes, terms, interaction, columns, frames, stretches, blocks,
    spans, stencil, scheme, limits, measured, surveys, found, cosines,
):  # fmt: skip
    """What `step_transform` does, up to a stage.

    They are 1 load, 2 gather, 3 force, 4 transform, 5 accept.
    """
    for k in range(cells.shape[0]):
        i = cells[k]
        n = list_blocks(i, boxes, True, blocks)
        clear(i, boxes, frames[PHI])
        load(phi, boxes.start[i], blocks, n, frames[PHI])
        if stage >= 2:
            gather(
                i, boxes, True, interaction, columns, None, None, frames[PHI], stretches[R],
                frames[PSI], spans,
            )  # fmt: skip
            mirror(i, boxes, frames[PHI])
        if stage >= 3:
            right_hand_side(
                i, boxes, blocks, n, terms, terms.drift, frames[PHI], frames[PSI], stretches[R],
                history, stretches[RHS], stretches[MEMORY], None, stencil, scheme, limits.half,
                True,
            )  # fmt: skip
        if stage >= 4:
            helmholtz_solve(
                stretches[RHS], frames[PSI], frames[PHI],
                boxes.shape[i, 0], boxes.shape[i, 1], boxes.shape[i, 2],
                cosines, scheme.lhs, terms.gamma[i],
            )  # fmt: skip
        if stage >= 5:
            accept_box(i, phi, stretches[RHS], boxes, limits, found, measured, surveys)
            keep_history(i, history, boxes, stretches[MEMORY])


@kernel()
def accumulate_again(lists, phi, boxes, interaction, columns, repeats):
    """Sum all cells on the columns, each column so many times before the next."""
    for a in range(lists.start.shape[0]):
        for _ in range(repeats):
            sum_column(
                a, lists, phi, boxes, interaction.types, interaction.pull.shape[0],
                interaction.g, columns.background, columns.field, columns.repulsion,
                columns.potential,
            )  # fmt: skip


@kernel()
def count_points(boxes, whole, columns, spans, out):
    """Points (N, N_COUNTED) that the kernels' loops run over."""
    for i in range(boxes.start.shape[0]):
        nx, ny, nz = boxes.shape[i, 0], boxes.shape[i, 1], boxes.shape[i, 2]
        ox, oy = boxes.origin[i, 0], boxes.origin[i, 1]
        columns_y = ((oy + ny + HALO - 1) >> SHIFT) - ((oy - HALO) >> SHIFT) + 1
        list_spans(i, boxes, True, spans)
        reach(i, boxes, spans)
        for x in range(-HALO, nx + HALO):
            column = columns.cover_start[i]
            column += (((ox + x) >> SHIFT) - ((ox - HALO) >> SHIFT)) * columns_y
            for y in range(-HALO, ny + HALO):
                k = listed(x, y, ny)
                read = max(np.int64(spans[NEW_HIGH, k]) - np.int64(spans[NEW_LOW, k]), 0)
                in_band = own = 0
                if 0 <= x < nx and 0 <= y < ny:
                    low, high = row_span(x, y, i, boxes)
                    in_band = own = max(high - low, 0)
                if whole:
                    read, own = nz + 2 * HALO, nz if 0 <= x < nx and 0 <= y < ny else 0
                out[i, IN_BAND] += own
                out[i, WORKED] += BLOCK * n_blocks(0, own)
                out[i, REACH] += read
                place = columns.cover[column + ((oy + y) >> SHIFT) - ((oy - HALO) >> SHIFT)]
                if place[0] >= 0:
                    out[i, ADDED] += in_band
                    out[i, REPELLED] += own
                    out[i, PULLED] += read


@dataclass(frozen=True)
class Work:
    """What a phase does, mean of the cells: points and flops, and values moved."""

    points: float
    flops: float
    pools: float
    """Values read from or written to pools and columns."""
    frames: float
    """Values read from or written to work arrays, and sums that stay in the cache."""


class Profile:
    """Scene of one solver: its phases, their time and their work."""

    def __init__(self, cells: int, radius: float, solver: str) -> None:
        scene = packed_scene(cells, radius, solver=solver, threads=1)
        self.solver, self.phases = solver, PHASES[solver]
        self.real, simulation = Simulation(scene), Simulation(scene)
        self.real.step(SETTLING)
        simulation.step(SETTLING)
        engine = self.engine = simulation.engine
        state = self._state = engine.step_state()
        columns = state.coupling.columns
        if columns is None or not columns.felt.all():
            raise ValueError("this account is of cells that meet: take more of them")
        self._scheme, self._terms = state.later, state.terms
        if solver == "band":
            self._terms = engine.solver.with_weights(self._terms)
        zero, one = engine.dtype.type(0), engine.dtype.type(1)
        self._still = (
            self._terms._replace(gamma=np.zeros_like(self._terms.gamma)),
            Scheme(self._scheme.lhs, self._scheme.lhs, zero, zero, zero, one, zero),
        )  # lhs φⁿ⁺¹ = lhs φⁿ, whatever the force
        pool = state.pool
        self._arrays = (
            pool.phi, pool.history, pool.surveys, pool.low, pool.high, pool.place, pool.lost,
        )  # fmt: skip
        self._saved = [array.copy() for array in self._arrays]
        self._points = np.zeros((cells, N_COUNTED), np.int64)
        spans = state.workspace.room.spans[0]
        count_points(pool.boxes, solver == "dct", columns, spans, self._points)
        worked = self._points[:, WORKED]
        self._middle = int(np.argmin(abs(worked - worked.mean())))
        self._check()

    def _check(self) -> None:
        """The stages together are a step, and one cell taken again and again stays as it is."""
        engine, phi = self.engine, self._state.pool.phi
        self._accumulate()
        engine.solver.advance(self._state, lambda values: values)
        expected = phi.copy()
        self._ready_all()
        self._do_all(len(self.phases))
        if not np.allclose(phi, expected, rtol=0, atol=1e-5):
            raise RuntimeError(f"{self.solver}: the stages do not add up to a step")
        self._ready_one()
        self._do_one(len(self.phases))
        if not np.allclose(phi, self._saved[0], rtol=0, atol=engine.numerics.box_tolerance):
            raise RuntimeError(f"{self.solver}: the cell taken again and again changes")

    def _do_all(self, stage: int) -> None:
        """All stages up to one, of all cells."""
        self._do(stage, self._state.schedule.order, self._terms, self._scheme)

    def _do_one(self, stage: int, times: int = AGAIN) -> None:
        """All stages up to one, of one cell again and again."""
        self._do(stage, np.full(times, self._middle, np.int64), *self._still)

    def _do(self, stage: int, cells: np.ndarray, terms: CellTerms, scheme: Scheme) -> None:
        state, space = self._state, self._state.workspace.room
        pool, coupling = state.pool, state.coupling
        common = (
            stage, cells, pool.phi, pool.history, pool.boxes, terms, coupling.interaction,
            coupling.columns, space.frames[0], space.stretches[0], space.blocks[0], space.spans[0],
            state.stencil, scheme, state.limits, space.measured[0], pool.surveys,
        )  # fmt: skip
        if self.solver == "band":
            band_stages(*common, pool.room, pool.lost)
        else:
            transform_stages(*common, space.found[0], self.engine.solver.tables.arrays)

    def _accumulate(self) -> None:
        self._state.coupling.accumulate(self._state.pool, self._state.schedule)

    def _restore(self) -> None:
        for array, saved in zip(self._arrays, self._saved, strict=True):
            np.copyto(array, saved)

    def _ready_all(self) -> None:
        """As a step finds it: the state, and its sums made just before."""
        self._restore()
        self._accumulate()

    def _ready_one(self) -> None:
        """State and columns of one cell in the cache; without history it stays as it is."""
        self._ready_all()
        pool = self._state.pool
        pool.history[pool.stretch(self._middle)] = 0
        self._do_one(len(self.phases), 3)

    def _ready_sums(self) -> None:
        """As sums find the state: just after a step."""
        self._restore()
        self._do_all(len(self.phases))

    def _accumulate_again(self) -> None:
        pool, coupling = self._state.pool, self._state.coupling
        accumulate_again(
            coupling.lists, pool.phi, pool.boxes, coupling.interaction, coupling.columns,
            1 + ADD_AGAIN,
        )  # fmt: skip

    def actions(self) -> dict[Any, tuple[Callable[[], None], Callable[[], None]]]:
        """What to time, each with what precedes it untimed."""
        found: dict[Any, tuple[Callable[[], None], Callable[[], None]]] = {
            (self.solver, "step"): (self.real.step, self.real.step),
            (self.solver, "sums"): (self._ready_sums, self._accumulate),
            (self.solver, "sums again"): (self._ready_sums, self._accumulate_again),
        }
        for stage in range(1, len(self.phases) + 1):
            found[self.solver, stage, "all"] = self._ready_all, partial(self._do_all, stage)
            found[self.solver, stage, "one"] = self._ready_one, partial(self._do_one, stage)
        return found

    def microseconds(self, seconds: Mapping[Any, float]) -> dict[str, tuple[float, float]]:
        """Per cell, of each phase: of all cells, and in the cache."""
        cells, sums = len(self.engine), seconds[self.solver, "sums"]
        again = (seconds[self.solver, "sums again"] - sums) / ADD_AGAIN
        found = {"accumulate": (1e6 * sums / cells, 1e6 * again / cells)}
        before = 0.0, 0.0
        for stage, phase in enumerate(self.phases, 1):
            now = (
                1e6 * seconds[self.solver, stage, "all"] / cells,
                1e6 * seconds[self.solver, stage, "one"] / AGAIN,
            )
            found[phase] = now[0] - before[0], now[1] - before[1]
            before = now
        return found

    def points(self) -> dict[str, Any]:
        """Points per cell: one line of a table."""
        mean = self._points.mean(axis=0)
        return {
            "solver": self.solver,
            "of the box": float(self._state.pool.sizes().mean()),
            "active": self.active,
            "of the band, or box": float(mean[IN_BAND]),
            "of blocks": float(mean[WORKED]),
            "that stencils read": float(mean[REACH]),
            "added to columns": float(mean[ADDED]),
            "active of blocks, %": 100 * self.active / float(mean[WORKED]),
        }

    @property
    def frames(self) -> int:
        """Bytes of the padded work arrays, and of the others, of the only thread."""
        room = self._state.workspace.room
        return room.frames.nbytes + room.stretches.nbytes

    @property
    def active(self) -> float:
        """Points per cell with |φ| beyond the tolerance."""
        return float(self._saved[2][:, BAND].mean())

    def work(self) -> dict[str, Work]:
        """What each phase does per cell; see the kernels that `band_stages` calls."""
        engine = self.engine
        mean = self._points.mean(axis=0).tolist()
        held, worked, reached, added, repelled, pulled = mean
        columns = 2.0 * ROWS * float(self._state.coupling.lists.length.sum()) / len(engine)
        box = float(self._state.pool.sizes().mean())
        if self.solver == "band":
            count = int(self._terms.n_iterations[0])
            own = {
                # Fills φ's frame, and wipes it and that of the start.
                "load": Work(worked, 0, held, 3 * held),
                # Reads φ, R, H, ψ; writes H, the right-hand side and the start.
                "force": Work(
                    worked, (RIGHT_HAND_SIDE + START_OF_ITERATIONS) * worked, held,
                    2 * reached + 4 * held,
                ),
                # Each reads u and the right-hand side, and writes u.
                "iterations": Work(
                    count * worked, ITERATION * count * worked, 0, count * (reached + 2 * held)
                ),
                # Reads φ twice and H; writes both pools.
                "accept": Work(held, SURVEY * held, 2 * held, 3 * held),
            }  # fmt: skip
        else:
            sizes = self._state.pool.shape.sum(axis=1)
            framed = float((self._state.pool.shape + 2 * HALO).prod(axis=1).mean())
            products = float((4 * self._state.pool.sizes() * sizes).mean())
            own = {
                # Clears φ's frame, and fills it.
                "load": Work(worked, 0, box, framed + box),
                # Reads φ, R, H, ψ; writes H and the right-hand side.
                "force": Work(worked, RIGHT_HAND_SIDE * worked, box, 2 * reached + 3 * box),
                # Six products and a division, each reads and writes; two copies into blocks, which
                # stay in the innermost cache.
                "transform": Work(box, products + DIVIDE * box, 0, (6 * 2 + 2 + 2) * box),
                # Reads φ twice and H; writes both pools.
                "accept": Work(box, SURVEY * box, 2 * box, 3 * box),
            }
        both = {
            # Reads φ from the pool and writes the columns, once; adds to two sums in the cache.
            "accumulate": Work(added, ADD * added, added + columns, 4 * added),
            # Reads two sums and φ for each; writes R and ψ.
            "gather": Work(
                reached, READ * (repelled + pulled), repelled + pulled,
                repelled + held + pulled + reached,
            ),
        }  # fmt: skip
        work = both | own
        return {phase: work[phase] for phase in ("accumulate", *self.phases)}

    def rows(self, seconds: Mapping[Any, float], speeds: Mapping[str, float]) -> list[dict]:
        """The account: a line for each phase, their sum, and the step."""
        work, found = self.work(), self.microseconds(seconds)
        bytes_each = self.engine.dtype.itemsize
        pools, frames = speeds[f"copy, {self.solver} pools, GB/s"], speeds["copy, frames, GB/s"]
        rows = []
        for phase, (us, cached) in found.items():
            done = work[phase]
            least = {
                "flops": 1e-3 * done.flops / speeds["peak, GFlop/s"],
                "pools": 1e-3 * done.pools * bytes_each / pools,
                "frames": 1e-3 * done.frames * bytes_each / frames,
            }
            bound = max(least, key=least.__getitem__)
            rows.append({
                "solver": self.solver,
                "phase": phase,
                "us": us,
                "in cache, us": cached,
                "points": round(done.points),
                "flops/point": done.flops / done.points,
                "pools, kB": 1e-3 * done.pools * bytes_each,
                "frames, kB": 1e-3 * done.frames * bytes_each,
                **{f"by {name}, us": value for name, value in least.items()},
                "limit, us": least[bound],
                "bound": bound,
            })  # fmt: skip
        summed = [key for key in rows[0] if key.endswith((", us", ", kB")) or key == "us"]
        total = {key: sum(row[key] for row in rows) for key in summed}
        blank = dict.fromkeys(rows[0])
        step = 1e6 * seconds[self.solver, "step"] / len(self.engine)
        rows.append(blank | {"solver": self.solver, "phase": "sum"} | total)
        rows.append(
            blank | {"solver": self.solver, "phase": "real step"} | total
            | {"us": step, "in cache, us": None}
        )  # fmt: skip
        for row in rows:
            row["of flops, %"] = 100 * row["by flops, us"] / row["us"]
            row["of bytes, %"] = 100 * max(row["by pools, us"], row["by frames, us"]) / row["us"]
            row["of limit, %"] = 100 * row["limit, us"] / row["us"]
        return rows


def conclusion(rows: list[dict], points: Mapping[str, Any]) -> str:
    """Limit, share reached, and what stands between, from the numbers."""
    *phases, total, step = rows
    lost = sorted(phases, key=lambda row: row["limit, us"] - row["us"])
    parts = [
        f"{row['phase']} {round(row['us'] - row['limit, us'])} (limit by {row['bound']} "
        f"{row['limit, us']:.0f})"
        for row in lost
    ]
    outside = step["us"] - total["us"]
    away = total["us"] - total["in cache, us"]
    return (
        f"{step['solver']}: the limit is {step['limit, us']:.0f} us per cell and core, a step "
        f"takes {step['us']:.0f}: {step['of limit, %']:.0f} % of the limit is reached. Between "
        f"them stand, in us, {', '.join(parts)}, and {round(outside)} outside of the phases. Of "
        f"this, having all cells' state outside of the cache costs {round(away)}. "
        f"{points['active of blocks, %']:.0f} % of the points of the blocks are active."
    )


def timed(
    actions: Mapping[Any, tuple[Callable[[], None], Callable[[], None]]],
    rounds: int,
    warm_up: int = 2,
) -> dict[Any, float]:
    """Lower quartile of the seconds of each action, in turn; what precedes it is not timed."""
    found: dict[Any, list[float]] = {name: [] for name in actions}
    for turn in range(warm_up + rounds):
        for name, (ready, action) in actions.items():
            ready()
            begin = time.perf_counter()
            action()
            if turn >= warm_up:
                found[name].append(time.perf_counter() - begin)
    return {name: float(np.quantile(values, QUARTILE)) for name, values in found.items()}


def best(action: Callable[[], None], rounds: int) -> float:
    """Least seconds of an action."""
    seconds = []
    for _ in range(rounds + 1):
        begin = time.perf_counter()
        action()
        seconds.append(time.perf_counter() - begin)
    return min(seconds[1:])


def peak(rounds: int) -> float:
    """Single-precision multiply-adds, GFlop/s."""
    x, out = np.full(CHAIN_POINTS, 0.5, np.float32), np.zeros(CHAIN_POINTS, np.float32)
    weights, repeats = np.linspace(0.4, 0.5, CHAINS, dtype=np.float32), 50
    seconds = best(lambda: multiply_add(x, out, weights, repeats), rounds)
    return 2e-9 * CHAINS * STEPS * CHAIN_POINTS * repeats / seconds


def copy_speed(size: int, rounds: int, threads: int = 1) -> float:
    """Copy of an array of `size` bytes to another, GB/s read and written."""
    source, target = np.ones(size // 4, np.float32), np.zeros(size // 4, np.float32)
    target[:] = 0  # maps its pages
    repeats = max(1, 16_000_000 // size)
    sources, targets = np.array_split(source, threads), np.array_split(target, threads)
    if threads == 1:
        seconds = best(lambda: copy(source, target, repeats), rounds)
    else:
        with ThreadPoolExecutor(threads) as pool:
            every = [repeats] * threads
            seconds = best(lambda: list(pool.map(copy, sources, targets, every)), rounds)
    return 2e-9 * source.nbytes * repeats / seconds


def limits(profiles: Mapping[str, Profile], rounds: int) -> dict[str, float]:
    """What the machine can do."""
    found = {"peak, GFlop/s": peak(rounds)}
    frames = max(profile.frames for profile in profiles.values())
    found["frames, MB"] = 1e-6 * frames
    found["copy, frames, GB/s"] = copy_speed(frames // 2, rounds)
    for solver, profile in profiles.items():
        pools = profile.engine.nbytes - profile.frames
        found[f"{solver} pools, MB"] = 1e-6 * pools
        found[f"copy, {solver} pools, GB/s"] = copy_speed(pools // 2, rounds)
    found["copy, memory, GB/s"] = copy_speed(LARGE, rounds)
    found["copy, memory, 2 threads, GB/s"] = copy_speed(LARGE, rounds, 2)
    return found


def main() -> None:
    """Measure and report."""
    options = arguments(__doc__, cells=100, radius=4.0, rounds=31)
    profiles = {name: Profile(options.cells, options.radius, name) for name in PHASES}
    actions = {k: v for profile in profiles.values() for k, v in profile.actions().items()}
    with profiles["band"].engine.limited_threads():
        speeds = limits(profiles, options.rounds)
        seconds = timed(actions, options.rounds)
    points = {name: profile.points() for name, profile in profiles.items()}
    accounts = {name: profile.rows(seconds, speeds) for name, profile in profiles.items()}
    for name, value in speeds.items():
        print(f"{name}: {value:.1f}")
    print("\npoints per cell")
    print_table(list(points.values()))
    print("\nus per cell and step, one thread")
    for name, rows in accounts.items():  # in the JSON, not in the table
        rows[-1] |= {"machine's limits": speeds, "points per cell": points[name]}
    report([row for rows in accounts.values() for row in rows], options.json)
    print()
    for name, rows in accounts.items():
        print(conclusion(rows, points[name]))


if __name__ == "__main__":
    main()
