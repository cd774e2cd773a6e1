"""Force terms as a user would write them, in a file of the user's own."""

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

import numpy as np

from morphosim import Column, Term, point_force


@dataclass(frozen=True, kw_only=True)
class Gravity(Term):
    """d·∇φ with d = (0, 0, weight): cells sink with the velocity weight / τ."""

    weight: float = 0.1

    def __post_init__(self) -> None:
        if not np.isfinite(self.weight):
            message = f"gravity: weight = {self.weight}; it must be finite"
            raise ValueError(message)

    def update(self, cells: Any, step: Any, forces: Any) -> None:
        """Pull down."""
        forces.drift[:, 2] += self.weight


@dataclass(frozen=True, kw_only=True)
class Persistence(Term):
    """Cells of a type swim along directions of their own that turn, and tire with age."""

    type: str
    speed: float = 0.05
    turn: float = 0.1

    columns = (
        Column("heading", shape=(3,)),
        Column("age", inherits=False),
        Column("tired", inherits=lambda mothers: np.repeat(mothers / 2, 2)),
        Column("swims", bool, saved=False),
    )

    def check(self, names: Collection[str], types: Collection[str]) -> None:
        """There must be such cells."""
        if self.type not in types:
            message = f"persistence: type = {self.type!r} is not one of {sorted(types)}"
            raise ValueError(message)

    def start(self, cells: Any, numerics: Any) -> None:
        """Head along x."""
        cells["heading"][:] = (1.0, 0.0, 0.0)

    def prepare(self, cells: Any, numerics: Any) -> None:
        """Find who swims."""
        cells["swims"][:] = [kind == self.type for kind in cells.types]

    def update(self, cells: Any, step: Any, forces: Any) -> None:
        """Swim, turn, grow old and tired."""
        forces.drift[:] -= self.speed * cells["swims"][:, None] * cells["heading"]
        x, y = cells["heading"][:, 0].copy(), cells["heading"][:, 1].copy()
        angle = self.turn * step.dt * (1 + cells["id"] % 2)
        cells["heading"][:, 0] = x * np.cos(angle) - y * np.sin(angle)
        cells["heading"][:, 1] = x * np.sin(angle) + y * np.cos(angle)
        cells["age"][:] += step.dt
        cells["tired"][:] += step.dt


@point_force
def slowed(values, phi, gx, gy, gz, laplacian):  # type: ignore[no-untyped-def]
    """- k φ² (1 - φ), and a part of the curvature."""
    return values[0] * laplacian - values[1] * phi * phi * (values[2] - phi)


@point_force
def leaning(values, phi, gx, gy, gz, laplacian):  # type: ignore[no-untyped-def]
    """A |∂φ/∂x|, without a branch."""
    return values[0] * np.sqrt(gx * gx)


@dataclass(frozen=True, kw_only=True)
class Stiffness(Term):
    """A part of γΔφ taken explicitly, and a softer well."""

    bending: float = 0.01
    well: float = 0.02

    point = slowed

    def point_values(self, cells: Any) -> Any:
        """The same for all cells."""
        return np.tile([self.bending, self.well, 1.0], (len(cells), 1))

    def explicit_rate(self, conditions: Any) -> float:
        """Of the curvature, at the lattice's shortest wave."""
        return 18.1 * self.bending / conditions.numerics.spacing**2


@dataclass(frozen=True, kw_only=True)
class Lean(Term):
    """Grow where the surface faces along x."""

    strength: float = 0.01

    point = leaning

    def point_values(self, cells: Any) -> Any:
        """By the cell's number."""
        return self.strength * (1.0 + cells["id"][:, None])


@dataclass(frozen=True, kw_only=True)
class Chemotaxis(Term):
    """- ∇φ·∇ψ with ψ = slope (x - z): cells climb ψ with the velocity slope (1, 0, -1) / τ."""

    slope: float = 0.1

    def surround(self, environment: Any) -> None:
        """Add ψ, which is evaluated anew only if the slope changes."""
        environment.add_potential(self, lambda x, y, z: self.slope * (x - z + 0 * y))


@dataclass(frozen=True, kw_only=True)
class Floor(Term):
    """- φ R with R = strength where z < height: a wall that yields."""

    height: float
    strength: float = 2.0

    def surround(self, environment: Any) -> None:
        """Add R."""
        environment.add_wall(
            self, lambda x, y, z: self.strength * (z < self.height) + 0 * (x + y),
            most=self.strength,
        )  # fmt: skip

    def explicit_rate(self, conditions: Any) -> float:
        """R at most."""
        return self.strength


@point_force
def pressed(values, phi, gx, gy, gz, laplacian):  # type: ignore[no-untyped-def]
    """P |∇φ|."""
    return values[0] * np.sqrt(gx * gx + gy * gy + gz * gz)


@dataclass(frozen=True, kw_only=True)
class PressureAtPoints(Term):
    """p |∇φ| as a force at points."""

    by: float

    point = pressed

    def point_values(self, cells: Any) -> Any:
        """The same for all cells."""
        return np.full((len(cells), 1), self.by)


@dataclass(frozen=True, kw_only=True)
class Pressure(Term):
    """p |∇φ| as the kernel has it."""

    by: float

    def update(self, cells: Any, step: Any, forces: Any) -> None:
        """Press."""
        forces.pressure[:] += self.by
