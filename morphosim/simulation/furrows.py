"""Furrows: what is known of cells that are dividing, until they are cut."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from morphosim._shown import short_repr
from morphosim.cell_field import CellField
from morphosim.physics.contractile_ring import ContractileRing

Floats = NDArray[np.float64]
Vector = tuple[float, float, float]
LOOK = 1.0
"""*In silico* time between two looks at a furrow."""


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
    recoil : (3,)
        d of a drift d·∇φ by which the ring's force is none on the cell as a whole.
    closed : bool
        Whether φ is below 1/2 all over the plane.
    """

    daughters: tuple[str, str] | None
    axis: Vector
    fraction: float
    types: tuple[str, str] | None
    volumes: tuple[float, float] | None
    until: int
    height: float = 0.0
    recoil: Vector = (0.0, 0.0, 0.0)
    closed: bool = False

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
        values: dict[str, Any] = {
            name: tuple(value) if isinstance(value, list) else value
            for name, value in table.items()
        }
        return cls(**values)

    def seen(
        self, field: CellField, spacing: float, ring: ContractileRing, strength: float
    ) -> Self:
        """Where it lies now, and what its ring does.

        Parameters
        ----------
        field : CellField
            Of the cell.
        spacing : float
            Lattice spacing, µm.
        ring : ContractileRing
        strength : float
            γ χ of the cell's ring.
        """
        x, y, z = places = [
            (first + np.arange(n)).reshape(shape)
            for first, n, shape in zip(
                field.origin.tolist(), np.shape(field.phi),
                ((-1, 1, 1), (1, -1, 1), (1, 1, -1)), strict=True,
            )
        ]  # fmt: skip
        a, b, c = (spacing * part for part in self.axis)
        heights = a * x + b * y + c * z
        phi = np.asarray(field.phi, np.float64)
        height = _height_of_share(phi, heights, spacing, self.fraction)
        closed = not (phi[np.abs(heights - height) < spacing] >= 0.5).any()
        plane = ring.plane(np.array(self.axis), height, spacing)
        recoil = _recoil(phi, places, spacing, ring, strength, plane)
        return replace(self, height=height, recoil=recoil, closed=closed)


def _height_of_share(phi: Floats, heights: Floats, spacing: float, fraction: float) -> float:
    """Height beyond which a fraction of ∫ φ lies, in the unit of `heights`."""
    lowest = heights.min() - spacing / 2  # lattice planes lie in the middle of slices
    slices = ((heights - lowest) / spacing).astype(np.int64)
    weights = np.bincount(slices.ravel(), np.maximum(phi, 0).ravel())
    beyond = np.append(np.cumsum(weights[::-1])[::-1], 0.0)  # at the lower face of each slice
    faces = lowest + spacing * np.arange(len(beyond))
    return float(np.interp(fraction * beyond[0], beyond[::-1], faces[::-1]))


def _recoil(
    phi: Floats, places: list[NDArray[np.int64]], spacing: float, ring: ContractileRing,
    strength: float, plane: Floats,
) -> Vector:  # fmt: skip
    """D of ∫ (f - d·∇φ) ∇φ = 0, with f the force of the ring: a ring pulls a cell nowhere."""
    inside = (slice(1, -1),) * 3
    slope: Any = np.gradient(np.pad(phi, 1), spacing)
    xx, xy, xz = np.gradient(slope[0], spacing)
    _, yy, yz = np.gradient(slope[1], spacing)
    zz = np.gradient(slope[2], spacing, axis=2)
    second = [part[inside] for part in (xx, yy, zz, xy, xz, yz)]
    gradient = [part[inside] for part in slope]
    force = ring.force(strength, plane, phi, gradient, second, places)
    whole = np.array([(force * one).sum() for one in gradient])
    drag = np.array([[(one * other).sum() for other in gradient] for one in gradient])
    x, y, z = np.linalg.solve(drag, whole).tolist()
    return x, y, z
