"""Small scenes and figures that the tests of scans share."""

from collections.abc import Sequence
from pathlib import Path

import xarray as xr

from morphosim import Cell, Scene, Sphere
from morphosim.sweeps.axes import Plan, make_plan
from morphosim.sweeps.figures import make_figures
from morphosim.sweeps.members import Task

FIGURES = ("volume", "contact_area")


def pair(**options: object) -> Scene:
    """Two cells that touch; ten steps."""
    cells = [
        Cell(name=name, shape=Sphere(center=(x, 0, 0), radius=3.0))
        for name, x in (("left", 0.0), ("right", 5.5))
    ]
    return Scene(cells=cells, **({"duration": 20.0, "save_every": 10.0} | options))


def plan(axes: dict, **options: object) -> Plan:
    """Plan with the usual defaults."""
    usual = {
        "replicates": 1, "samples": None, "sampling": "sobol", "sample_seed": 0, "seed": 0,
        "fixed": {},
    }  # fmt: skip
    return make_plan(axes, **(usual | options))


def task(directory: Path, figures: Sequence = FIGURES, keep_runs: bool = False) -> Task:
    """Task on one thread."""
    return Task(
        directory=directory, scene="", figures=make_figures(figures), threads=1,
        keep_runs=keep_runs,
    )  # fmt: skip


def length(run: xr.Dataset) -> xr.DataArray:
    """A figure that needs the fields: points of a cell at half height, along each axis."""
    inside = run.morpho.phi("left") > 0.5
    sizes = [int(inside.any([d for d in "xyz" if d != axis]).sum()) for axis in "xyz"]
    return xr.DataArray(sizes, {"side": list("xyz")}, ["side"])
