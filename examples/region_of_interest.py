"""A region of interest in a segmented embryo (paper §4): its cells move, the others are boundary.

Run as `python examples/region_of_interest.py`: about a minute. The segmented image is made here,
from a short run of the built-in eight-cell embryo; put the path of your own in its place.
"""

from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter

import numpy as np
import tifffile

from morphosim import Scene, Simulation, built_in_scene
from morphosim.labelfile import read_labels
from morphosim.labelimage import LabelImage
from morphosim.labels import label_image
from morphosim.segmentation import import_labels

REGION = ("ABpl", "E", "MS")
TIME = 100.0  # in silico, both of the run that makes the image and of those that start from it

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


def advance(scene: Scene) -> tuple[Simulation, float]:
    """The scene at TIME, and milliseconds per step."""
    simulation = Simulation(scene)
    simulation.step()  # compiles what is not in the cache
    start, before = perf_counter(), simulation.engine.steps
    simulation.run(until=TIME)
    return simulation, 1e3 * (perf_counter() - start) / (simulation.engine.steps - before)


names = dict(enumerate(embryo.names, start=1))
options = {
    "names": names, "physics": embryo.physics, "confinement": embryo.confinement,
    "volumes": "surface",
}  # fmt: skip
with TemporaryDirectory() as folder:
    image = make_image(folder)
start = Simulation(import_labels(image, **options)).centroids
free, free_time = advance(import_labels(image, **options))
region, region_time = advance(import_labels(image, active=REGION, **options))

print(f"all {len(names)} cells free:         {free_time:6.1f} ms per step")
print(f"only {', '.join(REGION)} free: {region_time:6.1f} ms per step")
print(f"after {TIME:g} more units of time, cell: moved if all are free; region alone differs by")
for name in REGION:
    k = free.names.index(name)
    moved = np.linalg.norm(free.centroids[k] - start[k])
    apart = np.linalg.norm(region.centroids[k] - free.centroids[k])
    print(f"  {name:5} {moved:6.3f} um {apart:6.3f} um")
