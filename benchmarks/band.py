"""The band solver beside the cosine transforms: error, time, least stable S.

Run as `python benchmarks/band.py`; about six minutes. The error is the difference of centroids
between the two solvers with the same numerics otherwise, in nanometres; `stencil` is that of the
transforms with the symbol of the band's stencil, which more iterations come to. Time is that of the
whole run, both solvers in turn. With --long the embryo is run to t = 15000 by both.
"""

import time
import warnings
from typing import Any

import numpy as np
from _common import arguments, report
from _scenes import adhering, embryo, relaxing, walled
from stability import bisect

from morphosim import Scene, Simulation, StabilityWarning
from morphosim.errors import SimulationError
from morphosim.measure.contacts import touching
from morphosim.scene import stability

SCENES = {
    "relaxing": (relaxing(), 120.0),
    "adhering": (adhering(), 200.0),
    "walled": (walled(), 200.0),
    "embryo": (embryo(), 480.0),
}
VARIANTS: dict[str, dict[str, Any]] = {
    "2 iterations": {},
    "3 iterations": {"sweeps": 3},
    "4 iterations": {"sweeps": 4},
    "box tolerance 3e-3": {"box_tolerance": 3e-3},
    "box tolerance 1e-4": {"box_tolerance": 1e-4},
    "h = 2/3, δt = 4, box tolerance 3e-3": {
        "spacing": 2 / 3, "dt": 4.0, "box_tolerance": 3e-3,
    },
}  # fmt: skip
LEAST_S = {
    "dt = 0.5": {"dt": 0.5},
    "dt = 2": {"dt": 2.0},
    "dt = 4": {"dt": 4.0},
    "dt = 2, stepped walls": {"walls": "stepped"},
    "dt = 2, imex1": {"scheme": "imex1"},
}
SOUND = 1.6
"""|φ| beyond this is on its way to divergence."""


def run(scene: Scene, until: float, **numerics: Any) -> tuple[Simulation, float]:
    """Simulation at a time, and the seconds of its steps after the first two."""
    simulation = Simulation(scene.with_numerics(**numerics))
    simulation.step(2)  # compiles
    begin = time.perf_counter()
    simulation.run(until=until)
    return simulation, time.perf_counter() - begin


def difference(a: Simulation, b: Simulation) -> np.ndarray:
    """Distance of centroids, nm."""
    return np.asarray(1e3 * np.linalg.norm(a.centroids - b.centroids, axis=1))


def errors() -> list[dict[str, Any]]:
    """Difference of the solvers by scene and numerics."""
    rows = []
    for name, (scene, until) in SCENES.items():
        for variant, numerics in VARIANTS.items():
            without = {k: v for k, v in numerics.items() if k != "sweeps"}
            exact, exact_seconds = run(scene, until, **without)
            stencil, _ = run(scene, until, laplacian="stencil", **without)
            band, seconds = run(scene, until, solver="band", **numerics)
            error = difference(band, exact)
            rows.append(
                {
                    "scene": name,
                    "numerics": variant,
                    "rms, nm": float(np.sqrt((error**2).mean())),
                    "largest, nm": float(error.max()),
                    "stencil, nm": float(difference(stencil, exact).max()),
                    "volume, relative": float(np.abs(band.volumes / exact.volumes - 1).max()),
                    "times as fast": exact_seconds / seconds,
                }
            )
    return rows


def stable(scene: Scene, until: float, **numerics: Any) -> bool:
    """Whether a run stays sound."""
    try:
        simulation, _ = run(scene, until, **numerics)
    except SimulationError:
        return False
    return all(np.abs(field.phi).max() < SOUND for field in simulation.fields)


def least_S(scene: Scene, until: float, **numerics: Any) -> float:
    """Least stable S, to 3/8."""
    return bisect(lambda S: stable(scene, until, S=S, **numerics), 24.0, 0.0, close=0.375)


def limits() -> list[dict[str, Any]]:
    """Least S of both solvers, and by the formula."""
    rows = []
    for name, until in (("adhering", 200.0), ("walled", 200.0), ("embryo", 160.0)):
        scene = SCENES[name][0]
        for variant, numerics in LEAST_S.items():
            if scene.confinement is None and "walls" in numerics:
                continue
            chosen = scene.with_numerics(**numerics)
            rows.append(
                {
                    "scene": name,
                    "numerics": variant,
                    "least S, dct": least_S(scene, until, **numerics),
                    "least S, band": least_S(scene, until, solver="band", **numerics),
                    "formula": stability.least_S(chosen, stability.pressing(chosen)),
                }
            )
    return rows


def long_run() -> list[dict[str, Any]]:
    """The embryo at t = 15000: contacts, and the difference on the way and at the end."""
    exact, band = (Simulation(embryo().with_numerics(solver=solver)) for solver in ("dct", "band"))
    worst, seconds = 0.0, {"dct": 0.0, "band": 0.0}
    for until in range(500, 15001, 500):
        for name, simulation in (("dct", exact), ("band", band)):
            begin = time.perf_counter()
            simulation.run(until=until)
            seconds[name] += time.perf_counter() - begin
        worst = max(worst, float(difference(band, exact).max()))
    error = difference(band, exact)
    pairs = [sorted(touching(s.fields)) for s in (exact, band)]
    return [
        {
            "scene": "embryo, t = 15000",
            "rms, nm": float(np.sqrt((error**2).mean())),
            "largest, nm": float(error.max()),
            "worst on the way, nm": worst,
            "contacts": f"{len(pairs[1])}, {'the same' if pairs[0] == pairs[1] else 'others'}",
            "seconds, dct": seconds["dct"],
            "seconds, band": seconds["band"],
        }
    ]


def main() -> None:
    """Measure and report."""
    options = arguments(__doc__, long=False)
    warnings.simplefilter("ignore", StabilityWarning)
    if options.long:
        report(long_run(), options.json)
        return
    report(errors(), options.json)
    print()
    path = options.json
    report(limits(), path and path.with_stem(f"{path.stem}-limits"))


if __name__ == "__main__":
    main()
