"""Which cosine transform is fastest: one step of the same cells with each backend.

Run as `python benchmarks/transforms.py`. The default of `Numerics.transform` is what this shows.
"""

from _common import alternating_medians, arguments, packed_scene, report, stepper

from morphosim import Simulation
from morphosim.numerics.parameters import TRANSFORMS


def main() -> None:
    """Measure and report."""
    options = arguments(__doc__, cells=27, rounds=9)
    rows = []
    for radius in (3.0, 4.0, 6.0, 8.5):
        simulations = {
            name: Simulation(packed_scene(options.cells, radius, transform=name))
            for name in TRANSFORMS
        }
        medians = alternating_medians(
            {name: stepper(s) for name, s in simulations.items()}, options.rounds
        )
        shape = simulations["matrix"].fields[0].phi.shape
        rows.append(
            {"R um": radius, "box": "x".join(map(str, shape))}
            | {f"{name}, us per cell": 1e6 * t / options.cells for name, t in medians.items()}
        )
    report(rows, options.json)


if __name__ == "__main__":
    main()
