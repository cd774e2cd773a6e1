"""A scene against a trajectory of the published scheme: centroids and contacts at equal times.

Run as `python benchmarks/against_published.py SCENE.toml --trajectory trajectory.csv
--contacts contacts.csv [--until 10000] [--offset 0]`. The trajectory has columns time, cell, x_um,
y_um, z_um, volume_above_half_um3; the contacts time, cell1, cell2. Numerics are the preset
`published`, and what `--set` says. `--offset` is the trajectory's
time at which the scene starts. Centroids are those of φ > 0.02, as in the trajectory.
"""

import argparse
import csv
import tomllib
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
from _common import report

from morphosim import Simulation, load_scene, touching
from morphosim.cell_field import CellField, centroid

Trajectory = dict[float, dict[str, dict[str, float]]]


def read_trajectory(path: Path) -> Trajectory:
    """Rows of the trajectory by time and cell."""
    table: Trajectory = defaultdict(dict)
    with path.open(newline="") as file:
        for row in csv.DictReader(file):
            cell, time = row.pop("cell"), float(row.pop("time"))
            table[time][cell] = {key: float(value) for key, value in row.items()}
    return table


def read_contacts(path: Path) -> dict[float, set[tuple[str, str]]]:
    """Pairs that touch, by time."""
    pairs: dict[float, set[tuple[str, str]]] = defaultdict(set)
    with path.open(newline="") as file:
        for row in csv.DictReader(file):
            pairs[float(row["time"])].add((row["cell1"], row["cell2"]))
    return pairs


def centroids(simulation: Simulation) -> np.ndarray:
    """(N, 3) centroids of φ > 0.02, µm."""
    spacing = simulation.scene.numerics.spacing
    return np.array(
        [
            centroid(CellField(f.name, f.origin, np.where(f.phi > 0.02, f.phi, 0)), spacing)
            for f in simulation.fields
        ]
    )


def compare(simulation: Simulation, cells: dict[str, dict[str, float]], start: np.ndarray) -> dict:
    """Largest differences at one time."""
    rows = [cells[name] for name in simulation.names]
    there = np.array([[row["x_um"], row["y_um"], row["z_um"]] for row in rows])
    wanted = np.array([row["volume_above_half_um3"] for row in rows])
    return {
        "time": simulation.time,
        "centroids differ nm": 1e3 * np.linalg.norm(centroids(simulation) - there, axis=1).max(),
        "cells moved um": np.linalg.norm(there - start, axis=1).max(),
        "core volumes differ": float(np.abs(simulation.engine.core_volumes / wanted - 1).max()),
    }


def options() -> argparse.Namespace:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scene", type=Path)
    parser.add_argument("--trajectory", type=Path, required=True)
    parser.add_argument("--contacts", type=Path, required=True)
    parser.add_argument("--until", type=float, default=10000.0)
    parser.add_argument("--offset", type=float, default=0.0)
    parser.add_argument("--set", action="append", default=[], help="numerics.order=4, …")
    parser.add_argument("--json", type=Path)
    return parser.parse_args()


def main() -> None:
    """Run the scene, stop at every time of the contact table, and report."""
    given = options()
    overrides: dict[str, Any] = {"numerics.preset": "published"}
    for setting in given.set:
        key, _, text = setting.partition("=")
        overrides[key] = tomllib.loads(f"value = {text}")["value"]
    simulation = Simulation(load_scene(given.scene, overrides))
    trajectory, contacts = read_trajectory(given.trajectory), read_contacts(given.contacts)
    start, rows = centroids(simulation), []
    for time in sorted(contacts):
        if not given.offset < time <= given.until:
            continue
        simulation.run(until=time - given.offset)
        row = compare(simulation, trajectory[time], start)
        row["contacts equal"] = set(touching(simulation.fields)) == contacts[time]
        rows.append(row | {"time": time})
    report(rows, given.json)


if __name__ == "__main__":
    main()
