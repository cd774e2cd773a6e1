"""What saving costs: time of a save in steps, its share of a run, and the sizes of the files.

Run as `python benchmarks/saves.py`; about two minutes. Steps, all δt long, and saves of a scene
alternate; the times are medians. The share is that of a run that saves every 100 steps. The last
columns are the time to open the saves as one Dataset, and to read the fields of one.

A second table has whole runs of the embryo with presets, whose steps are longer: what of their time
the saves take that the scene asks for.
"""

import tempfile
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from _common import arguments, packed_scene, report

from morphosim import RunWriter, Scene, Simulation, built_in_scene, load_fields, open_run
from morphosim.bench import COMPILING, RUN_PRESETS
from morphosim.errors import ResolutionWarning

SETTLING = 24
STEPS = 8
"""Steps between two saves, all of them timed."""
PERIOD = 100
"""Steps between two saves of a run, for the share."""


def seconds(action: Callable[[], Any]) -> float:
    """Wall time of a call."""
    begin = time.perf_counter()
    action()
    return time.perf_counter() - begin


def row(name: str, scene: Scene, saves: int) -> dict[str, Any]:
    """One line of the table."""
    simulation = Simulation(scene)
    simulation.step(SETTLING)
    cells = len(simulation.cells)
    with tempfile.TemporaryDirectory() as folder:
        writer = RunWriter(folder, every=STEPS * scene.numerics.dt)
        writer.start(simulation)
        steps, writes = [], []
        for _ in range(saves):
            steps.append(seconds(lambda: simulation.step(STEPS)) / STEPS)
            writes.append(seconds(lambda: writer.after_step(simulation)))
        writer.finish(simulation)
        size = [p.stat().st_size for p in (writer.files.saves[-1], *Path(folder).glob("*.npz"))]
        opening = seconds(lambda: open_run(folder))
        run = open_run(folder)
        fields = seconds(lambda: load_fields(run, -1))
        assert run.sizes["time"] == saves + 1
    step, write = np.median(steps), np.median(writes)
    return {
        "scene": name,
        "solver": scene.numerics.solver,
        "ms per step": 1e3 * step,
        "ms per save": 1e3 * write,
        "save, in steps": write / step,
        "share, %": 100 * write / (write + PERIOD * step),
        "save, kB per cell": size[0] / cells / 1e3,
        "state, kB per cell": size[1] / cells / 1e3,
        "open, ms per save": 1e3 * opening / (saves + 1),
        "fields of a save, ms": 1e3 * fields,
    }


class TimedWriter(RunWriter):
    """A `RunWriter` that knows how long it took."""

    spent = 0.0

    def after_step(self, simulation: Simulation) -> None:
        """See `RunWriter`."""
        self.spent += seconds(lambda: super(TimedWriter, self).after_step(simulation))


def run_row(preset: str) -> dict[str, Any]:
    """What saves take of a whole run of the embryo."""
    scene = built_in_scene("celegans-8", {"numerics.preset": preset})
    Simulation(scene).step(COMPILING)
    simulation = Simulation(scene)
    with tempfile.TemporaryDirectory() as folder:
        writer = TimedWriter(folder, every=scene.save_every)
        whole = seconds(lambda: simulation.run(observers=[writer]))
        saves = len(writer.files.saves)
    return {
        "preset": preset,
        "to": simulation.time,
        "save every": scene.save_every,
        "saves": saves,
        "steps": simulation.steps,
        "s": whole,
        "of that saves, s": writer.spent,
        "share, %": 100 * writer.spent / whole,
    }


def main() -> None:
    """Measure and report."""
    options = arguments(__doc__, saves=15, many=1000)
    warnings.simplefilter("ignore", ResolutionWarning)
    rows = []
    for solver in ("dct", "band"):
        embryo = built_in_scene("celegans-8", {"numerics.solver": solver})
        rows.append(row("embryo, 8 cells", embryo, options.saves))
        for cells in (100, options.many):
            packed = packed_scene(cells, solver=solver)
            rows.append(row(f"{cells} packed cells", packed, options.saves))
    report(rows, options.json)
    print()
    path = options.json
    report([run_row(p) for p in RUN_PRESETS], path and path.with_stem(f"{path.stem}-runs"))


if __name__ == "__main__":
    main()
