"""Furrows: what is known of cells that are dividing, until they are cut."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from morphosim._shown import short_repr
from morphosim.cell_field import CellField

LOOK = 1.0
"""*In silico* time between two looks at where the plane of a furrow lies."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Furrow:
    """A division under way.

    Attributes
    ----------
    daughters : (str, str) or None
        Their names; None if they are to be numbered.
    axis : (3,) of length 1, from the second daughter to the first
    fraction : float
        Share of the volume that the first daughter is to get.
    types, volumes : of the daughters, as `Simulation.divide` takes them
    until : int
        Tick at which the cell is cut at the latest.
    height : float
        The plane of the furrow is axis·r = height, µm.
    """

    daughters: tuple[str, str] | None
    axis: tuple[float, float, float]
    fraction: float
    types: tuple[str, str] | None
    volumes: tuple[float, float] | None
    until: int
    height: float = 0.0

    __repr__ = short_repr

    @property
    def says(self) -> tuple[str, ...]:
        """What it says of the daughters; what it does not follows when the cell is cut."""
        said = ("daughters", "types", "volumes")
        return tuple(what for what in said if getattr(self, what) is not None)

    @property
    def table(self) -> dict[str, Any]:
        """What a checkpoint says of it."""
        return asdict(self)

    @classmethod
    def of(cls, table: Mapping[str, Any]) -> Self:
        """What a checkpoint said."""
        return cls(**{
            name: tuple(value) if isinstance(value, list) else value
            for name, value in table.items()
        })  # fmt: skip


def plane_of(
    field: CellField, spacing: float, axis: tuple[float, float, float], fraction: float
) -> tuple[float, bool]:
    """Where the plane of a furrow lies, and whether its neck has closed.

    Parameters
    ----------
    field : CellField
    spacing : float
        Lattice spacing, µm.
    axis : (3,)
        Normal of the plane, of length 1.
    fraction : float
        Share of ∫ φ that lies beyond the plane along the axis.

    Returns
    -------
    height : float
        The plane is axis·r = height, µm.
    closed : bool
        Whether φ is below 1/2 all over the plane.
    """
    phi = np.asarray(field.phi)
    heights = _heights(field, spacing, axis)
    lowest = heights.min() - spacing / 2  # lattice planes lie in the middle of slices
    slices = ((heights - lowest) / spacing).astype(np.int64)
    weights = np.bincount(slices.ravel(), np.maximum(phi, 0).ravel())
    beyond = np.append(np.cumsum(weights[::-1])[::-1], 0.0)  # at the lower face of each slice
    faces = lowest + spacing * np.arange(len(beyond))
    height = float(np.interp(fraction * beyond[0], beyond[::-1], faces[::-1]))
    return height, not (phi[np.abs(heights - height) < spacing] >= 0.5).any()


def _heights(
    field: CellField, spacing: float, axis: tuple[float, float, float]
) -> NDArray[np.float64]:
    """axis·r of each point of a field's box, µm."""
    x, y, z = (
        (first + np.arange(n)) * spacing * u
        for first, n, u in zip(field.origin.tolist(), np.shape(field.phi), axis, strict=True)
    )
    return np.asarray(x[:, None, None] + y[None, :, None] + z[None, None, :])
