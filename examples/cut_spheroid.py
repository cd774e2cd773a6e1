"""A tissue cut open, coloured by two figures of its cells.

Run as `python examples/cut_spheroid.py DIR OUT.png`, where DIR is a run of the scene `spheroid`:
`morphosim run spheroid --set stages.0.end.cells=10000 -o DIR`.
"""

import sys

import matplotlib as mpl

mpl.use("agg")
from matplotlib import pyplot as plt
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.ticker import MaxNLocator

from morphosim import open_run

TITLES = {"pressure": "pressure 1 − v/V", "generation": "generation"}


def main(directory: str, picture: str) -> None:
    """Draw both halves beside each other, with their colour bars."""
    figure, axes = plt.subplots(1, 2, figsize=(9.0, 5.0))
    figure.subplots_adjust(0.01, 0.14, 0.99, 0.99, wspace=0.02)
    with open_run(directory) as run:
        for ax, (by, title) in zip(axes, TITLES.items(), strict=True):
            run.morpho.draw(ax, view="corner", by=by, cut="z", names=False, axes=False)
            low, high = float(run[by].min()), float(run[by].max())  # of all saves, as the colours
            bar = ScalarMappable(Normalize(low, high), "viridis")
            half = ax.get_position()
            place = (half.x0 + 0.1 * half.width, 0.1, 0.8 * half.width, 0.025)
            marks = MaxNLocator(5, integer=by == "generation")
            room = figure.add_axes(place)
            figure.colorbar(bar, cax=room, orientation="horizontal", label=title, ticks=marks)
    figure.savefig(picture, dpi=110)


if __name__ == "__main__":
    main(*sys.argv[1:])
