"""Steps D and E of Supplementary Note 1: the attraction that fits the contact areas of four cells.

Run as `python examples/attraction_scan.py RUN` on a run of `celegans-1-to-8`; some three minutes.
From the end of its four-cell stage without attraction, σ between all cells is scanned for the
smallest mean difference of four contact areas to the experiment (σ_S), and then that of EMS-P2
alone, below σ_S, for all five (σ_W).
"""

import sys
from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from morphosim import Attraction, Scene, Simulation, contact_areas, open_run
from morphosim.lineage import contact_areas as experiment
from morphosim.stages import Stage, Steady

START = "4-cell, no attraction"
FIVE = experiment()
FOUR = [pair for pair in FIVE if set(pair) != {"EMS", "P2"}]


def differences(scene: Scene, sigma: Attraction) -> dict[tuple[str, str], float]:
    """Relative difference of each contact area to the experiment, with cells at rest."""
    rest = Stage(name="rest", end=Steady(2e-4), limit=2000.0)
    simulation = Simulation(replace(scene.with_physics(sigma=sigma), stages=[rest], duration=1e5))
    simulation.run()
    found = contact_areas(simulation.fields, scene.numerics.spacing)
    areas = {frozenset(pair): area for pair, area in found.items()}
    return {pair: areas.get(frozenset(pair), 0.0) / area - 1 for pair, area in FIVE.items()}


def scan(scene: Scene, sigmas: dict[float, Attraction], pairs: Iterable[tuple[str, str]]) -> float:
    """The value whose areas of these pairs fit best; prints all."""
    fits = {}
    for value, sigma in sigmas.items():
        off = differences(scene, sigma)
        fits[value] = float(np.mean([abs(off[pair]) for pair in pairs]))
        texts = "  ".join(f"{a}-{b} {100 * d:+.0f}%" for (a, b), d in off.items())
        print(f"  {value:.1f}: mean |difference| {100 * fits[value]:.1f} %   {texts}", flush=True)
    return min(fits, key=lambda value: fits[value])


def main(directory: str) -> None:
    """Scan both."""
    with open_run(directory) as run:
        time = float(run["time"].values[np.flatnonzero(run["stage"].values == START)[-1]])
    scene = Simulation.from_run(directory, time=time).scene
    print(f"from {directory} at t = {time:g}; sigma between all cells")
    values = [k / 10 for k in range(16)]
    strong = scan(scene, {v: Attraction(default=v) for v in values}, FOUR)
    print(f"sigma_S = {strong:.1f}\nsigma between EMS and P2")
    lower = {v: Attraction(default=strong, pairs={("EMS", "P2"): v}) for v in values if v < strong}
    print(f"sigma_W = {scan(scene, lower, FIVE):.1f}" if lower else "sigma_W: none below sigma_S")


if __name__ == "__main__":
    main(sys.argv[1])
