"""The paper's Table 1: minutes of computation for 6 to 100 cells in the eggshell.

Run as `python benchmarks/table1.py` (a few minutes: the median time of a step, times the number of
steps), or with `--full` to run every row to its end (about half an hour). `--cells 6,8` takes some
rows, `--solvers band,dct,linearised` some solvers, with steps that are all δt long. With `--presets
fast,standard` rows run to their end with these presets instead: their steps have no one length.

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
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from _common import alternating_medians, arguments, report, stepper
from _scenes import embryo
from scipy.spatial import cKDTree

from morphosim import EllipsoidShell, Numerics, Physics, Scene, Simulation, open_run
from morphosim.bench import BY_SOLVER, PACKED_DT, PER_MINUTE

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
    """Seconds that all simulations take to the end of so many steps of δt, one after the other."""
    found = {}
    for name, simulation in simulations.items():
        begin = time.perf_counter()
        simulation.step_to(simulation.scene.numerics.ticks_to(steps * PACKED_DT))
        found[name] = time.perf_counter() - begin
        say(f"{simulation.scene.name}, {name}: {simulation.steps} steps in {found[name]:.1f} s")
    return found


def contestants(options: Any) -> dict[str, Numerics]:
    """Numerics to measure: presets, or else solvers with steps of δt."""
    if options.presets:
        return {
            f"preset {name}": Numerics.preset(name, threads=options.threads)
            for name in options.presets.split(",")
        }
    return {
        name: Numerics(dt=PACKED_DT, threads=options.threads, **BY_SOLVER[name])
        for name in options.solvers.split(",")
    }


def rows(cells: int, chosen: Mapping[str, Numerics], options: Any) -> list[dict[str, Any]]:
    """The lines of one number of cells."""
    vivo, gpu, cpu = PUBLISHED[cells]
    steps, whole = step_count(cells), options.full or bool(options.presets)
    say(f"{cells} cells: building")
    simulations = {
        name: Simulation(
            lineage_scene(options.run, cells, n) if options.run else shell_scene(cells, n)
        )
        for name, n in chosen.items()
    }
    say(f"{cells} cells: {'running' if whole else 'timing'}")
    if whole:
        seconds = whole_runs(simulations, steps)
    else:
        seconds = estimated(simulations, steps, options.rounds)
    taken = {name: s.steps if whole else steps for name, s in simulations.items()}
    return [
        {
            "cells": len(simulations[name].cells),
            "min in vivo": vivo,
            "numerics": name,
            "steps": taken[name],
            "threads": simulations[name].engine.workers,
            "ms per step": 1e3 * seconds[name] / taken[name],
            "min": seconds[name] / 60,
            "how": "whole run" if whole else f"{options.rounds} steps x",
            "P100, min": gpu,
            "P100 / ours": 60 * gpu / seconds[name],
            "Xeon, min": cpu,
            "Xeon / ours": 60 * cpu / seconds[name],
        }
        for name in chosen
    ]


def main() -> None:
    """Measure and report."""
    options = arguments(
        __doc__, cells=",".join(map(str, PUBLISHED)), solvers="band,dct", presets="", rounds=50,
        threads=0, full=False, run="",
    )  # fmt: skip
    chosen = contestants(options)
    for numerics in chosen.values():  # compiles
        Simulation(shell_scene(6, numerics)).step(12)
    found = [row for cells in options.cells.split(",") for row in rows(int(cells), chosen, options)]
    report(found, options.json)
    print(
        f"time: inferred, {PER_MINUTE:g} of in silico time per minute in vivo, at dt = "
        f"{PACKED_DT:g} without a tolerance; the paper does not give it"
    )
    if not (options.full or options.presets):
        print(f"min: median of {options.rounds} steps after {WARM_UP}, times the number of steps")


if __name__ == "__main__":
    main()
