"""Worker of `compare.py`: simulates packed cells with the package that its Python has.

It uses public names only, so that it runs with revisions of long ago. Each line of its input is a
JSON object: `do` names a method of `Worker`, the rest are its arguments; each line of its output is
what the method gives.
"""

import gc
import hashlib
import json
import os
import sys
import time
import warnings
from pathlib import Path
from typing import Any

import numpy as np

from morphosim import Cell, Numerics, Physics, Scene, Simulation, Sphere

STATUS = Path("/proc/self/statm")


class Worker:
    """One simulation at a time, and what is asked of it."""

    simulation: Simulation | None = None
    before: int | None = None

    def start(self, points: list[list[float]], radius: float, numerics: dict[str, Any]) -> float:
        """Make a simulation of balls at these points, in place of the last; its seconds."""
        self.simulation = None
        gc.collect()
        self.before = resident()
        cells = [
            Cell(name=f"c{k}", shape=Sphere(center=tuple(point), radius=radius))
            for k, point in enumerate(points)
        ]
        scene = Scene(cells=cells, physics=Physics(sigma=0.5), numerics=Numerics(**numerics))
        begin = time.perf_counter()
        self.simulation = Simulation(scene)
        return time.perf_counter() - begin

    def step(self, steps: int) -> float:
        """Advance; the seconds that it takes."""
        begin = time.perf_counter()
        self.simulation.step(steps)
        return time.perf_counter() - begin

    def memory(self) -> int | None:
        """Bytes by which the process has grown since `start`; None where the system hides it."""
        now = resident()
        return None if now is None or self.before is None else now - self.before

    def digest(self) -> str:
        """A hash of all fields and of where their boxes lie."""
        found = hashlib.sha256()
        for field in self.simulation.fields:
            phi = np.ascontiguousarray(field.phi)
            found.update(f"{field.name} {field.origin.tolist()} {phi.shape} {phi.dtype}".encode())
            found.update(phi.tobytes())
        return found.hexdigest()

    def save(self, path: str) -> None:
        """Write all fields and the origins of their boxes to an .npz file."""
        arrays: dict[str, Any] = {}
        for field in self.simulation.fields:
            arrays |= {f"origin {field.name}": field.origin, f"phi {field.name}": field.phi}
        np.savez(path, **arrays)


def resident() -> int | None:
    """Bytes of this process in memory."""
    if not STATUS.exists():
        return None
    return int(STATUS.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def main() -> None:
    """Answer line by line until the input ends; what else is printed goes to the errors."""
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    warnings.simplefilter("ignore")
    worker = Worker()
    for line in sys.stdin:
        request = json.loads(line)
        answer = getattr(worker, request.pop("do"))(**request)
        print(json.dumps(answer), file=answers, flush=True)


if __name__ == "__main__":
    main()
