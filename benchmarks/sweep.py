"""A scan that is killed (SIGKILL, with all its processes) and gone on with; how busy cores are.

Run as `python benchmarks/sweep.py [--kills 2]`: 48 members of eight cells, γ by σ by δt, with h =
2/3 µm. The share of ideal is the sum of the members' own seconds over (cores × wall time), for a
scan that is not killed; `start` is what a call takes that has nothing left to do but make the
Dataset. `--fresh` gives the scan an empty cache of compiled kernels.
"""

import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import xarray as xr
from _common import arguments, report

MEMBERS = 48
COMMAND = "from morphosim.cli import main; main()"
FILE = """
scene = "celegans-8"
figures = ["volume", "contact_area", "centroid", "rms_speed(time)"]
[axes]
physics.gamma = [0.15, 0.2, 0.25, 0.3, 0.35, 0.4]
physics.sigma.default = [0.0, 0.25, 0.5, 0.75]
numerics.dt = [2.0, 4.0]
[overrides]
numerics.spacing = 0.6666666666666666
numerics.box_tolerance = 3e-3
duration = {duration}
save_every = {duration}
"""


def command(place: Path, directory: str) -> list[str]:
    """The scan on the command line."""
    words = ["sweep", str(place / "sweep.toml"), "-o", str(place / directory)]
    return [sys.executable, "-c", COMMAND, *words]


def results(directory: Path) -> dict[str, int]:
    """Members that are finished, with the time of their writing."""
    return {p.name: p.stat().st_mtime_ns for p in directory.glob("members/*.nc")}


def kill_at(place: Path, least: int, environment: dict[str, str]) -> tuple[dict[str, int], int]:
    """Start or go on, kill when so many are finished; the finished, and those run anew."""
    before = results(place / "parts")
    process = subprocess.Popen(command(place, "parts"), env=environment, stderr=subprocess.DEVNULL)
    while len(results(place / "parts")) < least and process.poll() is None:
        time.sleep(0.05)
    process.send_signal(signal.SIGKILL)
    process.wait()
    time.sleep(2)
    after = results(place / "parts")
    return after, sum(after[name] != written for name, written in before.items())


def timed(place: Path, directory: str, environment: dict[str, str]) -> float:
    """Seconds that a scan takes to its end."""
    begun = time.perf_counter()
    subprocess.run(command(place, directory), env=environment, check=True, capture_output=True)
    return time.perf_counter() - begun


def same(one: Path, other: Path) -> bool:
    """Whether two scans have the same figures, bit for bit."""
    with xr.open_dataset(one / "sweep.nc") as a, xr.open_dataset(other / "sweep.nc") as b:
        names = [name for name in a.data_vars if name != "seconds"]
        return all(np.array_equal(a[n].values, b[n].values, equal_nan=a[n].dtype.kind == "f")
                   for n in names) and not (a["error"] != "").any()  # fmt: skip


def busy(place: Path, wall: float, cores: int) -> float:
    """Share of the cores' time that members have had."""
    with xr.open_dataset(place / "whole" / "sweep.nc") as scan:
        seconds = float(scan["seconds"].sum()) * scan.attrs["threads_per_member"]
    return seconds / (cores * wall)


def main() -> None:
    """Time a whole scan, kill another one again and again, compare."""
    options = arguments(__doc__, kills=2, duration=400.0, fresh=False)
    with tempfile.TemporaryDirectory() as folder:
        place, environment = Path(folder), dict(os.environ)
        if options.fresh:
            environment["NUMBA_CACHE_DIR"] = str(place / "cache")
        text = FILE.replace("{duration}", str(options.duration))
        (place / "sweep.toml").write_text(text, encoding="utf-8")
        cores = len(os.sched_getaffinity(0))
        wall = timed(place, "whole", environment)
        row = {
            "members": MEMBERS, "cores": cores, "seconds": wall,
            "share of ideal": busy(place, wall, cores), "start": timed(place, "whole", environment),
        }  # fmt: skip
        again, kept = 0, {}
        for kill in range(options.kills):
            kept, anew = kill_at(place, MEMBERS * (kill + 1) // (options.kills + 1), environment)
            again += anew
        row["kept at the last kill"] = len(kept)
        row["resumed in"] = timed(place, "parts", environment)
        end = results(place / "parts")
        row["run again"] = again + sum(end[name] != written for name, written in kept.items())
        row["same, bit for bit"] = same(place / "whole", place / "parts")
    report([row], options.json)


if __name__ == "__main__":
    main()
