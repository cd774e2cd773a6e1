"""Axes of a scan, and the members that they make."""

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from morphosim import _validate
from morphosim._shown import short_repr
from morphosim.numerics.parameters import LARGEST_SEED

VALUE = "{value}"
"""Stands for the axis' value in what an axis sets."""
SAMPLINGS = ("sobol", "latin")
SAMPLE, REPLICATE, SEED = "sample", "replicate", "numerics.seed"
THREADS = "numerics.threads"
MOST_MEMBERS = 10**6
Settings = dict[str, Any]
"""Values by dotted key, as `load_scene` takes them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Axis:
    """Values that are all taken, each together with all of the other axes.

    Attributes
    ----------
    values : sequence
        Numbers, texts, or whatever a scene file may say at that place.
    sets : str or mapping, optional
        Dotted key that gets the value; or what each of several keys gets, where "{value}" stands
        for the value. By default the axis' name is the key.
    """

    values: Sequence[Any]
    sets: str | Mapping[str, Any] | None = None

    __repr__ = short_repr


@dataclass(frozen=True, slots=True, kw_only=True)
class Range:
    """Numbers between two bounds, sampled together with those of all other ranges.

    Attributes
    ----------
    low, high : float
    log : bool
        Whether their logarithms are spread evenly.
    sets : str or mapping, optional
        See `Axis`.
    """

    low: float
    high: float
    log: bool = False
    sets: str | Mapping[str, Any] | None = None

    __repr__ = short_repr

    def at(self, share: NDArray[np.float64]) -> NDArray[np.float64]:
        """Values at shares, 0 to 1, of the range."""
        if self.log:
            return np.asarray(self.low * (self.high / self.low) ** share)
        return np.asarray(self.low + (self.high - self.low) * share)


@dataclass(frozen=True, slots=True)
class Member:
    """One run of a scan: its number and the settings it differs by."""

    number: int
    settings: Settings

    __repr__ = short_repr


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """All members of a scan.

    Attributes
    ----------
    grid : mapping from name to Axis
        One dimension each.
    ranges : mapping from name to (samples,) values
        Together the dimension `sample`.
    sets : mapping from name to what the axis sets
    replicates : int
        Runs of the same settings with other seeds: the dimension `replicate`.
    seed : int
        Seed of the first replicate.
    fixed : settings of all members
    """

    grid: Mapping[str, Axis]
    ranges: Mapping[str, Sequence[float]]
    sets: Mapping[str, str | Mapping[str, Any]]
    replicates: int = 1
    seed: int = 0
    fixed: Settings = field(default_factory=dict)

    __repr__ = short_repr

    @property
    def sizes(self) -> dict[str, int]:
        """Dimensions of the scan."""
        sizes = {name: len(axis.values) for name, axis in self.grid.items()}
        if self.ranges:
            sizes[SAMPLE] = len(next(iter(self.ranges.values())))
        if self.replicates > 1:
            sizes[REPLICATE] = self.replicates
        return sizes

    @property
    def members(self) -> list[Member]:
        """All members, the last dimension fastest."""
        places = product(*(range(n) for n in self.sizes.values()))
        return [Member(k, self._settings(place)) for k, place in enumerate(places)]

    def _settings(self, place: tuple[int, ...]) -> Settings:
        at = dict(zip(self.sizes, place, strict=True))
        values = {name: axis.values[at[name]] for name, axis in self.grid.items()}
        values |= {name: sampled[at[SAMPLE]] for name, sampled in self.ranges.items()}
        settings = dict(self.fixed)
        for name, value in values.items():
            settings |= settings_of(self.sets[name], value)
        if self.replicates > 1:
            settings[SEED] = self.seed + at[REPLICATE]
        return settings

    def trials(self) -> Iterator[tuple[str, Any, Settings]]:
        """Axis, value and settings, once for every value, the other axes at their first."""
        choices = {name: list(axis.values) for name, axis in self.grid.items()}
        choices |= {name: [min(v), max(v)] for name, v in self.ranges.items()}
        first = dict(self.fixed)
        for name, values in choices.items():
            first |= settings_of(self.sets[name], values[0])
        for name, values in choices.items():
            for value in values:
                yield name, value, first | settings_of(self.sets[name], value)

    def coordinates(self) -> dict[str, tuple[str, NDArray[Any]]]:
        """Dimension and values of every coordinate."""
        found = {name: (name, labels(axis.values)) for name, axis in self.grid.items()}
        found |= {name: (SAMPLE, np.array(values)) for name, values in self.ranges.items()}
        if self.replicates > 1:
            found["seed"] = (REPLICATE, self.seed + np.arange(self.replicates))
        return found

    def description(self) -> dict[str, Any]:
        """What tells this plan from another, as JSON can hold it."""
        axes = {name: list(axis.values) for name, axis in self.grid.items()}
        axes |= {name: list(values) for name, values in self.ranges.items()}
        return {
            "axes": axes, "sets": dict(self.sets), "replicates": self.replicates,
            "seed": self.seed, "overrides": self.fixed,
        }  # fmt: skip


def settings_of(sets: str | Mapping[str, Any], value: Any) -> Settings:
    """Settings that an axis makes of one of its values."""
    if isinstance(sets, str):
        return {sets: value}
    return {key: _filled(template, value) for key, template in sets.items()}


def _filled(template: Any, value: Any) -> Any:
    """Template with the value where it says "{value}"."""
    if isinstance(template, str):
        return value if template == VALUE else template
    if isinstance(template, Mapping):
        return {key: _filled(item, value) for key, item in template.items()}
    if isinstance(template, list | tuple):
        return [_filled(item, value) for item in template]
    return template


def labels(values: Sequence[Any]) -> NDArray[Any]:
    """Values as a coordinate: numbers and texts as they are, anything else as JSON."""
    if all(isinstance(v, int | float) and not isinstance(v, bool) for v in values):
        return np.array(values)
    texts = [v if isinstance(v, str) else json.dumps(v) for v in values]
    return np.array(texts, dtype=object)


def make_plan(
    axes: Mapping[str, Any],
    *,
    replicates: int,
    samples: int | None,
    sampling: str,
    sample_seed: int,
    seed: int,
    fixed: Settings,
) -> Plan:
    """Plan of a scan; see `sweep`.

    Raises
    ------
    ValueError
        An axis is empty or has a value twice, two axes set the same key, or samples are missing.
    """
    _validate.instance("axes", axes, Mapping)
    if not axes:
        message = "axes is empty; a scan needs at least one, such as {'physics.gamma': [0.2, 0.3]}"
        raise ValueError(message)
    _validate.integer("replicates", replicates, least=1, most=MOST_MEMBERS)
    _validate.integer("sample_seed", sample_seed, least=0, most=LARGEST_SEED)
    _validate.integer(SEED, seed, least=0, most=LARGEST_SEED - replicates)
    made = {name: _axis(name, axis) for name, axis in axes.items()}
    sets = {name: name if axis.sets is None else axis.sets for name, axis in made.items()}
    _check_keys(sets, fixed, replicates)
    ranges = {name: axis for name, axis in made.items() if isinstance(axis, Range)}
    plan = Plan(
        grid={name: axis for name, axis in made.items() if isinstance(axis, Axis)},
        ranges=_sampled(ranges, samples, sampling, sample_seed),
        sets=sets, replicates=replicates, seed=seed, fixed=fixed,
    )  # fmt: skip
    count = math.prod(plan.sizes.values())
    if count > MOST_MEMBERS:
        sizes = " x ".join(f"{name} {size}" for name, size in plan.sizes.items())
        message = f"the scan has {count} members ({sizes}); at most {MOST_MEMBERS} are allowed"
        raise ValueError(message)
    return plan


def _axis(name: str, given: Any) -> Axis | Range:
    """Axis as given, or of a plain list of values; checked, its values plain Python."""
    _validate.label("name of an axis", name)
    _check_sets(name, getattr(given, "sets", None))
    if isinstance(given, Range):
        _validate.flag(f"axis {name!r}: log", given.log)
        low = _validate.number(f"axis {name!r}: low", given.low)
        _validate.number(f"axis {name!r}: high", given.high, above=low)
        if given.log:
            _validate.number(f"axis {name!r}: low of a logarithmic range", low, above=0)
        return given
    axis = given if isinstance(given, Axis) else Axis(values=given)
    values = axis.values.tolist() if isinstance(axis.values, np.ndarray) else axis.values
    if isinstance(values, str) or not isinstance(values, Sequence) or not values:
        message = f"axis {name!r} = {_validate.brief(values)}; expected a list of values that is "
        message += "not empty"
        raise ValueError(message)
    values = [v.tolist() if isinstance(v, np.generic | np.ndarray) else v for v in values]
    try:
        _validate.unique(f"axis {name!r}: value", [json.dumps(value) for value in values])
    except TypeError as error:
        message = f"axis {name!r} has a value that a scene file cannot say ({error})"
        raise ValueError(message) from error
    return Axis(values=values, sets=axis.sets)


def _check_sets(name: str, sets: Any) -> None:
    """Raise unless this is a dotted key, or a table of values by dotted key that JSON can hold."""
    if sets is None:
        return
    for key in sets if isinstance(sets, Mapping) else [sets]:
        _validate.label(f"axis {name!r}: key of sets", key)
    try:
        json.dumps(sets)
    except (TypeError, ValueError, RecursionError) as error:
        message = f"axis {name!r} sets {_validate.brief(sets)}, which no file can say ({error})"
        raise ValueError(message) from error


def _check_keys(sets: Mapping[str, Any], fixed: Settings, replicates: int) -> None:
    """Raise ValueError if a key is set twice, an axis sets nothing, or threads are an axis."""
    if THREADS in fixed:
        message = f"overrides set {THREADS}, which threads_per_member does"
        raise ValueError(message)
    owner = dict.fromkeys(fixed, "overrides")
    if replicates > 1:
        owner[SEED] = "replicates"
    for name, target in sets.items():
        keys = [target] if isinstance(target, str) else list(target)
        if not isinstance(target, str) and VALUE not in json.dumps(target):
            message = f"axis {name!r} sets {target!r}, in which {VALUE!r} does not occur"
            raise ValueError(message)
        for key in keys:
            if key == THREADS:
                message = f"axis {name!r}: {key} is no axis; threads_per_member sets it"
                raise ValueError(message)
            if key in owner:
                message = f"axis {name!r} sets {key}, and so do {owner[key]}; leave one of them out"
                raise ValueError(message)
            owner[key] = f"axis {name!r}"


def _sampled(
    ranges: Mapping[str, Range], samples: int | None, sampling: str, seed: int
) -> dict[str, list[float]]:
    """Values of all ranges at the points of a Sobol sequence or a Latin hypercube."""
    _validate.choice("sampling", sampling, SAMPLINGS)
    if not ranges or samples is None:
        if bool(ranges) != (samples is not None):
            names = ", ".join(ranges) or "no axis is a range"
            message = f"samples = {samples}: ranges and a number of samples go together ({names})"
            raise ValueError(message)
        return {}
    samples = _validate.integer("samples", samples, least=1, most=MOST_MEMBERS)
    from scipy.stats import qmc

    if sampling == "sobol" and samples & (samples - 1):
        message = (
            f"samples = {samples}: a Sobol sequence is even for powers of two alone; take "
            f"{1 << samples.bit_length() - 1} or {1 << samples.bit_length()}, or sampling = 'latin'"
        )
        raise ValueError(message)
    kind = qmc.Sobol if sampling == "sobol" else qmc.LatinHypercube
    points = kind(len(ranges), seed=seed).random(samples)
    return {name: axis.at(points[:, k]).tolist() for k, (name, axis) in enumerate(ranges.items())}
