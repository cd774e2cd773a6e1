"""Two threads against one, on a quiet machine and beside a busy process.

Run as `python benchmarks/beside.py` (some minutes; two processors are used, whatever there are).
Of each number of cells two simulations, on one thread and on two, take steps in turn: first alone,
then beside a process that is always busy. Each begins with `--settle` steps in which the run finds
how many threads pay, and then the mean counts: what steps wait for is in few of them.
"""

import multiprocessing
import os
import time
from typing import Any

import numpy as np
from _common import arguments, packed_scene, report

from morphosim import Simulation
from morphosim.bench import BY_SOLVER


def keep_busy() -> None:
    """Compute for ever, on whichever processor."""
    total = 0.0
    while True:
        total = (total + 1.1) % 7


def two_on(count: int) -> None:
    """Use so many processors."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:count])


def times(cells: int, options: Any) -> list[float]:
    """Mean seconds of a step on one thread and on two."""
    pair = [
        Simulation(packed_scene(cells, threads=threads, **BY_SOLVER[options.solver]))
        for threads in (1, 2)
    ]
    steps = max(4, options.cell_steps // cells)
    for simulation in pair:
        simulation.step(options.settle)
    taken: list[list[float]] = [[], []]
    for _ in range(options.rounds):
        for simulation, seconds in zip(pair, taken, strict=True):
            begin = time.perf_counter()
            simulation.step(steps)
            seconds.append((time.perf_counter() - begin) / steps)
    return [float(np.mean(seconds)) for seconds in taken]


def main() -> None:
    """Measure and report."""
    options = arguments(
        __doc__ or "", cells="8,100,1000", solver="band", settle=60, cell_steps=2000, rounds=5
    )
    two_on(2)
    counts = [int(cells) for cells in str(options.cells).split(",")]
    quiet = {cells: times(cells, options) for cells in counts}
    busy = multiprocessing.get_context("spawn").Process(target=keep_busy, daemon=True)
    busy.start()
    beside = {cells: times(cells, options) for cells in counts}
    busy.terminate()
    rows = [
        {
            "cells": cells, "quiet, 1 thread, ms": 1e3 * quiet[cells][0],
            "2 threads / 1": quiet[cells][1] / quiet[cells][0],
            "beside, 1 thread, ms": 1e3 * beside[cells][0],
            "beside, 2 threads / 1": beside[cells][1] / beside[cells][0],
        }
        for cells in counts
    ]  # fmt: skip
    report(rows, options.json)


if __name__ == "__main__":
    main()
