"""One cell becomes a tissue: cells against time, wall time, memory, and what is not the kernels.

Run as `python benchmarks/growth.py` (to 1000 cells, a minute or two; `--cells 10000` takes some ten
minutes and 4 GB on two cores). Grows the built-in scene `spheroid`, and writes a row each time that
the cells have doubled: since the row before, the mean time of a step, and the share of the time
that passes outside of compiled kernels (told by `cProfile`, which slows that part alone). Ends by
itself where it would hold more than `--memory` GB. Writes a table, and JSON on request.
"""

import cProfile
import pstats
import resource
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

from _common import arguments, report

from morphosim import CellCount, Scene, Simulation, built_in_scene
from morphosim.numerics.threads import available_processors

Row = dict[str, Any]


def spheroid(cells: int, threads: int) -> Scene:
    """The built-in scene, up to so many cells."""
    scene = built_in_scene("spheroid").with_numerics(threads=threads)
    growth = replace(scene.stages[0], end=CellCount(cells))
    return replace(scene, stages=[growth], duration=1e6)


def memory() -> float:
    """Most memory that the process has held, GB."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (1e9 if sys.platform == "darwin" else 1e6)


def outside_kernels(profile: cProfile.Profile) -> float:
    """Share of a profile's time that is not spent in compiled kernels."""
    stats: Any = pstats.Stats(profile)
    inside = sum(
        own
        for (file, _, _), (_, _, own, _, _) in stats.stats.items()
        if Path(file).parent.name == "kernels"
    )
    return float(1 - inside / stats.total_tt)


class Doublings:
    """Stops a run whenever its cells have doubled, or where it holds too much."""

    def __init__(self, memory: float) -> None:
        self.wanted, self._memory = 2, memory

    def __call__(self, simulation: Simulation) -> None:
        """After each step."""
        if memory() > self._memory:
            simulation.stop(f"it holds more than {self._memory:g} GB")
        elif len(simulation.names) >= self.wanted:
            simulation.stop("cells have doubled")

    def next_row(self, simulation: Simulation, begin: float) -> Row:
        """Go on to the next doubling, and tell how that was."""
        steps, clock, profile = simulation.engine.steps, time.perf_counter(), cProfile.Profile()
        profile.runcall(simulation.run, observers=[self])
        took, cells = time.perf_counter() - clock, len(simulation.names)
        while self.wanted <= cells:
            self.wanted *= 2
        return {
            "cells": cells, "t": round(simulation.time, 1), "wall, s": time.perf_counter() - begin,
            "processors, s": time.process_time(),
            "step, ms": 1e3 * took / (simulation.engine.steps - steps),
            "peak, GB": memory(), "outside kernels, %": 100 * outside_kernels(profile),
        }  # fmt: skip


def main() -> None:
    options = arguments(__doc__ or "", cells=1000, threads=available_processors(), memory=20.0)
    simulation = Simulation(spheroid(options.cells, options.threads))
    simulation.step()  # compiles, or reads what is compiled
    doublings, begin, rows = Doublings(options.memory), time.perf_counter(), []
    while not simulation.finished and memory() <= options.memory:
        rows.append(doublings.next_row(simulation, begin))
        print(f"{rows[-1]['cells']} cells, {rows[-1]['wall, s']:.0f} s", file=sys.stderr)
    report(rows, options.json)


if __name__ == "__main__":
    main()
