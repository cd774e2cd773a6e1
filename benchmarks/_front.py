"""Error against cost of the eight-cell embryo: former settings, presets, runs with a tolerance.

A *race* takes simulations through the same times in turn, one stretch of time each, so that what
else the machine does falls on all alike. Races are kept in a JSON file, each when it is over:
whoever is interrupted goes on with the next.
"""

import json
import time
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self

import numpy as np
from _common import machine, markdown_table
from _scenes import embryo
from _states import CONTACT_AREA, cached

from morphosim import Numerics, Simulation, contact_areas
from morphosim.errors import SimulationError
from morphosim.numerics.parameters import PRESETS

STRETCH = {480.0: 120.0, 15000.0: 500.0}
"""How much time each simulation has at its turn, by the end of the race."""
FORMER: dict[str, dict[str, Any]] = {
    "draft": {"dt": 4.0, "spacing": 2 / 3, "box_tolerance": 3e-3},
    "fast": {"solver": "band"},
    "standard": {},
    "reference": {"dt": 0.5, "spacing": 1 / 3},
}
"""The presets before steps knew their error; the rest of their numbers is `COMMON`."""
FINE = 0.5
"""Spacing below which the new front has boxes as wide as `COMMON` has."""
COMMON: dict[str, Any] = {
    "scheme": "bdf2", "solver": "dct", "dt": 2.0, "S": 6.0, "spacing": 0.5, "order": 6,
    "box_tolerance": 1e-3, "precision": "single", "walls": "resolved",
}  # fmt: skip
WARM_UP = 3
"""Steps that compile all that a race needs."""
CLAIMS = {"draft": "draft", "standard": "fast", "reference": "reference"}
"""At the error of which former preset the new front is compared with the time of which."""
TOLERANCES = {
    1 / 3: (0.5, 1.0, 2.0), 0.4: (2.0, 5.0), 0.5: (5.0, 10.0, 20.0), 0.55: (5.0, 10.0, 20.0),
    0.6: (10.0, 15.0, 20.0, 50.0), 2 / 3: (20.0, 50.0),
}  # fmt: skip
"""Tolerances of the new front, by spacing: those whose error is about that of the lattice."""
TRUTH: dict[float, dict[str, Any]] = {
    480.0: {"spacing": 0.25, "dt": 0.25, "S": 4.4, "precision": "double", "box_tolerance": 1e-5},
    15000.0: {"spacing": 0.25, "tolerance": 1.0, "order": "fitted", "box_tolerance": 1e-4},
}
"""Numerics, with the band solver, that errors at the end of a race are measured against: those of
the former scheme at first, and of the new one where the former would take hours."""


def variants() -> dict[str, Numerics]:
    """All that races: by family and name, the former front first."""
    former = {f"former {name}": Numerics(**(COMMON | own)) for name, own in FORMER.items()}
    presets = {f"preset {name}": Numerics.preset(name) for name in PRESETS}
    new = {
        f"{tolerance:g} nm, h = {h:.3g}": Numerics(
            tolerance=tolerance,
            spacing=h,
            order="fitted",
            box_tolerance=1e-3 if h < FINE else 3e-3,
        )
        for h, tolerances in TOLERANCES.items()
        for tolerance in tolerances
    }
    return former | presets | new


@dataclass(frozen=True)
class Course:
    """What is kept of one simulation in one race."""

    seconds: float
    """Wall time of all its turns."""
    processor_seconds: float
    """Time of all threads, which does not count what others do."""
    steps: int
    times: list[float]
    centroids: np.ndarray
    """(T, N, 3) µm, at the end of each turn."""
    contacts: list[list[str]]
    """Pairs that touch at the end."""

    @classmethod
    def from_json(cls, table: Mapping[str, Any]) -> Self:
        """What `to_json` gave."""
        return cls(**(dict(table) | {"centroids": np.array(table["centroids"])}))

    def to_json(self) -> dict[str, Any]:
        """As numbers and lists."""
        return vars(self) | {"centroids": self.centroids.tolist()}

    def error(self, truth: Self) -> dict[str, float]:
        """Distances of centroids, nm, and how many contacts are not in both."""
        distance = 1e3 * np.linalg.norm(self.centroids - truth.centroids, axis=2)
        pairs = ({tuple(pair) for pair in course.contacts} for course in (self, truth))
        return {
            "rms": float(np.sqrt((distance[-1] ** 2).mean())),
            "largest": float(distance[-1].max()),
            "largest ever": float(distance.max()),
            "contacts": len(self.contacts),
            "not in both": len(next(pairs) ^ next(pairs)),
        }


def race(chosen: Mapping[str, Numerics], until: float) -> dict[str, Course]:
    """Take one simulation of each to `until`, in turn; without those that fail on the way."""
    scenes = {name: replace(embryo(), numerics=numerics) for name, numerics in chosen.items()}
    for scene in scenes.values():
        Simulation(scene).step(WARM_UP)
    simulations = {name: Simulation(scene) for name, scene in scenes.items()}
    times = np.arange(1, round(until / STRETCH[until]) + 1) * STRETCH[until]
    spent = {name: np.zeros(2) for name in chosen}
    places: dict[str, list[np.ndarray]] = {name: [] for name in chosen}
    for t in times.tolist():
        for name, simulation in list(simulations.items()):
            begin = clocks()
            try:
                simulation.run(until=t)
            except SimulationError as error:
                print(f"{name}: {error}", flush=True)
                del simulations[name]
                continue
            spent[name] += clocks() - begin
            places[name].append(simulation.centroids)
        print(f"t = {t:g}", flush=True)
    return {
        name: Course(
            *spent[name].tolist(), s.engine.steps, times.tolist(), np.array(places[name]),
            contacts(s),
        )
        for name, s in simulations.items()
    }  # fmt: skip


def clocks() -> np.ndarray:
    """Wall time, and time of all threads of this process."""
    return np.array([time.perf_counter(), time.process_time()])


def contacts(simulation: Simulation) -> list[list[str]]:
    """Pairs of cells that touch over more than `CONTACT_AREA`."""
    areas = contact_areas(simulation.fields, simulation.scene.numerics.spacing)
    return sorted(sorted(pair) for pair, area in areas.items() if area > CONTACT_AREA)


class Races:
    """All races that have been run, in a file.

    Parameters
    ----------
    path : Path
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        known = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
        self._courses: dict[str, list[dict[str, Any]]] = known.get("courses", {})

    def of(self, name: str, until: float) -> list[Course]:
        """Courses of one variant to one time."""
        return [Course.from_json(c) for c in self._courses.get(f"{name} to {until:g}", [])]

    def run(self, chosen: Mapping[str, Numerics], until: float, rounds: int) -> None:
        """Race until each has so many courses; who has them already stays out."""
        able = list(chosen)
        while behind := {n: chosen[n] for n in able if len(self.of(n, until)) < rounds}:
            print(f"race to {until:g}: {', '.join(behind)}", flush=True)
            courses = race(behind, until)
            able = [n for n in able if n in courses or n not in behind]
            for name, course in courses.items():
                self._courses.setdefault(f"{name} to {until:g}", []).append(course.to_json())
            text = json.dumps({"machine": machine(), "courses": self._courses}, indent=1)
            self._path.write_text(text, encoding="utf-8")


def truth(folder: Path, until: float) -> Course:
    """The converged course; computed once per folder."""
    numerics = Numerics(solver="band", allow_coarse=True, **TRUTH[until])
    path = folder / f"front-truth-{until:g}.pickle"
    return cached(path, lambda: race({"truth": numerics}, until)["truth"])


def rows(races: Races, true: Course, until: float) -> list[dict[str, Any]]:
    """Error and cost of all variants that have been to `until`."""
    found = []
    for name in variants():
        if courses := races.of(name, until):
            clock = ("seconds", "processor_seconds")  # what else the machine does only adds to it
            cost: dict[str, Any] = {k: min(getattr(c, k) for c in courses) for k in clock}
            cost["steps"] = courses[0].steps
            found.append({"variant": name} | cost | courses[0].error(true))
    return found


def cost_at(found: Sequence[Mapping[str, Any]], error: float) -> float:
    """Least time for an error, on the front of log error over log time.

    It is nan where the front does not come within a tenth of the error.
    """
    points = sorted((r["seconds"], r["rms"]) for r in found)
    best = [np.inf]
    front = [(s, e) for s, e in points if e < best[-1] and not best.append(e)]
    if not front or error < 0.9 * front[-1][1]:
        return np.nan
    if error >= front[0][1]:
        return front[0][0]
    seconds, errors = np.log(front)[::-1].T
    return float(np.exp(np.interp(np.log(error), errors, seconds)))


def gains(found: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """How many times less time the new front takes, by claim."""
    former = {r["variant"].removeprefix("former "): r for r in found if is_former(r)}
    new = [r for r in found if not is_former(r)]
    return {
        f"than former {slow}, at the error of former {right}":
            former[slow]["seconds"] / cost_at(new, former[right]["rms"])
        for right, slow in CLAIMS.items()
        if {right, slow} <= former.keys()
    }  # fmt: skip


def is_former(row: Mapping[str, Any]) -> bool:
    """Whether a row is of the former front."""
    return row["variant"].startswith("former ")


COLUMNS = ("largest", "largest ever", "contacts", "not in both")
"""Of the table, besides the variant, its cost and the root mean square error at the end."""


def markdown(found: Sequence[Mapping[str, Any]], until: float) -> str:
    """A table, and the gains in time."""
    head = ["variant", "s", "processor s", "steps", "rms, nm", *COLUMNS]
    body = [
        [
            r["variant"],
            *(f"{r[k]:.4g}" for k in ("seconds", "processor_seconds", "steps", "rms", *COLUMNS)),
        ]
        for r in found
    ]
    told = "".join(f"- {gain:.2g} times less time {what}\n" for what, gain in gains(found).items())
    return f"t = {until:g}\n\n{markdown_table(head, body)}\n{told}\n"


def measure(
    folder: Path, ends: Collection[float], names: Collection[str], rounds: int
) -> dict[float, list[dict[str, Any]]]:
    """Race, those to the later time once, and give rows by the time of the end."""
    races = Races(folder / "front.json")
    chosen = {n: v for n, v in variants().items() if not names or n in names}
    found = {}
    for until in ends:
        races.run(chosen, until, rounds if until == min(STRETCH) else 1)
        found[until] = rows(races, truth(folder, until), until)
    return found
