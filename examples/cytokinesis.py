"""A contractile ring draws in the furrow of a cell that divides.

Run as `python examples/cytokinesis.py OUT.png` (a minute); needs matplotlib. A free cell divides
into shares of 0.6 and 0.4, cut at once or by rings of several strengths. Above, the section of the
cell in the course of time; below, the radius of its neck.
"""

import sys
from pathlib import Path

import matplotlib as mpl

mpl.use("agg")
import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes

from morphosim import Cell, ContractileRing, Numerics, Physics, Scene, Simulation, Sphere

RADIUS, SHARE, OVER = 5.0, 0.6, 300.0
SHOWN = 8.0
"""Strength χ of the ring whose course is drawn."""
STRENGTHS = (2.0, 5.0, SHOWN, 12.0)
TIMES = (0.0, 20.0, 45.0, 60.0, 90.0)
COLOURS = ("#4e79a7", "#f28e2b")


def dividing(strength: float) -> Simulation:
    """A cell at rest that begins to divide."""
    cell = Cell(name="mother", shape=Sphere(center=(0, 0, 0), radius=RADIUS))
    ring = ContractileRing(strength=strength)
    scene = Scene(
        cells=[cell], physics=Physics(terms=[ring]), numerics=Numerics.preset("fast"), duration=OVER
    )
    simulation = Simulation(scene)
    simulation.divide("mother", ("first", "second"), axis=(-1, 0, 0), fraction=SHARE, over=OVER)
    return simulation


def section(ax: Axes, simulation: Simulation) -> None:
    """Outlines of the cells in the plane z = 0."""
    for field, colour in zip(simulation.fields, COLOURS, strict=False):
        x, y = (
            (first + np.arange(n)) * simulation.spacing
            for first, n in zip(field.origin[:2], field.phi.shape[:2], strict=True)
        )
        middle = field.phi[:, :, -int(field.origin[2])]
        ax.contourf(x, y, middle.T, levels=[0.5, 2], colors=[colour], alpha=0.3)
        ax.contour(x, y, middle.T, levels=[0.5], colors=[colour])
    ax.set_title(f"t = {simulation.time:.0f}")
    ax.set_aspect("equal")
    ax.set(xlim=(-9, 9), ylim=(-6, 6), xticks=[], yticks=[])


def neck(simulation: Simulation) -> float:
    """Radius of the least cross-section near the middle, µm; 0 when it is cut."""
    if not simulation.dividing:
        return 0.0
    (field,) = simulation.fields
    areas = np.maximum(field.phi, 0).sum(axis=(1, 2)) * simulation.spacing**2
    places = (field.origin[0] + np.arange(len(areas))) * simulation.spacing
    near = np.abs(places - simulation.centroids[0, 0]) < 1.5
    return float(np.sqrt(areas[near].min() / np.pi))


def main(picture: str) -> None:
    """Compute all and draw them."""
    figure = plt.figure(figsize=(11, 5.4), layout="constrained")
    grid = figure.add_gridspec(2, len(TIMES), height_ratios=[1, 1.3])
    below = figure.add_subplot(grid[1, :])
    for strength in STRENGTHS:
        simulation, times, radii = dividing(strength), [], []
        frames = dict(zip(TIMES, range(len(TIMES)), strict=True)) if strength == SHOWN else {}
        for time in sorted({*TIMES, *np.arange(2.0, OVER, 2.0)}):
            simulation.run(until=time)
            times.append(simulation.time)
            radii.append(neck(simulation))
            if time in frames:
                section(figure.add_subplot(grid[0, frames[time]]), simulation)
        below.plot(times, radii, label=f"χ = {strength:g}")
        closed = next((t for t, r in zip(times, radii, strict=True) if r == 0), None)
        print(f"χ = {strength:g}: " + (f"cut at t = {closed:g}" if closed else "not closed"))
    below.plot([0, 0], [radii[0], 0], "k--", label="cut at once")
    below.set(xlabel="time", ylabel="radius of the neck, µm", ylim=(0, None))
    below.legend()
    figure.savefig(picture, dpi=110)


if __name__ == "__main__":
    main(str(Path(sys.argv[1])))
