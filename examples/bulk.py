"""Bulk tissue in periodic space: what a random packing is like at the faces, and elsewhere.

Run as `python examples/bulk.py OUT.png` (some minutes); needs matplotlib. 125 cells fill a box of
35.2 µm that repeats along x, y and z. They start at random places, and rearrange by a little noise.
"""

import sys
import tempfile
from pathlib import Path

import matplotlib as mpl

mpl.use("agg")
import numpy as np
from matplotlib import pyplot as plt

from morphosim import Cell, Numerics, Physics, RunWriter, Scene, Simulation, Sphere, open_run

LENGTH, COUNT, END = 35.2, 125, 600.0


def apart(places: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Distances of places to the nearest image of another, µm."""
    way = places - place
    return np.linalg.norm(way - LENGTH * np.rint(way / LENGTH), axis=-1)


def bulk(seed: int = 1) -> Scene:
    """Balls at random places, 5.4 µm apart at least, that grow until they fill space."""
    rng, places = np.random.default_rng(seed), np.empty((0, 3))
    while len(places) < COUNT:
        place = rng.uniform(0, LENGTH, 3)
        if (apart(places, place) > 5.4).all():
            places = np.vstack([places, place])
    volume = LENGTH**3 / COUNT
    cells = [
        Cell(name=f"c{k}", shape=Sphere(center=tuple(place), radius=3.2), volume=volume)
        for k, place in enumerate(places)
    ]
    return Scene(
        cells=cells, physics=Physics(sigma=0.3, kappa=0.05), period=(LENGTH,) * 3,
        numerics=Numerics.preset("fast", seed=seed), duration=END, save_every=END / 3,
        save_labels=True,
    )  # fmt: skip


def main(picture: str) -> None:
    """Compute, compare cells at the faces with the others, and draw."""
    figure, axes = plt.subplots(1, 3, figsize=(13, 4), layout="constrained")
    with tempfile.TemporaryDirectory() as folder:
        Simulation(bulk()).run(observers=[RunWriter(Path(folder) / "run", END / 3)])
        with open_run(Path(folder) / "run") as run:
            last = run.isel(time=-1).load()
            labels = run.morpho.labels(END).isel(z=0).values
            g = run.morpho.pair_correlation(END, bins=28, furthest=16.0).load()
    touching = last["contact_area"].values > 0.5
    neighbours, volumes = touching.sum(axis=0), last["volume"].values
    inside = last["centroid"].values % LENGTH
    at_faces = (np.minimum(inside, LENGTH - inside) < 3.5).any(axis=1)
    for name, which in (("at faces", at_faces), ("elsewhere", ~at_faces)):
        error = neighbours[which].std() / np.sqrt(which.sum())
        print(
            f"{which.sum()} cells {name}: {neighbours[which].mean():.2f} ± {error:.2f} neighbours, "
            f"volume {volumes[which].mean():.2f} ± {volumes[which].std():.2f} µm³"
        )
        axes[1].hist(neighbours[which], np.arange(8.5, 21), alpha=0.6, density=True, label=name)
    twice = np.tile(labels, (2, 2)).T
    colours = mpl.colormaps["tab20"](np.arange(COUNT + 1) * 7 % 20)
    colours[0] = 1.0
    axes[0].imshow(colours[twice], origin="lower", extent=(0, 2 * LENGTH, 0, 2 * LENGTH))
    axes[0].axhline(LENGTH, color="black", lw=1)
    axes[0].axvline(LENGTH, color="black", lw=1)
    axes[0].set(title="z = 0, four periods", xlabel="x, µm", ylabel="y, µm")
    axes[1].set(title="neighbours", xlabel="neighbours of a cell", ylabel="share of cells")
    axes[1].legend(frameon=False)
    axes[2].plot(g["distance"], g["g"])
    axes[2].set(title="pair correlation", xlabel="distance of centres, µm", ylabel="g")
    figure.savefig(picture, dpi=110)


if __name__ == "__main__":
    main(*sys.argv[1:])
