"""Two cells that adhere: the smallest scene of your own.

Run as `python examples/two_cells.py`. It prints how the contact grows and saves nothing.
"""

from morphosim import Cell, Physics, Scene, Simulation, Sphere, contact_areas

left = Cell(name="left", shape=Sphere(center=(0, 0, 0), radius=5))
right = Cell(name="right", shape=Sphere(center=(9.5, 0, 0), radius=4), volume=300.0)
scene = Scene(cells=[left, right], physics=Physics(sigma=0.5))

simulation = Simulation(scene)
for time in (0, 100, 200, 400):
    simulation.run(until=time)
    areas = contact_areas(simulation.fields, scene.numerics.spacing)
    contact = areas.get(("left", "right"), 0.0)
    print(f"t = {simulation.time:4g}: contact {contact:5.1f} um2, volumes {simulation.volumes}")
