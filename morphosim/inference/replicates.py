"""Resampling: the best fit is photographed and fitted again, voxels and errors falling anew."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from morphosim.cell_field import CellField
from morphosim.importers.labels.label_image import LabelImage
from morphosim.inference.estimate import Misfit
from morphosim.inference.observation import photographed
from morphosim.inference.search import intervals_of
from morphosim.inference.trial import Frame, Model, Start

Floats = NDArray[np.float64]
SETTLED = 5
"""How often fields of a replicate settle and are moved back."""
DIFFERS = 4.0
"""Of so many face neighbours of a voxel at a surface one has another label, or a little less."""


@dataclass(frozen=True, kw_only=True)
class Replica:
    """What all replicates share: the best fit, and the errors of its images."""

    model: Model
    misfit: Misfit
    frames: Sequence[Frame]
    starts: Sequence[Start]
    vector: Floats
    slopes: Floats
    flips: Sequence[float]


def replicated(replica: Replica, seed: int) -> Floats:
    """(n,) by how much the estimate is off, of images of the best fit itself.

    They lie elsewhere on the voxels, and as many voxels at surfaces have the label of a neighbour
    as differ between the images that were given and those of the best fit.
    """
    random = np.random.default_rng(seed)
    frames, starts = [], []
    for frame, best, share in zip(replica.frames, replica.starts, replica.flips, strict=True):
        shift = random.uniform(-0.5, 0.5, 3) * frame.image.steps
        grid = replace(frame.image, origin=np.asarray(frame.image.origin) + shift)
        image = flipped(photographed(best.fields, replica.model.spacing, grid), share, random)
        seen = Frame.of(frame.time, image, frame.surfaces.names, frame.patches)
        start = replica.model.begun(seen, replica.vector)
        for _ in range(SETTLED):
            start = replica.model.settled(seen, start, replica.vector)
        frames.append(seen)
        starts.append(start)
    missed = [
        replica.model.missed(interval, replica.vector) for interval in intervals_of(frames, starts)
    ]
    off = replica.misfit.weighted(np.concatenate(missed))
    return replica.misfit.gain(replica.slopes) @ off


def mismatch(frame: Frame, fields: Sequence[CellField], spacing: float) -> float:
    """Share of voxels at surfaces whose label differs between an image and that of fields."""
    image = frame.like(fields, spacing)
    at_surface = int(np.count_nonzero(_at_surface(frame.image.labels)))
    return int(np.count_nonzero(image.labels != frame.image.labels)) / at_surface


def _at_surface(labels: NDArray[np.integer]) -> NDArray[np.bool_]:
    """Voxels with a face neighbour of another label."""
    out = np.zeros(labels.shape, bool)
    for axis in range(3):
        for shift in (1, -1):
            out |= labels != np.roll(labels, shift, axis)
    return out


def flipped(image: LabelImage, share: float, random: np.random.Generator) -> LabelImage:
    """Image of which this share of the voxels at surfaces has the label of a face neighbour."""
    labels = image.labels.copy()
    at = np.argwhere(_at_surface(image.labels) & (random.random(labels.shape) < DIFFERS * share))
    axis = random.integers(0, 3, len(at))
    other = at.copy()
    other[np.arange(len(at)), axis] += random.choice([-1, 1], len(at))
    other = np.clip(other, 0, np.array(labels.shape) - 1)
    labels[tuple(at.T)] = image.labels[tuple(other.T)]
    return replace(image, labels=labels)
