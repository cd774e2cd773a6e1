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


def draw_growth(axes: Axes, run: Dataset, counts: np.ndarray, doubling_time: float) -> None:
    """Total target volume against time, and that of growth without hindrance."""
    time, total = run["time"].values, run["target_volume"].sum("cell").values
    axes.semilogy(time, total / total[0], "o", ms=3, label="volume")
    axes.semilogy(time, counts, "s", ms=3, label="cells")
    axes.semilogy(time, 2 ** (time / doubling_time), "k-", lw=1, label="$2^{t/T}$")
    axes.set(xlabel="in silico time", ylabel="in those of the start")
    axes.legend(frameon=False)


def draw_profiles(axes: Axes, run: Dataset) -> None:
    """Pressure at the end against the distance from the middle, cell by cell and on average."""
    last = run.isel(time=-1).dropna("cell", subset=["volume"])
    radius, pressure = last["radial_position"].values, last["pressure"].values
    edges = np.linspace(0, radius.max() * (1 + 1e-9), 8)
    place = np.digitize(radius, edges)
    known = [k for k in range(1, len(edges)) if (place == k).any()]
    axes.plot(radius, pressure, ".", ms=3, color="0.6")
    axes.plot(
        [radius[place == k].mean() for k in known], [pressure[place == k].mean() for k in known],
        "o-", color="#cc4477",
    )  # fmt: skip
    axes.set(xlabel="distance from the middle, µm", ylabel="pressure 1 - v/V", ylim=(0, None))


def main(directory: str, picture: str) -> None:
    """Draw the figure."""
    with open_run(directory) as run:
        counts = run["volume"].notnull().sum("cell").values
        figure, axes = plt.subplots(1, 5, figsize=(15, 3.2), layout="constrained")
        for ax, wanted in zip(axes, (*STAGES, int(counts[-1])), strict=False):
            draw_cells(ax, run, counts, wanted)
        draw_growth(axes[3], run, counts, doubling_time=500.0)
        draw_profiles(axes[4], run)
        figure.savefig(picture, dpi=110)


if __name__ == "__main__":
    main(*sys.argv[1:])
