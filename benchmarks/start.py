"""Time from the start of Python to the first step: with an empty kernel cache, and with a full one.

Run as `python benchmarks/start.py`; about two minutes. Each start is a process of its own that
simulates two steps of the eight-cell embryo, for each preset. `two at once` are two processes that
start together with an empty cache and share it.
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
from morphosim import Numerics, Simulation, built_in_scene
warnings.simplefilter("ignore")
scene = built_in_scene("celegans-8")
from dataclasses import replace
Simulation(replace(scene, numerics=Numerics.preset({preset!r}))).step(2)
"""


def seconds(cache: Path, preset: str, processes: int = 1) -> float:
    """Until all of so many processes have ended."""
    environment = os.environ | {"NUMBA_CACHE_DIR": str(cache)}
    begin = time.perf_counter()
    started = [
        subprocess.Popen([sys.executable, "-c", PROGRAM.format(preset=preset)], env=environment)
        for _ in range(processes)
    ]
    if any(process.wait() for process in started):
        raise SystemExit("a start failed; its error stands above")
    return time.perf_counter() - begin


def row(preset: str) -> dict[str, Any]:
    """Starts of one preset."""
    with tempfile.TemporaryDirectory() as first, tempfile.TemporaryDirectory() as other:
        return {
            "preset": preset,
            "empty cache, s": seconds(Path(first), preset),
            "full cache, s": min(seconds(Path(first), preset) for _ in range(3)),
            "empty, two at once, s": seconds(Path(other), preset, processes=2),
        }


def main() -> None:
    """Measure and report."""
    options = arguments(__doc__)
    report([row(preset) for preset in ("standard", "fast")], options.json)


if __name__ == "__main__":
    main()
