"""Depth below the surface of a region given as an image."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from morphosim.provenance import memory

Floats = NDArray[np.float64]
BYTES = 40
"""Memory that a voxel takes: two distances, their indices, a blur."""


@dataclass(frozen=True, slots=True, eq=False)
class Image:
    """Values on a regular grid.

    Attributes
    ----------
    values : (nx, ny, nz)
    origin : (3,) µm, position of the value [0, 0, 0]
    steps : (3,) µm, spacing per axis
    """

    values: NDArray
    origin: Floats
    steps: Floats

    def at(self, x: Floats, y: Floats, z: Floats) -> Floats:
        """Values at points in µm, linear in between, the nearest one beyond the image."""
        from scipy.ndimage import map_coordinates

        coordinates = [
            (p - o) / h for p, o, h in zip((x, y, z), self.origin, self.steps, strict=True)
        ]
        points = np.stack(np.broadcast_arrays(*coordinates))
        values = np.asarray(self.values, np.float64)
        return np.asarray(map_coordinates(values, points, order=1, mode="nearest"))

    def bounds(self, inside: NDArray[np.bool_]) -> tuple[Floats, Floats]:
        """Positions of the outermost voxels that are `inside`."""
        voxels = np.argwhere(inside)
        return self.origin + voxels.min(0) * self.steps, self.origin + voxels.max(0) * self.steps


def _check_memory(shape: NDArray[np.int64], steps: Floats) -> None:
    """Raise ValueError if distances in an image of this shape do not fit into memory."""
    needed = BYTES * float(shape.astype(float).prod())
    if needed > memory():
        message = (
            f"an image of voxels of {steps.tolist()} µm would take {needed / 1e9:.3g} GB of memory "
            f"with what lies around it; there are {memory() / 1e9:.3g} GB. Take coarser voxels"
        )
        raise ValueError(message)


def depth_image(
    mask: NDArray[np.bool_], origin: Floats, steps: Floats, reach: float, smoothing: float = 0.0
) -> Image:
    """Depth below the surface of the voxels that are set, µm, positive inside.

    Far from the surface it is the distance. Within smoothing / 2 of it, it is what a box blur of
    that width gives, smoothing · (blur - 1/2): exact for a plane, and without voxel steps.

    Parameters
    ----------
    mask : (nx, ny, nz) bool, with at least one voxel set
    origin, steps : (3,) µm
    reach : float
        µm around the mask that the result covers.
    smoothing : float
        Width of the blur in µm; 0 gives the plain distance.
    """
    from scipy.ndimage import distance_transform_edt, uniform_filter

    voxels = np.argwhere(mask)
    first, last = voxels.min(0), voxels.max(0) + 1
    window = 2 * np.floor(smoothing / (2 * steps) + 0.25).astype(int) + 1
    pad = int(np.ceil(reach / steps.min())) + int(window.max()) // 2 + 2
    _check_memory(last - first + 2 * pad, steps)
    padded = np.pad(mask[tuple(map(slice, first, last))], pad)
    half = 0.5 * steps.min()
    inside = distance_transform_edt(padded, sampling=steps)
    outside = distance_transform_edt(~padded, sampling=steps)
    depth = np.where(padded, inside - half, half - outside)
    if smoothing > 0:
        width = float(np.mean(window * steps))
        blur = uniform_filter(padded.astype(np.float64), window.tolist(), mode="constant")
        near = np.abs(blur - 0.5) < 0.5 - 1e-9
        far = np.sign(depth) * np.maximum(np.abs(depth), width / 2)
        depth = np.where(near, width * (blur - 0.5), far)
    return Image(depth, origin + (first - pad) * steps, steps)
