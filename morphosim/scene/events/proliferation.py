"""Cells divide by rule."""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from morphosim import _validate
from morphosim._shown import short_repr
from morphosim.geometry.phase_field import least_volume
from morphosim.measure.measurement import centroids_and_axes
from morphosim.physics.contractile_ring import require_ring
from morphosim.scene.events.living import (
    BORN,
    COURSE,
    DYING,
    GENERATION,
    Floats,
    Mask,
    check_conditions,
    check_types,
    picked,
    rehearse_types,
    spread_out,
    uniform,
)
from morphosim.scene.target import Foreseen, Target

AXES = ("long", "short", "random", "outward", "tangential")
LEAST_SHARE = 0.1
"""Shares are drawn between this and 1 less this."""
ROOM = 2.0
"""A daughter's share must be so many times what the lattice can just resolve."""
NUMBERED = re.compile(r"(?P<founder>.+)\.(?P<number>[1-9][0-9]*)")
"""Name that a rule gives: daughters of a are a.2 and a.3; those of a.2 a.4 and a.5, and so on."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Proliferation:
    """Cells divide, each into two that are named and numbered by themselves.

    A cell divides if it meets all conditions that are given, of which there is at least one but
    `neighbours`; it must also be so large that the lattice can resolve its daughters. Cells that
    are frozen or die do not.

    Attributes
    ----------
    volume : float, optional
        ∫ φ in µm³ from which on a cell divides.
    age : float, optional
        *In silico* time since its birth at which it does.
    rate : float, optional
        Chance per unit of time that it does.
    when : function of a simulation, optional
        Gives (N,) bool, one for each cell.
    spread : float
        Standard deviation of the volumes and ages at which cells divide, in their mean. Each cell
        draws its own once, from a lognormal distribution.
    neighbours : int, optional
        A cell with more neighbours in contact does not divide.
    axis : {"long", "short", "random", "outward", "tangential"}, (3,) or function
        Along which daughters lie: the longest or shortest principal axis of the cell, a direction
        by chance, away from the middle of all cells, one by chance across that, always the same
        one, or what a function of the simulation and the rows (n,) of the mothers gives, (n, 3).
    share : float
        Share of the volume that the first daughter gets.
    share_spread : float
        Standard deviation of that share, which is normal and cut off at 0.1 and 0.9.
    into : (str, str) or mapping from type to (str, str), optional
        Types of the daughters, or those of mothers of a type; else they have their mother's.
    probability : float
        Chance that a division is `into` these types.
    over : float
        *In silico* time within which a contractile ring draws in the furrow; see `Division`.
    types : types of the cells that divide; () are all.
    """

    volume: float | None = None
    age: float | None = None
    rate: float | None = None
    when: Callable[[Any], ArrayLike] | None = None
    spread: float = 0.0
    neighbours: int | None = None
    axis: str | Sequence[float] | Callable[[Any, Any], ArrayLike] = "long"
    share: float = 0.5
    share_spread: float = 0.0
    into: Sequence[str] | Mapping[str, Sequence[str]] | None = None
    probability: float = 1.0
    over: float = 0.0
    types: Sequence[str] = ()

    columns = (GENERATION, BORN, *COURSE, DYING)
    divides = True

    __repr__ = short_repr

    def __post_init__(self) -> None:
        check_conditions("proliferation", self.rate, self.age, self.spread, self.when)
        if self.volume is not None:
            _validate.number("proliferation: volume", self.volume, above=0)
        if all(getattr(self, key) is None for key in ("volume", "age", "rate", "when")):
            message = "proliferation: nothing says who divides; give volume, age, rate or when"
            raise ValueError(message)
        if self.neighbours is not None:
            _validate.integer("proliferation: neighbours", self.neighbours, least=0)
        least, most = LEAST_SHARE, 1 - LEAST_SHARE
        _validate.number("proliferation: share", self.share, least=least, most=most)
        _validate.number("proliferation: share_spread", self.share_spread, least=0, most=0.5)
        _validate.number("proliferation: probability", self.probability, least=0, most=1)
        _validate.number("proliferation: over", self.over, least=0)
        self._check_axis()
        object.__setattr__(self, "into", _kinds(self.into))
        object.__setattr__(self, "types", check_types("proliferation", self.types))

    def _check_axis(self) -> None:
        if isinstance(self.axis, str):
            _validate.choice("proliferation: axis", self.axis, AXES)
        elif callable(self.axis):
            _validate.function("proliferation: axis", self.axis, 2)
        elif np.abs(_validate.vector("proliferation: axis", self.axis)).max() < _validate.SMALLEST:
            message = f"proliferation: axis = {_validate.brief(self.axis)} has no direction"
            raise ValueError(message)

    @property
    def makes(self) -> tuple[str, ...]:
        """See `Event`."""
        pairs = self.into.values() if isinstance(self.into, Mapping) else (self.into or (),)
        return tuple(chain.from_iterable(pairs))

    def rehearse(self, rehearsal: Foreseen) -> None:
        """See `Event`; who divides is not known."""
        rehearse_types("proliferation", self.types, rehearsal)
        if self.over:
            require_ring(rehearsal.physics.terms, "proliferation: over")
        if isinstance(self.into, Mapping):
            for kind in self.into:
                rehearsal.check_type("proliferation: into", kind)
        alive = set(rehearsal.names)
        for name in rehearsal.names:
            found = NUMBERED.fullmatch(name)
            if found and found["founder"] in alive:
                message = (
                    f"cell {name!r} has a name that a descendant of {found['founder']!r} may get "
                    "by proliferation; give it one that does not end in a number after a point"
                )
                raise ValueError(message)
        rehearsal.surprise(self)

    def apply(self, simulation: Target) -> None:
        """Divide the cells that are due."""
        rows = np.flatnonzero(self._due(simulation))
        shares = np.full(len(rows), float(self.share))
        if self.share_spread:
            shares += self.share_spread * simulation.chance("proliferation: share")[rows, 0]
            shares = np.clip(shares, LEAST_SHARE, 1 - LEAST_SHARE)
        smaller = np.minimum(shares, 1 - shares) * simulation.volumes[rows]
        large = smaller >= ROOM * least_volume(simulation.spacing)
        rows, shares = rows[large], shares[large]
        if len(rows):
            simulation.divide_cells(
                simulation.column("name")[rows].tolist(), axes=self._axes(simulation, rows),
                fractions=shares, types=self._types(simulation, rows), over=self.over,
            )  # fmt: skip

    def _due(self, simulation: Target) -> Mask:
        """Which cells divide (N,), if the lattice can resolve their daughters."""
        ready = simulation.ready(self.types)
        if self.volume is not None:
            normals = simulation.chance("proliferation: volume")[:, 0]
            ready &= simulation.volumes >= spread_out(self.volume, self.spread, normals)
        due = picked(
            simulation, "proliferation", ready,
            rate=self.rate, age=self.age, spread=self.spread, when=self.when,
        )  # fmt: skip
        if self.neighbours is not None and due.any():
            pairs = simulation.measured().contacts
            due &= np.bincount(pairs.ravel(), minlength=len(due)) <= self.neighbours
        return due

    def _axes(self, simulation: Target, rows: NDArray[np.int64]) -> Floats:
        """Axes of division (n, 3) of the cells of these rows."""
        drawn = simulation.chance("proliferation: axis")[rows]
        if callable(self.axis):
            return _given_axes(self.axis(simulation, rows), len(rows))
        if not isinstance(self.axis, str):
            return np.tile(np.asarray(self.axis, float), (len(rows), 1))
        if self.axis == "random":
            return drawn
        names = simulation.column("name")[rows].tolist()
        centres, principal = centroids_and_axes(
            [simulation.field(name) for name in names], simulation.spacing
        )
        if self.axis in ("long", "short"):
            # either way along it, by chance: its sign means nothing
            return np.asarray(principal[:, 0 if self.axis == "long" else 2] * _signs(drawn))
        outward = centres - _middle(simulation)
        if self.axis == "outward":
            return np.where(_length(outward) > 0, outward, drawn)
        across = np.cross(outward, drawn)
        return np.where(_length(across) > 0, across, drawn)

    def _types(self, simulation: Target, rows: NDArray[np.int64]) -> list[tuple[str, str]] | None:
        """Types of the daughters of each of these cells."""
        if self.into is None:
            return None
        drawn = uniform(simulation.chance("proliferation: into")[rows])
        kinds = simulation.types
        types: list[tuple[str, str]] = []
        for row, number in zip(rows.tolist(), drawn.tolist(), strict=True):
            own = kinds[row]
            pair = self.into.get(own) if isinstance(self.into, Mapping) else self.into
            first, second = pair if pair is not None and number < self.probability else (own, own)
            types.append((first, second))
        return types


def _kinds(into: Any) -> Any:
    """Types of daughters, checked."""
    where = "proliferation: into"
    if into is None:
        return None
    if not isinstance(into, Mapping):
        return _validate.labels(where, into, 2, empty=True)
    for kind in into:
        _validate.label(f"{where}: type of the mother", kind, empty=True)
    return {
        kind: _validate.labels(f"{where}[{kind!r}]", pair, 2, empty=True)
        for kind, pair in into.items()
    }


def _given_axes(given: Any, count: int) -> Floats:
    axes = _validate.array("proliferation: axes that the function gives", given, (count, 3))
    if (np.abs(axes).max(axis=1, initial=0) < _validate.SMALLEST).any():
        message = "proliferation: an axis that the function gives has no direction"
        raise ValueError(message)
    return axes


def _signs(drawn: Floats) -> Floats:
    """1 or -1 (n, 1), by chance."""
    return np.where(drawn[:, :1] < 0, -1.0, 1.0)


def _length(vectors: Floats) -> Floats:
    return np.asarray(np.linalg.norm(vectors, axis=1, keepdims=True))


def _middle(simulation: Target) -> Floats:
    """Mean place (3,) of the boxes of all cells, µm: about that of the cells, at no cost."""
    centres = simulation.column("origin") + simulation.column("shape") / 2
    return np.asarray(centres.mean(axis=0) * simulation.spacing)
