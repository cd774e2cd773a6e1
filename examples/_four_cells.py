"""What scan and fit of the attraction share: four cells of a run, and their contact areas."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import xarray as xr

from morphosim import (
    Scene,
    Simulation,
    Stage,
    Steady,
    celegans_contact_areas,
    load_fields,
    open_run,
    voxel_contact_areas,
)

START = "4-cell, no attraction"
FIVE = ["-".join(pair) for pair in celegans_contact_areas()]
FOUR = [pair for pair in FIVE if pair != "EMS-P2"]
"""The contacts that σ_S is found by; EMS-P2 is left to σ_W."""
EXPERIMENT = xr.DataArray(list(celegans_contact_areas().values()), {"pair": FIVE}, ["pair"])
"""Areas that were measured, µm²."""


def four_cells(directory: str | Path) -> Scene:
    """End of the four-cell stage of a run of `celegans-1-to-8`, to be brought to rest."""
    with open_run(directory) as run:
        time = float(run["time"].values[np.flatnonzero(run["stage"].values == START)[-1]])
    scene = Simulation.from_run(directory, time=time).scene
    rest = Stage(name="rest", end=Steady(2e-4), limit=2000.0)
    return replace(scene, stages=[rest], duration=1e5, save_every=1e5)


def surface_areas(run: xr.Dataset) -> xr.DataArray:
    """Areas of the five contacts at the end of a run, µm²: φ = 0.34 where the neighbour is 0.2."""
    areas = run["contact_area"].isel(time=-1, drop=True)
    found = [float(areas.sel(cell=a, neighbour=b)) for a, b in celegans_contact_areas()]
    return EXPERIMENT.copy(data=found)


def voxel_areas(run: xr.Dataset) -> xr.DataArray:
    """The same as microscopy measures them: on voxels of 0.18 µm."""
    found = voxel_contact_areas(load_fields(run, -1), run.attrs["spacing_um"])
    return EXPERIMENT.copy(
        data=[found.get((a, b), found.get((b, a), 0.0)) for a, b in celegans_contact_areas()]
    )


def mean_difference(areas: xr.DataArray) -> xr.DataArray:
    """Mean absolute difference to the experiment, relative to it (Note 1.3 D, E)."""
    return abs(areas / EXPERIMENT - 1).mean("pair")


def proportion(areas: xr.DataArray) -> xr.Dataset:
    """Line through the origin: its slope, the mean difference from it, and the correlation."""
    wanted = EXPERIMENT.sel(pair=areas["pair"])
    slope = (areas * wanted).sum("pair") / (wanted**2).sum("pair")
    return xr.Dataset(
        {
            "slope": slope,
            "difference": mean_difference(areas / slope),
            "correlation": xr.corr(areas, wanted, "pair"),
        }
    )
