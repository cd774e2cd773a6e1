"""Tension along an axis makes cells of a layer flat, plump or columnar.

Run as `python examples/columnar.py OUT.png` (a minute); needs matplotlib. A patch of 19 cells that
adhere to each other lies on a plane, with the tension γ √(1 + χ (p·n)²), p normal to the plane.
"""

import sys
import tempfile
from pathlib import Path

import matplotlib as mpl

mpl.use("agg")
import numpy as np
from matplotlib import pyplot as plt

from morphosim import (
    AxialTension,
    BoxWalls,
    Cell,
    Numerics,
    Physics,
    RunWriter,
    Scene,
    Simulation,
    Sphere,
    WallAdhesion,
    open_run,
)

CHIS = (-0.6, 0.0, 3.0)
RADIUS, APART, END = 4.0, 6.8, 1500.0


def patch(chi: float) -> Scene:
    """A hexagon of cells on the plane y = 0; the other walls are far away."""
    places = [
        (APART * (a + b / 2), RADIUS, APART * b * np.sqrt(3) / 2)
        for a in range(-2, 3) for b in range(-2, 3) if abs(a + b) <= 2
    ]  # fmt: skip
    cells = [
        Cell(name=f"c{k}", shape=Sphere(center=place, radius=RADIUS))
        for k, place in enumerate(places)
    ]
    along = AxialTension(chi=chi, direction=(0, 1, 0))
    return Scene(
        cells=cells,
        physics=Physics(sigma=0.4, terms=[WallAdhesion(sigma=0.5), along]),
        numerics=Numerics.preset("fast"),
        confinement=BoxWalls(lower=(-60, 0, -60), upper=(60, 60, 60)),
        duration=END, save_every=END / 5,
    )  # fmt: skip


def main(picture: str) -> None:
    """Compute all and draw them from the side, cut through the middle."""
    figure, axes = plt.subplots(1, len(CHIS), figsize=(13, 3.6), layout="constrained")
    with tempfile.TemporaryDirectory() as folder:
        for ax, chi in zip(axes, CHIS, strict=True):
            directory = Path(folder) / f"chi{chi:g}"
            Simulation(patch(chi)).run(observers=[RunWriter(directory, END / 5)])
            with open_run(directory) as run:
                run.morpho.draw(ax, END, view="z", names=False, shell=False, cut="z")
                height = 2 * float(run["centroid"].sel(axis="y").isel(time=-1).mean("cell"))
            ax.set_title(f"χ = {chi:g}: {height:.1f} µm high")
            print(f"χ = {chi:g}: {height:.1f} µm high")
    figure.savefig(picture, dpi=110)


if __name__ == "__main__":
    main(*sys.argv[1:])
