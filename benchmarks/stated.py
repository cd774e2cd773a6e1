"""Errors that runs state, beside their true ones.

Run as `python benchmarks/stated.py` (about ten minutes). Every scene runs with each of `NUMERICS`,
and again with fixed steps of an eighth of δt (error in time), and on a lattice of half the spacing
with small steps (error in space, against the same steps on the lattice of the numerics). Stated and
true error are root mean squares over the cells, of their centroids, and of their semi-axes; at each
of three times, and once more over the three. Noise is held for 2 units of time, so that it is the
same with all steps.

With `--preset` and `--set`, other numerics: `--preset fast --set tolerance=5`. With `--random 16`,
so many scenes drawn at random instead, each with numerics drawn for it.
"""

import argparse
import json
import sys
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from _common import markdown_table
from _scenes import adhering, embryo, relaxing, walled

from morphosim import (
    Attraction,
    BoxWalls,
    Cell,
    Ellipsoid,
    EllipsoidShell,
    Numerics,
    Physics,
    Scene,
    Simulation,
    Sphere,
    Term,
    VolumeCourse,
)

FINER_STEPS, FINER_LATTICE = 8, 2
NUMERICS: dict[str, Numerics] = {
    "band": Numerics(solver="band"),
    "fast": Numerics.preset("fast"),
    "standard": Numerics.preset("standard"),
}
"""What scenes run with by default; "band" has fixed steps of 2."""
SMALL_STEPS: dict[str, dict[str, Any]] = {
    "bdf2": {"dt": 1.0, "S": 12.0},
    "linearised": {"dt": 0.5, "S": 1.0, "tolerance": None},
}
"""Of the two runs whose lattices differ, by scheme; S is what either lattice needs."""
SHARES = (0.25, 0.5, 1.0)
"""Of a run's end, at which errors are compared."""
MOST = 3.0
"""Factor within which stated errors should be."""


@dataclass(frozen=True, kw_only=True)
class HeldNoise(Term):
    """Motility whose directions are drawn every so often, whatever the step."""

    strength: float = 0.08
    held: float = 2.0
    random = True

    def update(self, cells: Any, step: Any, forces: Any) -> None:
        number = int(step.time / self.held + 1e-6)
        scale = self.strength * np.sqrt(self.held)
        for row, cell in enumerate(cells["id"].tolist()):
            forces.drift[row] += scale * np.random.default_rng([7, number, cell]).normal(size=3)


@dataclass(frozen=True)
class Case:
    """A scene, when it ends, and divisions on the way: time, cell, daughters, axis."""

    make: Callable[[], Scene]
    end: float
    divisions: Sequence[tuple[float, str, tuple[str, str], tuple[float, float, float]]] = ()


def ball(name: str, center: Sequence[float], radius: float, **values: Any) -> Cell:
    return Cell(name=name, shape=Sphere(center=tuple(center), radius=radius), **values)


def cluster(count: int, seed: int, radius: float, distance: float) -> list[Cell]:
    """Balls that touch, each one of those before."""
    rng, places = np.random.default_rng(seed), [np.zeros(3)]
    while len(places) < count:
        direction = rng.normal(size=3)
        place = places[rng.integers(len(places))] + distance * direction / np.linalg.norm(direction)
        if min(np.linalg.norm(place - other) for other in places) >= distance - 1e-9:
            places.append(place)
    return [ball(f"c{k}", place, radius) for k, place in enumerate(places)]


def random_table(scene: Scene, seed: int, most: float) -> Scene:
    """The scene with an asymmetric attraction table drawn at random."""
    sigma = np.random.default_rng(seed).uniform(0, most, (len(scene.names),) * 2)
    np.fill_diagonal(sigma, 0)
    return scene.with_physics(sigma=Attraction.from_matrix(scene.names, sigma))


def soft_among_stiff() -> Scene:
    cells = cluster(5, 5, 3.2, 6.2)
    cells = [replace(cell, gamma=0.12 if k == 0 else 0.4) for k, cell in enumerate(cells)]
    return Scene(cells=cells, physics=Physics(sigma=0.3))


def growing() -> Scene:
    cells = cluster(3, 7, 3.2, 6.2)
    course = VolumeCourse(times=[0, 100], volumes=[137, 220])
    return Scene(cells=[replace(cells[0], volume=course), *cells[1:]], physics=Physics(sigma=0.3))


def corner() -> Scene:
    walls = BoxWalls(lower=(-3.3, -3.1, -3.2), upper=(20, 20, 20))
    cells = [ball("a", (0.4, 0.6, 0.5), 3.6), ball("b", (6.6, 0.8, 0.3), 3.6)]
    return Scene(cells=cells, physics=Physics(sigma=0.4), confinement=walls)


def dividing() -> Scene:
    mother = Cell(name="P", shape=Ellipsoid(center=(0, 0, 0), semi_axes=(6, 4.5, 4.2)))
    return Scene(cells=[mother, ball("n", (0, 8.2, 1), 3.6)], physics=Physics(sigma=0.4))


def sorting() -> Scene:
    cells = [replace(c, type="ab"[k % 2]) for k, c in enumerate(cluster(6, 11, 3.0, 5.9))]
    types = {("a", "a"): 0.6, ("b", "b"): 0.4, ("a", "b"): 0.1}
    return Scene(cells=cells, physics=Physics(sigma=Attraction(types=types)))


def chain() -> Scene:
    cells = [ball(f"c{k}", (6.9 * k, 0.9 * (k % 2), 0.3 * k), 3.4) for k in range(4)]
    return Scene(cells=cells, physics=Physics(sigma=0.6))


def unequal() -> Scene:
    cells = [ball("a", (0, 0, 0), 4.2), ball("b", (6.8, 1, 0), 2.8), ball("c", (1, 6.9, 0.7), 3.0)]
    return Scene(cells=cells, physics=Physics(sigma=0.5))


def overlapping() -> Scene:
    places = ((0, 0, 0), (5.2, 1, 0.3), (1, 5.4, 0.7))
    cells = [ball("abc"[k], place, 3.6) for k, place in enumerate(places)]
    return Scene(cells=cells, physics=Physics(sigma=0.2))


def noisy() -> Scene:
    return Scene(cells=cluster(4, 13, 3.2, 6.2), physics=Physics(sigma=0.4, terms=[HeldNoise()]))


def free_random() -> Scene:
    return random_table(Scene(cells=cluster(5, 3, 3.2, 6.2)), 3, 0.98)


CASES = {
    "relaxing": Case(relaxing, 120),
    "adhering": Case(adhering, 120),
    "walled": Case(walled, 120),
    "dividing": Case(dividing, 120, [(32, "P", ("P0", "P1"), (1, 0.2, 0.1))]),
    "noisy": Case(noisy, 120),
    "embryo": Case(embryo, 240),
    "random σ": Case(free_random, 200),
    "embryo, random σ": Case(lambda: random_table(embryo(), 0, 0.98), 100),
    "soft among stiff": Case(soft_among_stiff, 240),
    "growing": Case(growing, 180),
    "corner": Case(corner, 240),
    "two types": Case(sorting, 240),
    "chain": Case(chain, 240),
    "unequal": Case(unequal, 120),
    "overlapping": Case(overlapping, 120),
}


@dataclass(frozen=True)
class Seen:
    """Cells at one time, µm, and the errors that the run states, nm."""

    names: list[str]
    centroids: np.ndarray
    axes: np.ndarray
    time: np.ndarray
    shape: np.ndarray
    space: np.ndarray


def seen(case: Case, numerics: Numerics) -> list[Seen]:
    """A run of the case, at some shares of its end."""
    simulation = Simulation(replace(case.make(), numerics=numerics, duration=1e6))
    found = []
    for end in sorted({*(share * case.end for share in SHARES), *(d[0] for d in case.divisions)}):
        simulation.run(until=end)
        for time, cell, daughters, axis in case.divisions:
            if time == end:
                simulation.divide(cell, daughters, axis=axis)
        if end / case.end in SHARES:
            found.append(_seen(simulation))
    return found


def _seen(simulation: Simulation) -> Seen:
    errors = simulation.errors
    return Seen(
        simulation.names, simulation.centroids, simulation.measured().semi_axes, errors.time,
        errors.shape, errors.space,
    )  # fmt: skip


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def rows_of(name: str, case: Case, numerics: Numerics) -> list[dict[str, Any]]:
    """Stated and true errors of a case at each of its times."""
    fine = {"dt": numerics.dt / FINER_STEPS}
    small = replace(numerics, **SMALL_STEPS[numerics.scheme])
    runs = [
        seen(case, each) for each in (
            numerics, replace(numerics, **fine, tolerance=None), small,
            replace(small, spacing=numerics.spacing / FINER_LATTICE),
        )
    ]  # fmt: skip
    rows = []
    for share, here, steps, coarse, lattice in zip(SHARES, *runs, strict=True):
        assert here.names == steps.names == lattice.names
        rows.append({
            "scene": name, "time": share * case.end,
            "time_stated": rms(here.time),
            "time_true": 1e3 * rms(np.linalg.norm(here.centroids - steps.centroids, axis=1)),
            "shape_stated": rms(here.shape),
            "shape_true": 1e3 * rms(here.axes - steps.axes),
            "space_stated": rms(coarse.space),
            "space_true": 1e3 * rms(np.linalg.norm(coarse.centroids - lattice.centroids, axis=1)),
        })  # fmt: skip
    return rows


KINDS = ("time", "space", "shape")
FLOORS = {"time": 0.5, "space": 1.5, "shape": 1.0}
"""True errors below these, nm, are no measure: to state less than three times that is right."""


def ratio(row: dict[str, Any], kind: str) -> float:
    """Stated over true error; NaN where both are next to nothing."""
    stated, true = row[f"{kind}_stated"], row[f"{kind}_true"]
    return np.nan if true < FLOORS[kind] and stated < MOST * FLOORS[kind] else stated / true


def markdown(rows: list[dict[str, Any]]) -> str:
    head = ["scene", "t", *(f"{kind}, {what}" for kind in KINDS for what in ("stated", "true", ""))]
    lines = []
    for row in rows:
        line = [row["scene"], f"{row['time']:g}"]
        for kind in KINDS:
            share = ratio(row, kind)
            line += [f"{row[f'{kind}_stated']:.2g}", f"{row[f'{kind}_true']:.2g}"]
            line.append("" if np.isnan(share) else f"{share:.2g}")
        lines.append(line)
    return markdown_table(head, lines)


def summary(rows: list[dict[str, Any]]) -> str:
    lines = []
    for kind in KINDS:
        found = np.array([ratio(row, kind) for row in rows])
        found = found[np.isfinite(found)]
        if not len(found):
            continue
        within = ((found >= 1 / MOST) & (found <= MOST)).mean()
        lines.append(
            f"{kind}: {len(found)} compared, {100 * within:.0f} % within a factor of {MOST:g}, "
            f"{(found < 1 / MOST).sum()} understated by more; {found.min():.2f} to "
            f"{found.max():.2f}, median {np.median(found):.2f}"
        )
    return "\n".join(lines)


def over_times(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """One row per scene: root mean squares over its times."""
    found = []
    for name in dict.fromkeys(row["scene"] for row in rows):
        own = [row for row in rows if row["scene"] == name]
        keys = [f"{kind}_{what}" for kind in KINDS for what in ("stated", "true")]
        found.append({"scene": name} | {key: rms(np.array([r[key] for r in own])) for key in keys})
    return found


def report(rows: list[dict[str, Any]]) -> str:
    """The table of all rows, and what they come to."""
    whole = f"of each time:\n{summary(rows)}\n\nof each scene, over its times:\n"
    return f"{markdown(rows)}\n\n{whole}{summary(over_times(rows))}\n"


def random_case(seed: int) -> tuple[Case, Numerics]:
    """Up to six balls that touch, free, boxed or in a shell, and numerics: all drawn at random."""
    draw = np.random.default_rng([seed, 77])
    count, radius = int(draw.integers(1, 7)), draw.uniform(2.8, 3.8)
    cells = cluster(count, seed, radius, radius * draw.uniform(1.75, 2.0))
    place = draw.choice(["open", "box", "shell"])
    if draw.random() < 0.3:
        cells = [replace(cell, gamma=float(draw.uniform(0.15, 0.4))) for cell in cells]
    centres = np.array([cell.shape.center for cell in cells])
    pad, walls = radius * draw.uniform(0.8, 1.05), None
    if place == "box":
        walls = BoxWalls(lower=tuple(centres.min(0) - pad), upper=tuple(centres.max(0) + pad))
    elif place == "shell":
        middle = centres.mean(axis=0)
        long = np.linalg.norm(centres - middle, axis=1).max() + radius * draw.uniform(0.85, 1.05)
        axes = (long, long * draw.uniform(0.85, 1), long * draw.uniform(0.85, 1))
        walls = EllipsoidShell(center=tuple(middle), semi_axes=axes)
    physics = Physics(sigma=float(draw.uniform(0, 0.9)))
    scene = Scene(cells=cells, physics=physics, confinement=walls)
    if count > 1 and draw.random() < 0.6:
        scene = random_table(scene, seed, float(draw.uniform(0.5, 0.98)))
    values: dict[str, Any] = {"spacing": float(draw.choice([0.4, 0.5, 0.6, 2 / 3]))}
    values["order"] = (6, "fitted")[int(draw.integers(2))]
    if draw.random() < 0.6:
        values["tolerance"] = float(np.exp(draw.uniform(np.log(2), np.log(50))))
    else:
        values["dt"] = float(np.exp(draw.uniform(np.log(0.5), np.log(4))))
        values["scheme"] = ("bdf2", "linearised")[int(draw.integers(2))]
    end = float(draw.choice([60, 120, 200]))
    return Case(lambda: scene, end), Numerics(solver="band", **values)


def main() -> None:
    """Compare all cases, and write the results."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", type=Path, default=Path("runs/stated"))
    parser.add_argument("--preset", help="instead of all of NUMERICS")
    parser.add_argument("--set", action="append", default=[], help="a value of the numerics")
    parser.add_argument("--only", nargs="+", choices=list(CASES))
    parser.add_argument("--random", type=int, metavar="N", help="so many scenes drawn at random")
    options = parser.parse_args()
    changes = {key: json.loads(value) for key, value in (s.split("=", 1) for s in options.set)}
    chosen = NUMERICS
    if options.preset or changes:
        name = options.preset or "standard"
        chosen = {" ".join([name, *options.set]): Numerics.preset(name, **changes)}
    jobs = {
        label: [(name, CASES[name], numerics) for name in options.only or CASES]
        for label, numerics in chosen.items()
    }
    if options.random:
        drawn = [(f"random {seed}", *random_case(seed)) for seed in range(options.random)]
        jobs = {"random": drawn}
    warnings.simplefilter("ignore")
    options.output.mkdir(parents=True, exist_ok=True)
    for label, cases in jobs.items():
        rows: list[dict[str, Any]] = []
        for case in cases:
            rows += rows_of(*case)
            print(markdown(rows[-len(SHARES) :]), file=sys.stderr, flush=True)
        (options.output / f"{label}.json").write_text(json.dumps(rows, indent=1))
        (options.output / f"{label}.md").write_text(report(rows))
        print(f"{label}\n\n{report(rows)}", flush=True)


if __name__ == "__main__":
    main()
