"""How well shapes come through: a label image in, a scene simulated, a label image out.

Run as `python benchmarks/segmentation.py`; about two minutes. The eight-cell embryo at t = 1000 is
photographed with voxels of several sizes and noise-free; each image becomes a scene, which
is run for 20 units of time and photographed on the same voxels. The table has the intersection over
union (IoU) of each cell's voxels before and after.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from _common import arguments, report
from scipy.ndimage import map_coordinates

from morphosim import LabelImage, Scene, Simulation, built_in_scene, import_labels
from morphosim.cell_field import CellField

VOXELS = ((0.5, 0.5, 0.5), (0.25, 0.25, 1.0), (0.2, 0.2, 0.2), (0.2, 0.2, 0.6))
EMBRYO = built_in_scene("celegans-8")
SPACING = EMBRYO.numerics.spacing
LOW, HIGH = np.zeros(3), np.array([60.0, 40.0, 30.0])


def photographed(fields: Sequence[CellField], voxel: Sequence[float]) -> np.ndarray:
    """Label image of the embryo's domain: the cell of largest φ where that exceeds 1/2."""
    axes = [np.arange(a, b, step) for a, b, step in zip(LOW, HIGH, voxel, strict=True)]
    labels = np.zeros([len(a) for a in axes], np.uint8)
    largest = np.full(labels.shape, 0.5)
    for label, field in enumerate(fields, 1):
        last = field.origin + np.array(field.phi.shape) - 1
        part = tuple(
            slice(*np.searchsorted(a, np.array([lo, hi]) * SPACING))
            for a, lo, hi in zip(axes, field.origin, last, strict=True)
        )
        places = [a[p] / SPACING - o for a, p, o in zip(axes, part, field.origin, strict=True)]
        points = np.stack(np.meshgrid(*places, indexing="ij"))
        phi = map_coordinates(np.asarray(field.phi, float), points, order=1)
        labels[part][phi > largest[part]] = label
        np.maximum(largest[part], phi, out=largest[part])
    return labels


def row(labels: np.ndarray, voxel: Sequence[float], volumes: str, time: float) -> dict[str, Any]:
    """One line of the table."""
    image = LabelImage(labels=labels, spacing=voxel)
    names = dict(enumerate(EMBRYO.names, 1))
    scene: Scene = import_labels(
        image, names=names, volumes=volumes, physics=EMBRYO.physics,
        confinement=EMBRYO.confinement,
    )  # fmt: skip
    simulation = Simulation(scene)
    simulation.run(until=time)
    after = photographed(simulation.fields, voxel)
    found = {
        name: np.count_nonzero((labels == k) & (after == k))
        / np.count_nonzero((labels == k) | (after == k))
        for k, name in names.items()
    }
    size = " x ".join(f"{step:g}" for step in voxel)
    return {"voxel, um": size, "volumes": volumes, "least": min(found.values())} | found


def main() -> None:
    """Measure and report."""
    options = arguments(__doc__, start=1000.0, time=20.0)
    embryo = Simulation(EMBRYO)
    embryo.run(until=options.start)
    images = {voxel: photographed(embryo.fields, voxel) for voxel in VOXELS}
    rows = [
        row(labels, voxel, volumes, options.time)
        for volumes in ("surface", "voxels")
        for voxel, labels in images.items()
    ]
    report(rows, options.json)


if __name__ == "__main__":
    main()
