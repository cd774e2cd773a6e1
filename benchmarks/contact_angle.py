"""Contact angles of a cell on a plane that attracts it, against the balance of tensions.

`python benchmarks/contact_angle.py docs/images/contact-angle.png` brings cells of two sizes to rest
on a plane, for each σ_wall, and extrapolates their angles to those of a large one. The line is that
of the tension of a flat interface at the same wall, in one dimension. A minute; needs matplotlib.
"""

import sys

import numpy as np
from _spheres import fitted_sphere, surface_points
from numpy.typing import NDArray
from scipy.linalg import solve_banded

from morphosim import BoxWalls, Cell, Numerics, Physics, Scene, Simulation, Sphere, WallAdhesion
from morphosim.physics.confinement_repulsion import wall_repulsion

Floats = NDArray[np.float64]
FAR = 60.0
WALLS = BoxWalls(lower=(-FAR, -FAR, 0), upper=(FAR, FAR, 2 * FAR))
NUMERICS = Numerics.preset("fast", threads=1, spacing=0.5)
RADII = (8.0, 12.0)
REST = 60.0
"""Time in which a cell of 1 µm comes to rest; it goes with the square of the radius."""
CLEAR = 4.0
"""µm above the wall, from where on the surface is part of a sphere."""


def balanced_angle(sigma_wall: float, step: float = 0.02) -> float:
    """Contact angle of a large cell, in degrees: cos θ = -T/T_0, of a flat interface at the wall.

    T is the least ∫ w (γ/2 φ'² + γ c φ² (1 - φ)² + R φ²/2) dz with w = exp(-σ_wall φ_w/γ), found by
    Newton's method, and T_0 = γ √(c/2) / 3 that of the free surface.
    """
    physics = Physics()
    gamma, c, scale = physics.gamma, physics.c, physics.interface_scale
    z = np.arange(-6, 10, step)
    weight = np.exp(-sigma_wall * (1 - np.tanh(scale * z)) / 2 / gamma)
    between = np.sqrt(weight[1:] * weight[:-1])
    wall = wall_repulsion(WALLS, physics.g_e, gamma, NUMERICS)(0 * z, 0 * z, z)
    phi = (1 + np.tanh(scale * (z - 1))) / 2
    pace = 1.0  # pseudo-time steps, longer and longer
    for _ in range(2000):
        slope = between * gamma * np.diff(phi) / step
        well = gamma * c * (4 * phi**3 - 6 * phi**2 + 2 * phi) + wall * phi
        stiffness = np.maximum(gamma * c * (12 * phi**2 - 12 * phi + 2) + wall, -0.9 / pace)
        bands = np.zeros((3, len(z)))
        bands[0, 2:] = -between[1:] * gamma / step**2
        bands[2, :-2] = -between[:-1] * gamma / step**2
        bands[1] = 1
        bands[1, 1:-1] = -bands[0, 2:] - bands[2, :-2] + (weight * (stiffness + 1 / pace))[1:-1]
        residual = np.zeros(len(z))
        residual[1:-1] = np.diff(slope) / step - (weight * well)[1:-1]
        change = solve_banded((1, 1), bands, residual)
        phi += change
        pace = min(1.03 * pace, 1e6)
        if np.abs(change).max() < 1e-10:
            break
    local = weight * (gamma * c * phi**2 * (1 - phi) ** 2 + wall * phi**2 / 2)
    tension = (slope * np.diff(phi)).sum() / 2 + local.sum() * step
    return float(np.degrees(np.arccos(max(-tension / (gamma * scale / 3), -1))))


def angle_at_rest(sigma_wall: float, radius: float) -> float:
    """Contact angle of a cell of this radius, in degrees: where its sphere meets z = 0."""
    cell = Cell(name="a", shape=Sphere(center=(0, 0, radius), radius=radius))
    physics = Physics(terms=[WallAdhesion(sigma=sigma_wall)])
    simulation = Simulation(
        Scene(cells=[cell], physics=physics, numerics=NUMERICS, confinement=WALLS)
    )
    simulation.run(until=REST * radius**2)
    (field,) = simulation.fields
    surface = surface_points(field, NUMERICS.spacing)
    center, own_radius = fitted_sphere(surface[surface[:, 2] > CLEAR])
    return float(np.degrees(np.arccos(-center[2] / own_radius)))


def angle_of_a_large_cell(sigma_wall: float) -> float:
    """That of cells of two radii, linear in 1/R, where 1/R is 0."""
    small, large = (angle_at_rest(sigma_wall, radius) for radius in RADII)
    return (RADII[1] * large - RADII[0] * small) / (RADII[1] - RADII[0])


def main(picture: str) -> None:
    """Draw points and line, and print them."""
    import matplotlib as mpl

    mpl.use("agg")
    from matplotlib import pyplot as plt

    gamma = Physics().gamma
    line = np.linspace(0.1, 3.0, 30)
    figure, ax = plt.subplots(figsize=(5, 3.4), layout="constrained")
    ax.plot(line / gamma, [balanced_angle(s) for s in line], "k-", label="balance of tensions")
    for sigma_wall in (0.3, 0.5, 0.8, 1.2, 2.0, 2.75):
        small, found = angle_at_rest(sigma_wall, RADII[0]), angle_of_a_large_cell(sigma_wall)
        print(f"{sigma_wall:5.2f} {small:8.2f} {found:8.2f} {balanced_angle(sigma_wall):8.2f}")
        first = sigma_wall == 0.3
        ax.plot(sigma_wall / gamma, found, "C3o", label="cells, 1/R → 0" if first else None)
        ax.plot(sigma_wall / gamma, small, "C0.", label="R = 8 µm" if first else None)
    ax.set(xlabel="σ_wall / γ", ylabel="contact angle, degrees", ylim=(85, 180))
    ax.legend(frameon=False)
    figure.savefig(picture, dpi=110)


if __name__ == "__main__":
    main(*sys.argv[1:])
