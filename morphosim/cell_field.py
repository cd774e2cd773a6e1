"""The field of one cell in its box, as simulations give it and runs keep it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from morphosim._shown import short_repr


@dataclass(frozen=True, slots=True)
class CellField:
    """The field of one cell in its box.

    Attributes
    ----------
    name : str
    origin : (3,) int64
        Lattice position of the first value; times the spacing it is a position in µm.
    phi : (nx, ny, nz) array
    """

    name: str
    origin: NDArray[np.int64]
    phi: NDArray

    __repr__ = short_repr


def centroid(cell: CellField, spacing: float) -> NDArray[np.float64]:
    """∫ r φ / ∫ φ of one field, µm."""
    phi = np.asarray(cell.phi, np.float64)
    total = phi.sum()
    means = [
        (phi.sum(axis=others) @ np.arange(n)) / total
        for others, n in zip(((1, 2), (0, 2), (0, 1)), phi.shape, strict=True)
    ]
    return np.asarray((np.array(means) + cell.origin) * spacing)
