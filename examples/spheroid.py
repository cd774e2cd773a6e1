"""A spheroid that grows from one cell: how it looks, how fast, and the pressure inside.

Run as `python examples/spheroid.py RUN PICTURE` on a run of `spheroid`
(`morphosim run spheroid --set stages.0.end.cells=300 -o RUN`, about a minute); needs matplotlib.
"""

import sys

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from xarray import Dataset

from morphosim import open_run

STAGES = (8, 64)
"""Numbers of cells that are drawn, besides those at the end."""


def draw_cells(axes: Axes, run: Dataset, counts: np.ndarray, wanted: int) -> None:
    """The cells at the first save with so many, coloured one by one."""
    time = float(run["time"][int(np.argmax(counts >= wanted))])
    run.morpho.draw(axes, time, view="corner", names=False)
    axes.set_title(f"{int(counts[run.morpho.save_number(time)])} cells, t = {time:.0f}")


def draw_growth(axes: Axes, growth: Dataset, doubling_time: float) -> None:
    """Total target volume against time, and that of growth without hindrance."""
    time, total = growth["time"], growth["target_volume"]
    axes.semilogy(time, total / total[0], "o", ms=3, label="volume")
    axes.semilogy(time, growth["cells"], "s", ms=3, label="cells")
    axes.semilogy(time, 2 ** (time / doubling_time), "k-", lw=1, label="$2^{t/T}$")
    axes.set(xlabel="in silico time", ylabel="in those of the start")
    axes.legend(frameon=False)


def draw_profile(axes: Axes, run: Dataset) -> None:
    """Pressure at the end against the distance from the middle, cell by cell and on average."""
    last, profile = run.isel(time=-1), run.morpho.profile("pressure")
    axes.plot(last["radial_position"], last["pressure"], ".", ms=3, color="0.6")
    axes.plot(profile["radius"], profile["mean"], "o-", color="#cc4477")
    axes.set(xlabel="distance from the middle, µm", ylabel="pressure 1 - v/V", ylim=(0, None))


def main(directory: str, picture: str) -> None:
    """Draw the figure."""
    with open_run(directory) as run:
        growth = run.morpho.growth()
        counts = growth["cells"].values
        figure, axes = plt.subplots(1, 5, figsize=(15, 3.2), layout="constrained")
        for ax, wanted in zip(axes, (*STAGES, int(counts[-1])), strict=False):
            draw_cells(ax, run, counts, wanted)
        draw_growth(axes[3], growth, doubling_time=500.0)
        draw_profile(axes[4], run)
        figure.savefig(picture, dpi=110)


if __name__ == "__main__":
    main(*sys.argv[1:])
