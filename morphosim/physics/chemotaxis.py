"""Chemotaxis: cells climb, or flee, a concentration that is given."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from morphosim import _validate
from morphosim._shown import short_repr
from morphosim.cell_table import CellTable
from morphosim.geometry.signed_distance import Image
from morphosim.physics.by_type import ByType
from morphosim.physics.steady_drift import too_fast
from morphosim.physics.term import Concern, Conditions, Environment, Forces, Step
from morphosim.physics.term_by_type import TermByType

Floats = NDArray[np.float64]
SOURCES = ("gradient", "function", "values")
SAMPLES = 25
"""Points along each axis on which the steepness of a function is looked for."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Chemotaxis(TermByType):
    """- ∇φ·∇ψ with ψ = χ C, or χ C / (1 + C/K): a small cell moves with the velocity ∇ψ/τ.

    The second is that of receptors of which half are bound at the concentration K (Lapidus and
    Schiller, Biophys. J. 16, 779, 1976). C is one of `gradient`, `function` and `values`, steady,
    and not changed by the cells.

    Attributes
    ----------
    sensitivity : float
        χ, [F] µm² per unit of C; negative for cells that flee.
    sensitivity_by_type : mapping from cell type to float
        χ of cells of these types, instead of `sensitivity`.
    saturation : float, optional
        K, in the unit of C; without it the response is linear.
    gradient : (3,), optional
        ∇C of C = level + ∇C·x, per µm.
    level : float
        C at the origin, with a gradient; where C would be negative it is 0. Without level and
        saturation the gradient is the same everywhere.
    function : C(x, y, z) of arrays in µm that broadcast, optional
    values : (nx, ny, nz), optional
        C on a lattice, linear in between; beyond it, that of the nearest point.
    origin : (3,) µm
        Position of values[0, 0, 0].
    spacing : float or (3,) µm
        That of the values.
    """

    sensitivity: float = 0.0
    sensitivity_by_type: Mapping[str, float] = field(default_factory=dict)
    saturation: float | None = None
    gradient: ArrayLike | None = None
    level: float | None = None
    function: Callable[[Any, Any, Any], Any] | None = None
    values: NDArray[np.float64] | None = None
    origin: ArrayLike = (0.0, 0.0, 0.0)
    spacing: ArrayLike = 1.0

    label = "chemotaxis"

    __repr__ = short_repr

    def __post_init__(self) -> None:
        self.strengths.validate()
        given = [name for name in SOURCES if getattr(self, name) is not None]
        if len(given) != 1:
            said = " and ".join(given) or "none"
            message = f"chemotaxis has {said} of {', '.join(SOURCES)}; expected exactly one of them"
            raise ValueError(message)
        if self.saturation is not None:
            _validate.number("chemotaxis.saturation", self.saturation, above=0)
        checks = {"gradient": self._check_gradient, "values": self._check_values}
        checks.get(given[0], self._check_function)()

    def _check_gradient(self) -> None:
        _validate.vector("chemotaxis.gradient", self.gradient)  # type: ignore[arg-type]
        if self.level is not None:
            _validate.number("chemotaxis.level", self.level, least=0)

    def _check_function(self) -> None:
        self._refuse_level()
        _validate.function("chemotaxis.function", self.function, 3)

    def _check_values(self) -> None:
        self._refuse_level()
        values = _validate.array("chemotaxis.values", self.values, (None, None, None))  # type: ignore[arg-type]
        if values.size == 0 or values.min() < 0:
            least = f"values down to {values.min():g}" if values.size else "no value"
            message = f"chemotaxis.values has {least}; expected an image of concentrations ≥ 0"
            raise ValueError(message)
        object.__setattr__(self, "values", values)
        _validate.vector("chemotaxis.origin", self.origin)
        _validate.spacing("chemotaxis.spacing", self.spacing)

    def _refuse_level(self) -> None:
        if self.level is not None:
            message = f"chemotaxis.level = {self.level:g} is of a gradient, and none is given"
            raise ValueError(message)

    @property
    def strengths(self) -> ByType:
        """χ, by type."""
        return ByType("chemotaxis.sensitivity", self.sensitivity, self.sensitivity_by_type)

    @property
    def uniform(self) -> bool:
        """Whether ∇ψ is the same everywhere, so that a drift does it."""
        return self.gradient is not None and self.level is None and self.saturation is None

    @property
    def drifts(self) -> bool:  # type: ignore[override]
        """Whether it adds a drift."""
        return self.uniform

    def update(self, cells: CellTable, step: Step, forces: Forces) -> None:
        """Add the drift of a uniform gradient."""
        if self.uniform:
            slope = np.asarray(self.gradient, np.float64)
            forces.drift[:] -= np.outer(self.strengths.of_each(cells), slope)

    def surround(self, environment: Environment) -> None:
        """Add ψ, where its gradient is not the same everywhere."""
        if not self.uniform:
            environment.add_potential(self, self.signal, strength=self.strengths)

    def concentration(self, x: Floats, y: Floats, z: Floats) -> Floats:
        """C at points in µm; ValueError if a function gives something that is none."""
        if self.gradient is not None:
            slope = np.asarray(self.gradient, np.float64)
            level = self.level or 0.0
            rise = sum(g * p for g, p in zip(slope, (x, y, z), strict=True))
            return np.asarray(np.maximum(level + rise, 0))
        if self.values is not None:
            steps = np.array(np.broadcast_to(np.asarray(self.spacing, float), 3))
            return Image(self.values, np.asarray(self.origin, float), steps).at(x, y, z)
        assert self.function is not None
        shape = np.broadcast_shapes(np.shape(x), np.shape(y), np.shape(z))
        values = np.broadcast_to(np.asarray(self.function(x, y, z), np.float64), shape)
        if not (values >= 0).all():
            message = (
                f"chemotaxis.function gives {np.min(values):g} somewhere; a concentration must be "
                "finite and ≥ 0"
            )
            raise ValueError(message)
        return values

    def signal(self, x: Floats, y: Floats, z: Floats) -> Floats:
        """ψ / χ: C, or C / (1 + C/K)."""
        concentration = self.concentration(x, y, z)
        if self.saturation is None:
            return concentration
        return np.asarray(concentration / (1 + concentration / self.saturation))

    def concern(self, conditions: Conditions) -> Concern | None:
        """Cells that climb too far in a step; of a function, as far as walls say where."""
        steepest = self._steepest(conditions)
        sensitivity = self.strengths.largest(conditions.types)
        what = (
            f"chemotaxis.sensitivity = {sensitivity:g} with gradients up to {steepest:.3g} per µm"
        )
        return too_fast(what, sensitivity * steepest, conditions)

    def _steepest(self, conditions: Conditions) -> float:
        """Largest slope of ψ / χ, as far as it is known, per µm."""
        if self.gradient is not None:
            return float(np.linalg.norm(np.asarray(self.gradient, np.float64)))
        if self.values is not None:
            low, steps = np.asarray(self.origin, float), _validate.spacing("", self.spacing)
            axes = [
                a + h * np.arange(n) for a, h, n in zip(low, steps, self.values.shape, strict=True)
            ]
        elif conditions.confinement is not None:
            corners = conditions.confinement.bounds()
            axes = [np.linspace(a, b, SAMPLES) for a, b in zip(*corners, strict=True)]
        else:
            return 0.0
        return _steepest_on(axes, self.signal(*np.meshgrid(*axes, indexing="ij", sparse=True)))


def _steepest_on(axes: list[Floats], values: Floats) -> float:
    """Largest slope of values on a grid."""
    slopes = [np.gradient(values, a, axis=k) for k, a in enumerate(axes) if len(a) > 1]
    return float(np.sqrt(sum(s**2 for s in slopes)).max()) if slopes else 0.0
