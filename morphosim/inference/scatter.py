"""κ from the scatter of cells: how far they are from where cells without noise would be."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from morphosim.importers.labels.label_image import LabelImage
from morphosim.inference.observation import photographed
from morphosim.inference.pool import Pool
from morphosim.inference.trial import Interval, Model

Floats = NDArray[np.float64]
TRIAL = 0.2
"""κ of the trials by which scatter is told in units of κ, in units of the mean γ."""
TRIALS = 8
"""Trials with noise, of each interval."""


def scatter_strength(
    model: Model, intervals: Sequence[Interval], vector: Floats, pool: Pool
) -> tuple[float, float]:
    """κ and its standard deviation.

    The mean square distance of cells in each image from those at the end of a run without noise
    from the image before is as κ²; by how much, runs with a known κ tell. As published, it depends
    on the step δt (`Physics.kappa`): κ is that of the numerics that are given.
    """
    trial = TRIAL * model.unknowns.mean
    items = [(k, vector, 0.0, 0) for k in range(len(intervals))]
    items += [(k, vector, trial, s) for k in range(len(intervals)) for s in range(1, TRIALS + 1)]
    ends = np.array(pool.map(_ends, (model, intervals), items))
    still, noisy = ends[: len(intervals)], ends[len(intervals) :]
    seen = np.array([centres(interval.frame.image) for interval in intervals])
    noisy = noisy.reshape(len(intervals), TRIALS, *noisy.shape[1:])
    square = float(np.mean((noisy - still[:, None]) ** 2))
    off = seen - still
    kappa = trial * float(np.sqrt(np.mean(off**2) / square))
    return kappa, kappa / np.sqrt(2 * off.size)


def _ends(shared: tuple[Model, Sequence[Interval]], item: tuple[int, Floats, float, int]) -> Floats:
    """(N, 3) positions of cells at the end of an interval, as an image of them shows."""
    (model, intervals), (k, vector, kappa, seed) = shared, item
    scene = model.scene.with_physics(kappa=kappa).with_numerics(seed=seed)
    unknowns = replace(model.unknowns, physics=replace(model.unknowns.physics, kappa=kappa))
    moving = replace(model, scene=scene, unknowns=unknowns)
    simulation, _ = moving.over(intervals[k], vector)
    return centres(photographed(simulation.fields, model.spacing, intervals[k].frame.image))


def centres(image: LabelImage) -> Floats:
    """(N, 3) centre of the voxels of each label, µm."""
    from scipy.ndimage import center_of_mass

    labels = np.arange(1, int(image.labels.max()) + 1)
    found = np.array(center_of_mass(image.labels > 0, image.labels, labels))
    return np.asarray(found * image.steps + np.asarray(image.origin))
