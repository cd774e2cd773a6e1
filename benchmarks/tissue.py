"""What rules of living tissues cost: steps with them against steps of the same cells without.

Run as `python benchmarks/tissue.py` (some minutes; `--cells 100` for less). Cells are packed balls
of 1 to 2 times the volume at which daughters are born, so that about as many divide at each look.
One simulation takes in turn the steps between two looks without rules (`Simulation.step`), with
them (`run`), and so on; each stretch with rules is compared with the mean of its neighbours, which
have the cells of before and of after. Writes a table, and JSON on request.
"""

import time
from collections.abc import Callable

import numpy as np
from _common import arguments, report

from morphosim import (
    Cell,
    Duration,
    Growth,
    Numerics,
    Physics,
    Proliferation,
    Scene,
    Simulation,
    Sphere,
    Stage,
)
from morphosim.bench import packed_points

RADIUS = 4.5
"""Of a cell that is about to divide, µm."""
EVERY, DT = 20.0, 2.0


def tissue(count: int, doubling_time: float, threads: int, solver: str, spacing: float) -> Scene:
    """Packed cells that grow and divide."""
    volume = 4 / 3 * np.pi * RADIUS**3
    shares = 2 ** (np.random.default_rng(0).random(count) - 1)
    cells = [
        Cell(name=f"c{k}", shape=Sphere(center=point, radius=RADIUS * share ** (1 / 3)))
        for k, (point, share) in enumerate(zip(packed_points(count, RADIUS), shares, strict=True))
    ]
    rules = [
        Proliferation(volume=0.97 * volume, spread=0.05),
        Growth(doubling_time=doubling_time, spread=0.1, pressure=0.5),
    ]
    life = Stage(name="life", end=Duration(1e6), rules=rules, rules_every=EVERY)
    numerics = Numerics(
        dt=DT, solver=solver, threads=threads, spacing=spacing, allow_coarse=spacing > 2 / 3
    )
    return Scene(
        cells=cells, physics=Physics(sigma=0.3), numerics=numerics, stages=[life], duration=1e6
    )


def measure(scene: Scene, rounds: int) -> dict[str, float]:
    """Milliseconds per step with rules and without, cells and divisions."""
    simulation, steps = Simulation(scene), round(EVERY / DT)
    simulation.run(until=2.5 * EVERY)  # so that a look lies in the middle of each stretch
    plain, ruled, born = [], [], 0
    with simulation.engine.limited_threads():
        for _ in range(rounds):
            plain.append(_timed(lambda: simulation.step(steps)))
            before = len(simulation.names)
            ruled.append(_timed(lambda: simulation.run(until=simulation.time + EVERY)))
            born += len(simulation.names) - before
        plain.append(_timed(lambda: simulation.step(steps)))
    between = (np.array(plain[1:]) + plain[:-1]) / 2
    return {
        "cells": len(simulation.names), "divisions per look": born / rounds,
        "with rules, ms": 1e3 * float(np.median(ruled)) / steps,
        "without, ms": 1e3 * float(np.median(between)) / steps,
        "ratio": float(np.median(np.array(ruled) / between)),
    }  # fmt: skip


def _timed(action: Callable[[], object]) -> float:
    begin = time.perf_counter()
    action()
    return time.perf_counter() - begin


def main() -> None:
    options = arguments(
        __doc__ or "", cells="100,1000,10000", rounds=9, doubling_time=1000.0, threads=1,
        solver="band", spacing=0.5,
    )  # fmt: skip
    rows = []
    for count in options.cells.split(","):
        scene = tissue(
            int(count), options.doubling_time, options.threads, options.solver, options.spacing
        )
        rows.append(measure(scene, options.rounds))
    report(rows, options.json)


if __name__ == "__main__":
    main()
