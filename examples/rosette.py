"""A rosette of eight cells opens a lumen, as wide as the tension along the cells' axes has it.

Run as `python examples/rosette.py OUT.png` (a minute); needs matplotlib. Cells that adhere to each
other lie in a closed ring between two plates. A term of their own keeps their polarity along the
ring's radius, and `AxialTension` follows it: cells that are short along it (χ < 0) make the ring
wider, and those that are long narrow it.
"""

import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl

mpl.use("agg")
import numpy as np
from matplotlib import pyplot as plt
from scipy.ndimage import label

from morphosim import (
    AxialTension,
    BoxWalls,
    Cell,
    Column,
    Numerics,
    Physics,
    RunWriter,
    Scene,
    Simulation,
    Sphere,
    Term,
    open_run,
)

CHIS = (2.0, 0.0, -0.6)
RADIUS, RING, HEIGHT, END = 4.0, 5.2, 9.0, 2400.0


@dataclass(frozen=True, kw_only=True)
class Radial(Term):
    """Polarity away from the axis through the middle of all cells, along z."""

    every: float = 10.0

    columns = (Column("polarity", shape=(3,)),)
    drifts = False

    def senses(self, step):
        """Now and then."""
        return step.time == 0 or step.time % self.every < step.dt

    def update(self, cells, step, forces):
        """Set the polarity."""
        if self.senses(step):
            away = step.surroundings.centroid - step.surroundings.centroid.mean(axis=0)
            away[:, 2] = 0
            cells["polarity"][:] = away / np.linalg.norm(away, axis=1, keepdims=True)


def rosette(chi: float) -> Scene:
    """Eight cells in a ring, so narrow that its middle is closed."""
    cells = []
    for k, angle in enumerate(np.arange(8) * np.pi / 4):
        place = RING * np.cos(angle), RING * np.sin(angle), 0
        cells.append(Cell(name=f"c{k}", shape=Sphere(center=place, radius=RADIUS)))
    return Scene(
        cells=cells,
        physics=Physics(sigma=0.4, terms=[Radial(), AxialTension(chi=chi)]),
        numerics=Numerics.preset("fast"),
        confinement=BoxWalls(lower=(-60, -60, -HEIGHT / 2), upper=(60, 60, HEIGHT / 2)),
        duration=END, save_every=END / 24,
    )  # fmt: skip


def lumen(run, time: float) -> float:
    """Area around the axis that no cell covers, at half the height, µm²."""
    covered = run.morpho.full(time).sel(z=0, method="nearest").sum("cell") > 0.5
    holes, _ = label(np.pad(~covered.values, 1, constant_values=True))
    x, y = (int(np.abs(covered[axis].values).argmin()) + 1 for axis in "xy")
    inside = holes[x, y] not in (0, holes[0, 0])
    return float((holes == holes[x, y]).sum() * run.attrs["spacing_um"] ** 2) if inside else 0.0


def main(picture: str) -> None:
    """Compute all, draw them from above, and how the lumen opens."""
    figure, axes = plt.subplots(1, len(CHIS) + 1, figsize=(14, 3.6), layout="constrained")
    with tempfile.TemporaryDirectory() as folder:
        for ax, chi in zip(axes, CHIS, strict=False):
            directory = Path(folder) / f"chi{chi:g}"
            Simulation(rosette(chi)).run(observers=[RunWriter(directory, END / 24)])
            with open_run(directory) as run:
                run.morpho.draw(ax, END, view="z", names=False, shell=False, cut="z")
                areas = [lumen(run, t) for t in run["time"].values]
                axes[-1].plot(run["time"], areas, label=f"χ = {chi:g}")
            ax.set_title(f"χ = {chi:g}")
            print(f"χ = {chi:g}: lumen of {areas[0]:.0f}, in the end {areas[-1]:.0f} µm²")
    axes[-1].set(xlabel="in silico time", ylabel="lumen, µm²")
    axes[-1].legend(frameon=False)
    figure.savefig(picture, dpi=110)


if __name__ == "__main__":
    main(*sys.argv[1:])
