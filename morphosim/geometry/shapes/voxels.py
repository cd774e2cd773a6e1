"""What the shapes given as arrays share: where the array lies."""

from numpy.typing import ArrayLike, NDArray

from morphosim import _validate
from morphosim.geometry.shapes.protocol import Floats
from morphosim.geometry.signed_distance import Image


def voxel_steps(spacing: ArrayLike) -> Floats:
    """(3,) size of a voxel in µm, checked."""
    return _validate.spacing("shape.spacing", spacing)


def placed_image(values: NDArray, origin: ArrayLike, spacing: ArrayLike) -> Image:
    """Image with its place checked."""
    return Image(values, _validate.vector("shape.origin", origin), voxel_steps(spacing))
