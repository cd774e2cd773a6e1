"""What a force term is: parameters, checks, state per cell, what it adds to a step, its rate.

The force on a cell is one sum (Eq. S2, S3 of the paper),

    F = Σ terms = - γ c W'(φ) - φ R - ∇φ·∇ψ + p |∇φ| + d·∇φ + f(φ, ∇φ, Δφ)

and a term adds to one or more of its parts: to the pressure p and the drift d of each cell
(`Term.update`), to the repulsion R and the potential ψ that cells feel of each other and of space
(`Term.surround`), or at each point by a small compiled function f (`Term.point`).
"""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, NamedTuple, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from morphosim._shown import short_repr
from morphosim.cell_table import CellTable, Column
from morphosim.geometry.confinement import Confinement
from morphosim.kernels.points import PointForce
from morphosim.measure.surroundings import Surroundings
from morphosim.numerics.parameters import Numerics
from morphosim.physics.by_type import ByType

Floats = NDArray[np.float64]
SpaceFunction = Callable[[Floats, Floats, Floats], Floats]


@dataclass(frozen=True, slots=True)
class Step:
    """The step under way.

    On several MPI ranks the table holds a part of all cells, and among them ghost cells: cells of
    other ranks that come near, marked as frozen. Their volumes are right, but columns of a term
    have no meaning for them; take no sums over cells.

    Attributes
    ----------
    number : int
        Of the tick at which it begins: of steps before it, where all are of the same length.
    time : float
        *In silico* time at which it begins.
    forces_at : float
        Time at which forces are taken: that of its begin, or of its end with the scheme
        "linearised". Take there what depends on time.
    dt : float
        Its length, *in silico* time.
    usual_dt : float
        `Numerics.dt`; the same, unless a tolerance has steps of other lengths.
    seed : int
        `Numerics.seed`. Draw random numbers from it, `number` and a cell's id alone, as
        `kernels.noise` does: then they depend neither on threads nor on other cells.
    volumes : (N,) float64
        ∫ φ of each cell, µm³.
    tau : float or (N, 1) float64
        Viscosity τ, of each cell where it differs: a drift d moves a cell with the velocity -d/τ.
    surroundings : Surroundings or None
        Where cells are and what they touch, if a term `senses` it in this step. Then ghost cells
        have the columns of terms, too.
    """

    number: int
    time: float
    forces_at: float
    dt: float
    usual_dt: float
    seed: int
    volumes: Floats
    tau: float | Floats
    surroundings: Surroundings | None = None

    __repr__ = short_repr


@dataclass(slots=True)
class Forces:
    """What the terms add to in a step; all is 0 at its beginning.

    Attributes
    ----------
    pressure : (N,) float64
        p of p |∇φ|, per cell.
    drift : (N, 3) float64
        d of d·∇φ, per cell. A cell drifts with the velocity -d/τ.
    stiffness : (N,) float64
        - ∂p/∂v, per cell and µm³: by how much the pressures fall as the volume rises. The scheme
        "linearised" takes that into account.
    """

    pressure: Floats
    drift: Floats
    stiffness: Floats

    __repr__ = short_repr


class Pull(Protocol):
    """Attraction σ between cells; see `Attraction`."""

    def type_matrix(self, types: Sequence[str]) -> Floats:
        """(K, K) σ by type, [j, i]."""

    def exceptions(
        self, rows: "dict[str, int]", parents: Sequence[str] | None = None
    ) -> dict[tuple[int, int], float]:
        """σ of pairs of rows (j, i) that their types do not tell."""

    @property
    def stated(self) -> set[str]:
        """Names of cells in stated pairs."""

    @property
    def needs_parents(self) -> bool:
        """Whether `exceptions` looks at the cells' mothers."""


class SpaceTerm(NamedTuple):
    """A function of space."""

    name: str
    """Of its term, for errors."""
    function: SpaceFunction
    key: tuple[Any, ...]
    """What it depends on."""
    most: float | None = None
    """Its largest value, if that is known."""
    strength: ByType | None = None
    """By what it is multiplied for cells of each type, if that is not 1."""
    local: bool = False
    """Whether it is about 0 in most of space, where it then costs nothing."""


@dataclass(slots=True)
class Environment:
    """What cells feel of each other and of space: R = Σ_j g φ_j² + walls, and ψ.

    Attributes
    ----------
    numerics, confinement
        See `Scene`.
    tension : float
        Mean surface tension of all cells.
    interface_scale : float
        See `Physics`.
    g : float
        Strength of Σ_j g φ_j² in R.
    attraction : Pull or None
        ψ_i = Σ_j σ_ji φ_j.
    walls, potentials : lists of SpaceTerm
        See `add_wall` and `add_potential`.
    """

    numerics: Numerics
    confinement: Confinement | None
    tension: float
    interface_scale: float
    g: float = 0.0
    attraction: Pull | None = None
    walls: list[SpaceTerm] = field(default_factory=list)
    potentials: list[SpaceTerm] = field(default_factory=list)

    __repr__ = short_repr

    def add_wall(
        self, term: "Term", function: SpaceFunction, *depends: Any, most: float | None = None
    ) -> None:
        """Add R(x, y, z) ≥ 0, a function of points in µm, and `most`, its largest value.

        It is evaluated again only if the term, or something else that it `depends` on, changes.
        The iterations of "linearised" depend on the largest R. Without `most` that is the largest
        near the cells, which is looked for whenever their boxes move.
        """
        self.walls.append(SpaceTerm(term.name, function, (term, *depends), most))

    def add_potential(
        self, term: "Term", function: SpaceFunction, *depends: Any,
        strength: ByType | None = None, local: bool = False,
    ) -> None:  # fmt: skip
        """Add ψ(x, y, z), likewise, times a `strength` by cell type if one is given.

        Where it is linear, a cell drifts with the velocity ∇ψ/τ. One that is `local` counts as 0
        where it is below 10⁻⁶ on all of a tile, as walls do.
        """
        key = (term, *depends)
        self.potentials.append(SpaceTerm(term.name, function, key, strength=strength, local=local))


@dataclass(frozen=True, slots=True)
class Conditions:
    """What the stability check knows of a scene, now and in later stages.

    Attributes
    ----------
    tensions : (n,) surface tensions of the cells that are stepped
    mean_tension : float
        Of all cells.
    volumes : (m,) target volumes of these cells, and those that they come to, µm³
    filled : (m,) ∫ φ of these cells, where it may be more
    types : cell types that there are or may be
    several : bool
        Whether there is more than one cell, now or by divisions that are stated.
    staged : bool
        Whether there are stages, whose events may bring about more cells.
    tau : float
        Least viscosity τ of these types.
    interface_scale : float
        See `Physics`.
    numerics, confinement
        See `Scene`.
    pressing : float
        Whether cells are, or may come to be, pressed to the walls: 1, or down to 0 where they only
        touch them.
    """

    tensions: Floats
    mean_tension: float
    volumes: Floats
    filled: Floats
    types: Sequence[str]
    several: bool
    staged: bool
    tau: float
    interface_scale: float
    numerics: Numerics
    confinement: Confinement | None
    pressing: float = 1.0

    __repr__ = short_repr

    @property
    def linearised(self) -> bool:
        """Whether the scheme is "linearised".

        It takes implicitly what a cell's own φ does to the force there, by the double well and R,
        and what its volume does to its pressure; only the rest counts as explicit.
        """
        return self.numerics.scheme == "linearised"


@dataclass(frozen=True, slots=True)
class Concern:
    """Something that is likely to go wrong.

    Attributes
    ----------
    excess : float
        How many times too strong it is; the worst is told.
    text : str
        What it is, its value, the limit, and what to try, in one sentence.
    """

    excess: float
    text: str


class Term:
    """A force term. Subclass it as a frozen dataclass whose fields are its parameters.

    Only what the term needs has to be overridden. Parameters must be values that a scene file can
    say: numbers, texts, flags, lists, tables with texts as keys, arrays where the field's
    annotation is `NDArray`, functions of a module where it is `Callable`. They are checked in
    `__post_init__`. Without such a class the term acts, but neither scene nor run can be saved.

    Attributes
    ----------
    columns : tuple of Column
        Its own state per cell: saved, resumed, divided and sent to other ranks with no further
        code.
    drifts : bool
        Whether `update` may add to `Forces.drift`; a scene without such a term does not pay for it.
    random : bool
        Whether it draws random numbers, so that another seed gives another course.
    point : PointForce or None
        Force at each point, a function of φ and its derivatives there; see
        `kernels.points.point_force`.
    point_varies : bool
        Whether `point_values` differ from step to step.
    label : str
        What warnings call it; by default the name of its class.
    """

    columns: ClassVar[tuple[Column, ...]] = ()
    drifts: ClassVar[bool] = True
    random: ClassVar[bool] = False
    point: ClassVar[PointForce | None] = None
    point_varies: ClassVar[bool] = False
    label: ClassVar[str] = ""

    @property
    def present(self) -> bool:
        """Whether it acts at all; a term that does not allocates nothing and costs nothing."""
        return True

    def check(self, names: Collection[str], types: Collection[str]) -> None:
        """Raise ValueError if a parameter names a cell or a type that is not one of these."""

    def among(self, names: Collection[str], types: Collection[str]) -> Self:
        """Copy that says nothing of other cells and types than these."""
        return self

    def start(self, cells: CellTable, numerics: Numerics) -> None:
        """Set its columns when a simulation or a stage begins with it, not when a run goes on."""

    def prepare(self, cells: CellTable, numerics: Numerics) -> None:
        """Set columns that follow from parameters and types; called whenever these change."""

    def surround(self, environment: Environment) -> None:
        """Add to what cells feel of each other and of space; called as `prepare` is."""

    def senses(self, step: Step) -> bool:
        """Whether `update` asks for `Step.surroundings` in a step; the same on all ranks."""
        return False

    def update(self, cells: CellTable, step: Step, forces: Forces) -> None:
        """Add to pressure and drift, and advance its own columns by a step."""

    def point_values(self, cells: CellTable) -> Floats:
        """(N, K) values of each cell that `point` gets; called as `prepare` is, or in each step."""
        return np.zeros((len(cells), 1))

    def explicit_rate(self, conditions: Conditions) -> float:
        """Fastest rate at which it relaxes φ at a point, as a factor of φ; see `stability`."""
        return 0.0

    def whole_cell_rate(self, conditions: Conditions) -> float:
        """Likewise, where it acts on a cell as a whole and not at each point alone."""
        return 0.0

    @property
    def stiffening(self) -> float:
        """Share of γΔφ that it adds by second derivatives, for the diffusion of "linearised"."""
        return 0.0

    def concern(self, conditions: Conditions) -> Concern | None:
        """What beside these rates is likely to go wrong."""
        return None

    @property
    def name(self) -> str:
        """What warnings call it: `label`, or the name of its class."""
        return self.label or type(self).__name__
