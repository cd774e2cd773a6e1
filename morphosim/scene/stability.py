"""What is stable and right, told before the first step: where `Numerics` meets `Physics`.

What a step takes explicitly relaxes φ at a rate f / τ: the walls (g_e φ_e²), other cells (g Σ φ²)
and the double well (2γc at φ = 0 and 1), or the volume constraint (M' A / V, A the surface). Each
force term tells its own (`Term.explicit_rate`, `Term.whole_cell_rate`). A perturbation flips its
sign at every step and grows unless

    S > 3/4 f - τ/δt   ("bdf2", Eq. 9)        S > 1/2 f - τ/δt   ("imex1", Eq. 8)

which follows from φⁿ⁺¹ = -φⁿ in Eq. 9 and 8 with the force -f φ and no diffusion. "euler" has no S;
its diffusion is explicit too: δt < 2τ / (f + γ k²), k² the largest eigenvalue of -Δ (18.1 / h²).
`benchmarks/stability.py` measures how well this holds, and the limits of what has no such theory.

What is stable may be late. In Eq. 9 S multiplies φⁿ⁺¹ - 2φⁿ + φⁿ⁻¹ ≈ δt² φ'': an inertia, by which
velocities follow forces with a lag of L = S δt²/τ. In Eq. 8 S multiplies φⁿ⁺¹ - φⁿ ≈ δt φ': a
viscosity, which makes time run 1 + S δt/τ times slower. Of the way that a constant force makes in a
time T, (1 - exp(-T/L)) L/T, or S δt / (τ + S δt), is missing at the end. What swings is off by
exp(-T / 2L), which is less (`benchmarks/stability.py --lag`).
"""

from collections.abc import Callable, Sequence

import numpy as np

from morphosim.errors import warn
from morphosim.geometry.phase_field import lattice_field, share_outside
from morphosim.numerics.chebyshev import largest_eigenvalue
from morphosim.numerics.schemes import SHARES, stabilisation
from morphosim.physics.confinement_repulsion import is_resolved
from morphosim.physics.parameters import Physics
from morphosim.physics.term import Concern, Conditions
from morphosim.scene.cell import Cell, tensions
from morphosim.scene.scene import Scene

COARSEST = 1.5
"""Largest √(2c) h: the profile's tail falls by exp(-√(2c) h) from one lattice point to the next."""


NOT_PRESSED = {"bdf2": 1.4, "imex1": 0.8}
"""By how much S may be less than `least_S`, by scheme, where walls do not press the cells.

The eight-cell embryo needs 1.6 to 1.7 less, or 0.9 to 1.2 with "imex1" (docs/stability.md).
"""
MOST_OUTSIDE = 0.04
"""Share of ∫ φ that may start beyond walls that do not press.

It is 0.025 of the embryo's cells. Two balls between stepped walls at δt = 2 are stable at S = 12
with 0.034, at 12.3 with 0.069, and need 13.1 and more from 0.147 on; `least_S` is 13.4.
"""
CLOSED_IN = 0.3
"""Share of the whole cells' rates that adds to those at points in walls from an image.

They close in on cells from all sides. Measured, needed S less `least_S` of balls of 2.2, 3, 5 and
8 µm: 1.6, 1.8, 0.8, 0.8 at most at δt = 2, and 2, 2.2, 1.2, 0.2 with "draft"; this makes it 2.5,
1.8, 1.1 and 0.7.
"""
MISSED = 0.15
"""Share of what changes in a run that may be missing at its end with no warning: T > 6.6 L."""
MOST_MISSED = {"bdf2": 0.9, "imex1": 0.99}
"""Share from which on a run is refused, by scheme; "imex1" with a large S is a known stretch."""
SHORT_LAG = 16.0
"""Lag that is no matter however short the run is, in times τ/2γc in which an interface relaxes.

The preset "draft" has 14. With it two cells of R = 4 µm are off by R / 40 at most.
"""
FAR = 4.0
"""Least lag that a run is refused for, in those that are no matter: no preset comes so far."""
UNTOLD = 10.0
"""Time that a stage is taken to last if only its cells end it, in lags that are no matter."""
GROWTH = 1.15
"""A cell whose target is more than this many times what it starts with grows into its walls."""


class StabilityWarning(UserWarning):
    """A scene is likely to diverge, or to be late; the message says what to change."""


def check(scene: Scene) -> None:
    """Report what is known to fail before it does.

    Raises
    ------
    ValueError
        See `refuse`.

    Warns
    -----
    StabilityWarning
        A combination of physics and numerics is expected to diverge, or to be late.
    """
    refuse(scene)
    for concern in concerns(scene):
        warn(concern, StabilityWarning)


def refuse(scene: Scene) -> None:
    """Raise ValueError if a run cannot be right.

    The lattice does not resolve the interface, and `numerics.allow_coarse` is not set; or steps are
    so long that next to nothing would have moved by the end.
    """
    physics, numerics = scene.physics, scene.numerics
    coarsest = COARSEST / (2 * physics.interface_scale)
    if numerics.spacing > coarsest * (1 + 1e-9) and not numerics.allow_coarse:
        message = (
            f"numerics.spacing = {numerics.spacing:g} µm does not resolve the interface at "
            f"physics.c = {physics.c:g}: at most {COARSEST:g} / √(2c) = {coarsest:.3g} µm is "
            "allowed. Take that, or numerics.allow_coarse = true"
        )
        raise ValueError(message)
    if is_late(scene, MOST_MISSED.get(numerics.scheme, 1.0), FAR):
        raise ValueError(_late(scene))


def concerns(scene: Scene) -> list[str]:
    """What is likely to go wrong, in words."""
    found = (
        _euler_step(scene), _late(scene), _stabilisation(scene), *_concerns_of_terms(scene)
    )  # fmt: skip
    return [text for text in found if text]


def _euler_step(scene: Scene) -> str:
    numerics, limit = scene.numerics, largest_euler_step(scene)
    if numerics.scheme != "euler" or numerics.dt <= limit:
        return ""
    return (
        f"numerics.dt = {numerics.dt:g} is likely to diverge with scheme = 'euler': take at most "
        f"{limit:.2g}, or scheme = 'bdf2'"
    )


def _late(scene: Scene) -> str:
    if not is_late(scene):
        return ""
    what = f"so up to {100 * missed(scene):.0f} % of what changes would be missing at the end"
    return _slow_time(scene, what) if scene.numerics.scheme == "imex1" else _lagging(scene, what)


def _slow_time(scene: Scene, what: str) -> str:
    numerics, tau = scene.numerics, _least_tau(scene)
    return (
        f"numerics.dt = {numerics.dt:g} with S = {numerics.S:g} makes time run 1 + S δt/τ = "
        f"{1 + numerics.S * numerics.dt / tau:.3g} times slower, {what}. Take scheme = 'bdf2', or "
        f"dt times S of at most {_rounded(tau * MISSED / (1 - MISSED), np.floor)}"
    )


def _lagging(scene: Scene, what: str) -> str:
    numerics, span = scene.numerics, _span(scene)
    longest = np.sqrt(max(MISSED * span, short_lag(scene)) * _least_tau(scene) / numerics.S)
    least = _rounded(lag(scene) / MISSED, np.ceil)
    short, enough = f"a run of {span:g}", f", or a duration of {least}"
    if scene.stages:
        short = f"stages of {span:.3g} on average" if scene.end else f"stages of about {span:.3g}"
        enough = f", or stages of {least}" if scene.end else ""
    return (
        f"numerics.dt = {numerics.dt:g} is too long for {short}: by S = {numerics.S:g} cells "
        f"follow what pulls them S δt²/τ = {lag(scene):.3g} later, {what}. Take at most "
        f"{_rounded(longest, np.floor)}{enough}"
    )


def _rounded(value: float, to: Callable[[float], float]) -> str:
    """A bound with two digits that is still one, rounded up or down."""
    digit = 10.0 ** (np.floor(np.log10(value)) - 1)
    return f"{to(value / digit) * digit:.4g}"


def _stabilisation(scene: Scene) -> str:
    numerics, needed = scene.numerics, least_S(scene)
    if needed <= numerics.S:
        return ""
    rates, spared = explicit_rates(scene), NOT_PRESSED.get(numerics.scheme, 0.0)
    if "walls" in rates and needed - spared <= numerics.S and not _walls_press(scene):
        return ""
    parts = ", ".join(f"{name} {rate:.3g}" for name, rate in rates.items())
    advice = "a smaller dt, or weaker forces"
    if "walls" in rates and numerics.walls == "stepped":
        advice += ", or walls = 'resolved'"
    return (
        f"numerics.S = {numerics.S:g} may diverge at numerics.dt = {numerics.dt:g}: what acts on "
        f"the cells ({parts}) needs at least {np.ceil(10 * needed) / 10:g}. Take that, {advice}"
    )


def _walls_press(scene: Scene) -> bool:
    """Whether cells start pressed to the walls, or may come to be: they divide, or grow."""
    stepped = [cell for cell in scene.cells if not cell.frozen]
    return bool(scene.stages) or any(_grows(cell) or _is_pressed(cell, scene) for cell in stepped)


def _grows(cell: Cell) -> bool:
    return callable(cell.volume) or cell.target_volume(0.0) > GROWTH * cell.start_volume


def _is_pressed(cell: Cell, scene: Scene) -> bool:
    spacing, scale = scene.numerics.spacing, scene.physics.interface_scale
    origin, phi = lattice_field(cell.shape, cell.name, scale, spacing, cell.start_volume)
    return share_outside(scene.confinement, origin, phi, spacing) > MOST_OUTSIDE


def _concerns_of_terms(scene: Scene) -> list[str]:
    """The worst concern of each kind of term, over all stages."""
    worst: dict[type, Concern] = {}
    for physics, conditions in _courses(scene):
        for term in physics.active_terms:
            concern, kind = term.concern(conditions), type(term)
            if concern and (kind not in worst or concern.excess > worst[kind].excess):
                worst[kind] = concern
    return [concern.text for concern in worst.values()]


def explicit_rates(scene: Scene) -> dict[str, float]:
    """What the scheme takes explicitly and at which rates; their sum is f.

    Those of the stage where they are fastest.
    """
    rates = [_rates(*course) for course in _courses(scene)]
    return max(rates, key=lambda rates: sum(rates.values()))


def _courses(scene: Scene) -> list[tuple[Physics, Conditions]]:
    """All physics that hold in turn, each with what its terms are asked about."""
    rehearsal = scene.rehearsed()
    given = rehearsal.tensions
    return [(physics, _conditions(scene, physics, given)) for physics in rehearsal.courses]


def _conditions(scene: Scene, physics: Physics, given: Sequence[float]) -> Conditions:
    """What force terms are asked about; events give cells the surface tensions `given`."""
    stepped = [cell for cell in scene.cells if not cell.frozen] or list(scene.cells)
    return Conditions(
        tensions=np.array([*tensions(stepped, physics), *given]),
        mean_tension=float(np.mean(tensions(scene.cells, physics))),
        volumes=np.concatenate([_volumes(cell) for cell in stepped]),
        types=scene.possible_types,
        several=len(scene.possible_names) > 1,
        staged=bool(scene.stages),
        tau=physics.tau,
        interface_scale=physics.interface_scale,
        numerics=scene.numerics,
        confinement=scene.confinement,
    )


def _volumes(cell: Cell) -> list[float]:
    """Target volumes that a cell has at the start and is known to come to, µm³."""
    return [cell.target_volume(0.0), *getattr(cell.volume, "volumes", ())]


def _rates(physics: Physics, conditions: Conditions) -> dict[str, float]:
    """Rates at a point, or of cells as a whole, whichever are faster together."""
    terms = physics.active_terms
    at_points = [(term.name, term.explicit_rate(conditions)) for term in terms]
    of_cells = [(term.name, term.whole_cell_rate(conditions)) for term in terms]
    return max(_summed(at_points), _summed(of_cells), key=lambda rates: sum(rates.values()))


def _summed(rates: list[tuple[str, float]]) -> dict[str, float]:
    """Rates by name of the term, without those that are 0."""
    return {
        name: sum(rate for other, rate in rates if other == name)
        for name in dict.fromkeys(name for name, rate in rates if rate > 0)
    }


def explicit_rate(scene: Scene) -> float:
    """The rate f."""
    return sum(explicit_rates(scene).values())


def least_S(scene: Scene) -> float:
    """Least S that is expected to be stable; 0 for "euler", which has none."""
    dt, scheme = scene.numerics.dt, scene.numerics.scheme
    return max(
        stabilisation(sum(_rates(*course).values()), dt, course[0].tau, scheme)
        for course in _courses(scene)
    )


def lag(scene: Scene) -> float:
    """*In silico* time by which "bdf2" lets velocities follow forces, S δt²/τ (see above)."""
    numerics = scene.numerics
    return numerics.S * numerics.dt**2 / _least_tau(scene)


def missed(scene: Scene) -> float:
    """Share of what changes in the run, or a stage, that S may make it miss at its end, at most."""
    numerics, end = scene.numerics, _span(scene)
    if end == 0 or numerics.S == 0 or numerics.scheme == "euler":
        return 0.0
    if numerics.scheme == "imex1":
        return 1 - 1 / (1 + numerics.S * numerics.dt / _least_tau(scene))
    least = np.finfo(float).tiny  # where a lag, or the share of it, is too small for a number
    lags = max(end / max(lag(scene), least), least)
    return float(-np.expm1(-lags) / lags)


def is_late(scene: Scene, share: float = MISSED, lags: float = 1.0) -> bool:
    """Whether more than a share is missing, by a lag of more than so many that are no matter."""
    slow = scene.numerics.scheme == "imex1"
    return missed(scene) > share and (slow or lag(scene) > lags * short_lag(scene))


def _span(scene: Scene) -> float:
    """*In silico* time of the run, or of its stages on average."""
    if not scene.stages:
        return scene.duration
    if scene.end is None:
        return min(scene.duration, UNTOLD * short_lag(scene))
    return scene.end / len(scene.stages)


def _least_tau(scene: Scene) -> float:
    return min(physics.tau for physics in scene.courses)


def short_lag(scene: Scene) -> float:
    """Lag that is no matter however short the run is."""
    rates = [2 * c.tensions.max() * p.c / p.tau for p, c in _courses(scene)]
    return SHORT_LAG / float(max(rates))


def stabilised(scene: Scene) -> Scene:
    """Copy of the scene with the S that its walls need, where they cannot be resolved (images)."""
    numerics, walls = scene.numerics, scene.confinement
    if walls is None or numerics.walls != "resolved" or is_resolved(walls, numerics):
        return scene
    breathing = max(_whole_cell_rate(*course) for course in _courses(scene))
    needed = least_S(scene) + SHARES.get(numerics.scheme, 0.0) * CLOSED_IN * breathing
    return scene.with_numerics(S=max(numerics.S, float(np.ceil(needed))))


def _whole_cell_rate(physics: Physics, conditions: Conditions) -> float:
    """Rate of cells as a whole."""
    return sum(term.whole_cell_rate(conditions) for term in physics.active_terms)


def largest_euler_step(scene: Scene) -> float:
    """Largest δt of explicit Euler that is expected to be stable."""
    numerics, scale = scene.numerics, scene.physics.interface_scale
    k2 = largest_eigenvalue(numerics.order, numerics.spacing, scale)
    stiffest = max(float(conditions.tensions.max()) for _, conditions in _courses(scene))
    fastest = explicit_rate(scene) + stiffest * k2
    return float(2 * scene.physics.tau / fastest)
