"""The eight-cell embryo by this engine, by the published scheme on full grids, and by py-pde.

Run as `python benchmarks/peers.py [--threads 1] [--time 20] [--rounds 9] [--precision both]`
(two and a half minutes, half of it py-pde's compilation; `--precision single` leaves out py-pde in
double precision and takes two thirds of that). py-pde is needed by this benchmark alone: `pip
install py-pde`; where it is absent the other rows are shown.

All start from the same fields (scene `celegans-8`, the full grid of 120 × 80 × 60 points is the
published one) and have the same physics: double well, repulsion by cells and by the same wall that
the lattice resolves, attraction pair by pair, relative volume constraint. They are

- this engine with the presets `standard`, `fast` (if it has it) and `draft`. Only `draft` has a
  lattice of its own: h = 2/3 µm, δt = 4, and starts from the same shapes on it;
- the full grid: Eq. 8 and 9 with Fourier derivatives on N full grids, δt = 2 and S as `standard`,
  in NumPy and SciPy (`_peers.FullGrid`). It takes five transforms per cell and step, and is
  faster than `tests/reference/full_grid.py`, which it equals to rounding. It is not the published
  program itself, which is MATLAB;
- py-pde: explicit Euler, central differences of second order, Neumann boundaries, its Numba backend
  with the pointwise terms in one compiled loop (`_peers.PyPde`). δt is 2τ / (f + γ k²), the largest
  that is expected to be stable, made to divide the time.

Threads: every row may use `--threads`, and the column `threads` says that many. This engine uses
them throughout; SciPy for the transforms and BLAS for the sums over cells, with NumPy's
element-wise work on one; py-pde for its Laplacians and gradients, the rest on one.

Columns: time of a step and of a unit of *in silico* time relative to `standard`, medians of runs in
turn in one process after a warm-up (all have run and compiled before); memory of the arrays that
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
from collections.abc import Callable
from dataclasses import dataclass
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
from morphosim.numerics.parameters import PRESETS
from morphosim.scene.stability import chosen_S

WANTED = ("standard", "fast", "draft")
GRID = (60.0, 40.0, 30.0)
"""Size of the published grid, µm."""
FINE = {"dt": 0.25, "S": 0.0}
PRECISIONS = {"single": np.float32, "double": np.float64}
STEPS = 5
"""Steps of this engine in one measurement, which are short; of the others it is one."""


@dataclass(frozen=True)
class Contestant:
    """One way to advance the embryo."""

    name: str
    precision: str
    dt: float
    steps: int
    advance: Callable[[int], None]
    centroids: Callable[[], np.ndarray]
    nbytes: Callable[[], int]


def engine(preset: str, threads: int) -> Contestant:
    """One of the presets of this engine."""
    numerics = Numerics.preset(preset, threads=threads)
    simulation = Simulation(embryo().with_numerics(**PRESETS[preset], threads=threads))
    return Contestant(
        name=preset,
        precision=numerics.precision,
        dt=numerics.dt,
        steps=STEPS,
        advance=simulation.step,
        centroids=lambda: cut_centroids(simulation.fields, numerics.spacing),
        nbytes=lambda: simulation.engine.nbytes,
    )


def peer(name: str, precision: str, solver: FullGrid | PyPde) -> Contestant:
    """One of the others."""
    return Contestant(
        name=name,
        precision=precision,
        dt=solver.dt,
        steps=1,
        advance=solver.advance,
        centroids=solver.centroids,
        nbytes=lambda: solver.nbytes,
    )


def full_grid(start: Problem, precision: str, threads: int, **changes: float) -> FullGrid:
    """The published scheme with the numerics of `standard`."""
    numerics = start.scene.numerics
    steps = {"dt": numerics.dt, "S": chosen_S(start.scene)} | changes
    return FullGrid(start, PRECISIONS[precision], threads, **steps)


def contestants(start: Problem, options: argparse.Namespace) -> list[Contestant]:
    """All of them, `standard` first."""
    threads = options.threads
    chosen = list(PRECISIONS) if options.precision == "both" else [options.precision]
    found = [engine(preset, threads) for preset in WANTED if preset in PRESETS]
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


def row(
    one: Contestant, cells: int, threads: int, seconds: dict[str, float], nm: dict[str, float]
) -> dict[str, Any]:
    """One line of the table."""
    return {
        "solver": one.name,
        "precision": one.precision,
        "threads": threads,
        "dt": one.dt,
        "ms per step": 1e3 * seconds["mine"],
        "step, relative": seconds["mine"] / seconds["standard"],
        "unit of time, relative": seconds["mine"] / one.dt / seconds["standard per time"],
        "MB per cell": one.nbytes() / cells / 1e6,
        **nm,
    }


def main() -> None:
    """Advance all to the same time, compare, then measure."""
    options = arguments(__doc__, threads=1, time=20.0, rounds=9, precision="both")
    if options.time <= 0 or options.time % 4:
        sys.exit(f"--time {options.time:g}: expected a multiple of 4, the step of draft")
    start = problem(embryo().with_numerics(threads=options.threads), GRID)
    all_of_them = contestants(start, options)
    fine = full_grid(start, "single", options.threads, **FINE)
    fine.advance(round(options.time / fine.dt))
    ends = []
    for one in all_of_them:
        one.advance(round(options.time / one.dt))
        ends.append(one.centroids())
    end_fine = fine.centroids()
    exact = next(
        end
        for one, end in zip(all_of_them, ends, strict=True)
        if (one.name, one.precision) == ("full grid", "double")
    )
    begin = grid_centroids(start.phi, start.h)
    medians = alternating_medians(
        {str(k): lambda one=one: one.advance(one.steps) for k, one in enumerate(all_of_them)},
        options.rounds,
        warm_up=1,
    )
    steps = [medians[str(k)] / one.steps for k, one in enumerate(all_of_them)]
    standard = {"standard": steps[0], "standard per time": steps[0] / all_of_them[0].dt}
    rows = []
    for one, mine, end in zip(all_of_them, steps, ends, strict=True):
        rms, largest = distances(end, exact)
        fine_rms, fine_largest = distances(end, end_fine)
        nm = {
            "rms nm": rms,
            "max nm": largest,
            "rms nm, small dt": fine_rms,
            "max nm, small dt": fine_largest,
            "moved nm": distances(end, begin)[0],
        }
        rows.append(row(one, len(start.phi), options.threads, standard | {"mine": mine}, nm))
    report(rows, options.json)


if __name__ == "__main__":
    main()
