"""Two types of cells, mixed at random, that sort: cuts through their middle, and how far they are.

Run as `python examples/sorting.py RUN PICTURE` on a run of `sorting`
(`morphosim run sorting -o RUN`); needs matplotlib.
"""

import sys

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from xarray import Dataset

from morphosim import open_run

COLOURS = {"A": "#cc4477", "B": "#56b4e9"}


def draw_cut(axes: Axes, run: Dataset, save: int) -> None:
    """The half behind the middle, coloured by type."""
    time = float(run["time"][save])
    run.morpho.draw(axes, time, view="z", by="type", colours=COLOURS, cut="z", names=False)
    axes.set_title(f"t = {time:.0f}")


def draw_unlike(axes: Axes, run: Dataset) -> None:
    """Share of the contacts that are between types, and that of cells mixed at random."""
    counts = np.array([int((run["type"][0] == kind).sum()) for kind in COLOURS])
    mixed = 1 - (counts * (counts - 1)).sum() / (counts.sum() * (counts.sum() - 1))
    axes.plot(run["time"], 1 - run["sorting_index"], "ko-", ms=3)
    axes.axhline(mixed, color="0.6", ls="--", label="mixed at random")
    axes.set(xlabel="in silico time", ylabel="share of unlike contacts", ylim=(0, None))
    axes.legend(frameon=False, loc="lower left")


def draw_places(axes: Axes, run: Dataset) -> None:
    """Distance of each type from the middle of all cells, on average."""
    away = run["centroid"] - run["centroid"].mean("cell")
    distance = np.sqrt((away**2).sum("axis"))
    for kind, colour in COLOURS.items():
        radius = distance.where(run["type"] == kind).mean("cell")
        axes.plot(run["time"], radius, "o-", ms=3, color=colour, label=kind)
    axes.set(xlabel="in silico time", ylabel="distance from the middle, µm")
    axes.legend(frameon=False)


def main(directory: str, picture: str) -> None:
    """Draw the figure."""
    with open_run(directory) as run:
        figure, axes = plt.subplots(1, 4, figsize=(14, 3.6), layout="constrained")
        draw_cut(axes[0], run, 0)
        draw_cut(axes[1], run, run.sizes["time"] - 1)
        draw_unlike(axes[2], run)
        draw_places(axes[3], run)
        figure.savefig(picture, dpi=110)


if __name__ == "__main__":
    main(*sys.argv[1:])
