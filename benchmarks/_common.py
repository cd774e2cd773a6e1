"""What all benchmarks share: machine description, timing, scenes, results as table and JSON."""

import argparse
import json
import platform
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_info

from morphosim import Cell, Numerics, Physics, Scene, Simulation, Sphere


def machine() -> dict[str, Any]:
    """Processor, memory bandwidth-free facts and library versions of this machine."""
    import numba
    import scipy

    cpu = platform.processor()
    info = Path("/proc/cpuinfo")
    if info.exists():
        names = [line for line in info.read_text().splitlines() if line.startswith("model name")]
        cpu = f"{len(names)} x {names[0].partition(':')[2].strip()}" if names else cpu
    blas = [f"{b['internal_api']} {b.get('architecture', '')}" for b in threadpool_info()]
    return {
        "cpu": cpu,
        "system": platform.platform(),
        "python": platform.python_version(),
        "numpy": np.__version__,
        "scipy": scipy.__version__,
        "numba": numba.__version__,
        "thread pools": sorted(set(blas)),
    }


def packed_points(count: int, radius: float) -> np.ndarray:
    """Centres (count, 3) of touching balls in face-centred cubic packing, nearest the middle."""
    side = int(np.ceil((count / 4) ** (1 / 3))) + 1
    corners = np.array(np.meshgrid(*[np.arange(side)] * 3, indexing="ij")).reshape(3, -1).T
    basis = np.array([[0, 0, 0], [0.5, 0.5, 0], [0.5, 0, 0.5], [0, 0.5, 0.5]])
    points = (corners[:, None] + basis[None]).reshape(-1, 3) * radius * np.sqrt(8)
    offsets = ((points - points.mean(axis=0)) ** 2).sum(axis=1)
    return np.asarray(points[np.argsort(offsets, kind="stable")[:count]])


def packed_scene(count: int, radius: float = 4.0, **numerics: Any) -> Scene:
    """Close-packed cells without a shell, σ = 0.5 for all, δt = 1.5."""
    cells = [
        Cell(name=f"c{k}", shape=Sphere(center=point, radius=radius))
        for k, point in enumerate(packed_points(count, radius))
    ]
    return Scene(
        cells=cells, physics=Physics(sigma=0.5), numerics=Numerics(**({"dt": 1.5} | numerics))
    )


def alternating_medians(
    actions: Mapping[str, Callable[[], None]], rounds: int, warm_up: int = 2
) -> dict[str, float]:
    """Median seconds of each action, run in turn so that all see the same noise."""
    seconds: dict[str, list[float]] = {name: [] for name in actions}
    for turn in range(warm_up + rounds):
        for name, action in actions.items():
            begin = time.perf_counter()
            action()
            if turn >= warm_up:
                seconds[name].append(time.perf_counter() - begin)
    return {name: float(np.median(values)) for name, values in seconds.items()}


def stepper(simulation: Simulation, steps: int = 1) -> Callable[[], None]:
    """Action that advances a simulation."""

    def advance() -> None:
        simulation.step(steps)

    return advance


def print_table(rows: Sequence[Mapping[str, Any]]) -> None:
    """Rows as a plain table; the first row gives the columns."""
    columns = list(rows[0])
    texts = [[_text(row[c]) for c in columns] for row in rows]
    widths = [max(len(c), *(len(t[k]) for t in texts)) for k, c in enumerate(columns)]
    for line in [columns, *texts]:
        print("  ".join(value.rjust(width) for value, width in zip(line, widths, strict=True)))


def markdown_table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table in Markdown."""
    lines = [head, ["---"] * len(head), *rows]
    return "".join(f"| {' | '.join(cells)} |\n" for cells in lines)


def _text(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def arguments(description: str, **options: Any) -> argparse.Namespace:
    """Command line of a benchmark: its own options, and --json FILE."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--json", type=Path, help="write the result to this file")
    for name, default in options.items():
        parser.add_argument(
            f"--{name.replace('_', '-')}", type=type(default), default=default, help=f"{default}"
        )
    return parser.parse_args()


def report(rows: Sequence[Mapping[str, Any]], path: Path | None) -> None:
    """Print a table and, on request, write it as JSON with the machine's description."""
    print_table(rows)
    if path is not None:
        path.write_text(json.dumps({"machine": machine(), "rows": list(rows)}, indent=1))
