"""Pictures of what the benchmarks measure."""

from collections.abc import Callable
from pathlib import Path

import matplotlib as mpl
import numpy as np
import xarray as xr

mpl.use("Agg")
import matplotlib.pyplot as plt

COLORS = (
    "#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00", "#999999", "#000000",
)  # fmt: skip
"""Okabe and Ito's palette, which colour-blind readers can tell apart."""
MARKERS = "os^Dvp<>PX*hd"


def pareto_picture(
    data: xr.Dataset, pareto: Callable[[np.ndarray, np.ndarray], np.ndarray], path: Path
) -> None:
    """Error against cost on the embryo, variants by knob, with the Pareto front."""
    cost = data["cost"].values
    error = data["error"].sel(place="embryo t=480", measure="centroid_rms_nm").values
    knobs = data["knob"].values.astype(str)
    figure, axes = plt.subplots(figsize=(10, 6.5), layout="constrained")
    front = pareto(cost, error)
    order = np.argsort(cost[front])
    axes.plot(
        cost[front][order], error[front][order], "-", color="0.6", lw=6, alpha=0.5, zorder=1,
        solid_capstyle="round", label="Pareto front",
    )  # fmt: skip
    shown = [k for k in dict.fromkeys(knobs) if k != "preset"]
    for k, knob in enumerate(shown):
        chosen = knobs == knob
        axes.plot(
            cost[chosen], error[chosen], MARKERS[k % len(MARKERS)], ms=7, label=knob,
            color=COLORS[k % len(COLORS)], alpha=0.85, mec="white", mew=0.5,
        )  # fmt: skip
    for name in data["variant"].values[knobs == "preset"]:
        x = float(data["cost"].sel(variant=name))
        y = float(error[list(data["variant"].values).index(name)])
        axes.plot(x, y, "o", ms=17, mfc="none", mec="black", mew=2)
        axes.annotate(
            str(name),
            (x, y),
            xytext=(14, 12),
            textcoords="offset points",
            fontsize=12,
            weight="bold",
        )
    axes.set(
        xscale="log", yscale="log", xlabel="time per in silico time, relative to standard",
        ylabel="centroid error of the eight-cell embryo\nat t = 480, root mean square, nm",
    )  # fmt: skip
    axes.grid(which="both", alpha=0.2)
    axes.legend(fontsize=9, ncols=2, loc="upper right")
    figure.savefig(path, dpi=110)
    plt.close(figure)


def stability_picture(data: xr.Dataset, path: Path) -> None:
    pass


def limits_picture(data: xr.Dataset, path: Path) -> None:
    pass
