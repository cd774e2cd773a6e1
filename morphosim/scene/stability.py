"""What is stable, told before the first step: where `Numerics` meets `Physics`.

What a step takes explicitly relaxes φ at a rate f / τ: the walls (g_e φ_e²), other cells (g Σ φ²)
and the double well (2γc at φ = 0 and 1), or the volume constraint (M' A / V, A the surface). A
perturbation flips its sign at every step and grows unless

    S > 3/4 f - τ/δt   ("bdf2", Eq. 9)        S > 1/2 f - τ/δt   ("imex1", Eq. 8)

which follows from φⁿ⁺¹ = -φⁿ in Eq. 9 and 8 with the force -f φ and no diffusion. "euler" has no S;
its diffusion is explicit too: δt < 2τ / (f + γ k²), k² the largest eigenvalue of -Δ (18.1 / h²).
`benchmarks/stability.py` measures how well this holds, and the limits of what has no such theory.
"""

import warnings
from dataclasses import replace

import numpy as np

from morphosim.numerics.chebyshev import largest_eigenvalue
from morphosim.physics.confinement_repulsion import is_resolved, wall_strength
from morphosim.physics.parameters import Physics
from morphosim.scene.cell import Cell
from morphosim.scene.scene import Scene

COARSEST = 1.5
"""Largest √(2c) h: the profile's tail falls by exp(-√(2c) h) from one lattice point to the next."""
PRESSED = 1.0
"""Measured addition to f where cells are pressed to walls."""
STRONGEST_ATTRACTION = {"long": 11.0, "short": 15.0}
"""Largest σ / γ that was stable at δt = 2, and at any δt; at 16, cells of γ = 1/64 fail at any."""
FARTHEST_JUMP = 0.6
"""Largest stable motility noise: root mean square move per step in widths 1 / √(c/2)."""


class StabilityWarning(UserWarning):
    """A scene is likely to diverge; the message says what to change."""


def check(scene: Scene) -> None:
    """Report what is known to fail before it does.

    Raises
    ------
    ValueError
        The lattice does not resolve the interface, and `numerics.allow_coarse` is not set.

    Warns
    -----
    StabilityWarning
        A combination of physics and numerics is expected to diverge.
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
    for concern in concerns(scene):
        warnings.warn(concern, StabilityWarning, stacklevel=4)


def concerns(scene: Scene) -> list[str]:
    """What is likely to go wrong, in words."""
    found = (_euler_step(scene), _stabilisation(scene), _attraction(scene), _noise(scene))
    return [text for text in found if text]


def _euler_step(scene: Scene) -> str:
    numerics, limit = scene.numerics, largest_euler_step(scene)
    if numerics.scheme != "euler" or numerics.dt <= limit:
        return ""
    return (
        f"numerics.dt = {numerics.dt:g} is likely to diverge with scheme = 'euler': take at most "
        f"{limit:.2g}, or scheme = 'bdf2'"
    )


def _stabilisation(scene: Scene) -> str:
    numerics, needed = scene.numerics, least_S(scene)
    if needed <= numerics.S:
        return ""
    rates = explicit_rates(scene)
    parts = ", ".join(f"{name} {rate:.3g}" for name, rate in rates.items())
    advice = "a smaller dt, or weaker forces"
    if "walls" in rates and numerics.walls == "stepped":
        advice += ", or walls = 'resolved'"
    return (
        f"numerics.S = {numerics.S:g} may diverge at numerics.dt = {numerics.dt:g}: what acts on "
        f"the cells ({parts}) needs at least {np.ceil(10 * needed) / 10:g}. Take that, {advice}"
    )


def _attraction(scene: Scene) -> str:
    if len(scene.cells) == 1 and not scene.stages:
        return ""
    stated = [stage.physics["sigma"] for stage in scene.stages if "sigma" in stage.physics]
    sigmas = [scene.physics.attraction, *(Physics(sigma=sigma).attraction for sigma in stated)]
    strongest = max(sigma.strongest(scene.possible_types) for sigma in sigmas)
    softest = min(_tensions(scene))
    limit = STRONGEST_ATTRACTION["long" if scene.numerics.dt > 1 else "short"]
    if strongest <= limit * softest:
        return ""
    return (
        f"physics.sigma = {strongest:g} is more than {limit:g} times the surface tension "
        f"{softest:g}: cells may tear each other apart. Take a weaker sigma or a larger gamma"
    )


def _noise(scene: Scene) -> str:
    dt = scene.numerics.dt
    jump, kappa = max(_jump(course) for course in _courses(scene))
    if jump <= FARTHEST_JUMP:
        return ""
    return (
        f"physics.kappa = {kappa:g} moves cells by {jump:.2g} interface widths in a step "
        f"of numerics.dt = {dt:g}; more than {FARTHEST_JUMP:g} is likely to diverge. Take a "
        "smaller dt or kappa"
    )


def _jump(scene: Scene) -> tuple[float, float]:
    """Interface widths by which noise moves a cell in a step, and the largest κ."""
    physics = scene.physics
    kappa = max(map(physics.motility, scene.possible_types))
    return kappa * scene.numerics.dt**1.5 / physics.tau * physics.interface_scale, kappa


def explicit_rates(scene: Scene) -> dict[str, float]:
    """What the scheme takes explicitly and at which rates; their sum is f.

    Those of the stage where they are fastest.
    """
    return max(map(_rates, _courses(scene)), key=lambda rates: sum(rates.values()))


def _courses(scene: Scene) -> list[Scene]:
    """The scene, and the scene with the physics of each stage that changes more than σ."""
    courses, physics = [scene], scene.physics
    for stage in scene.stages:
        physics = replace(physics, **stage.physics)
        if stage.physics.keys() - {"sigma"}:
            courses.append(replace(scene, physics=physics))
    return courses


def _rates(scene: Scene) -> dict[str, float]:
    physics = scene.physics
    local = {"double well": 2 * max(_tensions(scene)) * physics.c}
    if len(scene.possible_names) > 1 and physics.g > 0:
        local["cells"] = physics.g
    if scene.confinement is not None and physics.g_e > 0:
        gamma = float(np.mean(scene.tensions))  # as the engine's walls
        local["walls"] = PRESSED + wall_strength(
            scene.confinement, physics.g_e, gamma, scene.numerics
        )
    volume = {"volume constraint": _volume_rate(scene)}
    return max(local, volume, key=lambda rates: sum(rates.values()))


def explicit_rate(scene: Scene) -> float:
    """The rate f."""
    return sum(explicit_rates(scene).values())


def least_S(scene: Scene) -> float:
    """Least S that is expected to be stable; 0 for "euler", which has none."""
    if scene.numerics.scheme == "euler":
        return 0.0
    share = 0.75 if scene.numerics.scheme == "bdf2" else 0.5
    needed = [
        share * sum(_rates(s).values()) - s.physics.tau / s.numerics.dt for s in _courses(scene)
    ]
    return max(0.0, *needed)


def stabilised(scene: Scene) -> Scene:
    """Copy of the scene with the S that its walls need, where they cannot be resolved (images)."""
    numerics, walls = scene.numerics, scene.confinement
    if walls is None or numerics.walls != "resolved" or is_resolved(walls, numerics):
        return scene
    return scene.with_numerics(S=max(numerics.S, float(np.ceil(least_S(scene)))))


def largest_euler_step(scene: Scene) -> float:
    """Largest δt of explicit Euler that is expected to be stable."""
    k2 = largest_eigenvalue(scene.numerics.order, scene.numerics.spacing)
    return float(2 * scene.physics.tau / (explicit_rate(scene) + max(_tensions(scene)) * k2))


def _stepped(scene: Scene) -> list[Cell]:
    """Cells that are not frozen; all of them if none is."""
    return [cell for cell in scene.cells if not cell.frozen] or list(scene.cells)


def _tensions(scene: Scene) -> list[float]:
    """Surface tensions of the same cells."""
    pairs = zip(scene.tensions, scene.cells, strict=True)
    return [gamma for gamma, cell in pairs if not cell.frozen] or scene.tensions


def _volume_rate(scene: Scene) -> float:
    """Rate at which the volume constraint acts, on the cell that is worst off, taken as a ball."""
    physics = scene.physics
    known = [[c.target_volume(0.0), *getattr(c.volume, "volumes", ())] for c in _stepped(scene)]
    volumes = np.concatenate(known)
    rates = physics.volume_strength * (36 * np.pi * volumes**2) ** (1 / 3)
    return float((rates / volumes if physics.volume_constraint == "relative" else rates).max())
