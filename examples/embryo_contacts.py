"""Fig. 4 of the paper: weak attraction between ABpl and E keeps the embryo three-dimensional.

Runs both built-in scenes (a few minutes) and prints their contact maps and how flat they end.
`python examples/embryo_contacts.py [time]` stops earlier.
"""

import sys

import numpy as np

from morphosim import ProgressBar, Simulation, built_in_scene, touching

until = float(sys.argv[1]) if len(sys.argv) > 1 else 15000.0
for name in ("celegans-8", "celegans-8-strong"):
    simulation = Simulation(built_in_scene(name))
    simulation.run(until=until, observers=[ProgressBar()])
    cells = simulation.names
    pairs = touching(simulation.fields)
    print(f"\n{name}, t = {simulation.time:g}: {len(pairs)} contacts")
    for a in cells:
        row = " ".join("o" if {(a, b), (b, a)} & pairs.keys() else "." for b in cells)
        print(f"  {a:5} {row}")
    centred = simulation.centroids - simulation.centroids.mean(axis=0)
    thickness = np.linalg.svd(centred, compute_uv=False)[2] / np.sqrt(len(cells))
    print(f"  root mean square distance from the best plane: {thickness:.2f} um")
