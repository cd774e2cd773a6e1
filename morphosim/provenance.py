"""What computes: processor, system and library versions, as results and runs record them."""

import math
import os
import platform
from contextlib import suppress
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

CONTAINER_LIMIT = Path("/sys/fs/cgroup/memory.max")
LIBRARIES = ("morphosim", "numpy", "scipy", "numba", "llvmlite", "netCDF4", "xarray")


@cache
def versions() -> dict[str, str]:
    """Versions of Python and of the libraries that results depend on."""
    return {"python": platform.python_version()} | {name: version(name) for name in LIBRARIES}


@cache
def processor() -> str:
    """Number and name of the processors, as far as the system tells."""
    info = Path("/proc/cpuinfo")
    if info.exists():
        names = [line for line in info.read_text().splitlines() if line.startswith("model name")]
        if names:
            return f"{len(names)} x {names[0].partition(':')[2].strip()}"
    return platform.processor() or platform.machine()


@cache
def memory() -> float:
    """Bytes of memory that a process may use: of the machine, or of its container if that is less.

    Infinite where the system does not tell.
    """
    found = [math.inf]
    with suppress(AttributeError, OSError, ValueError):  # as on Windows
        found.append(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
    with suppress(OSError, ValueError):  # no container, or "max"
        found.append(int(CONTAINER_LIMIT.read_text()))
    return float(min(found))


def check_memory(what: str, needed: float, advice: str) -> None:
    """Raise ValueError if something does not fit into memory, before it is made.

    Parameters
    ----------
    what : what takes it, in words
    needed : bytes
    advice : what to try
    """
    if needed > memory():
        message = (
            f"{what} would take {needed / 1e9:.3g} GB of memory; there are "
            f"{memory() / 1e9:.3g} GB: {advice}"
        )
        raise ValueError(message)


def machine() -> dict[str, Any]:
    """Processor, memory, system, library versions, and what BLAS and OpenMP run on."""
    from llvmlite.binding import get_host_cpu_name
    from threadpoolctl import threadpool_info

    blas = [f"{b['internal_api']} {b.get('architecture', '')}" for b in threadpool_info()]
    return {
        "cpu": processor(),
        "known to LLVM as": get_host_cpu_name(),
        "memory, GB": round(memory() / 1e9, 1) if math.isfinite(memory()) else None,
        "system": f"{platform.system()} {platform.machine()}",
        **versions(),
        "thread pools": sorted({pool.strip() for pool in blas}),
    }
