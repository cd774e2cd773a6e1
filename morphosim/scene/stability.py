"""What is stable and right, told before the first step: where `Numerics` meets `Physics`.

What a step takes explicitly relaxes φ at a rate f / τ: the walls (g_e φ_e²), other cells (g Σ φ²)
and the double well (2γc at φ = 0 and 1), or the volume constraint (M' A / V, A the surface). Each
force term tells its own (`Term.explicit_rate`, `Term.whole_cell_rate`); f is that of the place
where they are fastest together (`rates_of`). A perturbation flips its sign at every step and grows
unless

    S > 3/4 f - τ/δt   ("bdf2", Eq. 9)        S > 1/2 f - τ/δt   ("imex1", Eq. 8)

which follows from φⁿ⁺¹ = -φⁿ in Eq. 9 and 8 with the force -f φ and no diffusion. "euler" has no S;
its diffusion is explicit too: δt < 2τ / (f + γ k²), k² the largest eigenvalue of -Δ (18.1 / h²).
`benchmarks/stability.py` measures how well this holds, and the limits of what has no such theory.

What is stable may be late. In Eq. 9 S multiplies φⁿ⁺¹ - 2φⁿ + φⁿ⁻¹ ≈ δt² φ'': an inertia, by which
velocities follow forces with a lag of L = S δt²/τ. In Eq. 8 S multiplies φⁿ⁺¹ - φⁿ ≈ δt φ': a
viscosity, which makes time run 1 + S δt/τ times slower. Of the way that a constant force makes in a
time T, (1 - exp(-T/L)) L/T, or S δt / (τ + S δt), is missing at the end. What swings is off by
exp(-T / 2L), which is less (`benchmarks/stability.py --only lag`).
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from morphosim.errors import warn
from morphosim.geometry.phase_field import lattice_field, share_outside
from morphosim.numerics.chebyshev import largest_eigenvalue
from morphosim.numerics.parameters import Numerics
from morphosim.numerics.schemes import stabilisation, used_S
from morphosim.physics.confinement_repulsion import ConfinementRepulsion
from morphosim.physics.parameters import Physics
from morphosim.physics.repulsion import Repulsion
from morphosim.physics.term import Concern, Conditions
from morphosim.scene.cell import Cell, tensions
from morphosim.scene.rehearsal import Rehearsal
from morphosim.scene.scene import Scene

COARSEST = 1.5
"""Largest √(2c) h: the profile's tail falls by exp(-√(2c) h) from one lattice point to the next."""
WALLS, CELLS = ConfinementRepulsion.label, Repulsion.label
TOUCHING, PRESSING = 0.047, 0.147
"""Share of ∫ φ beyond the walls up to which they do not press a cell, and from which they do.

At the start it is up to 0.047 in the eight-cell embryo. Two balls between stepped walls at δt = 2
are stable at S = 12 with 0.034, at 12.3 with 0.069, and need 13.1 and more from 0.147 on.
"""
COUPLING, SQUEEZED = 0.08, 0.1
"""How much of what acts at walls acts on cells as a whole, and what pressing cells to walls adds.

With a the rates of wall and double well and w that of the cell as a whole, the rate measured is
0.95 to 1.02 of a/2 + w/2 + √((a - w)²/4 + 0.08 a w) in the eight-cell embryo (a = 3.2, 5 or 17, w =
3.7), 0.98 to 1.06 for one or two balls pressed to flat walls (a = 3.2, 5 or 10, w = 6), and up to
1.1 for eight to twelve cells that fill a box, and balls of 2.2 to 8 µm in walls from an image (a =
17, w = 11 to 3); 1.17 at M' = 16.
"""
MEETING = 0.023
"""How much of what acts where cells meet acts on them as a whole, likewise.

With a the rates of other cells and double well, and w = 6, the rate measured is 0.98 to 1.01 of
that for two cells that adhere, a = 3.6 to 6.6: c = 4 to 10.
"""
MARGIN, LINEARISED_MARGIN = 1.1, 1.6
"""Rates that S is chosen for, in those of the formula.

Measured, f that is needed over that of the formula: 0.83 to 1.08 of balls and halves of them, 1.07
of a disc of 7 by 1.6 µm, 0.93 to 1.03 of two cells that adhere; and see `COUPLING`. With
"linearised" and a tolerance, steps to t = 3000 are fewest at 0.5 to 0.7 of the formula for two to
four cells, and at 1.1 for the embryo; they are twice as many at 0.9 there, and 8 to 15 % more at
1.6. At 1.2 velocities still flip from step to step by a percent, which is no error to speak of and
ends quasi-steady stages too early; not at 1.6.
"""
INTERFACE = 0.2
"""Of the profile's k² = ∫ φ''² / ∫ φ'², in 2c."""
DIGIT = 0.05
"""Rates that S is chosen for are multiples of this: the rounding of volumes changes no S."""
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


def check(scene: Scene, S: float | None = None) -> None:
    """Report what is known to fail before it does.

    Parameters
    ----------
    scene : Scene
    S : float, optional
        What has been chosen for it, if that is known.

    Raises
    ------
    ValueError
        See `refuse`.

    Warns
    -----
    StabilityWarning
        A combination of physics and numerics is expected to diverge, or to be late.
    """
    refuse(scene, S)
    for concern in concerns(scene, S):
        warn(concern, StabilityWarning)


def refuse(scene: Scene, S: float | None = None) -> None:
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
    if may_be_late(scene):
        chosen = with_S(scene, S)
        if is_late(chosen, MOST_MISSED.get(numerics.scheme, 1.0), FAR):
            raise ValueError(_late(chosen))


def concerns(scene: Scene, S: float | None = None) -> list[str]:
    """What is likely to go wrong, in words; `S` is what has been chosen, if that is known."""
    found = (
        _euler_step(scene), _late(scene, S), _stabilisation(scene),
        *_concerns_of_terms(with_S(scene, S) if may_be_late(scene) else scene),
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


def _late(scene: Scene, S: float | None = None) -> str:
    if not may_be_late(scene):
        return ""
    scene = with_S(scene, S)
    if not is_late(scene):
        return ""
    what = f"so up to {100 * missed(scene):.0f} % of what changes would be missing at the end"
    return _slow_time(scene, what) if scene.numerics.scheme == "imex1" else _lagging(scene, what)


def _slow_time(scene: Scene, what: str) -> str:
    numerics, tau, S = scene.numerics, _least_tau(scene), _given(scene)
    return (
        f"numerics.dt = {numerics.dt:g} with S = {S:.3g} makes time run 1 + S δt/τ = "
        f"{1 + S * numerics.dt / tau:.3g} times slower, {what}. Take scheme = 'bdf2', or "
        f"dt times S of at most {_rounded(tau * MISSED / (1 - MISSED), np.floor)}"
    )


def _lagging(scene: Scene, what: str) -> str:
    numerics, span, S = scene.numerics, _span(scene), _given(scene)
    longest = np.sqrt(max(MISSED * span, short_lag(scene)) * _least_tau(scene) / S)
    least = _rounded(lag(scene) / MISSED, np.ceil)
    short, enough = f"a run of {span:g}", f", or a duration of {least}"
    if scene.stages:
        short = f"stages of {span:.3g} on average" if scene.end else f"stages of about {span:.3g}"
        enough = f", or stages of {least}" if scene.end else ""
    return (
        f"numerics.dt = {numerics.dt:g} is too long for {short}: by S = {S:.3g} cells "
        f"follow what pulls them S δt²/τ = {lag(scene):.3g} later, {what}. Take at most "
        f"{_rounded(longest, np.floor)}{enough}"
    )


def _rounded(value: float, to: Callable[[float], float]) -> str:
    """A bound with two digits that is still one, rounded up or down."""
    digit = 10.0 ** (np.floor(np.log10(value)) - 1)
    return f"{to(value / digit) * digit:.4g}"


def _stabilisation(scene: Scene) -> str:
    """What to say of an S that is given."""
    if scene.numerics.S is None:
        return ""
    press = 1.0 if least_S(scene) <= scene.numerics.S else pressing(scene)
    return too_small(scene.numerics, explicit_rates(scene, press), least_S(scene, press))


def too_small(numerics: Numerics, rates: Mapping[str, float], needed: float) -> str:
    """What to say of an S that is given if it is less than `needed` at these rates; else ""."""
    if numerics.S is None or needed <= numerics.S:
        return ""
    parts = ", ".join(f"{name} {rate:.3g}" for name, rate in rates.items())
    advice = "leave S out, which chooses it, or take a smaller dt, or weaker forces"
    if "walls" in rates and numerics.walls == "stepped":
        advice += ", or walls = 'resolved'"
    return (
        f"numerics.S = {numerics.S:g} may diverge at numerics.dt = {numerics.dt:g}: what acts on "
        f"the cells ({parts}) needs at least {np.ceil(10 * needed) / 10:g}. Take that, or {advice}"
    )


def pressing(scene: Scene, outside: float | None = None) -> float:
    """How much walls press the cells, from 0 to 1: at the start, or if they divide or grow.

    Parameters
    ----------
    scene : Scene
    outside : float, optional
        Largest share of ∫ φ that a cell has beyond the walls at the start, frozen cells left out.
        If it is not given, start fields are made to see.
    """
    if scene.confinement is None:
        return 0.0
    stepped = [cell for cell in scene.cells if not cell.frozen]
    if scene.stages or any(_grows(cell) for cell in stepped):
        return 1.0
    most = _most_outside(scene, stepped) if outside is None else outside
    return float(np.clip((most - TOUCHING) / (PRESSING - TOUCHING), 0.0, 1.0))


def _grows(cell: Cell) -> bool:
    return callable(cell.volume) or cell.target_volume(0.0) > GROWTH * cell.start_volume


def _most_outside(scene: Scene, cells: Iterable[Cell]) -> float:
    """Largest share beyond the walls at the start, or one that is as good."""
    most = 0.0
    for cell in cells:
        most = max(most, _outside(cell, scene))
        if most >= PRESSING:
            break
    return most


def _outside(cell: Cell, scene: Scene) -> float:
    """Share of ∫ φ of a cell beyond the walls at the start."""
    spacing, scale = scene.numerics.spacing, scene.physics.interface_scale
    origin, phi = lattice_field(cell.shape, cell.name, scale, spacing, cell.start_volume)
    return share_outside(scene.confinement, origin, phi, spacing)


def _concerns_of_terms(scene: Scene) -> list[str]:
    """The worst concern of each kind of term, over all stages."""
    worst: dict[type, Concern] = {}
    for physics, conditions in _courses(scene):
        for term in physics.active_terms:
            concern, kind = term.concern(conditions), type(term)
            if concern and (kind not in worst or concern.excess > worst[kind].excess):
                worst[kind] = concern
    return [concern.text for concern in worst.values()]


def explicit_rates(scene: Scene, pressing: float = 1.0) -> dict[str, float]:
    """What the scheme takes explicitly and at which rates; their sum is f.

    Those of the stage where they are fastest. For `pressing` see `least_S`.
    """
    rates = [rates_of(*course) for course in _courses(scene, pressing)]
    return max(rates, key=lambda rates: sum(rates.values()))


def _courses(scene: Scene, pressing: float = 1.0) -> list[tuple[Physics, Conditions]]:
    """All physics that hold in turn, each with what its terms are asked about."""
    rehearsal = scene.rehearsed()
    return [
        (physics, replace(conditions(scene, physics, rehearsal), pressing=pressing))
        for physics in rehearsal.courses
    ]


def conditions(scene: Scene, physics: Physics, rehearsal: Rehearsal | None = None) -> Conditions:
    """What force terms are asked about, where walls press and these physics hold.

    Of the scene's cells, and, where it is given, of those that come in a rehearsal.
    """
    given = (rehearsal.tensions, rehearsal.volumes) if rehearsal else ((), ())
    stepped = [cell for cell in scene.cells if not cell.frozen] or list(scene.cells)
    return conditions_of(
        scene, physics,
        tensions=np.array([*tensions(stepped, physics), *given[0]]),
        mean_tension=float(np.mean(tensions(scene.cells, physics))),
        volumes=np.concatenate([*map(_volumes, stepped), given[1]]),
        filled=np.concatenate([*map(_filled, stepped), given[1]]),
        types=scene.possible_types,
        several=scene.may_be_several,
    )  # fmt: skip


def conditions_of(scene: Scene, physics: Physics, **cells: Any) -> Conditions:
    """What force terms are asked about, of these cells of a scene."""
    return Conditions(
        staged=bool(scene.stages), tau=physics.viscosity.smallest(cells["types"]),
        interface_scale=physics.interface_scale,
        numerics=scene.numerics, confinement=scene.confinement, **cells,
    )  # fmt: skip


def _volumes(cell: Cell) -> list[float]:
    """Target volumes that a cell has at the start and is known to come to, µm³."""
    return [cell.target_volume(0.0), *getattr(cell.volume, "volumes", ())]


def _filled(cell: Cell) -> list[float]:
    """∫ φ that it has at the start, and about that of its target later, µm³."""
    return [cell.start_volume, *getattr(cell.volume, "volumes", ())]


def rates_of(physics: Physics, conditions: Conditions) -> dict[str, float]:
    """Rates by name of the term, where they are fastest together, as of cells with `physics.tau`.

    That is at walls, or where cells meet, or of cells as a whole; of those with the least τ.
    """
    terms, faster = physics.active_terms, mobility(physics, conditions)
    at_points = _summed([(t.name, faster * t.explicit_rate(conditions)) for t in terms])
    of_cells = _summed([(t.name, faster * t.whole_cell_rate(conditions)) for t in terms])
    at_walls, meeting = _without(CELLS, at_points), _without(WALLS, at_points)
    whole = sum(of_cells.values())
    if WALLS in at_walls:
        alone = sum(at_walls.values())
        both = _together(alone, whole, COUPLING)
        at_walls[WALLS] += (1 + SQUEEZED * conditions.pressing) * both - alone
    if CELLS in meeting and whole > 0:
        alone = sum(meeting.values())
        more = _together(alone, whole, MEETING) - max(alone, whole)
        meeting[CELLS] += more
        of_cells[max(of_cells, key=lambda name: of_cells[name])] += more
    return max((at_walls, meeting, of_cells), key=lambda rates: sum(rates.values()))


def mobility(physics: Physics, conditions: Conditions) -> float:
    """How many times faster cells with the least τ follow forces than those of `physics.tau`."""
    return physics.tau / conditions.tau


def _together(alone: float, whole: float, coupling: float) -> float:
    """Rate of what acts at a point and on a cell as a whole, of which a share is coupled."""
    apart = np.hypot((alone - whole) / 2, np.sqrt(coupling * alone * whole))
    return float((alone + whole) / 2 + apart)


def _without(name: str, rates: Mapping[str, float]) -> dict[str, float]:
    return {other: rate for other, rate in rates.items() if other != name}


def _summed(rates: list[tuple[str, float]]) -> dict[str, float]:
    """Rates by name of the term, without those that are 0."""
    return {
        name: sum(rate for other, rate in rates if other == name)
        for name in dict.fromkeys(name for name, rate in rates if rate > 0)
    }


def explicit_rate(scene: Scene) -> float:
    """The rate f."""
    return sum(explicit_rates(scene).values())


def least_S(scene: Scene, pressing: float = 1.0) -> float:
    """Least S that is expected to be stable; 0 for "euler", which has none.

    Parameters
    ----------
    scene : Scene
    pressing : float
        How much walls press the cells, see `stability.pressing`.
    """
    return max(needed_S(*course) for course in _courses(scene, pressing))


def needed_S(physics: Physics, conditions: Conditions) -> float:
    """Least S that is expected to be stable for physics that hold."""
    rate, numerics = sum(rates_of(physics, conditions).values()), conditions.numerics
    return stabilisation(rate, numerics.dt, physics.tau, numerics.scheme)


def safe_rate(physics: Physics, conditions: Conditions) -> float:
    """Rate that S is chosen for: what the formula says, with a margin, to a digit or two."""
    margin = LINEARISED_MARGIN if conditions.linearised else MARGIN
    rate = margin * sum(rates_of(physics, conditions).values())
    return float(np.ceil(rate / DIGIT) * DIGIT)


def start_rate(scene: Scene, outside: float | None = None) -> float:
    """Rate that S is chosen for at the start of a scene; for `outside` see `pressing`."""
    found = conditions(scene, scene.physics)
    pressed, free = (safe_rate(scene.physics, replace(found, pressing=p)) for p in (1.0, 0.0))
    if scene.numerics.S is not None or free == pressed:  # whether walls press is no matter
        return pressed
    return safe_rate(scene.physics, replace(found, pressing=pressing(scene, outside)))


def chosen_S(scene: Scene) -> float:
    """S that a run of the scene starts with: what is given, or chosen."""
    return used_S(scene.numerics, scene.physics.tau, start_rate(scene))


def with_S(scene: Scene, S: float | None = None) -> Scene:
    """The scene, or a copy with the S that is chosen for it if none is given.

    Parameters
    ----------
    scene : Scene
    S : float, optional
        What has been chosen, if that is known.
    """
    if scene.numerics.S is not None:
        return scene
    return scene.with_numerics(S=chosen_S(scene) if S is None else S)


def _given(scene: Scene) -> float:
    """S of a scene that has one."""
    assert scene.numerics.S is not None
    return scene.numerics.S


def lag(scene: Scene) -> float:
    """*In silico* time by which velocities follow forces, S δt²/τ (see above).

    It is less with "linearised", whose S acts as diffusion does.
    """
    scene = with_S(scene)
    inertia = INTERFACE if scene.numerics.scheme == "linearised" else 1.0
    return inertia * _given(scene) * scene.numerics.dt**2 / _least_tau(scene)


def may_be_late(scene: Scene) -> bool:
    """Whether S can make velocities late: not with a tolerance, nor by "euler", which has none."""
    return scene.numerics.tolerance is None and scene.numerics.scheme != "euler"


def missed(scene: Scene) -> float:
    """Share of what changes in the run, or a stage, that S may make it miss at its end, at most."""
    if not may_be_late(scene):
        return 0.0
    scene = with_S(scene)
    numerics, end, S = scene.numerics, _span(scene), _given(scene)
    if end == 0 or S == 0:
        return 0.0
    if numerics.scheme == "imex1":
        return 1 - 1 / (1 + S * numerics.dt / _least_tau(scene))
    least = np.finfo(float).tiny  # where a lag, or the share of it, is too small for a number
    lags = max(end / max(lag(scene), least), least)
    return float(-np.expm1(-lags) / lags)


def is_late(scene: Scene, share: float = MISSED, lags: float = 1.0) -> bool:
    """Whether more than a share is missing, by a lag of more than so many that are no matter."""
    scene, slow = with_S(scene), scene.numerics.scheme == "imex1"
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
    rates = [2 * c.tensions.max() * p.c / c.tau for p, c in _courses(scene)]
    return SHORT_LAG / float(max(rates))


def largest_euler_step(scene: Scene) -> float:
    """Largest δt of explicit Euler that is expected to be stable."""
    numerics, scale = scene.numerics, scene.physics.interface_scale
    k2 = largest_eigenvalue(numerics.order, numerics.spacing, scale)
    stiffest = max(float(c.tensions.max()) * mobility(p, c) for p, c in _courses(scene))
    fastest = explicit_rate(scene) + stiffest * k2
    return float(2 * scene.physics.tau / fastest)
