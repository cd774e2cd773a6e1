"""A sheet that grows from one cell: how it looks from above, and how many neighbours cells have.

Run as `python examples/epithelium.py RUN PICTURE` on a run of `epithelium`
(`morphosim run epithelium --set stages.0.end.cells=300 -o RUN`, about a minute); needs matplotlib.
"""

import sys

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from xarray import Dataset

from morphosim import open_run

INNER = 0.75
"""Cells within this share of the sheet's radius count: those at the rim have fewer neighbours."""


def neighbours(run: Dataset) -> tuple[np.ndarray, np.ndarray]:
    """Number of neighbours of each cell at the end, and whether it is an inner one."""
    last = run.isel(time=-1)
    alive = last["volume"].notnull().values
    areas = last["contact_area"].values[np.ix_(alive, alive)]
    radius = last["radial_position"].values[alive]
    return (areas > 0).sum(axis=1), radius < INNER * radius.max()


def draw_counts(axes: Axes, counts: np.ndarray) -> None:
    """How many cells have how many neighbours."""
    numbers = np.arange(counts.min(), counts.max() + 1)
    axes.bar(numbers, [(counts == number).mean() for number in numbers], color="#56b4e9")
    axes.axvline(counts.mean(), color="#d55e00")
    axes.set(xlabel="neighbours", ylabel="share of inner cells", title=f"mean {counts.mean():.2f}")


def main(directory: str, picture: str) -> None:
    """Draw the figure."""
    with open_run(directory) as run:
        counts, inner = neighbours(run)
        figure, axes = plt.subplots(1, 4, figsize=(14, 3.6), layout="constrained")
        total = run["volume"].notnull().sum("cell").values
        for ax, wanted in zip(axes, (8, 64, int(total[-1])), strict=False):
            time = float(run["time"][int(np.argmax(total >= wanted))])
            run.morpho.draw(ax, time, view="z", names=False, shell=False)
            ax.set_title(f"{int(total[run.morpho.save_number(time)])} cells, t = {time:.0f}")
        draw_counts(axes[3], counts[inner])
        figure.savefig(picture, dpi=110)


if __name__ == "__main__":
    main(*sys.argv[1:])
