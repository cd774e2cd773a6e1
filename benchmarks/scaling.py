"""Time and memory against the number of cells: 1 to 10000 close-packed cells of R = 4 µm.

Run as `python benchmarks/scaling.py` (about 15 minutes, 10 GB; `--cells 1,10,100` for less,
`--solvers band,linearised` for other solvers). Up to 1000 cells the solvers and numbers of threads
of one count run in turn in this process; more cells run one variant after the other, each in a
process of its own, so that only one holds memory. The peak memory of a process is always that of a
process of its own, with all that Python and the kernels take. Writes a table, and JSON on request.
"""

import multiprocessing
import resource
import sys
import time
from collections.abc import Sequence
from typing import Any

from _common import alternating_medians, arguments, packed_scene, report, stepper

from morphosim import Simulation
from morphosim.bench import BY_SOLVER

ALONE = 1000
"""More cells than this run in a process of their own."""
BASE = 100
"""Number of cells that cost is compared with."""
SETTLING = 12
TURN = 0.1
"""Seconds that a variant advances at least before the next has its turn."""

Key = tuple[int, str, int]
"""Number of cells, solver, number of threads."""


def say(text: str, end: str = "\n") -> None:
    """Progress."""
    print(text, end=end, file=sys.stderr, flush=True)


def build(key: Key) -> Simulation:
    """A simulation that is compiled and settled."""
    cells, solver, threads = key
    say(f"{cells} cells, {solver}, threads: {threads}: building", end="")
    begin = time.perf_counter()
    simulation = Simulation(packed_scene(cells, threads=threads, **BY_SOLVER[solver]))
    built = time.perf_counter()
    say(f" ({built - begin:.1f} s), first steps", end="")
    simulation.step(SETTLING)
    say(f" ({time.perf_counter() - built:.1f} s)")
    return simulation


def measure(keys: Sequence[Key], rounds: int) -> dict[Key, dict[str, float]]:
    """Seconds per step and bytes of variants that run in turn in this process."""
    simulations = {key: build(key) for key in keys}
    speeds = alternating_medians({str(k): stepper(s) for k, s in simulations.items()}, 1, 0)
    steps = {k: max(1, round(TURN / speeds[str(k)])) for k in keys}
    medians = alternating_medians(
        {str(k): stepper(s, steps[k]) for k, s in simulations.items()}, rounds, warm_up=1
    )
    return {
        key: {"seconds": medians[str(key)] / steps[key], "bytes": float(s.engine.nbytes)}
        for key, s in simulations.items()
    }


def peak_bytes() -> float:
    """Most memory that this process has held."""
    unit = 1 if sys.platform == "darwin" else 1024
    return float(unit * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)


def measure_alone(key: Key, rounds: int) -> dict[str, float]:
    """Seconds per step, bytes and peak memory of one variant; call it in a process of its own."""
    return measure([key], rounds)[key] | {"peak": peak_bytes()}


def in_child(key: Key, rounds: int) -> dict[str, float]:
    """`measure_alone` in a process of its own."""
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        return pool.apply(measure_alone, (key, rounds))


def results(cells: int, variants: Sequence[tuple[str, int]], rounds: int) -> dict[Key, dict]:
    """Measurements of all variants with one number of cells."""
    keys = [(cells, solver, threads) for solver, threads in variants]
    if cells > ALONE:
        return {key: in_child(key, rounds) for key in keys}
    found = measure(keys, rounds)
    return {key: found[key] | {"peak": in_child(key, 1)["peak"]} for key in keys}


def row(key: Key, found: dict[Key, dict[str, float]]) -> dict[str, Any]:
    """One line of the table."""
    cells, solver, threads = key
    per_cell = found[key]["seconds"] / cells
    base = found.get((BASE, solver, threads))
    return {
        "cells": cells,
        "solver": solver,
        "threads": threads,
        "ms per step": 1e3 * found[key]["seconds"],
        "us per cell-step": 1e6 * per_cell,
        "us x threads": 1e6 * per_cell * threads,
        f"per cell / {BASE}": per_cell * BASE / base["seconds"] if base else None,
        "MB per cell": found[key]["bytes"] / cells / 1e6,
        "peak MB, process": found[key]["peak"] / 1e6,
    }


def main() -> None:
    """Measure and report."""
    options = arguments(
        __doc__, cells="1,10,100,1000,10000", solvers="dct,band", threads="1,2", rounds=7
    )
    variants = [
        (solver, int(threads))
        for solver in options.solvers.split(",")
        for threads in options.threads.split(",")
    ]
    found: dict[Key, dict[str, float]] = {}
    for count in options.cells.split(","):
        found |= results(int(count), variants, options.rounds)
    report([row(key, found) for key in found], options.json)


if __name__ == "__main__":
    main()
