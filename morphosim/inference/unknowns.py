"""What is asked for: tensions, attractions and the like as a vector of numbers."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from morphosim import _validate
from morphosim.physics.attraction import Attraction
from morphosim.physics.parameters import Physics

Floats = NDArray[np.float64]
GAMMA, SIGMA = ("cell", "type"), ("pair", "type", "all")
STEPS = {"gamma": 0.05, "sigma": 0.05, "M": 0.05}
"""By how much an unknown is changed to see what follows: γ and M' by this share, σ by this times
four times the mean γ."""
SPREAD = 1.0
"""Standard deviation that is taken for granted of what an image does not tell: of the logarithm of
γ and M', and of σ over four times the mean γ."""


@dataclass(frozen=True, slots=True)
class Unknown:
    """One number that is asked for.

    Attributes
    ----------
    kind : {"gamma", "sigma", "M"}
    of : tuple of names
        The cell or type of a tension, both of an attraction.
    cells : tuple of int
        Cells that have this tension.
    """

    kind: str
    of: tuple[str, ...] = ()
    cells: tuple[int, ...] = ()

    @property
    def name(self) -> str:
        """As results call it: "gamma ABpl", "sigma ABpl-E"."""
        return " ".join(part for part in (self.kind, "-".join(self.of)) if part)


@dataclass(frozen=True, slots=True, kw_only=True)
class Unknowns:
    """All numbers that are asked for, and what they make of the physics.

    The vector holds ln γ/γ̄ (and ln M'/M'₀), and σ over four times γ̄, the mean tension.

    Attributes
    ----------
    each : sequence of Unknown
    names, types : of the cells
    tensions : γ of each cell, where it is not asked for
    physics : what is given
    gauge : bool
        Whether the mean γ of the cells is held: a still image tells ratios only.
    """

    each: Sequence[Unknown]
    names: Sequence[str]
    types: Sequence[str]
    tensions: Sequence[float]
    physics: Physics
    gauge: bool

    @property
    def mean(self) -> float:
        """γ̄, the mean of the tensions that are given, or held."""
        return float(np.mean(self.tensions))

    @property
    def scale(self) -> float:
        """σ of which the vector holds 1: four times the mean tension."""
        return 4 * self.mean

    def _are(self, kind: str) -> NDArray[np.bool_]:
        return np.array([unknown.kind == kind for unknown in self.each], bool)

    @property
    def start(self) -> Floats:
        """Where a search begins: all tensions alike, and all attractions the default one."""
        sigma = self.physics.attraction.default or 2 * self.mean
        return np.where(self._are("sigma"), sigma / self.scale, 0.0)

    @property
    def lowest(self) -> Floats:
        """Lower bounds: an attraction is not below 0."""
        return np.where(self._are("sigma"), 0.0, -np.inf)

    @property
    def steps(self) -> Floats:
        """By how much each is changed to see what follows."""
        return np.array([STEPS[unknown.kind] for unknown in self.each])

    @property
    def held(self) -> Floats:
        """(N,) direction that nothing determines where the mean γ is held, else zeros."""
        if not self.gauge:
            return np.zeros(len(self.each))
        return np.array([float(len(u.cells)) if u.kind == "gamma" else 0.0 for u in self.each])

    def values(self, vector: Floats) -> Floats:
        """γ, σ and M' themselves."""
        out = np.where(self._are("sigma"), vector * self.scale, 0.0)
        strength = self.physics.volume_strength
        out = np.where(self._are("M"), strength * np.exp(vector), out)
        gammas = self._tensions(vector)
        for k, unknown in enumerate(self.each):
            if unknown.kind == "gamma":
                out[k] = gammas[unknown.cells[0]]
        return out

    def slopes(self, vector: Floats) -> Floats:
        """(n, n) derivative of `values` by the vector."""
        step = 1e-6 * np.eye(len(vector))
        return np.stack(
            [(self.values(vector + d) - self.values(vector - d)) / 2e-6 for d in step], axis=1
        )

    def _tensions(self, vector: Floats) -> Floats:
        """(N,) γ of each cell."""
        gammas = np.array(self.tensions, float)
        for value, unknown in zip(vector, self.each, strict=True):
            if unknown.kind == "gamma":
                gammas[list(unknown.cells)] = self.mean * np.exp(value)
        return gammas * (self.mean / gammas.mean() if self.gauge else 1.0)

    def applied(self, vector: Floats) -> tuple[Floats, Physics]:
        """Tension of each cell, and the physics with these attractions."""
        values = self.values(vector)
        table: dict[str, Any] = {"pairs": {}, "types": {}}
        changes: dict[str, Any] = {}
        given = self.physics.attraction
        for value, unknown in zip(values.tolist(), self.each, strict=True):
            if unknown.kind == "M":
                changes["M"] = value
            elif unknown.kind == "sigma" and unknown.of:
                table["pairs" if unknown.cells else "types"][unknown.of] = value
            elif unknown.kind == "sigma":
                given = Attraction(default=value)
        pairs = _without(given.pairs, table["pairs"]) | table["pairs"]
        types = _without(given.types, table["types"]) | table["types"]
        changes["sigma"] = replace(given, pairs=pairs, types=types)
        return self._tensions(vector), replace(self.physics, **changes)


def _without(
    given: Mapping[tuple[str, str], float], asked: Mapping[tuple[str, str], float]
) -> dict[tuple[str, str], float]:
    """What is given of other pairs than those asked for, in either order."""
    return {(a, b): v for (a, b), v in given.items() if not {(a, b), (b, a)} & asked.keys()}


def unknowns_of(
    names: Sequence[str], types: Sequence[str], tensions: Sequence[float], physics: Physics,
    contacts: Sequence[tuple[int, int]], *, gamma: str | None, sigma: str | None, M: bool,
    still: bool,
) -> Unknowns:  # fmt: skip
    """What is asked for, of cells that touch so.

    Raises
    ------
    ValueError
        A choice is not known; nothing is asked for; or there are no contacts whose σ is asked for.
    """
    if gamma is not None:
        _validate.choice("gamma", gamma, GAMMA)
    if sigma is not None:
        _validate.choice("sigma", sigma, SIGMA)
    if sigma is not None and not contacts:
        message = "sigma is asked for, but no two cells touch; leave out sigma"
        raise ValueError(message)
    each = _tensions_asked(names, types, gamma) + _attractions_asked(names, types, contacts, sigma)
    each += [Unknown("M")] if M else []
    if not each:
        message = "nothing is asked for; give gamma = 'cell' or sigma = 'pair', for example"
        raise ValueError(message)
    scaled = sigma is not None or not physics.attraction.present
    if physics.attraction.sisters is not None and sigma in {"type", "all"}:
        physics = replace(physics, sigma=replace(physics.attraction, sisters=None))
    return Unknowns(
        each=each, names=names, types=types, tensions=tensions, physics=physics,
        gauge=gamma is not None and still and scaled,
    )  # fmt: skip


def _tensions_asked(names: Sequence[str], types: Sequence[str], gamma: str | None) -> list[Unknown]:
    if gamma == "cell":
        return [Unknown("gamma", (name,), (k,)) for k, name in enumerate(names)]
    kinds = sorted(set(types)) if gamma == "type" else []
    return [
        Unknown("gamma", (kind,), tuple(k for k, t in enumerate(types) if t == kind))
        for kind in kinds
    ]


def _attractions_asked(
    names: Sequence[str], types: Sequence[str], contacts: Sequence[tuple[int, int]],
    sigma: str | None,
) -> list[Unknown]:  # fmt: skip
    if sigma == "pair":
        return [Unknown("sigma", (names[i], names[j]), (i, j)) for i, j in contacts]
    if sigma == "all":
        return [Unknown("sigma")]
    pairs = {tuple(sorted((types[i], types[j]))) for i, j in contacts} if sigma else set()
    return [Unknown("sigma", (a, b)) for a, b in sorted(pairs)]
