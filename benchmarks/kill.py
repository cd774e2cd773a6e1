"""Crash safety: a run that is killed (SIGKILL) again and again at random times.

A run is killed, opened, also by plain xarray, and gone on with, until it comes to its end. It is
then compared, bit for bit, with one that was never interrupted. Saves are so frequent that many
kills fall into one. Run as
`python benchmarks/kill.py [--kills 40] [--scene celegans-8] [--start 1.5]`;
`--start` is the time, in seconds, in which a process does not write yet.
"""

import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import xarray as xr
from _common import arguments, report

from morphosim import open_run
from morphosim.runs.checkpoint import Checkpoint
from morphosim.runs.directory import RunDirectory

MORPHOSIM = str(Path(sys.executable).with_name("morphosim"))


def begin(scene: str, folder: Path, until: float, every: float) -> list[str]:
    """Command that starts a run, or goes on with it."""
    if (folder / "scene.toml").exists():
        return [MORPHOSIM, "run", "--resume", str(folder)]
    settings = ["--until", str(until), "--save-every", str(every)]
    return [MORPHOSIM, "run", scene, "-o", str(folder), *settings]


def opened(folder: Path, known: int) -> int:
    """Number of saves, opened as a run; those beyond the known ones read by plain xarray."""
    saves = RunDirectory(folder).saves
    for path in saves[known:]:
        with xr.open_dataset(path) as table, xr.open_dataset(path, group="fields") as fields:
            assert np.isfinite(table["volume"].values).all()
            assert fields["phi"].values.size == int(fields["row_size"].sum())
    if saves:
        with open_run(folder) as run:
            assert run.sizes["time"] == len(saves)
    return len(saves)


def kill_once(command: list[str], folder: Path, seconds: float) -> tuple[bool, int]:
    """Start, kill after some seconds; whether it had ended before, and the saves then."""
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        return process.wait(timeout=seconds) == 0, len(RunDirectory(folder).saves)
    except subprocess.TimeoutExpired:
        seen = len(RunDirectory(folder).saves)
        process.send_signal(signal.SIGKILL)
        process.wait()
        return False, seen


def same_saves(a: Path, b: Path) -> bool:
    """Whether two runs hold the same saves, bit for bit, and the same last state."""
    first, second = RunDirectory(a), RunDirectory(b)
    for one, other in zip(first.saves, second.saves, strict=True):
        for group in (None, "fields"):
            with xr.open_dataset(one, group=group) as x, xr.open_dataset(other, group=group) as y:
                if not x.equals(y):
                    return False
    x, y = (Checkpoint.read(files.restart(files.last)) for files in (first, second))
    return x.steps == y.steps and all(
        np.asarray(x.arrays[name]).tobytes() == np.asarray(y.arrays[name]).tobytes()
        for name in x.arrays
    )


def main() -> None:
    """Kill, open and go on; report."""
    options = arguments(
        __doc__, kills=40, scene="celegans-8", until=2400.0, every=2.0, seed=0, start=1.5
    )
    chance = random.Random(options.seed)
    with tempfile.TemporaryDirectory() as place:
        whole, parts = Path(place) / "whole", Path(place) / "parts"
        subprocess.run(
            begin(options.scene, whole, options.until, options.every),
            check=True, capture_output=True,
        )  # fmt: skip
        row = {"kills": 0, "during a save": 0, "opened": 0, "saves lost": 0, "ended": False}
        begun, held = time.perf_counter(), 0
        while not row["ended"]:
            patience = (
                options.start + 2.5 * chance.random() if row["kills"] < options.kills else 600
            )
            command = begin(options.scene, parts, options.until, options.every)
            row["ended"], seen = kill_once(command, parts, patience)
            row["kills"] += not row["ended"]
            row["during a save"] += bool(list(parts.glob("*.partial")))
            row["saves lost"] += max(seen - len(RunDirectory(parts).saves), 0)
            held = opened(parts, held)
            row["opened"] += not row["ended"]
        row["saves"] = held
        row["bit-identical"] = same_saves(whole, parts)
        row["seconds"] = time.perf_counter() - begun
    report([row], options.json)


if __name__ == "__main__":
    main()
