"""Polarity: a direction per cell that turns, and along which the cell moves."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from morphosim import _validate
from morphosim._shown import short_repr
from morphosim.cell_table import CellTable, Column
from morphosim.measure.surroundings import Surroundings
from morphosim.numerics.parameters import Numerics
from morphosim.physics import directions, steady_drift
from morphosim.physics.by_type import ByType
from morphosim.physics.directions import LEAST, Floats
from morphosim.physics.term import Concern, Conditions, Environment, Forces, Step, Term

CUES = ("velocity", "neighbours", "contacts", "attractant", "direction")
PLACES = ("everywhere", "free", "wall")
NEAR = 0.85
"""Nearness to a wall from which on a cell touches it; see `Surroundings.nearness`."""
LARGEST_TURN = 0.5
"""Largest rate at which p forgets, in 1/δt: walks of straight steps are right to 2 %."""
MOST_BLIND = 2.0
"""Largest rate of cues that follow from p itself, in 1/`look_every`."""


def _and_opposite(mothers: NDArray) -> NDArray:
    """One daughter like her mother, the other against her."""
    return np.stack([mothers, -mothers], axis=1).reshape(-1, *mothers.shape[1:])


DAUGHTERS: dict[str, bool | Callable[[NDArray], NDArray]] = {
    "inherit": True,
    "opposite": _and_opposite,
    "random": False,
}


@dataclass(frozen=True, kw_only=True)
class Polarity(Term):
    """- α s p·∇φ with a unit vector p of each cell, which turns: the cell moves along p.

    A free cell has the velocity α s p / τ. p turns at random and towards cues e_k,

        dp/dt = (1 - p p·) (Σ_k β_k e_k + √(2D) ξ),  ξ white noise.

    Without cues ⟨p(t)·p(0)⟩ = exp(-2 D t), or exp(-D t) in a plane, at any δt.

    A cue is a vector of length 1 at most, the same until the cell looks again:

    - "velocity": v τ/α, v that of the centroid since it has looked last; length 1 at most [1]_
    - "neighbours": Σ_j a_ij p_j, a_ij the share of the cell's surface that cell j covers [2]_
    - "contacts": Σ_j a_ij (r_i - r_j)/|r_i - r_j|, away from them, r centroids: contact inhibition
      of locomotion [3]_
    - "attractant": ∇c/|∇c|, from differences over the cell's radius
    - "direction": a direction that is the same for all

    Attributes
    ----------
    alpha : float
        Strength α, [F] µm.
    alpha_by_type : mapping from cell type to float
        α of cells of these types, instead of `alpha`.
    diffusion : float
        Rotational diffusion constant D, per unit of *in silico* time.
    align : mapping from cue to float
        Rates β_k per unit of time; where one is negative, p turns away.
    attractant : function of x, y, z, optional
        Concentration c of the cue "attractant" at points in µm, which come as arrays.
    direction : (3,), optional
        Of the cue "direction".
    initial : "random" or (3,)
        p of all cells when the term begins to act.
    plane : (3,), optional
        Normal of a plane that p stays in.
    where : {"everywhere", "free", "wall"}
        What s is: 1; the share of the cell's surface that touches no other cell; 1 where the cell
        touches the confinement, and else 0.
    daughters : {"inherit", "opposite", "random"}
        p of daughters: their mother's; that and its opposite; drawn anew.
    look_every : float
        *In silico* time after which cells look anew at cues and at where they are. Contacts take as
        long as half a step, the rest next to nothing.

    Raises
    ------
    ValueError
        A value is not allowed, or could have no effect.

    References
    ----------
    .. [1] Szabó et al. 2006, doi:10.1103/PhysRevE.74.061908
    .. [2] Vicsek et al. 1995, doi:10.1103/PhysRevLett.75.1226
    .. [3] Smeets et al. 2016, doi:10.1073/pnas.1521151113

    Examples
    --------
    >>> from morphosim import Physics, Polarity
    >>> Physics(terms=[Polarity(alpha=0.1, diffusion=0.01, align={"contacts": 0.5})]).summary
    'γ = 0.25, c = 2, σ = 0, polarity'
    """

    alpha: float = 0.0
    alpha_by_type: Mapping[str, float] = field(default_factory=dict)
    diffusion: float = 0.0
    align: Mapping[str, float] = field(default_factory=dict)
    attractant: Callable[[Floats, Floats, Floats], Floats] | None = None
    direction: Sequence[float] | None = None
    initial: Sequence[float] | str = "random"
    plane: Sequence[float] | None = None
    where: str = "everywhere"
    daughters: str = "inherit"
    look_every: float = 5.0

    label = "polarity"

    __repr__ = short_repr

    def __post_init__(self) -> None:
        self.strength.validate(least=0)
        _validate.number("polarity.diffusion", self.diffusion, least=0)
        _validate.instance("polarity.align", self.align, Mapping)
        for cue, rate in self.align.items():
            _validate.choice("cue in polarity.align", cue, CUES)
            _validate.number(f"polarity.align[{cue!r}]", rate)
        _validate.choice("polarity.where", self.where, PLACES)
        _validate.choice("polarity.daughters", self.daughters, DAUGHTERS)
        _validate.number("polarity.look_every", self.look_every, above=0)
        self._check_cues()
        self._check_directions()

    def _check_cues(self) -> None:
        """Raise ValueError if a cue lacks what it is, or the other way round."""
        for cue in ("attractant", "direction"):
            if (cue in self.align) != (getattr(self, cue) is not None):
                rate, value = f"align.{cue}", _validate.brief(getattr(self, cue), 60)
                has = f"{rate} = {self.align[cue]:g}" if cue in self.align else f"no {rate}"
                message = f"polarity: {cue} = {value} with {has}; give both, or none of the two"
                raise ValueError(message)
        if self.attractant is not None:
            _validate.function("polarity.attractant", self.attractant, 3)

    def _check_directions(self) -> None:
        """Raise ValueError if there is a direction that is none, also within the plane."""
        normal = None
        if self.plane is not None:
            normal = _direction("polarity.plane", self.plane, None)
        if self.direction is not None:
            _direction("polarity.direction", self.direction, normal)
        if not isinstance(self.initial, str):
            _direction("polarity.initial", self.initial, normal)
        elif self.initial != "random":
            message = (
                f"polarity.initial = {_validate.brief(self.initial)} is not allowed: give "
                "'random', or a direction of 3 numbers"
            )
            raise ValueError(message)

    @property
    def columns(self) -> tuple[Column, ...]:  # type: ignore[override]
        """p, what pulls at it, where the cell was seen last and when, s, and α."""
        inherits = DAUGHTERS[self.daughters]
        return (
            Column("polarity", shape=(3,), inherits=inherits),
            Column("polarity_pull", shape=(3,)),
            Column("polarity_seen", shape=(4,), default=np.nan, inherits=False),
            Column("polarity_share", default=1.0),
            Column("polarity_alpha", saved=False),
        )

    @property
    def random(self) -> bool:  # type: ignore[override]
        """Whether anything is drawn."""
        return self.diffusion > 0 or "random" in (self.initial, self.daughters)

    @property
    def looks(self) -> bool:
        """Whether cells look at anything."""
        return self.where != "everywhere" or bool(self.align.keys() - {"direction"})

    @property
    def normal(self) -> Floats | None:
        """Normal of the plane, of length 1."""
        return None if self.plane is None else _direction("polarity.plane", self.plane, None)

    @property
    def strength(self) -> ByType:
        """α, by type."""
        return ByType("polarity.alpha", self.alpha, self.alpha_by_type)

    def check(self, names: Collection[str], types: Collection[str]) -> None:
        """Raise ValueError if `alpha_by_type` names a type that is not one of these."""
        self.strength.check(types)

    def among(self, names: Collection[str], types: Collection[str]) -> Self:
        """Copy that says nothing of other types than these."""
        return replace(self, alpha_by_type=self.strength.among(types))

    def start(self, cells: CellTable, numerics: Numerics) -> None:
        """Give all cells their first directions."""
        if isinstance(self.initial, str):
            cells["polarity"] = directions.beginnings(numerics.seed, cells["id"], self.normal)
        else:
            cells["polarity"] = _direction("polarity.initial", self.initial, self.normal)

    def prepare(self, cells: CellTable, numerics: Numerics) -> None:
        """Set α of each cell, and directions of daughters that have none."""
        cells["polarity_alpha"][:] = self.strength.of_each(cells)
        new = ~cells["polarity"].any(axis=1)
        if new.any():
            drawn = directions.beginnings(numerics.seed, cells["id"][new], self.normal)
            cells["polarity"][new] = drawn

    def surround(self, environment: Environment) -> None:
        """Raise ValueError if cells are to move along walls that there are not."""
        if self.where == "wall" and environment.confinement is None:
            message = (
                "polarity.where = 'wall' with no confinement: no cell would ever move; give the "
                "scene a confinement, or take 'everywhere' or 'free'"
            )
            raise ValueError(message)

    def senses(self, step: Step) -> bool:
        """Whether a multiple of `look_every` is in the step."""
        due = np.ceil(step.time / self.look_every - 1e-9) * self.look_every
        return self.looks and bool(due < step.time + step.dt * (1 - 1e-9))

    def update(self, cells: CellTable, step: Step, forces: Forces) -> None:
        """Look around if it is time, add the drift, and turn p."""
        p, share = cells["polarity"], cells["polarity_share"]
        if step.surroundings is not None and self.senses(step):
            share[:] = self._share(step.surroundings)
            cells["polarity_pull"][:] = self._pull(cells, step, step.surroundings)
        forces.drift[:] -= (cells["polarity_alpha"] * share)[:, None] * p
        p[:] = self.turned(p, cells["polarity_pull"], cells["id"], step)

    def turned(self, p: Floats, pull: Floats, ids: NDArray[np.uint64], step: Step) -> Floats:
        """Directions (N, 3) after a step: half of the alignment, diffusion, the other half."""
        normal = self.normal
        if "direction" in self.align:
            pull = pull + self.align["direction"] * directions.unit(np.asarray(self.direction))
        pull = directions.within(pull, normal)
        if pull.any():
            p = directions.aligned(p, pull, step.dt / 2)
        if self.diffusion > 0:
            u = directions.normals(directions.TURNS, step.seed, step.number, ids)
            p = directions.diffused(p, u, self.diffusion * step.dt, normal)
        return directions.aligned(p, pull, step.dt / 2) if pull.any() else p

    def _share(self, around: Surroundings) -> Floats:
        """(N,) s."""
        if self.where == "free":
            return around.exposed
        if self.where == "wall":
            return (around.nearness >= NEAR).astype(float)
        return np.ones(len(around.centroid))

    def _pull(self, cells: CellTable, step: Step, around: Surroundings) -> Floats:
        """(N, 3) Σ β_k e_k of what cells look at."""
        pull = np.zeros((len(cells), 3))
        cues = {
            "velocity": self._velocity, "neighbours": self._neighbours,
            "contacts": self._contacts, "attractant": self._attractant,
        }  # fmt: skip
        for cue, look in cues.items():
            if cue in self.align:
                pull += self.align[cue] * look(cells, step, around)
        return np.nan_to_num(pull)  # cells without volume are nowhere

    def _velocity(self, cells: CellTable, step: Step, around: Surroundings) -> Floats:
        seen, now = cells["polarity_seen"], np.column_stack(
            [around.centroid, np.full(len(cells), step.forces_at)]
        )  # fmt: skip
        gone, time = now[:, :3] - seen[:, :3], now[:, 3:] - seen[:, 3:]
        seen[:] = now
        velocity = gone / np.where(time > 0, time, np.nan)
        speed = np.linalg.norm(velocity, axis=1, keepdims=True)
        own = cells["polarity_alpha"][:, None] * cells["polarity_share"][:, None] / step.tau
        return np.asarray(np.nan_to_num(velocity / np.maximum(np.maximum(own, speed), LEAST)))

    def _neighbours(self, cells: CellTable, step: Step, around: Surroundings) -> Floats:
        return _summed(around, cells["polarity"][around.contacts[1]])

    def _contacts(self, cells: CellTable, step: Step, around: Surroundings) -> Floats:
        cell, neighbour, _ = around.contacts
        away = directions.unit(around.between(neighbour, cell))
        return _summed(around, away)

    def _attractant(self, cells: CellTable, step: Step, around: Surroundings) -> Floats:
        assert self.attractant is not None
        radius = np.cbrt(3 * np.maximum(step.volumes, 0) / (4 * np.pi))
        slope = np.zeros((len(cells), 3))
        for axis in range(3):
            ahead, behind = around.centroid.copy(), around.centroid.copy()
            ahead[:, axis] += radius
            behind[:, axis] -= radius
            slope[:, axis] = self.attractant(*ahead.T) - self.attractant(*behind.T)
        known = np.asarray(np.isfinite(around.centroid).all(axis=1))
        if not np.isfinite(slope[known]).all():
            message = "polarity.attractant is not finite at some cell"
            raise ValueError(message)
        return directions.unit(np.where(known[:, None], slope, 0))

    def concern(self, conditions: Conditions) -> Concern | None:
        """The worst of what may be wrong: cells that go too far in a step, or turn too much."""
        alpha = self.strength.largest(conditions.types)
        too_fast = steady_drift.too_fast(f"polarity.alpha = {alpha:g}", alpha, conditions)
        found = [too_fast, self._turns(conditions), self._blind(conditions)]
        worst = max(filter(None, found), key=lambda concern: concern.excess)
        return worst if worst.excess > 1 else None

    def _turns(self, conditions: Conditions) -> Concern:
        """Cells that turn much while they go straight on."""
        dt, rate = conditions.numerics.dt, self.diffusion * (2 if self.plane is None else 1)
        return Concern(
            rate * dt / LARGEST_TURN,
            f"polarity.diffusion = {self.diffusion:g} makes cells forget where they go within "
            f"{1 / max(rate * dt, LEAST):.2g} steps of numerics.dt = {dt:g}: take at least "
            f"{1 / LARGEST_TURN:g}, by a smaller dt or diffusion",
        )

    def _blind(self, conditions: Conditions) -> Concern:
        """Cells that follow each other, or themselves, by what they have seen long ago."""
        rate, cue = max((abs(self.align.get(cue, 0.0)), cue) for cue in ("neighbours", "velocity"))
        return Concern(
            rate * max(self.look_every, conditions.numerics.dt) / MOST_BLIND,
            f"polarity.align.{cue} = {self.align.get(cue, 0.0):g} has cells turn to what they saw "
            f"up to polarity.look_every = {self.look_every:g} ago: it may swing. Take look_every "
            f"and dt of at most {MOST_BLIND / max(rate, LEAST):.2g}, or a smaller rate",
        )


def _direction(name: str, value: Sequence[float], normal: Floats | None) -> Floats:
    """Vector of length 1, within the plane; ValueError if there is none."""
    vector = directions.unit(directions.within(_validate.direction(name, value)[None], normal))[0]
    if not vector.any():
        message = f"{name} = {_validate.brief(value)} is normal to polarity.plane: no part is in it"
        raise ValueError(message)
    return np.asarray(vector)


def _summed(around: Surroundings, vectors: Floats) -> Floats:
    """(N, 3) sums over contacts of a (Q, 3) vector each, times the share of the cell's surface."""
    cell, _, area = around.contacts
    share = area / around.surface[cell]
    count = len(around.centroid)
    return np.stack([np.bincount(cell, share * v, count) for v in vectors.T], axis=1)
