"""What scan and fit of the attraction share: four cells of a run, and their contact areas."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import xarray as xr

from morphosim import Scene, Simulation, Stage, Steady, celegans_contact_areas, open_run

START = "4-cell, no attraction"
FIVE = celegans_contact_areas()
FOUR = [f"{a}-{b}" for a, b in FIVE if {a, b} != {"EMS", "P2"}]
"""The contacts that σ_S is found by; EMS-P2 is left to σ_W."""


def four_cells(directory: str | Path) -> Scene:
    """End of the four-cell stage of a run of `celegans-1-to-8`, to be brought to rest."""
    with open_run(directory) as run:
        time = float(run["time"].values[np.flatnonzero(run["stage"].values == START)[-1]])
    scene = Simulation.from_run(directory, time=time).scene
    rest = Stage(name="rest", end=Steady(2e-4), limit=2000.0)
    return replace(scene, stages=[rest], duration=1e5, save_every=1e5)


def differences(run: xr.Dataset) -> xr.DataArray:
    """Relative difference of each contact area, at the end of a run, to the experiment."""
    areas = run["contact_area"].isel(time=-1, drop=True)
    found = [float(areas.sel(cell=a, neighbour=b)) / area - 1 for (a, b), area in FIVE.items()]
    return xr.DataArray(found, {"pair": [f"{a}-{b}" for a, b in FIVE]}, ["pair"])
