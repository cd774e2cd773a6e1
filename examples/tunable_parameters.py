"""Table 3 of the paper: what each tunable parameter does, one small scene each.

Run as `python examples/tunable_parameters.py`: about half a minute.
"""

import numpy as np

from morphosim import (
    Attraction,
    Cell,
    Physics,
    Scene,
    Simulation,
    Sphere,
    VolumeCourse,
    measure_fields,
)


def ball(name: str, x: float, radius: float = 5.0, **options: object) -> Cell:
    """Sphere on the x axis."""
    return Cell(name=name, shape=Sphere(center=(x, 0, 0), radius=radius), **options)


def run(cells: list[Cell], until: float, **physics: object) -> Simulation:
    """The cells after some time."""
    simulation = Simulation(Scene(cells=cells, physics=Physics(**physics)))
    simulation.run(until=until)
    return simulation


def growth_and_apoptosis() -> None:
    """V_i(t): one cell doubles its volume, another shrinks to a quarter."""
    grows = VolumeCourse(times=[0, 200], volumes=[520, 1040])
    shrinks = VolumeCourse(times=[0, 200], volumes=[520, 130])
    simulation = run([ball("grows", 0, volume=grows), ball("shrinks", 10, volume=shrinks)], 250)
    for name, volume in zip(simulation.names, simulation.volumes, strict=True):
        print(f"V(t)    {name:8} 520 um3 at first, {volume:.0f} um3 in the end")


def soft_among_stiff() -> None:
    """γ per cell: the soft cell between two stiff ones gives way."""
    simulation = run(
        [ball("stiff 1", 0, gamma=0.5), ball("soft", 9, gamma=0.1), ball("stiff 2", 18, gamma=0.5)],
        500, sigma=0.3,
    )  # fmt: skip
    found = measure_fields(simulation.fields, simulation.scene.numerics.spacing)
    for name, eta in zip(simulation.names, found.irregularity, strict=True):
        print(f"gamma   {name:8} eta = {eta:.4f} (a ball: 2.1991)")


def chase() -> None:
    """σ_ij ≠ σ_ji: the hunter is drawn to the prey, which is not drawn to it."""
    sigma = Attraction(pairs={("prey", "hunter"): 0.8, ("hunter", "prey"): 0.0})
    for held in (False, True):
        cells = [
            ball("hunter", 0, gamma=0.15),
            ball("prey", 8, radius=3.0, gamma=0.5, frozen=held),
        ]
        start = Simulation(Scene(cells=cells)).centroids[:, 0]
        simulation = run(cells, 600, sigma=sigma)
        hunter, prey = simulation.centroids[:, 0] - start
        found = measure_fields(simulation.fields, simulation.scene.numerics.spacing)
        share = found.contact_area.sum() / found.surface_area[1]
        what = "held prey" if held else "free prey"
        print(
            f"sigma   {what}: the hunter has moved by {hunter:.1f} um, the prey by {prey:.1f} um; "
            f"{100 * share:.0f} % of the prey is covered"
        )


def viscosity() -> None:
    """τ: the same motion takes twice as long in twice the viscosity."""
    gaps = []
    for tau, until in ((2.62, 100), (5.24, 200)):
        simulation = run([ball("a", 0), ball("b", 10)], until, sigma=0.5, tau=tau)
        gaps.append(np.linalg.norm(np.diff(simulation.centroids, axis=0)))
    print(f"tau     2.62 at t = 100: {gaps[0]:.3f} um apart; 5.24 at t = 200: {gaps[1]:.3f} um")


if __name__ == "__main__":
    growth_and_apoptosis()
    soft_among_stiff()
    chase()
    viscosity()
