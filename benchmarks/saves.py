"""What saving costs: time of a save in steps, its share of a run, and the sizes of the files.

Run as `python benchmarks/saves.py`; about four minutes. Steps, all δt long, and saves of a scene
alternate; the times are medians, in steps by the clock and by what the processors do for it: on a
machine that is busy with other work the latter is what can be compared. The share is that of a run
that saves every 100 steps. The last column is the time to read the fields of one save.

A second table has the time to open a run of many saves of 100 cells, with and without its index.
A third has whole runs of the embryo with presets, whose steps are longer: what of their time the
saves take that the scene asks for.

`python benchmarks/saves.py --large 10000` has another table instead: what is around the steps of so
many packed cells, each in a process of its own, with its processor time and the most memory that
the process held; some ten minutes and 3 GB. `--run DIR` takes a run that is there, and leaves out
what needs none.
"""

import multiprocessing
import resource
import sys
import tempfile
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from _common import arguments, packed_scene, report

from morphosim import (
    RunWriter,
    Scene,
    Simulation,
    built_in_scene,
    export,
    load_fields,
    open_run,
    pack,
)
from morphosim.bench import COMPILING, RUN_PRESETS
from morphosim.cli.run_facts import run_facts
from morphosim.errors import ResolutionWarning

SETTLING = 24
STEPS = 8
"""Steps between two saves, all of them timed."""
PERIOD = 100
"""Steps between two saves of a run, for the share."""


def seconds(action: Callable[[], Any]) -> float:
    """Wall time of a call."""
    return both_times(action)[0]


def both_times(action: Callable[[], Any]) -> tuple[float, float]:
    """Wall time of a call, and processor time of all threads."""
    begin, worked = time.perf_counter(), time.process_time()
    action()
    return time.perf_counter() - begin, time.process_time() - worked


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
            steps.append(both_times(lambda: simulation.step(STEPS)))
            writes.append(both_times(lambda: writer.after_step(simulation)))
        writer.finish(simulation)
        size = [p.stat().st_size for p in (writer.files.saves[-1], *Path(folder).glob("*.npz"))]
        run = open_run(folder)
        fields = seconds(lambda: load_fields(run, -1))
        assert run.sizes["time"] == saves + 1
    step, step_work = np.median(steps, axis=0) / STEPS
    write, work = np.median(writes, axis=0)
    return {
        "scene": name,
        "solver": scene.numerics.solver,
        "ms per step": 1e3 * step,
        "ms per save": 1e3 * write,
        "save, in steps": write / step,
        "by processor time": work / step_work,
        "share, %": 100 * write / (write + PERIOD * step),
        "save, kB per cell": size[0] / cells / 1e3,
        "state, kB per cell": size[1] / cells / 1e3,
        "fields of a save, ms": 1e3 * fields,
    }


def opening_rows(saves: int) -> list[dict[str, Any]]:
    """What opening a run of so many saves takes."""
    simulation = Simulation(packed_scene(100, solver="band"))
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        writer = RunWriter(folder, every=simulation.dt, fields="none")
        simulation.run(simulation.dt * (saves - 1), observers=[writer])
        open_run(writer.files.saves[0]).close()  # imports what opening needs
        for name in ("with index", "without"):
            wall, work = both_times(lambda: open_run(folder))
            rows.append({f"{saves} saves": name, "open, s": wall, "processor s": work})
            writer.files.index.unlink(missing_ok=True)
    return rows


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


def make(cells: int, _: Path) -> Simulation:
    """Scene of packed cells, and its start fields."""
    return Simulation(packed_scene(cells, spacing=SPACING, solver="band", threads=1))


def save(cells: int, folder: Path) -> None:
    """A step of them, and the saves before and after it."""
    simulation = make(cells, folder)
    simulation.run(simulation.dt, observers=[RunWriter(folder, every=simulation.dt)])


AROUND: dict[str, Callable[[int, Path], Any]] = {
    "libraries": lambda cells, run: None,
    "scene and start fields": make,
    "these, a step and two saves": save,
    "going on from the last": lambda cells, run: Simulation.from_run(run),
    "open_run": lambda cells, run: open_run(run),
    "info": lambda cells, run: run_facts(open_run(run), run),
    "to_dataframe": lambda cells, run: open_run(run).morpho.to_dataframe(),
    "contact_graph": lambda cells, run: open_run(run).morpho.contact_graph(),
    "labels": lambda cells, run: open_run(run).morpho.labels(),
    "load_fields": lambda cells, run: load_fields(open_run(run), -1),
    **{
        f"export to {to}, last save": lambda cells, run, to=to: exported(run, to)
        for to in ("csv", "ome-tiff", "stl", "vtk")
    },
    "pack": lambda cells, run: packed(run),
}
"""What is around the steps, of a number of cells and the directory of their run."""
WITHOUT_RUN = ("scene and start fields", "these, a step and two saves")
SPACING = 2 / 3
"""Of the lattice of large runs, µm: that of `draft`."""


def exported(run: Path, to: str) -> None:
    """Export the last save, and forget it."""
    data = open_run(run)
    with tempfile.TemporaryDirectory() as folder:
        export(data, folder, to, [float(data["time"][-1])])


def packed(run: Path) -> None:
    """Pack a run, and forget it."""
    with tempfile.TemporaryDirectory() as folder:
        pack(run, Path(folder) / "run.nc")


def large_row(name: str, cells: int, run: Path) -> dict[str, Any]:
    """What one thing takes, in a process of its own."""
    context = multiprocessing.get_context("spawn")
    told = context.SimpleQueue()
    process = context.Process(target=measured_alone, args=(name, cells, run, told))
    process.start()
    process.join()
    if process.exitcode:
        raise SystemExit(f"{name}: the process ended with {process.exitcode}")
    return {"what": name} | told.get()


def measured_alone(name: str, cells: int, run: Path, told: Any) -> None:
    """In the process: do it, and tell what it took."""
    warnings.simplefilter("ignore")
    begin = time.process_time()
    wall = seconds(lambda: AROUND[name](cells, run))
    unit = 1e9 if sys.platform == "darwin" else 1e6
    told.put(
        {
            "s": wall,
            "processor s": time.process_time() - begin,
            "most memory, GB": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / unit,
        }
    )


def large_rows(cells: int, run: str) -> list[dict[str, Any]]:
    """What is around the steps of many cells."""
    with tempfile.TemporaryDirectory() as folder:
        names = [name for name in AROUND if not (run and name in WITHOUT_RUN)]
        place = Path(run or folder)
        if run:
            open_run(run).close()  # says before anything else that there is none
        return [large_row(name, cells, place) for name in names]


def main() -> None:
    """Measure and report."""
    options = arguments(__doc__, saves=15, many=1000, opened=1000, large=0, run="")
    if options.large or options.run:
        report(large_rows(options.large, options.run), options.json)
        return
    warnings.simplefilter("ignore", ResolutionWarning)
    rows = []
    for solver in ("dct", "band"):
        embryo = built_in_scene("celegans-8", {"numerics.solver": solver})
        rows.append(row("embryo, 8 cells", embryo, options.saves))
        for cells in (100, options.many):
            packed = packed_scene(cells, solver=solver)
            rows.append(row(f"{cells} packed cells", packed, options.saves))
    path = options.json
    report(rows, path)
    print()
    report(opening_rows(options.opened), path and path.with_stem(f"{path.stem}-opening"))
    print()
    report([run_row(p) for p in RUN_PRESETS], path and path.with_stem(f"{path.stem}-runs"))


if __name__ == "__main__":
    main()
