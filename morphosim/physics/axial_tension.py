"""Surface tension that depends on where a cell's surface faces: n = - ∇φ/|∇φ| against its axis p.

A surface of the tension γ a(n), a = √(1 + χ (p·n)²), moves by its weighted curvature K. With
A(v) = |v| a, which is √(v·M v) with M = 1 + χ p p, that is K = - ∇·(∂A/∂v) at v = ∇φ:

    f = γ |∇φ| (A'' : ∇∇φ) - γ (Δφ - n·∇∇φ·n),   A'' = M/A - M∇φ M∇φ/A³

is what is added to γΔφ. The profile of the interface, and so its width, stay as they are. The shape
of least energy at given volume (Wulff) is an ellipsoid: a free cell at rest is √(1 + χ) times as
long along p as across.

A tension γ (1 + χ p·n), more at one end than at the other, has no effect that could be computed
so: its energy is that of χ = 0, since ∮ p·n = 0 over a closed surface. See docs/terms.md.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from morphosim import _validate
from morphosim._shown import short_repr
from morphosim.cell_table import CellTable
from morphosim.kernels.points import point_force
from morphosim.numerics.parameters import Numerics
from morphosim.physics.added_curvature import FLATTEST, explicit_rate
from morphosim.physics.by_type import ByType
from morphosim.physics.term import Conditions
from morphosim.physics.term_by_type import TermByType

Floats = NDArray[np.float64]
SMALLEST, LARGEST = -0.75, 8.0
"""Bounds of χ: cells half as long as wide, or three times."""


@point_force
def weighted_curvature(values, phi, gx, gy, gz, laplacian, second):  # type: ignore[no-untyped-def]
    """f; `values` are γ, χ, p, `FLATTEST` and 2, the latter in the type of the fields."""
    xx, yy, zz, xy, xz, yz = second
    chi, px, py, pz, two = values[1], values[2], values[3], values[4], values[6]
    along = chi * (px * gx + py * gy + pz * gz)
    qx, qy, qz = gx + along * px, gy + along * py, gz + along * pz  # M ∇φ
    square = gx * gx + gy * gy + gz * gz + values[5]
    weighted = gx * qx + gy * qy + gz * qz + values[5]  # A²
    normal = gx * gx * xx + gy * gy * yy + gz * gz * zz
    normal += two * (gx * gy * xy + gx * gz * xz + gy * gz * yz)
    across = qx * qx * xx + qy * qy * yy + qz * qz * zz
    across += two * (qx * qy * xy + qx * qz * xz + qy * qz * yz)
    axis = px * px * xx + py * py * yy + pz * pz * zz
    axis += two * (px * py * xy + px * pz * xz + py * pz * yz)
    bent = np.sqrt(square / weighted) * (laplacian + chi * axis - across / weighted)
    return values[0] * (bent - (laplacian - normal / square))


@dataclass(frozen=True, slots=True, kw_only=True)
class AxialTension(TermByType):
    """Surface tension γ √(1 + χ (p·n)²), n the normal, by which cells are long along an axis p.

    Attributes
    ----------
    chi : float
        χ, from -0.75 to 8. A free cell at rest is √(1 + χ) times as long along p as across.
    chi_by_type : mapping from cell type to float
        χ of cells of these types, instead of `chi`.
    direction : (3,), optional
        p, of all cells; its length and sign are of no account. By default each cell's polarity.
    """

    chi: float = 0.0
    chi_by_type: Mapping[str, float] = field(default_factory=dict)
    direction: Any = None

    drifts = False
    label = "axial tension"
    point = weighted_curvature

    __repr__ = short_repr

    def __post_init__(self) -> None:
        self.strengths.validate(least=SMALLEST, most=LARGEST)
        if self.direction is not None:
            _validate.direction("axial_tension.direction", self.direction)

    @property
    def strengths(self) -> ByType:
        """χ, by type."""
        return ByType("axial_tension.chi", self.chi, self.chi_by_type)

    @property
    def point_varies(self) -> bool:  # type: ignore[override]
        """Whether p turns."""
        return self.direction is None

    def prepare(self, cells: CellTable, numerics: Numerics) -> None:
        """Raise ValueError if p is to be a polarity that cells do not have."""
        if self.direction is None and "polarity" not in cells:
            message = (
                "axial_tension: without a direction it is along the cells' polarity, and they have "
                "none; give a direction, or the scene the term 'polarity'"
            )
            raise ValueError(message)

    def point_values(self, cells: CellTable) -> Floats:
        """(N, 7) γ, χ, p, and the constants of the function."""
        n = len(cells)
        if self.direction is None:
            axes = cells["polarity"]
        else:
            axis = _validate.direction("axial_tension.direction", self.direction)
            axes = np.broadcast_to(axis, (n, 3))
        chi, constants = self.strengths.of_each(cells), np.tile([FLATTEST, 2.0], (n, 1))
        return np.column_stack([cells["tension"], chi, axes, constants])

    def explicit_rate(self, conditions: Conditions) -> float:
        """That of the finest waves along p, where it is more than γΔφ makes up for."""
        chis = [self.strengths.of(kind) for kind in conditions.types]
        return explicit_rate(_most_added(chis), conditions)

    @property
    def stiffening(self) -> float:
        """See `_most_added`."""
        return _most_added([self.chi, *self.chi_by_type.values()])


def _most_added(chis: list[float]) -> float:
    """Share of γΔφ that is added at most: along p where p·n = 0, or across it where p·n = 1."""
    return float(max(max(chi, 1 / np.sqrt(1 + chi) - 1) for chi in chis))
