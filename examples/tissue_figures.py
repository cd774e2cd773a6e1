"""Figures of a tissue: growth, pair correlation, neighbours, profiles and clones.

Run as `python examples/tissue_figures.py RUN PICTURE` on a run of `spheroid`
(`morphosim run spheroid --set stages.0.end.cells=300 -o RUN`, about a minute); needs matplotlib.
"""

import sys

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from xarray import Dataset

from morphosim import open_run

KNOWN = {"Kelvin": 14.0, "random foam": 13.7}
"""Mean numbers of neighbours of packings in space."""
ANCESTORS = 16
"""Clones are of the cells of the first save that has so many."""


def draw_growth(axes: Axes, run: Dataset) -> None:
    """Number of cells and their volume."""
    growth = run.morpho.growth()
    axes.semilogy(growth["time"], growth["cells"], "s", ms=3, label="cells")
    axes.semilogy(growth["time"], growth["volume"] / growth["volume"][0], "o", ms=3, label="volume")
    axes.set(xlabel="in silico time", ylabel="in those of the start")
    axes.legend(frameon=False)


def draw_pair_correlation(axes: Axes, run: Dataset) -> None:
    """Pair correlation at the end, with its error by chance."""
    found = run.morpho.pair_correlation(bins=35)
    error = found["g"] / np.sqrt(found["pairs"].where(found["pairs"] > 0))
    axes.axhline(1, color="0.7", lw=1)
    axes.errorbar(found["distance"], found["g"], error, color="#0072b2", lw=1, elinewidth=0.7)
    axes.set(xlabel="distance of centres, µm", ylabel="pair correlation g", ylim=(0, None))


def draw_neighbours(axes: Axes, run: Dataset) -> None:
    """Numbers of neighbours at the end of all cells, and of those inside."""
    everyone = run.morpho.neighbour_distribution()
    inner = run.morpho.neighbour_distribution(inner=True)
    axes.step(
        everyone["neighbours"], everyone["share"], where="mid", color="0.5", label="all cells"
    )
    axes.bar(inner["neighbours"], inner["share"], color="#56b4e9", label="inner")
    for (name, value), style in zip(KNOWN.items(), (":", "--"), strict=True):
        axes.axvline(value, color="k", lw=1, ls=style, label=f"{name}, {value:g}")
    axes.set(xlabel="neighbours", ylabel="share of cells", xlim=(2, None), xticks=range(4, 20, 4))
    axes.set_title(f"mean of inner cells {inner['mean']:.2f}")
    axes.legend(frameon=False, fontsize=7, loc="upper left")


def draw_profile(axes: Axes, run: Dataset, name: str, colour: str) -> None:
    """Mean of a variable at the end by depth, and its standard deviation."""
    found = run.morpho.profile(name, against="depth", bins=7)
    axes.errorbar(found["depth"], found["mean"], found["std"], fmt="o-", ms=3, color=colour)
    axes.set(xlabel="depth below the surface, µm", ylabel=name)


def draw_clones(axes: Axes, run: Dataset) -> None:
    """Size of each clone against time, from a time on."""
    counts = run.morpho.growth()["cells"]
    since = float(counts["time"][int(np.argmax(counts.values >= ANCESTORS))])
    found = run.morpho.clones(counts["time"][counts["time"] >= since], since=since)
    axes.semilogy(found["time"], found["cells"], lw=1)
    axes.set(xlabel="in silico time", ylabel="cells of a clone")
    whole = int((found["pieces"][-1] == 1).sum())
    axes.set_title(f"{whole} of {found.sizes['clone']} clones in one piece")


def main(directory: str, picture: str) -> None:
    """Draw the figure."""
    with open_run(directory) as run:
        figure, axes = plt.subplots(2, 3, figsize=(11, 6.2), layout="constrained")
        draw_growth(axes[0, 0], run)
        draw_pair_correlation(axes[0, 1], run)
        draw_neighbours(axes[0, 2], run)
        draw_profile(axes[1, 0], run, "pressure", "#cc4477")
        draw_profile(axes[1, 1], run, "age", "#009e73")
        draw_clones(axes[1, 2], run)
        figure.savefig(picture, dpi=110)


if __name__ == "__main__":
    main(*sys.argv[1:])
