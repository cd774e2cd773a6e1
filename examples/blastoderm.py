"""A blastoderm of Drosophila: the egg from outside and cut open, and how its cells are packed.

Run as `python examples/blastoderm.py RUN PICTURE [TIME]` on a run of `blastoderm`
(`morphosim run blastoderm --until 100 --save-every 100 -o RUN`, some minutes); needs matplotlib and
PyVista.
"""

import sys

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

from morphosim import label_image, load_fields, open_run

SHELL, YOLK = np.array([250.0, 90.0, 90.0]), np.array([220.0, 60.0, 60.0])
"""Semi-axes of the shell and of the yolk in the scene, µm."""


def labels_at(low: np.ndarray, image: np.ndarray, h: float, depth: float) -> np.ndarray:
    """Which cell is where on the ellipsoid at a share of the way from shell to yolk.

    Parameters
    ----------
    low, image : label image, as of `label_image`
    h : lattice spacing, µm

    Returns
    -------
    (along, around) int, by two angles; 0 is no cell
    """
    a, b, c = (1 - depth) * SHELL + depth * YOLK
    along, around = np.linspace(0, np.pi, 1200)[1:-1, None], np.linspace(0, 2 * np.pi, 1600)
    x, y, z = a * np.cos(along), b * np.sin(along) * np.cos(around), np.sin(along) * np.sin(around)
    places = [np.rint(p / h).astype(int) - o for p, o in zip((x, y, c * z), low, strict=True)]
    return np.asarray(image[tuple(places)])


def neighbour_counts(labels: np.ndarray) -> np.ndarray:
    """Number of neighbours of each cell that a map has, which closes around."""
    sides = [(labels, np.roll(labels, 1, axis=1)), (labels[1:], labels[:-1])]
    one, other = (np.concatenate([side[k].ravel() for side in sides]) for k in (0, 1))
    touch = (one != other) & (one > 0) & (other > 0)
    pairs = np.sort(np.stack([one[touch], other[touch]]), axis=0)
    counts = np.bincount(np.unique(pairs, axis=1).ravel())
    return np.asarray(counts[counts > 0])


def draw_counts(axes: Axes, counts: dict[str, np.ndarray]) -> None:
    """How many cells have how many neighbours, at several depths."""
    for name, numbers in counts.items():
        share = np.bincount(numbers, minlength=10)[:10] / len(numbers)
        axes.plot(share, "o-", label=f"{name}: {len(numbers)} cells, mean {numbers.mean():.2f}")
    axes.set(xlim=(2.5, 9.5), ylim=(0, 1.05), xlabel="neighbours", ylabel="share of cells")
    axes.legend(frameon=False, loc="upper center")


def main(directory: str, picture: str, time: str | None = None) -> None:
    """Draw the figure."""
    with open_run(directory) as run:
        save = run.morpho.save_number(None if time is None else float(time))
        when = float(run["time"][save])
        figure, axes = plt.subplots(
            1, 3, figsize=(15, 3.4), width_ratios=(2, 2, 1.4), layout="constrained"
        )
        low, image = label_image(load_fields(run, save), filled=True)
        h = float(run.attrs["spacing_um"])
        depths = {"near the shell": 0.15, "half way": 0.5, "near the yolk": 0.85}
        draw_counts(axes[2], {
            name: neighbour_counts(labels_at(low, image, h, depth))
            for name, depth in depths.items()
        })  # fmt: skip
        run.morpho.draw(axes[0], when, view="z", names=False, shell=False)
        run.morpho.draw(axes[1], when, view="z", names=False, shell=False, cut="z")
        axes[0].set_title(f"{run.sizes['cell']} cells, t = {when:.0f}")
        figure.savefig(picture, dpi=110)


if __name__ == "__main__":
    main(*sys.argv[1:])
