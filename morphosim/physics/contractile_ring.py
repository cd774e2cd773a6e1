"""Contractile ring: tension around a cell that divides, by which its furrow is drawn in.

In a band of the surface around the plane of division, which has the normal p and lies at the
distance d, the cortex has a further tension along the ring, that is along t = p × n. Such a stress
presses on the surface by its curvature in that direction, which gives the force

    f = γ χ e(d) t·∇∇φ·t,    e = (1 - d²/w²)² where |d| < w, else 0,    t = p × ∇φ / |p × ∇φ|

It is - γ χ e |∇φ| / r on a round neck of radius r. A ring pulls its cell nowhere: a drift d·∇φ is
taken off, by which the forces on the cell sum up to none. Only cells that divide with `over` have a
ring.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from morphosim import _validate
from morphosim._shown import short_repr
from morphosim.cell_table import CellTable, Column
from morphosim.kernels.points import point_force
from morphosim.physics.added_curvature import FLATTEST, explicit_rate
from morphosim.physics.by_type import ByType
from morphosim.physics.term import Concern, Conditions, Term
from morphosim.physics.term_by_type import TermByType

Floats = NDArray[np.float64]
PLANE = Column(
    "ring_plane", shape=(7,), inherits=False, saved=False, shared=True, aimed=True
)  # fmt: skip
"""a and b of d / w = a·r - b at the lattice position r, and the drift d that is taken off; all 0 of
a cell that does not divide."""
LARGEST = 20.0
"""Bound of χ."""
NARROWEST = 2.0
"""Least half width of a band, in lattice steps."""
ZERO, ONE = np.float32(0), np.float32(1)


@partial(point_force, rests=True)
def hoop_tension(values, phi, gx, gy, gz, laplacian, second, place):  # type: ignore[no-untyped-def]
    """Force f - d·∇φ; `values` are γ χ, p, a, b, d and `FLATTEST`."""
    xx, yy, zz, xy, xz, yz = second
    x, y, z = place
    px, py, pz = values[1], values[2], values[3]
    depth = values[4] * x + values[5] * y + values[6] * z - values[7]
    inside = np.maximum(ONE - depth * depth, ZERO)
    tx, ty, tz = py * gz - pz * gy, pz * gx - px * gz, px * gy - py * gx
    square = tx * tx + ty * ty + tz * tz + values[11]
    mixed = tx * ty * xy + tx * tz * xz + ty * tz * yz
    bent = (tx * tx * xx + ty * ty * yy + tz * tz * zz + (mixed + mixed)) / square
    drift = values[8] * gx + values[9] * gy + values[10] * gz
    return values[0] * inside * inside * bent - drift


@dataclass(frozen=True, slots=True, kw_only=True)
class ContractileRing(TermByType):
    """Tension along a ring around each cell that divides over a time; see `Simulation.divide`.

    Attributes
    ----------
    strength : float
        χ: in the middle of the band the tension along the ring is γ (1 + χ). To draw in the whole
        neck of a free cell of radius R, χ w must be more than about R.
    strength_by_type : mapping from cell type to float
        χ of cells of these types, instead of `strength`.
    width : float
        w, half the width of the band, µm.
    """

    strength: float = 8.0
    strength_by_type: Mapping[str, float] = field(default_factory=dict)
    width: float = 1.5

    columns = (PLANE,)
    drifts = False
    label = "contractile ring"
    point = hoop_tension
    point_varies = True

    __repr__ = short_repr

    def __post_init__(self) -> None:
        self.strengths.validate(least=0, most=LARGEST)
        _validate.number("contractile_ring.width", self.width, above=0)

    @property
    def strengths(self) -> ByType:
        """χ, by type."""
        return ByType("contractile_ring.strength", self.strength, self.strength_by_type)

    def plane(self, normal: Floats, height: float, spacing: float) -> Floats:
        """(4,) a and b of `PLANE`, for the plane normal·r = height; in µm, as is the spacing."""
        return np.asarray([*(normal * spacing / self.width), height / self.width])

    def force(
        self, strength: float, plane: Floats, phi: Floats, gradient: Sequence[Floats],
        second: Sequence[Floats], place: Sequence[Any],
    ) -> Floats:  # fmt: skip
        """f, of the strength γ χ, at points of which these are known; see `point_force`."""
        normal = plane[:3] / np.linalg.norm(plane[:3])
        values = [strength, *normal, *plane, 0.0, 0.0, 0.0, FLATTEST]
        return np.asarray(hoop_tension(values, phi, *gradient, None, second, place))

    def point_values(self, cells: CellTable) -> Floats:
        """(N, 12) γ χ, p, a, b, d, and the constant of the function."""
        planes = cells["ring_plane"]
        steps = np.linalg.norm(planes[:, :3], axis=1)
        divides = steps > 0
        normals = planes[:, :3] / np.where(divides, steps, 1)[:, None]
        tensions = np.where(divides, cells["tension"] * self.strengths.of_each(cells), 0)
        return np.column_stack([tensions, normals, planes, np.full(len(cells), FLATTEST)])

    def explicit_rate(self, conditions: Conditions) -> float:
        """That of the finest waves along the ring."""
        return explicit_rate(self.strengths.largest(conditions.types), conditions)

    @property
    def stiffening(self) -> float:
        """χ, the largest."""
        return max(self.strength, *self.strength_by_type.values(), 0.0)

    def concern(self, conditions: Conditions) -> Concern | None:
        """A band that is too narrow for the lattice."""
        least = NARROWEST * conditions.numerics.spacing
        if self.width >= least:
            return None
        text = (
            f"contractile_ring.width = {self.width:g} µm is too narrow for a lattice of "
            f"{conditions.numerics.spacing:g} µm: take at least {least:g}, or a finer spacing"
        )
        return Concern(least / self.width, text)


def require_ring(terms: Iterable[Term], where: str) -> None:
    """Raise ValueError if there is no contractile ring among force terms."""
    if any(isinstance(term, ContractileRing) and term.present for term in terms):
        return
    message = (
        f"{where}: a division that takes time needs the force term contractile_ring, which draws "
        "in the furrow; add it to the physics, or leave `over` out"
    )
    raise ValueError(message)
