"""Polar cells: a walk against its closed form, a group that scatters, and one that flocks.

Run as `python examples/polarity.py PICTURE` (`pip install '.[figures]'`). It takes a minute, and
keeps its runs in a folder that is gone afterwards.
"""

import sys
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

from morphosim import (
    BoxWalls,
    Cell,
    Numerics,
    Physics,
    Polarity,
    RunWriter,
    Scene,
    Simulation,
    Sphere,
    load_fields,
    open_run,
)

RADIUS, SPACING, UP = 4.0, 0.5, (0, 0, 1)
SPEED, TURNS = 0.06, 0.02  # µm per unit of time; rotational diffusion, per unit of time
PLATES = BoxWalls(lower=(-60, -60, -4.3), upper=(60, 60, 4.3))


def polarity(align: Mapping[str, float]) -> Polarity:
    """Polarity of cells that crawl in the plane z = 0."""
    return Polarity(
        alpha=SPEED * Physics().tau, diffusion=TURNS, align=align, plane=UP, look_every=2.0
    )


def walks(count: int = 64, end: float = 600.0) -> tuple[np.ndarray, np.ndarray]:
    """Times, and places of cells that are far from each other, (times, cells, 3)."""
    places = 30.0 * np.argwhere(np.ones((8, 8)))[:count]
    cells = [
        Cell(name=f"c{k}", shape=Sphere(center=(x, y, 0), radius=2.5))
        for k, (x, y) in enumerate(places)
    ]
    scene = Scene(
        cells=cells, physics=Physics(terms=[polarity({})]),
        numerics=Numerics(scheme="linearised", seed=1),
    )  # fmt: skip
    simulation, times, found = Simulation(scene), [0.0], []
    found.append(simulation.centroids)
    while simulation.time < end:
        simulation.run(until=simulation.time + 4)
        times.append(simulation.time)
        found.append(simulation.centroids)
    return np.array(times), np.array(found)


def draw_walks(axes: Axes) -> None:
    """Mean-square displacement over all cells and all stretches of a length of time."""
    times, places = walks()
    lags = np.unique(np.geomspace(1, len(times) // 3, 14).astype(int))
    squares = [((places[lag:] - places[:-lag]) ** 2).sum(axis=2).mean() for lag in lags]
    persistence, t = 1 / TURNS, np.geomspace(times[lags[0]], times[lags[-1]], 100)
    x = t / persistence
    axes.loglog(times[lags], squares, "ko", ms=4, label="64 cells, t to 600")
    exact = 2 * (SPEED * persistence) ** 2 * (x - 1 + np.exp(-x))
    axes.loglog(t, exact, color="#0072b2", label=r"$2 v^2 T^2 (t/T - 1 + e^{-t/T})$")
    axes.set(xlabel="in silico time t", ylabel="mean-square displacement, µm²")
    axes.set_title(f"free walk, v = {SPEED:g}, T = {persistence:g}")
    axes.legend(frameon=False)


def group(align: Mapping[str, float], directory: Path) -> None:
    """Run of 19 cells that touch between two plates."""
    rows = np.array([(x + y / 2, y * 3**0.5 / 2) for x in range(-2, 3) for y in range(-2, 3)
                     if abs(x + y) < 3])  # fmt: skip
    cells = [
        Cell(name=f"c{k}", shape=Sphere(center=(*(1.8 * RADIUS * place), 0), radius=RADIUS))
        for k, place in enumerate(rows)
    ]
    scene = Scene(
        cells=cells, confinement=PLATES,
        physics=Physics(sigma=0.3, terms=[polarity(align)]),
        numerics=Numerics(scheme="linearised", seed=2),
    )  # fmt: skip
    Simulation(scene).run(until=300, observers=[RunWriter(directory, 20.0)])


def draw_group(axes: Axes, directory: Path, title: str) -> None:
    """The cells at the end from above, with their directions, and the way that each has come."""
    with open_run(directory) as run:
        places, p = run["centroid"].values[..., :2], run["polarity"].values[-1, :, :2]
        fields = load_fields(run, -1)
    for cell in fields:
        x, y, z = (cell.origin[k] * SPACING + SPACING * np.arange(n)
                   for k, n in enumerate(cell.phi.shape))  # fmt: skip
        axes.contourf(x, y, cell.phi[:, :, np.abs(z).argmin()].T, [0.5, 2], colors=["#cfe3f1"])
        axes.contour(x, y, cell.phi[:, :, np.abs(z).argmin()].T, [0.5], colors=["#0072b2"])
    axes.plot(*places.transpose(2, 0, 1), color="0.5", lw=0.8)
    axes.quiver(*places[-1].T, *p.T, angles="xy", scale_units="xy", scale=1 / 5, width=0.006)
    order = np.linalg.norm(p.mean(axis=0))
    axes.set(aspect="equal", xlabel="x, µm", ylabel="y, µm")
    axes.set_title(f"{title}\n|⟨p⟩| = {order:.2f}")


def main(picture: str) -> None:
    """Draw the figure."""
    figure, axes = plt.subplots(1, 3, figsize=(13, 4.3), layout="constrained")
    draw_walks(axes[0])
    with TemporaryDirectory() as folder:
        for panel, name, align in (
            (axes[1], "away from contacts", {"contacts": 1.0}),
            (axes[2], "as neighbours and as it moves", {"neighbours": 0.9, "velocity": 0.2}),
        ):
            group(align, Path(folder) / name)
            draw_group(panel, Path(folder) / name, name)
    figure.savefig(picture, dpi=110)


if __name__ == "__main__":
    main(sys.argv[1])
