"""How many threads there are: what the machine, the job and Numba allow."""

import math
import os
from pathlib import Path

GROUPS = Path("/sys/fs/cgroup")
"""Where Linux says what share of the processors a container may use."""
if "OMP_WAIT_POLICY" not in os.environ:
    os.environ["OMP_WAIT_POLICY"] = "passive"
    os.environ.setdefault("GOMP_SPINCOUNT", "30000")
"""Threads of OpenMP that wait for each other spin for a moment, 2 ms or so with GNU's library, and
then sleep. If they slept at once they would come late to the next step, by 1 to 10 ms on a virtual
machine; if they spun on, they would take the processor from the one that is late. OpenMP reads this
when Numba starts its threads."""


def available_processors() -> int:
    """Number of processors that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        count = len(os.sched_getaffinity(0))
    else:
        count = os.cpu_count() or 1
    return math.ceil(min(count, _quota()))


def most_threads() -> int:
    """Most threads that Numba can use: NUMBA_NUM_THREADS as it was at the start.

    Raises
    ------
    ValueError
        It is below 1.
    """
    from numba import config

    threads = int(config.NUMBA_NUM_THREADS)
    if threads < 1:
        message = (
            f"the environment variable NUMBA_NUM_THREADS = {threads} allows no thread; set it to "
            "the number of threads, or leave it out"
        )
        raise ValueError(message)
    return threads


def automatic_threads() -> int:
    """Number of threads where nobody has said one."""
    return min(available_processors(), most_threads())


def check_threads(label: str, threads: int) -> None:
    """Raise ValueError if there cannot be so many threads."""
    if threads > most_threads():
        message = (
            f"{label} = {threads} is more than the {most_threads()} that Numba was started with "
            "here (NUMBA_NUM_THREADS, by default the processors of this process): take at most "
            f"{most_threads()}, or set NUMBA_NUM_THREADS before the start"
        )
        raise ValueError(message)


def _quota() -> float:
    """Processors' worth of time that the control group allows; inf without a limit."""
    for names in (("cpu.max",), ("cpu/cpu.cfs_quota_us", "cpu/cpu.cfs_period_us")):
        try:
            said = " ".join((GROUPS / name).read_text() for name in names)
            quota, period = said.split()
            if float(quota) > 0:  # -1 is no limit
                return float(quota) / float(period)
        except (OSError, ValueError):  # not there, or "max"
            continue
    return math.inf
