"""σ_S by optimisation: the attraction whose four contact areas fit the experiment best.

Run as `python examples/fit_attraction.py RUN [SIGMA]` on a run of `celegans-1-to-8`. Brent's method
takes fewer runs than the scan of step D (16 values, 0 to 1.5), and every run begins where the
others do. With SIGMA the areas to fit are those of a simulation with this attraction, so that the
answer is known.
"""

import sys
from collections.abc import Callable
from tempfile import TemporaryDirectory

import numpy as np
import xarray as xr
from _four_cells import EXPERIMENT, FOUR, four_cells, surface_areas
from scipy.optimize import minimize_scalar

from morphosim import Attraction, RunWriter, Scene, Simulation, open_run

HIGHEST, PRECISION = 1.5, 0.05
SCAN = np.arange(16) / 10
"""The values of step D."""


def areas(scene: Scene, sigma: float) -> xr.DataArray:
    """The four areas, µm², with cells at rest."""
    simulation = Simulation(scene.with_physics(sigma=Attraction(default=sigma)))
    with TemporaryDirectory() as directory:
        simulation.run(observers=[RunWriter(directory, scene.save_every, fields="none")])
        with open_run(directory) as run:
            return surface_areas(run).sel(pair=FOUR)


def misfit(scene: Scene, target: xr.DataArray) -> tuple[Callable[[float], float], dict]:
    """Mean difference of the areas to the target as a function of σ, and all its values so far."""
    known: dict[float, float] = {}

    def at(sigma: float) -> float:
        known[sigma] = float(abs(areas(scene, sigma) / target - 1).mean())
        print(f"  sigma = {sigma:.3f}: mean |difference| {100 * known[sigma]:.1f} %", flush=True)
        return known[sigma]

    return at, known


def fitted(scene: Scene, target: xr.DataArray) -> tuple[float, int]:
    """σ of the least misfit, and the number of runs that found it."""
    at, known = misfit(scene, target)
    minimize_scalar(at, bounds=(0, HIGHEST), method="bounded", options={"xatol": PRECISION})
    return min(known, key=lambda sigma: known[sigma]), len(known)


def main(run: str, sigma: str = "") -> None:
    """Fit, and tell the number of runs beside the scan's."""
    scene = four_cells(run)
    target = areas(scene, float(sigma)) if sigma else EXPERIMENT.sel(pair=FOUR)
    print(f"areas of {f'a simulation with sigma = {sigma}' if sigma else 'the experiment'}")
    best, runs = fitted(scene, target)
    print(f"sigma_S = {best:.2f} in {runs} runs; the scan takes {len(SCAN)}, to 0.1")


if __name__ == "__main__":
    main(*sys.argv[1:])
