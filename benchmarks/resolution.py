"""Fig. S2: which spacing and time step carry the embryo from one to eight cells, without S.

Run as `python benchmarks/resolution.py`; some twenty minutes. Each combination runs the scene
celegans-1-to-8 with the plain semi-implicit scheme (Eq. 6, and Eq. 9 with S = 0); stages end by
`--limit` at the latest, the last lasts `--last`. The table has the criterion of Supplementary
Note 1 that fails first: overflow, or contacts that are not as listed. Contact areas and axes are
not judged, as stages do not come to rest by the limit and areas of the experiment are stand-ins.
"""

import argparse
import tempfile
import time
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

from _common import report

from morphosim import Duration, Numerics, RunWriter, Scene, Simulation, StabilityWarning, open_run
from morphosim.errors import SimulationError
from morphosim.library.celegans.quality_control import quality_control
from morphosim.library.celegans.scenes import celegans_1_to_8

JUDGED = ("overflow", "touch", "contacts", "contact map", "distance from a plane")
"""Criteria that count, by words of their texts."""


def scene(spacing: float, dt: float, limit: float, last: float, walls: str) -> Scene:
    """The embryo on this lattice."""
    numerics = Numerics(
        spacing=spacing, dt=dt, S=0.0, solver="band", allow_coarse=True, walls=walls, threads=1
    )
    whole = celegans_1_to_8(numerics=numerics, save_fields="packed", save_every=1e5)
    stages = [replace(stage, limit=limit) for stage in whole.stages[:-1]]
    return replace(whole, stages=[*stages, replace(whole.stages[-1], end=Duration(last))])


def row(spacing: float, dt: float, options: argparse.Namespace) -> dict[str, Any]:
    """One line of the table."""
    begin, error = time.perf_counter(), ""
    with tempfile.TemporaryDirectory() as folder:
        try:
            simulation = Simulation(scene(spacing, dt, options.limit, options.last, options.walls))
            simulation.run(observers=[RunWriter(folder, every=1e5)])
        except (SimulationError, ValueError) as problem:
            error = str(problem).partition(":")[0]
        criteria = []
        if list(Path(folder).glob("save-*.nc")):
            with open_run(folder) as run:
                criteria = quality_control(run)
    failed = [c for c in criteria if c.passed is False and any(w in c.text for w in JUDGED)]
    return {
        "spacing": spacing,
        "dt": dt,
        "fails at": error or (failed[0].text if failed else "-"),
        "measured": failed[0].measured if failed and not error else "",
        "seconds": time.perf_counter() - begin,
    }


def main() -> None:
    """Measure and report."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--spacings", type=float, nargs="+", default=[0.5, 0.75, 1.0])
    parser.add_argument("--steps", type=float, nargs="+", default=[0.1, 0.2, 0.3, 0.4])
    parser.add_argument("--limit", type=float, default=1000.0)
    parser.add_argument("--last", type=float, default=2000.0)
    parser.add_argument("--walls", default="resolved", choices=("resolved", "stepped"))
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    warnings.simplefilter("ignore", StabilityWarning)
    rows = []
    for spacing in sorted(options.spacings, reverse=True):
        for dt in sorted(options.steps, reverse=True):
            rows.append(row(spacing, dt, options))
            print(rows[-1], flush=True)
    report(rows, options.json)


if __name__ == "__main__":
    main()
