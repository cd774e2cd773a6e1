"""The eight-cell embryo by this engine, by the published scheme on full grids, and by py-pde.

Run as `python benchmarks/peers.py [--threads 1] [--time 20] [--rounds 9] [--precision both]`
(two and a half minutes, half of it py-pde's compilation; `--precision single` leaves out py-pde in
double precision and takes two thirds of that). py-pde is needed by this benchmark alone: `pip
install py-pde`; where it is absent the other rows are shown.

All start from the same fields (scene `celegans-8`, the full grid of 120 × 80 × 60 points is the
published one) and have the same physics: double well, repulsion by cells and by the same wall that
the lattice resolves, attraction pair by pair, relative volume constraint. They are

- this engine on that lattice with steps of δt = 2, by its solvers `dct` (Eq. 9, as the full grid),
  `band` (Eq. 9) and `linearised`;
- this engine with the presets `standard`, `fast` and `draft`, whose steps are as long as their
  tolerance allows: `dt` is the mean of those that are timed. The last two have lattices of their
  own, h = 0.6 and 2/3 µm, and start from the same shapes on them;
- the full grid: Eq. 8 and 9 with Fourier derivatives on N full grids, δt = 2 and S as `dct`, in
  NumPy and SciPy (`_peers.FullGrid`). It takes five transforms per cell and step, and is faster
  than `tests/reference/full_grid.py`, which it equals to rounding. It is not the published program
  itself, which is MATLAB;
- py-pde: explicit Euler, central differences of second order, Neumann boundaries, its Numba backend
  with the pointwise terms in one compiled loop (`_peers.PyPde`). δt is 2τ / (f + γ k²), the largest
  that is expected to be stable, made to divide the time.

Threads: every row may use `--threads`, and the column `threads` says that many. This engine uses
them throughout; SciPy for the transforms and BLAS for the sums over cells, with NumPy's
element-wise work on one; py-pde for its Laplacians and gradients, the rest on one.

Columns: time of a step and of a unit of *in silico* time relative to `dct`, medians of runs in turn
in one process after a warm-up (all have run and compiled before); memory of the arrays that
live from step to step, per cell (of this engine: of all that grows with the cells, work space
included; of py-pde: the fields and their rates; the work space of full grids is not counted). And,
as a check that all solve the same problem, how far the centroids at `--time` are from those of the
full grid in double precision, as it is and with δt = 0.25, S = 0, where the error of its time step
has gone (single precision): root mean square and largest. py-pde differs from the latter by its own
errors, of second order in space and of first order in its small δt; the first comparison rather
shows the error of δt = 2. `moved` is how far cells have come since the start.
"""

import argparse
import importlib.util
import sys
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from _common import alternating_medians, arguments, report
from _peers import (
    FullGrid,
    Problem,
    PyPde,
    cut_centroids,
    dividing_step,
    grid_centroids,
    largest_explicit_step,
    problem,
)
from _scenes import embryo

from morphosim import Numerics, Simulation
from morphosim.bench import BY_SOLVER
from morphosim.errors import ResolutionWarning
from morphosim.scene.stability import chosen_S

PRESETS = ("standard", "fast", "draft")
GRID = (60.0, 40.0, 30.0)
"""Size of the published grid, µm."""
FINE = {"dt": 0.25, "S": 0.0}
PRECISIONS = {"single": np.float32, "double": np.float64}
SPAN = 10.0
"""*In silico* time of one measurement of this engine, which is fast; of the others it is a step."""


@dataclass(frozen=True)
class Contestant:
    """One way to advance the embryo."""

    name: str
    precision: str
    span: float
    """*In silico* time of one measurement."""
    advance: Callable[[float], int]
    """Advance by so much *in silico* time; the steps that it took."""
    centroids: Callable[[], np.ndarray]
    nbytes: Callable[[], int]


def engine(name: str, numerics: Numerics) -> Contestant:
    """The engine of this project, with some numerics."""
    simulation = Simulation(replace(embryo(), numerics=numerics))

    def advance(time: float) -> int:
        before = simulation.steps
        simulation.run(until=simulation.time + time)
        return simulation.steps - before

    return Contestant(
        name=name,
        precision=numerics.precision,
        span=SPAN,
        advance=advance,
        centroids=lambda: cut_centroids(simulation.fields, numerics.spacing),
        nbytes=lambda: simulation.engine.nbytes,
    )


def engines(threads: int) -> list[Contestant]:
    """The engine by its solvers with steps of δt, `dct` first, and with presets."""
    solvers = {n: Numerics(threads=threads, **values) for n, values in BY_SOLVER.items()}
    presets = {f"preset {n}": Numerics.preset(n, threads=threads) for n in PRESETS}
    return [engine(name, numerics) for name, numerics in (solvers | presets).items()]


def peer(name: str, precision: str, solver: FullGrid | PyPde) -> Contestant:
    """One of the others."""

    def advance(time: float) -> int:
        steps = round(time / solver.dt)
        solver.advance(steps)
        return steps

    return Contestant(
        name=name,
        precision=precision,
        span=solver.dt,
        advance=advance,
        centroids=solver.centroids,
        nbytes=lambda: solver.nbytes,
    )


def full_grid(start: Problem, precision: str, threads: int, **changes: float) -> FullGrid:
    """The published scheme, with δt and S of the engine's defaults."""
    numerics = start.scene.numerics
    steps = {"dt": numerics.dt, "S": chosen_S(start.scene)} | changes
    return FullGrid(start, PRECISIONS[precision], threads, **steps)


def contestants(start: Problem, options: argparse.Namespace) -> list[Contestant]:
    """All of them, `dct` first."""
    threads = options.threads
    chosen = list(PRECISIONS) if options.precision == "both" else [options.precision]
    found = engines(threads)
    # Double precision is what the centroids are compared with: it always runs.
    found += [peer("full grid", p, full_grid(start, p, threads)) for p in PRECISIONS]
    if importlib.util.find_spec("pde") is None:
        print("py-pde is absent, its rows are left out: pip install py-pde", file=sys.stderr)
        return found
    dt = dividing_step(largest_explicit_step(start.scene), options.time)
    for p in chosen:
        begin = time.perf_counter()
        found.append(peer("py-pde", p, PyPde(start, PRECISIONS[p], threads, dt)))
        print(f"py-pde, {p} precision: compiled in {time.perf_counter() - begin:.0f} s")
    return found


def distances(found: np.ndarray, expected: np.ndarray) -> tuple[float, float]:
    """Root mean square and largest distance, nm."""
    shift = 1e3 * np.linalg.norm(found - expected, axis=1)
    return float(np.sqrt((shift**2).mean())), float(shift.max())


def timed(all_of_them: list[Contestant], rounds: int) -> list[tuple[float, float]]:
    """Seconds of a unit of *in silico* time, and mean step, of all in turn."""
    steps = [0] * len(all_of_them)

    def advance(k: int) -> None:
        steps[k] += all_of_them[k].advance(all_of_them[k].span)

    actions = {str(k): lambda k=k: advance(k) for k in range(len(all_of_them))}
    medians = alternating_medians(actions, rounds, warm_up=1)
    return [
        (medians[str(k)] / one.span, (rounds + 1) * one.span / steps[k])
        for k, one in enumerate(all_of_them)
    ]


def main() -> None:
    """Advance all to the same time, compare, then measure."""
    options = arguments(__doc__, threads=1, time=20.0, rounds=9, precision="both")
    start = problem(embryo().with_numerics(threads=options.threads), GRID)
    if options.time <= 0 or options.time % start.scene.numerics.dt:
        sys.exit(f"--time {options.time:g}: expected a multiple of {start.scene.numerics.dt:g}")
    warnings.simplefilter("ignore", ResolutionWarning)
    all_of_them = contestants(start, options)
    fine = full_grid(start, "single", options.threads, **FINE)
    fine.advance(round(options.time / fine.dt))
    for one in all_of_them:
        one.advance(options.time)
    ends, end_fine = [one.centroids() for one in all_of_them], fine.centroids()
    exact = next(
        end
        for one, end in zip(all_of_them, ends, strict=True)
        if (one.name, one.precision) == ("full grid", "double")
    )
    begin = grid_centroids(start.phi, start.h)
    times = timed(all_of_them, options.rounds)
    unit, dt = times[0]
    rows: list[dict[str, Any]] = []
    for one, (own_unit, own_dt), end in zip(all_of_them, times, ends, strict=True):
        rms, largest = distances(end, exact)
        fine_rms, fine_largest = distances(end, end_fine)
        rows.append(
            {
                "solver": one.name,
                "precision": one.precision,
                "threads": options.threads,
                "dt": own_dt,
                "ms per step": 1e3 * own_unit * own_dt,
                "step, relative": own_unit * own_dt / (unit * dt),
                "unit of time, relative": own_unit / unit,
                "MB per cell": one.nbytes() / len(start.phi) / 1e6,
                "rms nm": rms,
                "max nm": largest,
                "rms nm, small dt": fine_rms,
                "max nm, small dt": fine_largest,
                "moved nm": distances(end, begin)[0],
            }
        )
    report(rows, options.json)


if __name__ == "__main__":
    main()
