"""A region of interest in a segmented embryo (paper §4): its cells move, the others are boundary.

Run as `python examples/region_of_interest.py`: about a minute. The segmented image is made here,
from a short run of the built-in eight-cell embryo; put the path of your own in its place.
"""

from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter

import numpy as np
import tifffile

from morphosim import (
    LabelImage,
    Scene,
    Simulation,
    built_in_scene,
    import_labels,
    label_image,
    read_labels,
    relaxed,
)

REGION = ("ABpl", "E", "MS")
TIME = 100.0  # in silico, of the run that makes the image and of those that start from it

embryo = built_in_scene("celegans-8")
spacing = embryo.numerics.spacing


def make_image(folder: str) -> LabelImage:
    """Label image of the embryo after a short run, written as TIFF and read again."""
    simulation = Simulation(embryo)
    simulation.run(until=TIME)
    origin, labels = label_image(simulation.fields)
    path = Path(folder) / "embryo.tif"
    tifffile.imwrite(path, labels.T.astype(np.uint8), photometric="minisblack")
    print(f"embryo at t = {TIME:g} as a label image of {' x '.join(map(str, labels.shape))} voxels")
    return read_labels(path, spacing=spacing, origin=origin * spacing)


def make_scene(image: LabelImage, active: tuple[str, ...] | None = None) -> Scene:
    """The embryo as it was segmented, in its shell."""
    return import_labels(
        image, names=dict(enumerate(embryo.names, start=1)), active=active,
        physics=embryo.physics, confinement=embryo.confinement,
    )  # fmt: skip


def advance(scene: Scene) -> tuple[dict[str, np.ndarray], float]:
    """Where cells are at TIME, and milliseconds per step."""
    simulation = Simulation(scene)
    simulation.step()  # compiles what is not in the cache
    start, before = perf_counter(), simulation.engine.steps
    simulation.run(until=TIME)
    took = 1e3 * (perf_counter() - start) / (simulation.engine.steps - before)
    return dict(zip(simulation.names, simulation.centroids, strict=True)), took


with TemporaryDirectory() as folder:
    image = make_image(folder)
everything, region = relaxed(make_scene(image)), make_scene(image, active=REGION)
start = dict(zip(embryo.names, Simulation(everything).centroids, strict=True))
free, free_time = advance(everything)
part, part_time = advance(relaxed(region))
as_measured, _ = advance(region)

print(f"all {len(start)} cells are stepped: {free_time:.1f} ms per step")
print(f"only {', '.join(REGION)} are stepped: {part_time:.1f} ms per step")
print(f"centroids after {TIME:g} units of time, um")
print(f"{'':6}{'moved':>8}{'region off by':>16}{'and not relaxed':>18}")
for name in REGION:
    moved, off, rough = (
        np.linalg.norm(free[name] - other[name]) for other in (start, part, as_measured)
    )
    print(f"{name:6}{moved:8.3f}{off:16.3f}{rough:18.3f}")
