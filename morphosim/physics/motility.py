"""Motility: random motion of cells (Eq. 11, S3)."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from morphosim._shown import short_repr
from morphosim.cell_table import CellTable, Column
from morphosim.kernels.noise import normal_vectors
from morphosim.numerics.parameters import Numerics
from morphosim.physics.by_type import ByType
from morphosim.physics.term import Concern, Conditions, Forces, Step
from morphosim.physics.term_by_type import TermByType

FARTHEST_JUMP = 0.6
"""Largest stable noise: root mean square move per step in widths 1 / √(c/2)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Motility(TermByType):
    """- κ √δt u·∇φ, u standard normal per cell and step (Eq. 11, S3).

    As published, a free cell's mean-square displacement along an axis is (κ δt/τ)² t: it depends on
    δt. A step of another length h draws -κ δt/√h u·∇φ: displacements in h have a variance of
    (κ δt/τ)² h, so that they add up to the same.

    Attributes
    ----------
    kappa : float
        Strength κ.
    kappa_by_type : mapping from cell type to float
        κ of cells of these types, instead of `kappa`.
    """

    kappa: float
    kappa_by_type: Mapping[str, float]

    columns = (Column("kappa", saved=False), Column("normals", shape=(3,), saved=False))
    random = True

    __repr__ = short_repr

    def __post_init__(self) -> None:
        self.strengths.validate(least=0)

    @property
    def strengths(self) -> ByType:
        """κ, by type."""
        return ByType("physics.kappa", self.kappa, self.kappa_by_type)

    def prepare(self, cells: CellTable, numerics: Numerics) -> None:
        """Set κ of each cell."""
        cells["kappa"][:] = self.strengths.of_each(cells)

    def update(self, cells: CellTable, step: Step, forces: Forces) -> None:
        """Draw u, and add the drift."""
        normals = cells["normals"]
        normal_vectors(np.uint64(step.seed), np.uint64(step.number), cells["id"], normals)
        strength = np.sqrt(step.dt) * (step.usual_dt / step.dt)
        normals *= (-strength * cells["kappa"])[:, None]
        np.add(forces.drift, normals, out=forces.drift)

    def explicit_rate(self, conditions: Conditions) -> float:
        """3 times the square of the jump in a step, in widths, as measured."""
        return 3 * self.jump(conditions) ** 2

    def whole_cell_rate(self, conditions: Conditions) -> float:
        """Likewise: noise moves whole cells."""
        return self.explicit_rate(conditions)

    def jump(self, conditions: Conditions) -> float:
        """Root mean square move per step, in interface widths, of the most motile type."""
        kappa = self.strengths.largest(conditions.types)
        return float(
            kappa * conditions.numerics.dt**1.5 / conditions.tau * conditions.interface_scale
        )

    def concern(self, conditions: Conditions) -> Concern | None:
        """Noise that moves cells too far in a step."""
        dt, kappa = conditions.numerics.dt, self.strengths.largest(conditions.types)
        jump = self.jump(conditions)
        if jump <= FARTHEST_JUMP:
            return None
        return Concern(
            jump / FARTHEST_JUMP,
            f"physics.kappa = {kappa:g} moves cells by {jump:.2g} interface widths in a step "
            f"of numerics.dt = {dt:g}; more than {FARTHEST_JUMP:g} is likely to diverge. Take a "
            "smaller dt or kappa",
        )
