"""Fig. S4: the irregularity η = area^(1/2) / volume^(1/3) of AB and P1 against γ.

Run as `python examples/stiffness.py [picture]`: about a minute; the picture needs matplotlib. The
egg divides in its shell and the two cells come to rest, for several surface tensions.
"""

import sys
from dataclasses import replace

from morphosim import Simulation, built_in_scene
from morphosim.measure import measure_fields

GAMMAS = (0.1, 0.15, 0.25, 0.4, 0.6)

rows = []
for gamma in GAMMAS:
    values = {"numerics.preset": "fast", "numerics.S": 12.0, "physics.gamma": gamma}
    scene = built_in_scene("celegans-1-to-8", values)
    simulation = Simulation(replace(scene, stages=scene.stages[:2]))
    simulation.run()
    found = measure_fields(simulation.fields, scene.numerics.spacing)
    eta = dict(zip(simulation.names, found.irregularity.tolist(), strict=True))
    rows.append((gamma, eta["AB"], eta["P1"]))
    print(f"gamma = {gamma:4}: eta of AB {eta['AB']:.4f}, of P1 {eta['P1']:.4f}")

if len(sys.argv) > 1:
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(5, 3.5), layout="constrained")
    for k, (name, color) in enumerate((("AB", "#0b4f8a"), ("P1", "#b3500c")), 1):
        axes.plot(GAMMAS, [row[k] for row in rows], "o-", color=color, label=name)
    axes.axhline(2.1995, color="0.6", lw=0.8)
    axes.annotate("a ball", (GAMMAS[-1], 2.1995), ha="right", va="bottom", color="0.4")
    axes.set(xlabel="surface tension γ", ylabel="irregularity η")
    axes.legend()
    figure.savefig(sys.argv[1], dpi=150)
