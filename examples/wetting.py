"""A spheroid on a plane that attracts it: it stays a ball, or wets the plane and spreads.

Run as `python examples/wetting.py OUT.png` (some minutes); needs matplotlib. A cap of 60 cells that
adhere to each other is left on a plane, whose adhesion σ_wall is 0.05 or 1.5.
"""

import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import matplotlib as mpl

mpl.use("agg")
import numpy as np
from matplotlib import pyplot as plt

from morphosim import (
    Aggregate,
    BoxWalls,
    Numerics,
    Physics,
    RunWriter,
    Scene,
    Simulation,
    Sphere,
    WallAdhesion,
    open_run,
)

WEAK, STRONG = 0.05, 1.5
RADIUS, PACKED, COUNT, END = 4.0, 3.4, 80, 8000.0


def on_a_plane(sigma_wall: float) -> Scene:
    """What of a spheroid is above the plane y = 0; the other walls are far away."""
    spheroid = Aggregate(
        counts={"cell": COUNT}, radius=PACKED, filling=0.5, center=(0, 10, 0), seed=1
    )
    full = Sphere(center=(0, 0, 0), radius=RADIUS).volume  # to which they fill the gaps
    cells = [
        replace(cell, volume=full)
        for cell in spheroid.cells(None, seed=1) if cell.shape.center[1] > PACKED
    ]  # fmt: skip
    return Scene(
        cells=cells,
        physics=Physics(sigma=0.5, kappa=0.05, terms=[WallAdhesion(sigma=sigma_wall)]),
        numerics=Numerics.preset("fast", seed=1),
        confinement=BoxWalls(lower=(-70, 0, -70), upper=(70, 70, 70)),
        duration=END, save_every=END / 20,
    )  # fmt: skip


def main(picture: str) -> None:
    """Compute both and draw them from the side, with how high they are."""
    figure, axes = plt.subplots(1, 4, figsize=(14, 3.4), layout="constrained")
    with tempfile.TemporaryDirectory() as folder:
        for place, sigma_wall in enumerate((WEAK, STRONG)):
            directory = Path(folder) / str(place)
            Simulation(on_a_plane(sigma_wall)).run(observers=[RunWriter(directory, END / 20)])
            with open_run(directory) as run:
                if place == 0:
                    run.morpho.draw(axes[0], 0.0, view="z", names=False, shell=False)
                    axes[0].set_title("t = 0")
                run.morpho.draw(axes[1 + place], END, view="z", names=False, shell=False)
                axes[1 + place].set_title(f"t = {END:g}, σ_wall = {sigma_wall:g}")
                height = run["centroid"].sel(axis="y").mean("cell")
                wide = np.hypot(*(run["centroid"].sel(axis=a) for a in "xz")).mean("cell")
                axes[3].plot(run["time"], wide / height, label=f"σ_wall = {sigma_wall:g}")
                print(f"σ_wall = {sigma_wall:g}: width / height {wide[-1] / height[-1]:.2f}")
    axes[3].set(xlabel="in silico time", ylabel="mean distance from the axis / mean height")
    axes[3].legend(frameon=False)
    figure.savefig(picture, dpi=110)


if __name__ == "__main__":
    main(*sys.argv[1:])
