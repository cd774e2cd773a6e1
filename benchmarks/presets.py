"""The presets on the eight-cell embryo to t = 15000: outcome, error and speed.

Run as `python benchmarks/presets.py` (about half an hour). Every preset is compared with
`reference`: centroids on the way, contacts at the end. Speed is timed at the end, all presets in
turn. Writes a table, and JSON on request.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from _common import alternating_medians, arguments, report, stepper
from _scenes import embryo
from _states import State, states

from morphosim import Numerics, Simulation
from morphosim.numerics.parameters import PRESETS


@dataclass(frozen=True)
class Course:
    """Where the cells went, and the contacts at the end."""

    simulation: Simulation
    states: list[State]

    @property
    def centroids(self) -> np.ndarray:
        """(T, N, 3) µm."""
        return np.array([state.centroids for state in self.states])

    @property
    def contacts(self) -> set[tuple[str, str]]:
        """Contacts at the end."""
        return self.states[-1].touching


def course(preset: str, until: float, every: float) -> Course:
    """Run one preset."""
    simulation = Simulation(replace(embryo(), numerics=Numerics.preset(preset)))
    found = []
    for k in range(1, round(until / every) + 1):
        found += states(simulation, [k * every])
        print(f"{preset} t = {simulation.time:g}", flush=True)
    return Course(simulation, found)


def compare(name: str, found: Course, truth: Course) -> dict[str, Any]:
    """One line of the table."""
    distance = 1e3 * np.linalg.norm(found.centroids - truth.centroids, axis=2)
    odd = found.contacts ^ truth.contacts
    return {
        "preset": name,
        "contacts": len(found.contacts),
        "not in both": ", ".join("-".join(p) for p in sorted(odd)) or "none",
        "rms at end, nm": float(np.sqrt((distance[-1] ** 2).mean())),
        "largest at end, nm": float(distance[-1].max()),
        "largest ever, nm": float(distance.max()),
    }


def main() -> None:
    """Run all presets and report."""
    options = arguments(__doc__, until=15000.0, every=500.0, rounds=15)
    found = {name: course(name, options.until, options.every) for name in PRESETS}
    seconds = alternating_medians(
        {name: stepper(run.simulation) for name, run in found.items()}, options.rounds
    )
    whole = {n: seconds[n] * options.until / Numerics.preset(n).dt for n in PRESETS}
    rows = [
        compare(name, found[name], found["reference"])
        | {
            "ms per step": 1e3 * seconds[name],
            "s to the end": whole[name],
            "speed": whole["reference"] / whole[name],
        }
        for name in PRESETS
    ]
    report(rows, options.json)


if __name__ == "__main__":
    main()
