"""Time from the start of Python to the first step: with an empty kernel cache, and with a full one.

Run as `python benchmarks/start.py`; about two minutes. Each start is a process of its own that
simulates two steps of the eight-cell embryo: by the solvers of steps that are all δt long, and with
a preset, which has a tolerance. `two at once` are two processes that start together with an empty
cache and share it.
"""

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from _common import arguments, report

PROGRAM = """
import warnings
from morphosim import Simulation, built_in_scene
warnings.simplefilter("ignore")
Simulation(built_in_scene("celegans-8", {overrides!r})).step(2)
"""
VARIANTS = {
    "dct": {"numerics.solver": "dct"},
    "band": {"numerics.solver": "band"},
    "preset fast": {"numerics.preset": "fast"},
}


def seconds(cache: Path, overrides: dict[str, Any], processes: int = 1) -> float:
    """Until all of so many processes have ended."""
    environment = os.environ | {"NUMBA_CACHE_DIR": str(cache)}
    begin = time.perf_counter()
    program = [sys.executable, "-c", PROGRAM.format(overrides=overrides)]
    started = [subprocess.Popen(program, env=environment) for _ in range(processes)]
    if any(process.wait() for process in started):
        raise SystemExit("a start failed; its error stands above")
    return time.perf_counter() - begin


def row(name: str, overrides: dict[str, Any]) -> dict[str, Any]:
    """Starts with one choice of numerics."""
    with tempfile.TemporaryDirectory() as first, tempfile.TemporaryDirectory() as other:
        return {
            "numerics": name,
            "empty cache, s": seconds(Path(first), overrides),
            "full cache, s": min(seconds(Path(first), overrides) for _ in range(3)),
            "empty, two at once, s": seconds(Path(other), overrides, processes=2),
        }


def main() -> None:
    """Measure and report."""
    options = arguments(__doc__)
    report([row(name, overrides) for name, overrides in VARIANTS.items()], options.json)


if __name__ == "__main__":
    main()
