"""Angles of doublets at rest, against the balance of tensions.

`python benchmarks/doublets.py` brings two cells that adhere to rest, of two sizes, and extrapolates
the angle at which their free surfaces meet to that of large ones. Tensions are from one dimension:
of the free surfaces γ √(c/2) / 3 each, and of the contact that of both less the work of taking the
flat faces apart. Some minutes.

The force - ∇φ_i·∇ψ is no derivative of an energy, and falls with the cosine of the angle between
two faces; the work is that of parallel ones. So the balance is exact where angles are flat.
"""

from typing import Any

import numpy as np
from _common import arguments, report
from _spheres import fitted_sphere, surface_points
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.linalg import solve_banded
from scipy.optimize import brentq

from morphosim import Attraction, Cell, Numerics, Physics, Scene, Simulation, Sphere

Floats = NDArray[np.float64]
NUMERICS = Numerics.preset("fast", threads=1, spacing=0.5)
REST = 90.0
"""Time in which a cell of 1 µm comes to rest; it goes with the square of the radius."""
CASES = {
    "equal, σ = 0.8 γ": ((0.25, 0.25), 0.2),
    "equal, σ = 1.2 γ": ((0.25, 0.25), 0.3),
    "equal, σ = 1.6 γ": ((0.25, 0.25), 0.4),
    "γ = 0.25 and 0.4, σ = 0.3": ((0.25, 0.4), 0.3),
}
"""Surface tensions of both cells, and σ."""
STEP = 0.05
X = np.arange(-10, 10 + STEP / 2, STEP)
RATE = 7.0
"""τ/δt + S of the relaxation in one dimension."""
GAPS = np.arange(-0.6, 7, 0.2)


def slope(field: Floats) -> Floats:
    """Derivative in one dimension."""
    return np.asarray(np.gradient(field, STEP))


def relaxed(field: Floats, force: Floats, tension: float, ends: tuple[int, int]) -> Floats:
    """The field after a step: its diffusion implicit, all else explicit."""
    bands = np.zeros((3, len(X)))
    bands[1] = RATE + 2 * tension / STEP**2
    bands[0, 2:] = bands[2, :-2] = -tension / STEP**2
    bands[1, [0, -1]] = 1
    right = RATE * field + force
    right[[0, -1]] = ends
    return np.asarray(solve_banded((1, 1), bands, right))


def pull(gap: float, tensions: tuple[float, float], sigma: float) -> tuple[float, float]:
    """Distance of two flat faces that are held about so far apart, and the pull between them.

    Each is held by a pressure that takes its motion away. The pull is the mean of both cells'.
    """
    physics = Physics()
    c, scale, g = physics.c, physics.interface_scale, physics.g
    a, b = ((1 + np.tanh(scale * (s * X - gap / 2))) / 2 for s in (-1, 1))
    for _ in range(3000):
        da, db = slope(a), slope(b)
        feels = (-g * a * b * b - sigma * da * db, -g * b * a * a - sigma * da * db)
        new, holding = [], []
        for f, df, force, tension, ends in zip(
            (a, b), (da, db), feels, tensions, ((1, 0), (0, 1)), strict=True
        ):
            pressure = -(force * df).sum() / (np.abs(df) * df).sum()
            well = tension * c * (4 * f**3 - 6 * f**2 + 2 * f)
            new.append(relaxed(f, force - well + pressure * np.abs(df), tension, ends))
            holding.append(pressure * (df * df).sum() * STEP)
        change = max(np.abs(new[0] - a).max(), np.abs(new[1] - b).max())
        a, b = new
        if change < 1e-9:
            break
    places = (float(np.interp(-0.5, -a, X)), float(np.interp(0.5, b, X)))
    return places[1] - places[0], -float(np.mean(holding))


def balanced_angle(tensions: tuple[float, float], sigma: float) -> float:
    """Angle of the free surfaces of large cells, degrees: that of three tensions (Neumann)."""
    gaps, pulls = np.array([pull(gap, tensions, sigma) for gap in GAPS]).T
    strongest = int(np.argmax(pulls))
    curve = CubicSpline(gaps, pulls)
    pushed = gaps[:strongest][pulls[:strongest] < 0][-1]
    work = curve.integrate(brentq(curve, pushed, gaps[strongest]), gaps[-1])
    first, second = (gamma * Physics().interface_scale / 3 for gamma in tensions)
    contact = first + second - work
    cosine = (contact**2 - first**2 - second**2) / (2 * first * second)
    return 180 - float(np.degrees(np.arccos(cosine)))


def angle_at_rest(tensions: tuple[float, float], sigma: float, radius: float) -> float:
    """That of cells of this radius: of the spheres that their free ends are part of."""
    cells = []
    for name, side, gamma in zip("ab", (-1, 1), tensions, strict=True):
        ball = Sphere(center=(side * (radius - 0.3), 0, 0), radius=radius)
        cells.append(Cell(name=name, type=name, gamma=gamma, shape=ball))
    adhesion = Attraction(types={("a", "b"): sigma, ("b", "a"): sigma})
    simulation = Simulation(Scene(cells=cells, physics=Physics(sigma=adhesion), numerics=NUMERICS))
    simulation.run(until=REST * radius**2)
    spheres = []
    for field, side, middle in zip(simulation.fields, (-1, 1), simulation.centroids, strict=True):
        surface = surface_points(field, NUMERICS.spacing)
        spheres.append(fitted_sphere(surface[side * (surface[:, 0] - middle[0]) > -0.2 * radius]))
    (one, r), (other, s) = spheres
    cosine = (r**2 + s**2 - ((one - other) ** 2).sum()) / (2 * r * s)
    return float(np.degrees(np.arccos(np.clip(cosine, -1, 1))))


def main() -> None:
    """Measure and report."""
    options = arguments(__doc__ or "", small=12.0, large=18.0)
    rows: list[dict[str, Any]] = []
    for name, (tensions, sigma) in CASES.items():
        radii = options.small, options.large
        small, large = (angle_at_rest(tensions, sigma, radius) for radius in radii)
        found = (radii[1] * large - radii[0] * small) / (radii[1] - radii[0])
        expected = balanced_angle(tensions, sigma)
        rows.append({
            "doublet": name, f"R = {radii[0]:g} µm": small, f"R = {radii[1]:g} µm": large,
            "1/R → 0": found, "balance": expected, "apart, per cell": (found - expected) / 2,
        })  # fmt: skip
    report(rows, options.json)


if __name__ == "__main__":
    main()
