"""Fig. S4 as a scan: the irregularity η = area^(1/2) / volume^(1/3) of AB and P1 against γ.

Run as `python examples/sweep_stiffness.py DIR [picture]`; the scan lies in DIR and goes on there
when it is stopped; the picture needs matplotlib. The egg divides in its shell and the two cells
come to rest, for several surface tensions and two strengths of the volume constraint.
"""

import math
import sys
from dataclasses import replace

import xarray as xr

from morphosim import built_in_scene, sweep

AXES = {"physics.gamma": [0.1, 0.15, 0.25, 0.4, 0.6], "physics.M": [4.0, 8.0]}
BALL = (36 * math.pi) ** (1 / 6)
"""η of a ball, the least there is."""


def draw(eta: xr.DataArray, path: str) -> None:
    """η against γ, a line per cell."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(5, 3.5), layout="constrained")
    for cell, colour in (("AB", "#0b4f8a"), ("P1", "#b3500c")):
        line = eta.sel(cell=cell)
        axes.plot(line["physics.gamma"], line, "o-", color=colour, label=cell)
    axes.axhline(BALL, color="0.6", lw=0.8)
    axes.annotate("a ball", (0.6, BALL), ha="right", va="bottom", color="0.4")
    axes.set(xlabel="surface tension γ", ylabel="irregularity η")
    axes.legend()
    figure.savefig(path, dpi=150)


def main(directory: str, picture: str = "") -> None:
    """Scan, print η and volumes relative to their targets, and draw."""
    egg = built_in_scene("celegans-1-to-8", {"numerics.solver": "band", "numerics.S": 12.0})
    found = sweep(
        replace(egg, stages=egg.stages[:2]), AXES, directory=directory,
        figures={"eta": "irregularity", "volume": "volume", "target": "target_volume"},
    )  # fmt: skip
    print(found["eta"].to_series().unstack("cell").round(4))
    print((found["volume"] / found["target"]).mean("cell").round(3).to_pandas())
    if picture:
        draw(found["eta"].sel({"physics.M": 8.0}), picture)


if __name__ == "__main__":
    main(*sys.argv[1:])
