"""The paper's Table 1: minutes of computation for 6 to 100 cells in the eggshell.

Run as `python benchmarks/table1.py` (a few minutes: the median time of a step, times the number of
steps), or with `--full` to run every row to its end (about half an hour). `--cells 6,8` takes some
rows.

The paper gives minutes in vivo and not the steps behind them. That 5 minutes are 5000 steps of
δt = 2 is inferred from its time per step, so a minute in vivo is taken as 2000 of *in silico*
time, at δt = 1.5: 5 minutes are 6667 steps. Nor are its cells published. Here they have equal
volumes that sum to that of the eight-cell embryo, about points that Lloyd's iteration spreads in
the same eggshell, and σ = 0.5 between all; `--run DIR` takes the states of a run of
celegans-1-to-102 instead (26 cells for 25). The published figures are of a Tesla P100 and of a
Xeon E5-2680 v3. Writes a table, and JSON on request.
"""

import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from _common import alternating_medians, arguments, report, stepper
from _scenes import embryo
from scipy.spatial import cKDTree

from morphosim import EllipsoidShell, Numerics, Physics, Scene, Simulation, open_run
from morphosim.bench import PACKED_DT, PER_MINUTE

PUBLISHED = {
    6: (1.1, 0.3, 4.1),
    7: (0.8, 0.1, 2.0),
    8: (5.3, 2.6, 39.5),
    25: (5.0, 17.2, 186.6),
    50: (5.0, 29.8, 356.3),
    100: (5.0, 93.8, 706.1),
}
"""By number of cells: minutes in vivo, minutes on the GPU, minutes on the CPU."""
WARM_UP = 50
"""Steps before the timing."""
SAMPLE = 0.75
"""Spacing, µm, of the points that stand for the shell's inside."""


def spread_points(shell: EllipsoidShell, count: int, sweeps: int = 100) -> np.ndarray:
    """Points (count, 3) spread evenly in a shell: farthest points, then Lloyd's iteration."""
    low, high = shell.bounds()
    axes = [np.arange(a + SAMPLE / 2, b, SAMPLE) for a, b in zip(low, high, strict=True)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    inside = grid[shell.depth(*grid.T) > 0]
    points = [inside[np.argmin(((inside - inside.mean(axis=0)) ** 2).sum(axis=1))]]
    distance = np.full(len(inside), np.inf)
    while len(points) < count:
        distance = np.minimum(distance, ((inside - points[-1]) ** 2).sum(axis=1))
        points.append(inside[np.argmax(distance)])
    spread = np.array(points)
    for _ in range(sweeps):
        nearest = cKDTree(spread).query(inside)[1]
        members = np.bincount(nearest, minlength=count)
        spread = np.stack(
            [np.bincount(nearest, inside[:, k], count) / members for k in range(3)], axis=1
        )
    return spread


def shell_scene(count: int, numerics: Numerics) -> Scene:
    """Cells of equal volume in the eggshell; together they are as large as the embryo's cells."""
    whole = embryo()
    shell = whole.confinement
    assert isinstance(shell, EllipsoidShell)
    total = sum(cell.target_volume(0.0) for cell in whole.cells)
    names = [f"c{k}" for k in range(count)]
    return Scene.from_points(
        names, spread_points(shell, count), np.full(count, total / count), shell,
        physics=Physics(sigma=0.5), numerics=numerics, name=f"{count} cells",
    )  # fmt: skip


def lineage_scene(run: str, count: int, numerics: Numerics) -> Scene:
    """The end of a stage of celegans-1-to-102, of so many cells or the next that there is."""
    with open_run(run) as data:
        cells = np.isfinite(data["volume"].values).sum(axis=1)
        enough = cells[cells >= count].min()
        time = float(data["time"].values[np.flatnonzero(cells == enough)[-1]])
    return replace(Simulation.from_run(run, time=time).scene, numerics=numerics)


def step_count(cells: int) -> int:
    """Steps of one row."""
    return round(PUBLISHED[cells][0] * PER_MINUTE / PACKED_DT)


def say(text: str) -> None:
    """A line of progress."""
    print(text, file=sys.stderr, flush=True)


def estimated(simulations: dict[str, Simulation], steps: int, rounds: int) -> dict[str, float]:
    """Seconds of `steps` steps, from the median of `rounds` steps of all simulations in turn."""
    for simulation in simulations.values():
        simulation.step(WARM_UP)
    medians = alternating_medians({n: stepper(s) for n, s in simulations.items()}, rounds)
    return {name: steps * seconds for name, seconds in medians.items()}


def whole_runs(simulations: dict[str, Simulation], steps: int) -> dict[str, float]:
    """Seconds of `steps` steps of all simulations, one after the other."""
    found = {}
    for name, simulation in simulations.items():
        begin = time.perf_counter()
        simulation.step(steps)
        found[name] = time.perf_counter() - begin
        say(f"{simulation.scene.name}, {name}: {steps} steps in {found[name]:.1f} s")
    return found


def rows(cells: int, presets: Sequence[str], options: Any) -> list[dict[str, Any]]:
    """The lines of one number of cells."""
    vivo, gpu, cpu = PUBLISHED[cells]
    steps = step_count(cells)
    say(f"{cells} cells: building")
    numerics = [Numerics.preset(p, dt=PACKED_DT, threads=options.threads) for p in presets]
    scenes = [
        lineage_scene(options.run, cells, n) if options.run else shell_scene(cells, n)
        for n in numerics
    ]
    simulations = dict(zip(presets, map(Simulation, scenes), strict=True))
    say(f"{cells} cells: {'running' if options.full else 'timing'}")
    if options.full:
        seconds = whole_runs(simulations, steps)
    else:
        seconds = estimated(simulations, steps, options.rounds)
    return [
        {
            "cells": len(simulations[preset].cells),
            "min in vivo": vivo,
            "steps": steps,
            "preset": preset,
            "threads": simulations[preset].engine.workers,
            "ms per step": 1e3 * seconds[preset] / steps,
            "min": seconds[preset] / 60,
            "how": "whole run" if options.full else f"{options.rounds} steps x",
            "P100, min": gpu,
            "P100 / ours": 60 * gpu / seconds[preset],
            "Xeon, min": cpu,
            "Xeon / ours": 60 * cpu / seconds[preset],
        }
        for preset in presets
    ]


def main() -> None:
    """Measure and report."""
    options = arguments(
        __doc__, cells=",".join(map(str, PUBLISHED)), presets="fast,standard", rounds=50,
        threads=0, full=False, run="",
    )  # fmt: skip
    presets = options.presets.split(",")
    for preset in presets:  # compiles
        scene = shell_scene(6, Numerics.preset(preset, dt=PACKED_DT, threads=options.threads))
        Simulation(scene).step(12)
    found = [
        row for cells in options.cells.split(",") for row in rows(int(cells), presets, options)
    ]
    report(found, options.json)
    print(
        f"steps: inferred, {PER_MINUTE:g} of in silico time per minute in vivo at dt = "
        f"{PACKED_DT:g}; the paper does not give them"
    )
    if not options.full:
        print(f"min: median of {options.rounds} steps after {WARM_UP}, times the number of steps")


if __name__ == "__main__":
    main()
