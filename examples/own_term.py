"""A force term of one's own: gravity, by which a cell sinks with the velocity weight / τ.

Run as `python examples/own_term.py`. It prints how fast the cell sinks and saves nothing.
"""

from dataclasses import dataclass

from morphosim import Cell, Numerics, Physics, Scene, Simulation, Sphere, Term


@dataclass(frozen=True, kw_only=True)
class Gravity(Term):
    """d·∇φ with d = (0, 0, weight)."""

    weight: float = 0.1

    def update(self, cells, step, forces):
        """Pull all cells down."""
        forces.drift[:, 2] += self.weight


if __name__ == "__main__":  # a run that goes on imports this file
    ball = Cell(name="ball", shape=Sphere(center=(0, 0, 0), radius=4))
    physics = Physics(terms=[Gravity(weight=0.1)])
    simulation = Simulation(Scene(cells=[ball], physics=physics, numerics=Numerics(dt=0.5)))
    simulation.run(until=20)  # by then the velocity has built up
    start = simulation.centroids[0, 2]
    simulation.run(until=60)
    speed = (start - simulation.centroids[0, 2]) / 40
    print(f"sinks by {speed:.4f} um per time; weight / tau is {0.1 / physics.tau:.4f}")
