"""Surface of walls, to be drawn."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from morphosim.geometry.confinement.protocol import Confinement

POINTS = 60
"""Points along the longest side."""


def wall_surface(
    confinement: Confinement, points: int = POINTS
) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
    """Triangle mesh of a confinement, where its depth is 0.

    Returns
    -------
    vertices (V, 3) in µm, and faces (F, 3), counterclockwise as seen from outside
    """
    from skimage.measure import marching_cubes

    low, high = confinement.bounds()
    step = float((high - low).max()) / points
    axes = [np.arange(a - 2 * step, b + 2.5 * step, step) for a, b in zip(low, high, strict=True)]
    depth: Any = confinement.depth(*np.meshgrid(*axes, indexing="ij", sparse=True))
    vertices, faces, _, _ = marching_cubes(np.asarray(depth, np.float32), 0.0)
    origin = np.array([axis[0] for axis in axes])
    return (vertices * step + origin).astype(np.float32), np.asarray(faces[:, ::-1], np.int32)
