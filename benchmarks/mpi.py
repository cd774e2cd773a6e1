"""One simulation over MPI ranks: same centroids, bytes sent, cost of MPI, and larger machines.

Run as `python benchmarks/mpi.py` (about 20 minutes, 4 GB; `--cells 100 --steps 20` for less). It
needs mpirun and mpi4py. Close-packed cells of R = 4 µm run alone and on 1, 2 and 4 ranks, one after
the other, each rank with one thread. "overhead" is the time of steps on one rank against those
without MPI, in turn in one process. `--plan` computes what larger machines would exchange: boxes,
ranks and messages are those of the program, only the steps are left out.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from _common import alternating_medians, arguments, packed_points, packed_scene, report, stepper

from morphosim import Simulation
from morphosim.mpi.decompose import owners
from morphosim.mpi.ghost_regions import portions

SETTLING = 4
MPIRUN = ("mpirun", "--oversubscribe", "--allow-run-as-root")
RADIUS, SPACING = 4.0, 0.5
SAMPLED = 12
"""Ranks whose messages are counted for a plan."""
PLANS = [(100_000, 4), (100_000, 32), (1_000_000, 32), (1_000_000, 256), (1_000_000, 4096)]
"""Numbers of cells and of ranks."""


def run(folder: Path, cells: int, steps: int, solver: str, precision: str, ranks: int) -> None:
    """Run this file on so many ranks; 0: without MPI."""
    start = [*MPIRUN, "-n", str(ranks)] if ranks else []
    given = {"cells": cells, "steps": steps, "solver": solver, "precision": precision}
    options = [text for name, value in given.items() for text in (f"--{name}", str(value))]
    subprocess.run(
        [*start, sys.executable, __file__, "--worker", str(folder), "--ranks", str(ranks),
         *options],
        check=True, env=os.environ | {"OMPI_MCA_mpi_yield_when_idle": "1"},
    )  # fmt: skip


def advance(simulation: Simulation, steps: int) -> float:
    """Advance; return the median seconds of a step after the first ones."""
    simulation.step(SETTLING)
    return alternating_medians({"step": stepper(simulation)}, steps - SETTLING, 0)["step"]


def worker(options: Any) -> None:
    """What a rank does; rank 0 writes the result."""
    scene = packed_scene(
        options.cells, solver=options.solver, precision=options.precision, threads=1
    )
    folder, ranks = Path(options.worker), int(options.ranks)
    if ranks == 0:
        simulation = Simulation(scene)
        seconds = advance(simulation, options.steps)
        save(folder, ranks, simulation.centroids, {"seconds": seconds})
        return
    from morphosim.mpi.distributed_simulation import DistributedSimulation

    distributed = DistributedSimulation(scene)
    shares = distributed.shares
    distributed.step(SETTLING)
    local, comm, before = shares.local, shares.comm, replace(shares.traffic)
    steps = options.steps - SETTLING
    seconds = advance(distributed, steps)
    fields, notices = (
        (getattr(shares.traffic, name) - getattr(before, name)) / steps
        for name in ("fields", "notices")
    )
    waited = (shares.traffic.seconds - before.seconds) / steps
    own = int(local.own.sum())
    mine = [fields, notices, len(local) - own, local.nbytes, waited, own]
    told = np.array(comm.allgather([float(value) for value in mine]))
    centroids = distributed.centroids
    if comm.rank == 0:
        save(folder, ranks, centroids, {"seconds": seconds, "told": told.tolist()})


def save(folder: Path, ranks: int, centroids: np.ndarray, facts: dict[str, Any]) -> None:
    np.save(folder / f"{ranks}.npy", centroids)
    (folder / f"{ranks}.json").write_text(json.dumps(facts))


def row(folder: Path, ranks: int) -> dict[str, Any]:
    """One line of the table."""
    facts = json.loads((folder / f"{ranks}.json").read_text())
    moved = np.abs(np.load(folder / f"{ranks}.npy") - np.load(folder / "0.npy")).max()
    told = np.array(facts.get("told", [[0] * 6]), float)
    return {
        "ranks": ranks,
        "ms per step": 1e3 * facts["seconds"],
        "largest difference, um": float(moved),
        "MB sent, all": told[:, 0].sum() / 1e6,
        "MB sent, rank": told[:, 0].max() / 1e6,
        "kB notices": told[:, 1].sum() / 1e3,
        "ghost cells, rank": int(told[:, 2].max()),
        "cells, rank": int(told[:, 5].max()),
        "MB held, rank": told[:, 3].max() / 1e6,
        "ms waiting": 1e3 * told[:, 4].max(),
    }


def overhead(options: Any) -> float:
    """Time of a step on one rank, against one without MPI."""
    from morphosim.mpi.distributed_simulation import DistributedSimulation

    scene = packed_scene(
        options.cells, solver=options.solver, precision=options.precision, threads=1
    )
    kinds = {"plain": Simulation(scene), "mpi": DistributedSimulation(scene)}
    for simulation in kinds.values():
        simulation.step(SETTLING)
    found = alternating_medians({k: stepper(s) for k, s in kinds.items()}, options.rounds, 2)
    return found["mpi"] / found["plain"] - 1


def planned(
    cells: int, ranks: int, box: tuple[np.ndarray, np.ndarray], band: float
) -> dict[str, Any]:
    """What a rank of a large machine would hold and send per step, in single precision.

    `box` is the box of a cell, from its centre, and `band` the share of its points in the band.
    """
    points = np.rint(packed_points(cells, RADIUS) / SPACING).astype(np.int64)
    origin, shape = points + box[0], np.tile(box[1], (cells, 1))
    owner = owners(origin + shape / 2, np.ones(cells), ranks)
    chosen = np.unique(np.linspace(0, ranks - 1, SAMPLED).astype(int)).tolist()
    begin = time.perf_counter()
    plans = [portions(origin, shape, owner, rank) for rank in chosen]
    seconds = (time.perf_counter() - begin) / len(chosen)
    points_sent = [sum(p.points for p in sends.values()) for sends, _ in plans]
    boxes = [sum(p.shape.prod(axis=1).sum() for p in gets.values()) for _, gets in plans]
    return {
        "cells": cells,
        "ranks": ranks,
        "cells, rank": int(np.bincount(owner).max()),
        "ghost cells, rank": max(sum(len(p.cells) for p in gets.values()) for _, gets in plans),
        "partners": max(len(sends) for sends, _ in plans),
        "MB sent": 4e-6 * band * max(points_sent),
        "MB of ghost cells": 4e-6 * max(boxes),
        "MB of own": 4e-6 * band * float(np.bincount(owner).max() * box[1].prod()),
        "ms to lay out": 1e3 * seconds,
    }


def plan(options: Any) -> None:
    """Table of what larger machines exchange."""
    pool = Simulation(packed_scene(13, solver="band", threads=1)).engine.pool
    centre = np.rint(packed_points(13, RADIUS)[0] / SPACING).astype(np.int64)
    box = pool.origin[0] - centre, pool.shape[0]
    held = pool.stretch(0)
    band = float((held.stop - held.start) / pool.sizes()[0])
    print(f"box {tuple(pool.shape[0].tolist())}, share of points in the band {band:.2f}")
    report([planned(cells, ranks, box, band) for cells, ranks in PLANS], options.json)


def main() -> None:
    """Measure and report."""
    options = arguments(
        __doc__, cells=1000, steps=100, ranks="1,2,4", solver="dct", precision="double", rounds=15,
        plan=False, overhead=False, worker="",
    )  # fmt: skip
    if options.worker:
        worker(options)
    elif options.plan:
        plan(options)
    elif options.overhead:
        print(f"overhead of MPI on one rank: {100 * overhead(options):.1f} %")
    else:
        with tempfile.TemporaryDirectory() as name:
            counts = [0, *map(int, options.ranks.split(","))]
            for ranks in counts:
                run(Path(name), options.cells, options.steps, options.solver, options.precision,
                    ranks)  # fmt: skip
            report([row(Path(name), ranks) for ranks in counts], options.json)


if __name__ == "__main__":
    main()
