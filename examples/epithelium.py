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


def draw_neighbours(axes: Axes, run: Dataset) -> None:
    """How many cells away from the rim have how many neighbours at the end."""
    found = run.morpho.neighbour_distribution(inner=True)
    axes.bar(found["neighbours"], found["share"], color="#56b4e9")
    axes.axvline(found["mean"], color="#d55e00")
    axes.set(xlabel="neighbours", ylabel="share of inner cells", xlim=(2, None))
    axes.set_title(f"mean {found['mean']:.2f}")


def main(directory: str, picture: str) -> None:
    """Draw the figure."""
    with open_run(directory) as run:
        figure, axes = plt.subplots(1, 4, figsize=(14, 3.6), layout="constrained")
        total = run.morpho.growth()["cells"].values
        for ax, wanted in zip(axes, (8, 64, int(total[-1])), strict=False):
            time = float(run["time"][int(np.argmax(total >= wanted))])
            run.morpho.draw(ax, time, view="z", names=False, shell=False)
            ax.set_title(f"{int(total[run.morpho.save_number(time)])} cells, t = {time:.0f}")
        draw_neighbours(axes[3], run)
        figure.savefig(picture, dpi=110)


if __name__ == "__main__":
    main(*sys.argv[1:])
