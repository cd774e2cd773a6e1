"""The presets on the eight-cell embryo to t = 15000: outcome, error and speed.

Run as `python benchmarks/presets.py` (about half an hour). Every preset runs alone, and is compared
with `reference`: centroids, contacts at the end, seconds. Writes a table, and JSON on request.
"""

import time
from typing import Any

import numpy as np
from _common import arguments, report
from _scenes import embryo

from morphosim import Numerics, Simulation, contact_areas, touching

PRESETS = ("reference", "standard", "draft", "published")


def course(preset: str, until: float, every: float) -> dict[str, Any]:
    """Run one preset; centroids over time, contacts at the end, seconds."""
    from dataclasses import replace

    simulation = Simulation(replace(embryo(), numerics=Numerics.preset(preset)))
    simulation.step(2)
    begin, paths = time.perf_counter(), []
    for k in range(1, round(until / every) + 1):
        simulation.run(until=k * every)
        paths.append(simulation.centroids)
        print(f"{preset} t = {simulation.time:g}", end="\r", flush=True)
    seconds = time.perf_counter() - begin
    fields, spacing = simulation.fields, simulation.scene.numerics.spacing
    return {
        "centroids": np.array(paths), "touching": set(touching(fields)),
        "areas": contact_areas(fields, spacing), "seconds": seconds,
        "ms": 1e3 * seconds / simulation.engine.steps,
    }  # fmt: skip


def compare(name: str, found: dict[str, Any], truth: dict[str, Any]) -> dict[str, Any]:
    """One line of the table."""
    distance = 1e3 * np.linalg.norm(found["centroids"] - truth["centroids"], axis=2)
    odd = found["touching"] ^ truth["touching"]
    doubtful = max((truth["areas"].get(p, found["areas"].get(p, 0.0)) for p in odd), default=0.0)
    return {
        "preset": name,
        "contacts": len(found["touching"]),
        "not in both": ", ".join("-".join(p) for p in sorted(odd)) or "none",
        "area of those, um2": float(doubtful),
        "rms at end, nm": float(np.sqrt((distance[-1] ** 2).mean())),
        "largest at end, nm": float(distance[-1].max()),
        "largest ever, nm": float(distance.max()),
        "seconds": found["seconds"],
        "ms per step": found["ms"],
        "times as fast": truth["seconds"] / found["seconds"],
    }


def main() -> None:
    """Run all presets and report."""
    options = arguments(__doc__, until=15000.0, every=500.0)
    found = {name: course(name, options.until, options.every) for name in PRESETS}
    rows = [compare(name, found[name], found["reference"]) for name in PRESETS]
    report(rows, options.json)


if __name__ == "__main__":
    main()
