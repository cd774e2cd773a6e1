"""Time from the start of Python to the second step: with an empty kernel cache, and a full one.

Run as `python benchmarks/start.py`; about ten minutes on two processors, with `--scenes` half an
hour. Each start is a process of its own. Without more it is one of the eight-cell embryo: by the
solvers of steps that are all δt long, and with presets; `--scenes` adds one of every built-in
scene, the largest of them with fewer cells. `one process` compiles when kernels are called, as for
a second kind of scene; `two at once` start together and share a cache.
"""

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from _common import arguments, report

from morphosim.library.built_in import scene_names

PROGRAM = """
import warnings
from contextlib import nullcontext
from morphosim import Simulation, built_in_scene
from morphosim.simulation.warming import not_ahead
warnings.simplefilter("ignore")
with {context}():
    Simulation(built_in_scene({scene!r}, {overrides!r})).step(2)
"""
EMBRYO = "celegans-8"
VARIANTS: list[tuple[str, dict[str, Any]]] = [
    (EMBRYO, {"numerics.solver": "dct"}),
    (EMBRYO, {"numerics.solver": "band"}),
    (EMBRYO, {"numerics.preset": "fast"}),
    (EMBRYO, {"numerics.preset": "published"}),
]
FEWER: dict[str, dict[str, Any]] = {
    "blastoderm": {
        "cells.count": 60,
        "confinement.semi_axes": [24, 20, 20],
        "confinement.core": [14, 10, 10],
    },
    "sorting": {"cells.counts.A": 20, "cells.counts.B": 20},
}
"""Smaller tissues of the same physics and numerics: what compiles, not what start fields take."""


def seconds(
    cache: Path, scene: str, overrides: dict[str, Any], processes: int = 1, ahead: bool = True
) -> tuple[float, float]:
    """Wall and processor time until all of so many processes have ended."""
    environment = os.environ | {"NUMBA_CACHE_DIR": str(cache)}
    begin, before = time.perf_counter(), _processor_time()
    context = "nullcontext" if ahead else "not_ahead"
    program = PROGRAM.format(scene=scene, overrides=overrides, context=context)
    command = [sys.executable, "-c", program]
    started = [subprocess.Popen(command, env=environment) for _ in range(processes)]
    if any(process.wait() for process in started):
        raise SystemExit("a start failed; its error stands above")
    return time.perf_counter() - begin, _processor_time() - before


def _processor_time() -> float:
    """Seconds of all processes that have ended, with those that they have started."""
    used = os.times()
    return used.children_user + used.children_system


def row(scene: str, overrides: dict[str, Any]) -> dict[str, Any]:
    """Starts of one scene with one choice of numerics."""
    with (
        tempfile.TemporaryDirectory() as ahead,
        tempfile.TemporaryDirectory() as alone,
        tempfile.TemporaryDirectory() as shared,
    ):
        first, used = seconds(Path(ahead), scene, overrides)
        full = [seconds(Path(ahead), scene, overrides)[0] for _ in range(3)]
        single, used_single = seconds(Path(alone), scene, overrides, ahead=False)
        both, _ = seconds(Path(shared), scene, overrides, processes=2)
    return {
        "scene": scene,
        "numerics": ", ".join(f"{v}" for k, v in overrides.items() if k.startswith("numerics")),
        "empty cache, s": first,
        "processor, s": used,
        "one process, s": single,
        "its processor, s": used_single,
        "two at once, s": both,
        "full cache, s": min(full),
    }


def main() -> None:
    """Measure and report."""
    options = arguments(__doc__, scenes=False)
    variants = list(VARIANTS)
    if options.scenes:
        variants += [(name, FEWER.get(name, {})) for name in scene_names() if name != EMBRYO]
    report([row(*variant) for variant in variants], options.json)


if __name__ == "__main__":
    main()
