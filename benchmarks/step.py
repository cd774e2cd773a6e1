"""Time and memory of a step: close-packed cells, 1 and 2 threads, near and far pairs.

Run as `python benchmarks/step.py` (`--solver band` or `linearised` for others). All variants run in
turn in one process. As a control of the machine, the same scene on one thread is also timed
in one process and in two at once, which share nothing: two threads cannot gain more than two
processes do.
"""

import multiprocessing
import time
from typing import Any

import numpy as np
from _common import alternating_medians, arguments, packed_scene, report, stepper
from _scenes import adhering

from morphosim import Simulation
from morphosim.bench import BY_SOLVER


def pair(distance: float, solver: str) -> Simulation:
    """Two cells of R = 4 µm with their centres `distance` µm apart."""
    return Simulation(adhering(distance).with_numerics(dt=1.5, **BY_SOLVER[solver]))


def row(name: str, simulation: Simulation, seconds: float) -> dict[str, Any]:
    """One line of the table."""
    cells = len(simulation.cells)
    return {
        "scene": name,
        "threads": simulation.engine.workers,
        "ms per step": 1e3 * seconds,
        "us per cell": 1e6 * seconds / cells,
        "MB per cell": simulation.engine.nbytes / cells / 1e6,
        "box": "x".join(map(str, simulation.fields[0].phi.shape)),
    }


def time_alone(cells: int, barrier: Any, result: Any) -> None:
    """Median seconds of a step on one thread, begun together with the other processes."""
    simulation = Simulation(packed_scene(cells, threads=1))
    simulation.step(2)
    barrier.wait()
    seconds = []
    for _ in range(20):
        begin = time.perf_counter()
        simulation.step()
        seconds.append(time.perf_counter() - begin)
    result.put(float(np.median(seconds)))


def machine_gain(cells: int) -> float:
    """How many times the work of one process two processes do on this machine."""
    context = multiprocessing.get_context("spawn")
    medians = []
    for count in (1, 2):
        barrier, result = context.Barrier(count), context.Queue()
        processes = [
            context.Process(target=time_alone, args=(cells, barrier, result)) for _ in range(count)
        ]
        for process in processes:
            process.start()
        medians.append(np.mean([result.get() for _ in processes]))
        for process in processes:
            process.join()
    return float(2 * medians[0] / medians[1])


def main() -> None:
    """Measure and report."""
    options = arguments(__doc__, cells=100, many=1000, rounds=15, solver="dct")
    few, many = f"{options.cells} cells", f"{options.many} cells"
    solver = BY_SOLVER[options.solver]
    simulations = {
        (few, 1): Simulation(packed_scene(options.cells, threads=1, **solver)),
        (few, 2): Simulation(packed_scene(options.cells, threads=2, **solver)),
        (many, 2): Simulation(packed_scene(options.many, threads=2, **solver)),
        ("touching pair", 2): pair(8.0, options.solver),
        ("pair 10 mm apart", 2): pair(10_000.0, options.solver),
    }
    medians = alternating_medians(
        {str(key): stepper(s) for key, s in simulations.items()}, options.rounds
    )
    rows = [row(key[0], s, medians[str(key)]) for key, s in simulations.items()]
    report(rows, options.json)
    print(f"two threads against one: {rows[0]['ms per step'] / rows[1]['ms per step']:.2f} times")
    print(f"two processes against one, the machine's own gain: {machine_gain(options.cells):.2f}")
    ratio = rows[2]["us per cell"] / rows[1]["us per cell"]
    print(f"cost per cell, {many} against {few}: {ratio:.2f} times")


if __name__ == "__main__":
    main()
