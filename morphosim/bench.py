"""Where a machine stands: steps, whole runs, memory, bandwidth; behind `morphosim bench`.

Solvers are compared by steps of one length; presets, whose steps are as long as a tolerance allows,
by whole runs.
"""

import os
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from morphosim import _validate
from morphosim.geometry.shapes import Sphere
from morphosim.library.built_in import built_in_scene
from morphosim.numerics.parameters import Numerics
from morphosim.physics.parameters import Physics
from morphosim.progress import TellWhat, silent
from morphosim.provenance import machine
from morphosim.scene.cell import Cell
from morphosim.scene.scene import Scene
from morphosim.simulation.simulation import Simulation

CELLS = 100
PACKED_DT = 1.5
EMBRYO = "celegans-8"
BY_SOLVER: dict[str, dict[str, Any]] = {
    "dct": {"solver": "dct"}, "band": {"solver": "band"}, "linearised": {"scheme": "linearised"},
}  # fmt: skip
"""Numerics by solver, with which all steps are δt long."""
RUN_PRESETS = ("draft", "fast", "standard")
"""Presets that take the embryo to its end."""
COMPILING = 3
"""Steps that compile all that a whole run needs."""
SETTLING = 12
"""Steps before the timing: all kernels are compiled, fields and boxes settled."""
TURN = 0.1
"""Most seconds that a variant advances before the next has its turn."""
LEAST_ROUNDS, WARM_UP = 5, 1
BUSY = 0.5
"""Load average at the start from which on the machine is said to do other work."""
PER_MINUTE = 2000.0
"""*In silico* time of a minute in vivo. The paper's Table 1 gives minutes only; that it has 5000
steps of δt = 2 in 5 min is inferred from its time per step."""
TABLE_1 = {"minutes in vivo": 5.0, "Tesla P100": 93.8, "Xeon CPU": 706.1}
"""Table 1 of the paper, 100 cells: minutes in vivo, and minutes of computation."""

MEASURED: dict[str, str | float | None] = {
    "machine": "2 virtual cores of an AMD EPYC (Zen 4), shared with others",
    "copy, 1 thread, GB/s": 21.2,
    "copy, 2 threads, GB/s": 21.5,
    "100 cells, dct, 1 thread, ms per step": 35.0,
    "100 cells, dct, 2 threads, ms per step": 26.8,
    "100 cells, band, 1 thread, ms per step": 14.1,
    "100 cells, band, 2 threads, ms per step": 12.6,
    "100 cells, linearised, 1 thread, ms per step": 17.9,
    "100 cells, linearised, 2 threads, ms per step": None,
    "celegans-8, dct, 1 thread, ms per step": 11.8,
    "celegans-8, dct, 2 threads, ms per step": 9.11,
    "celegans-8, band, 1 thread, ms per step": 4.07,
    "celegans-8, band, 2 threads, ms per step": 4.23,
    "celegans-8, linearised, 1 thread, ms per step": 5.67,
    "celegans-8, linearised, 2 threads, ms per step": None,
    "celegans-8 to t = 15000, preset draft, 2 threads, s": 1.15,
    "celegans-8 to t = 15000, preset fast, 2 threads, s": 2.24,
    "celegans-8 to t = 15000, preset standard, 2 threads, s": 4.40,
}
"""What `morphosim bench` gave on the developers' machine; None: not measured, not shown."""


@dataclass(frozen=True)
class Variant:
    """One scene with one solver and number of threads."""

    scene: str
    simulation: Simulation

    def row(self, seconds: float) -> dict[str, Any]:
        """One line of the table; `seconds` is the time of a step."""
        cells, numerics = len(self.simulation.cells), self.simulation.scene.numerics
        return {
            "scene": self.scene,
            "solver": numerics.active_solver,
            "dt": numerics.dt,
            "threads": self.simulation.engine.workers,
            "ms per step": 1e3 * seconds,
            "us per cell and step": 1e6 * seconds / cells,
            "MB per cell": self.simulation.engine.nbytes / cells / 1e6,
        }


def measure(
    seconds: float = 60.0, threads: int = 0, tell: TellWhat | None = None
) -> dict[str, Any]:
    """Time steps of packed cells and of the embryo, and the embryo to its end.

    Steps are timed on one thread and on all, in turn in this process; the whole runs follow, on
    all threads.

    Parameters
    ----------
    seconds : float
        About how long to time steps, after compilation. Every variant has at least six turns. The
        whole runs come on top: some 3600 steps of the embryo.
    threads : int
        Number of threads to compare with one; 0 takes all the processors available.
    tell : function of (what, done, of), optional
        Is told of the progress.

    Returns
    -------
    dict
        "machine", "load at start", "copy, GB/s" by number of threads, "rows" (medians), "ratios"
        of one thread to all, "runs" (measured), and "estimates" of the paper's Table 1 on all
        threads, whose steps are all of one length. It can be written as JSON.

    Raises
    ------
    ValueError
        `seconds` is not positive, or there are not so many threads.
    """
    _validate.number("seconds", seconds, above=0)
    say = tell or silent
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else None
    workers = Numerics(threads=threads).worker_count
    counts = sorted({1, workers})
    say("building", 0, 1)
    variants = _variants(counts)
    bandwidth = {str(n): copy_bandwidth(n) for n in counts}
    speeds = []
    for done, variant in enumerate(variants):
        say("compiling", done, len(variants))
        speeds.append(_settle(variant.simulation))
    turn = min(TURN, seconds / (2 * (LEAST_ROUNDS + WARM_UP) * len(variants)))
    steps = [max(1, round(turn / speed)) for speed in speeds]
    one_round = sum(n * speed for n, speed in zip(steps, speeds, strict=True))
    rounds = max(LEAST_ROUNDS, round(seconds / one_round) - WARM_UP)
    medians = alternating_medians(
        {str(k): stepper(v.simulation, steps[k]) for k, v in enumerate(variants)},
        rounds, WARM_UP, lambda done: say("timing, round", done, rounds + WARM_UP),
    )  # fmt: skip
    rows = [v.row(medians[str(k)] / steps[k]) for k, v in enumerate(variants)]
    return {
        "machine": machine(),
        "load at start": load,
        "copy, GB/s": bandwidth,
        "rows": rows,
        "ratios": _ratios(rows, workers),
        "runs": [whole_run(preset, workers, say) for preset in RUN_PRESETS],
        "estimates": _estimates([row for row in rows if row["threads"] == workers]),
    }


def text(result: Mapping[str, Any]) -> str:
    """What `measure` found, as tables and lines; beside it `MEASURED`, as far as it is known."""
    lines = [f"{key}: {_listed(value)}" for key, value in result["machine"].items()]
    lines += [
        f"copy of a large array, read and written: {speed:.1f} GB/s on {_threads(int(count))}"
        for count, speed in result["copy, GB/s"].items()
    ]
    if (result["load at start"] or 0) > BUSY:
        lines.append(
            f"other programs are running (load {result['load at start']:.1f} at the start): "
            "a quiet machine is faster"
        )
    lines += ["", table(result["rows"]), ""]
    lines += [
        f"{r['scene']}, {r['solver']}: {_threads(r['threads'])} against 1: {r['times']:.2f} times"
        for r in result["ratios"]
    ]
    lines += [
        f"{r['scene']} to t = {r['end']:g}, preset {r['preset']}: {r['s']:.3g} s on "
        f"{_threads(r['threads'])} ({r['steps']} steps)"
        for r in result["runs"]
    ]
    estimates = result["estimates"]
    lines += [
        f"{CELLS} cells, {estimates['steps']} steps (Table 1 of the paper; steps inferred), "
        f"{solver}: {minutes:.1f} min on {_threads(estimates['threads'])}"
        for solver, minutes in estimates["min"].items()
    ]
    published = [
        f"{TABLE_1[name]:g} min on a {name}" for name in TABLE_1 if name != "minutes in vivo"
    ]
    lines.append(f"published for 100 cells: {', '.join(published)}")
    known = {name: value for name, value in MEASURED.items() if value is not None}
    if known:
        lines += ["", "on the developers' machine:"]
        lines += [
            f"  {name}: {value:.4g}" if isinstance(value, float) else f"  {name}: {value}"
            for name, value in known.items()
        ]
    return "\n".join(lines)


def whole_run(preset: str, threads: int, say: TellWhat = silent) -> dict[str, Any]:
    """Take the embryo to its end with a preset, and time it; compilation is not counted."""
    numerics = Numerics.preset(preset, threads=threads)
    scene = replace(built_in_scene(EMBRYO), numerics=numerics)
    Simulation(scene).step(COMPILING)
    simulation, last = Simulation(scene), numerics.ticks_to(scene.duration)

    def tell(*ticks: int) -> None:
        done, of = (round(tick * numerics.tick) for tick in ticks)
        say(f"{EMBRYO}, preset {preset}, t", done, of)

    begin = time.perf_counter()
    simulation.step_to(last, tell)
    seconds = time.perf_counter() - begin
    return {
        "scene": EMBRYO,
        "preset": preset,
        "end": simulation.time,
        "threads": simulation.engine.workers,
        "steps": simulation.steps,
        "s": seconds,
    }


def copy_bandwidth(threads: int = 1, megabytes: int = 256, copies: int = 5) -> float:
    """Speed of NumPy's copy of a large array, GB/s read and written (median of `copies`)."""
    source, target = np.ones(megabytes * 125_000), np.zeros(megabytes * 125_000)
    target[:] = 0  # maps its pages
    sources, targets = np.array_split(source, threads), np.array_split(target, threads)
    seconds = []
    with ThreadPoolExecutor(threads) as pool:
        for _ in range(copies + 1):
            begin = time.perf_counter()
            list(pool.map(np.copyto, targets, sources))
            seconds.append(time.perf_counter() - begin)
    return float(2e-9 * source.nbytes / np.median(seconds[1:]))


def packed_points(count: int, radius: float) -> NDArray[np.float64]:
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
        cells=cells, physics=Physics(sigma=0.5),
        numerics=Numerics(**({"dt": PACKED_DT} | numerics)),
    )  # fmt: skip


def alternating_medians(
    actions: Mapping[str, Callable[[], None]],
    rounds: int,
    warm_up: int = 2,
    after_round: Callable[[int], None] | None = None,
) -> dict[str, float]:
    """Median seconds of each action, run in turn so that all see the same noise.

    Parameters
    ----------
    actions : dict of functions, by name
    rounds, warm_up : int
        Rounds that are counted, and rounds before them.
    after_round : function of the number of rounds done, optional
    """
    seconds: dict[str, list[float]] = {name: [] for name in actions}
    for turn in range(warm_up + rounds):
        for name, action in actions.items():
            begin = time.perf_counter()
            action()
            if turn >= warm_up:
                seconds[name].append(time.perf_counter() - begin)
        if after_round is not None:
            after_round(turn + 1)
    return {name: float(np.median(values)) for name, values in seconds.items()}


def stepper(simulation: Simulation, steps: int = 1) -> Callable[[], None]:
    """Action that advances a simulation."""

    def advance() -> None:
        simulation.step(steps)

    return advance


def table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Rows as a plain table; the first row gives the columns."""
    columns = list(rows[0])
    texts = [[_text(row[c]) for c in columns] for row in rows]
    widths = [max(len(c), *(len(t[k]) for t in texts)) for k, c in enumerate(columns)]
    return "\n".join(
        "  ".join(value.rjust(width) for value, width in zip(line, widths, strict=True))
        for line in [columns, *texts]
    )


def _text(value: Any) -> str:
    if value is None:
        return "-"
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _listed(value: Any) -> str:
    return ", ".join(value) if isinstance(value, list) else str(value)


def _threads(count: int) -> str:
    return f"{count} thread{'s' if count > 1 else ''}"


def _variants(counts: Sequence[int]) -> list[Variant]:
    """All whose steps `measure` times."""
    packed, embryo = packed_scene(CELLS), built_in_scene(EMBRYO)
    return [
        Variant(name, Simulation(scene.with_numerics(threads=count, **solver)))
        for name, scene in ((f"{CELLS} cells", packed), (EMBRYO, embryo))
        for solver in BY_SOLVER.values()
        for count in counts
    ]


def _settle(simulation: Simulation) -> float:
    """Advance by `SETTLING` steps; return the median seconds of the later half."""
    seconds = []
    for _ in range(SETTLING):
        begin = time.perf_counter()
        simulation.step()
        seconds.append(time.perf_counter() - begin)
    return float(np.median(seconds[SETTLING // 2 :]))


def _ratios(rows: Sequence[Mapping[str, Any]], workers: int) -> list[dict[str, Any]]:
    """How many times as fast as one thread all are; none if one is all."""
    alone = {(r["scene"], r["solver"]): r["ms per step"] for r in rows if r["threads"] == 1}
    return [
        {
            "scene": row["scene"],
            "solver": row["solver"],
            "threads": workers,
            "times": alone[row["scene"], row["solver"]] / row["ms per step"],
        }
        for row in rows
        if row["threads"] > 1
    ]


def _estimates(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Minutes that the last row of Table 1 takes, by solver, from times per step."""
    steps = round(TABLE_1["minutes in vivo"] * PER_MINUTE / PACKED_DT)
    return {
        "threads": rows[0]["threads"],
        "steps": steps,
        "min": {
            r["solver"]: 1e-3 * r["ms per step"] * steps / 60 for r in rows if r["scene"] != EMBRYO
        },
        "published, min": TABLE_1,
    }
