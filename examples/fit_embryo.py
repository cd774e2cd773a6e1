"""Tensions and attractions of the eight-cell embryo, from one image of it.

Run as `python examples/fit_embryo.py OUTPUT`; it takes some ten minutes on two cores. The embryo is
run, photographed on voxels of 0.5 µm, and fitted by itself: ABpl and E turn out not to attract each
other. A fit in which all attractions but those of sisters are alike leaves more over where they
touch.
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import xarray as xr

from morphosim import Attraction, LabelImage, Scene, Simulation, built_in_scene, fit, label_image

TIME = 800.0
"""*In silico* time of the image: cells have found their places, and creep by 1 nm per unit."""
WEAK = ("ABpl", "E")


def photograph(scene: Scene) -> tuple[LabelImage, dict[int, str]]:
    """Label image of the embryo, and the names of its labels."""
    simulation = Simulation(scene)
    simulation.run(until=TIME)
    fields = simulation.fields
    origin, labels = label_image(fields, filled=True)
    image = LabelImage(
        labels=np.pad(labels, 4), spacing=simulation.spacing,
        origin=(origin - 4) * simulation.spacing,
    )  # fmt: skip
    return image, {k: field.name for k, field in enumerate(fields, start=1)}


def known(scene: Scene, sigma: float = 0.5) -> Scene:
    """What the fit is given: the scene, without what it says of attractions."""
    return replace(scene, physics=replace(scene.physics, sigma=Attraction(default=sigma)))


def alike(scene: Scene) -> Scene:
    """The wrong model: ABpl and E attract each other as all others do."""
    pairs = dict(scene.physics.attraction.pairs)
    del pairs[WEAK]
    return replace(
        scene, physics=replace(scene.physics, sigma=Attraction(default=0.5, pairs=pairs))
    )


def main(output: str) -> None:
    """Photograph, fit with all attractions unknown, and with the wrong model."""
    scene = built_in_scene("celegans-8")
    image, names = photograph(scene)
    found = fit(image, scene=known(scene), names=names, directory=Path(output) / "motif")
    table = xr.Dataset({name: found[name] for name in ("estimate", "sd", "told")}).to_dataframe()
    print(table.to_string(float_format="{:.3f}".format))
    weak = found.sel(unknown="sigma ABpl-E")
    print(f"ABpl-E is {float((0.5 - weak.estimate) / weak.sd):.0f} standard deviations below 0.5")
    wrong = fit(
        image, scene=alike(scene), names=names, sigma=None, directory=Path(output) / "wrong"
    )
    for name, answer in (("all unknown", found), ("ABpl-E like others", wrong)):
        left = float(answer["contact_residual"].sel(contact="ABpl-E"))
        print(f"{name}: {left:.3f} µm are left over where ABpl and E touch")


if __name__ == "__main__":
    main(*sys.argv[1:])
