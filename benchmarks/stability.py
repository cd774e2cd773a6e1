"""The stability map: smallest stable S, stretch of time, and the limits of every parameter.

Run as `python benchmarks/stability.py` (about half an hour). Writes one file for each of its parts,
stability.md and the pictures into the output folder; with `--only limits`, say, it measures that
part alone, and draws what is there. With `--tolerance 10` it runs the extremes alone, with steps of
that tolerance, and counts their steps. With `--random 60` it runs that many scenes of random,
extreme numbers through the command line instead, and counts how they end, with `--tolerance` under
error control too.

A run is stable if it takes all its steps, ends with sound fields (-0.3 < φ < 1.5) and does not
flip from step to step. The parts:

- `smallest_S` over δt for both schemes (Fig. 2), on the eight-cell embryo with stepped walls as
  published and with resolved ones, beside what `morphosim.scene.stability` predicts;
- the stretch of *in silico* time at that S (Fig. S3): the factor by which the embryo's trajectory
  is slower than that of small steps;
- the limits of physical parameters with steps of δt = 2, with a tolerance (the preset `standard`),
  and with the preset `published`;
- what long steps miss: the error of the fields at the end of runs, as a share of what has changed
  since their start, beside what `morphosim.scene.stability.missed` says of it.
"""

import argparse
import random
import subprocess
import sys
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from _common import machine, markdown_table
from _pictures import limits_picture, stability_picture
from _scenes import adhering, embryo, relaxing, walled
from _states import difference, fields_of
from scipy.optimize import minimize_scalar

from morphosim import BoxWalls, Cell, DivergenceError, Numerics, Scene, Simulation, Sphere
from morphosim.cell_field import CellField
from morphosim.errors import CellVanishedError, ToleranceError
from morphosim.scene.stability import is_late, lag, least_S, missed, pressing

TIME_STEPS = (0.1, 0.3, 0.5, 1.0, 1.5, 2.0, 2.1, 2.5, 3.0, 4.0)
SCHEMES = ("bdf2", "imex1")
WALLS = ("stepped", "resolved")
LARGEST_S = 40.0
TOLERANCE = 10.0
"""Of the extremes under error control, nm per 100 units of time."""
STABLE = "stable"
LONG = 1e9


def outcome(scene: Scene, steps: int) -> str:
    """What becomes of a scene: stable, flips, unsound, diverged, vanished or missed; never NaN.

    Missed is a tolerance.
    """
    return outcome_of(Simulation(scene), steps)


def outcome_of(simulation: Simulation, steps: int) -> str:
    """What becomes of a simulation in the time of so many δt."""
    numerics = simulation.scene.numerics
    end = STABLE
    try:
        simulation.step_to(numerics.ticks_to(steps * numerics.dt))
        if _flips(simulation):
            end = "flips"
    except DivergenceError:
        end = "diverged"
    except CellVanishedError:
        end = "vanished"
    except ToleranceError:
        end = "missed"
    low = min(float(f.phi.min()) for f in simulation.fields)
    high = max(float(f.phi.max()) for f in simulation.fields)
    if not (np.isfinite(low) and np.isfinite(high)):
        return "NOT FINITE"
    return "unsound" if end == STABLE and (low < -0.3 or high > 1.5) else end


def _flips(simulation: Simulation) -> bool:
    """Whether some field moves back and forth from one step to the next by more than 0.02."""
    seen = []
    for _ in range(3):
        seen.append([(f.origin.copy(), f.phi.copy()) for f in simulation.fields])
        simulation.step()
    for first, second, third in zip(*seen, strict=True):
        same = all((o == first[0]).all() and p.shape == first[1].shape for o, p in (second, third))
        if not same:
            continue
        forth, back = second[1] - first[1], third[1] - second[1]
        if np.abs(back).max() > 0.02 and (forth * back).sum() < -0.5 * (back**2).sum():
            return True
    return False


def bisect(stable: Callable[[float], bool], good: float, bad: float, close: float) -> float:
    """Last value on the stable side between a stable and an unstable one."""
    while abs(bad - good) > close:
        middle = 0.5 * (good + bad)
        good, bad = (middle, bad) if stable(middle) else (good, middle)
    return good


def smallest_S(scene: Scene, steps: int, **numerics: Any) -> float:
    """Smallest stable S in steps of 0.1; nan where none up to 40 is stable."""

    def stable(tenths: float) -> bool:
        S = round(tenths) / 10
        return outcome(scene.with_numerics(S=S, **numerics), steps) == STABLE

    if stable(0):
        return 0.0
    if not stable(10 * LARGEST_S):
        return np.nan
    return round(bisect(stable, 10 * LARGEST_S, 0.0, 1.0)) / 10


def map_of_S(scene: Scene) -> xr.Dataset:
    """Smallest stable and predicted S over walls, scheme and δt."""
    shape = (len(WALLS), len(SCHEMES), len(TIME_STEPS))
    found, predicted = np.full(shape, np.nan), np.full(shape, np.nan)
    for index in np.ndindex(shape):
        numerics = {
            "walls": WALLS[index[0]], "scheme": SCHEMES[index[1]], "dt": TIME_STEPS[index[2]],
        }  # fmt: skip
        steps = int(max(200, 40 / numerics["dt"]))
        found[index] = smallest_S(scene, steps, **numerics)
        chosen = scene.with_numerics(**numerics)
        predicted[index] = least_S(chosen, pressing(chosen))
        print(
            *numerics.values(), "S =", found[index], f"predicted {predicted[index]:.1f}", flush=True
        )
    dims = ("walls", "scheme", "dt")
    coords = {"walls": list(WALLS), "scheme": list(SCHEMES), "dt": list(TIME_STEPS)}
    return xr.Dataset(
        {"smallest_S": (dims, found), "predicted_S": (dims, predicted)}, coords=coords
    )


def stable_map() -> xr.Dataset:
    """`map_of_S` of the embryo, and the stretch of time where walls are as published."""
    smallest = map_of_S(embryo())
    published = smallest["smallest_S"].sel(walls="stepped", drop=True)
    return smallest.assign(stretch=stretches(embryo().with_numerics(walls="stepped"), published))


def trajectory(scene: Scene, until: float, every: float) -> tuple[np.ndarray, np.ndarray]:
    """Times, and centroids (T, N, 3)."""
    simulation = Simulation(scene)
    times, places = [0.0], [simulation.centroids]
    while simulation.time < until:
        simulation.run(until=simulation.time + every)
        times.append(simulation.time)
        places.append(simulation.centroids)
    return np.array(times), np.array(places)


def stretches(scene: Scene, smallest: xr.DataArray, until: float = 240.0) -> xr.DataArray:
    """Factor by which time runs slow at the smallest stable S, for each scheme and δt."""
    base = trajectory(scene.with_numerics(dt=0.1, S=0.0, scheme="imex1"), until, 10.0)
    result = xr.full_like(smallest, np.nan)
    for index in np.ndindex(smallest.shape):
        point = smallest[index]
        scheme, dt, S = str(point.scheme.values), float(point.dt), float(point)
        if not np.isfinite(S):
            continue
        theory = 1 + S * dt / scene.physics.tau if scheme == "imex1" else 1.0
        changed = scene.with_numerics(dt=dt, S=S, scheme=scheme)
        try:
            path = trajectory(changed, 1.4 * theory * until, max(10.0, dt))
        except DivergenceError as error:
            print(error)
            continue
        result[index] = fitted_stretch(base, path, theory)
        print(scheme, dt, S, f"stretch {float(result[index]):.3f}, 1 + S dt/tau = {theory:.3f}")
    return result


def fitted_stretch(
    base: tuple[np.ndarray, np.ndarray], path: tuple[np.ndarray, np.ndarray], guess: float
) -> float:
    """Factor s at which path(s t) is nearest to base(t)."""
    times = base[0][1:]

    def misfit(factor: float) -> float:
        flat = path[1].reshape(len(path[0]), -1)
        at = [np.interp(factor * times, path[0], column) for column in flat.T]
        return float(((np.array(at).T - base[1][1:].reshape(len(times), -1)) ** 2).sum())

    found = minimize_scalar(misfit, bounds=(0.7 * guess, 1.4 * guess), method="bounded")
    return float(found.x)


@dataclass(frozen=True)
class Parameter:
    """A parameter, its scene, the extremes that must not fail badly, and the search for its limit.

    `usual` is stable; the limit is sought towards `bound`.
    """

    name: str
    make: Callable[[float], Scene]
    extremes: Sequence[float]
    usual: float
    bound: float
    unit: str = ""


def physics(make: Callable[[], Scene], name: str) -> Callable[[float], Scene]:
    """Scene with one physical parameter set."""
    return lambda value: make().with_physics(**{name: value})


def well(c: float) -> Scene:
    """Adhering cells with double well c, on a lattice with √(2c) h ≤ 1."""
    spacing = min(0.5, 1 / np.sqrt(2 * c))
    return adhering().with_physics(c=c).with_numerics(spacing=spacing)


def sized(radius: float) -> Scene:
    """Two touching cells of a radius."""
    return adhering(distance=2 * radius, radius=radius)


def overlapping(percent: float) -> Scene:
    """Two cells of R = 4 µm whose diameters overlap by a share at the start."""
    return adhering(distance=8.0 * (1 - percent / 100))


def cornered(percent: float) -> Scene:
    """A cell in the corner of a box, cut by three faces at a share of its radius."""
    wall = 4.0 * (1 - percent / 100)
    walls = BoxWalls(lower=(-wall, -wall, -wall), upper=(40, 40, 40))
    cell = Cell(name="cell", shape=Sphere(center=(0.0, 0.0, 0.0), radius=4.0))
    return Scene(cells=[cell], confinement=walls)


PARAMETERS = (
    Parameter("M'", physics(adhering, "M"), (0.0, 16.0, 32.0, 64.0, 1000.0), 8.0, 1000.0),
    Parameter("g", physics(lambda: overlapping(40), "g"), (0.0, 16.0, 100.0, 1e4), 1.6, 1e4),
    Parameter("g_e", physics(walled, "g_e"), (0.0, 1.0, 160.0, 1e4), 16.0, 1e4),
    Parameter("σ", physics(adhering, "sigma"), (0.0, 1.0, 2.0, 3.0, 10.0), 0.5, 30.0),
    Parameter("κ", physics(adhering, "kappa"), (0.0, 0.22, 1.0, 3.0, 30.0), 0.22, 100.0),
    Parameter("c", well, (0.5, 1.0, 4.0, 9.0, 18.0), 2.0, 100.0),
    Parameter("γ", physics(adhering, "gamma"), (0.25 / 16, 0.25 / 4, 1.0, 4.0), 0.25, 100.0),
    Parameter("radius", sized, (2.5, 3.0, 10.0, 20.0), 4.0, 1.5, "µm"),
    Parameter("start overlap", overlapping, (20.0, 40.0, 60.0, 80.0), 0.0, 90.0, "%"),
    Parameter("pressed into a corner", cornered, (10.0, 25.0, 40.0), 0.0, 45.0, "%"),
)
HEAD = """# Stability

Measured by `benchmarks/stability.py`; see [choosing numerics](choosing-numerics.md). First the
smallest stable S of the eight-cell embryo, in brackets what `morphosim.scene.stability.least_S`
asks for.

"""
LIMIT_HEAD = """
## Limits of parameters

How far single parameters go in the time of 150 steps of δt = 2: with these steps and an S that is
chosen for each value, with the preset `standard`, whose steps have a tolerance of 10, and with
`published`.

"""


def numerics_of(tolerance: float, spacing: float) -> Numerics:
    """The preset "standard" with a tolerance of its own."""
    return Numerics.preset("standard", tolerance=tolerance, spacing=spacing, allow_coarse=True)


def fixed_steps(spacing: float) -> Numerics:
    """Steps of δt = 2, for which S is chosen."""
    return Numerics(spacing=spacing, allow_coarse=True)


def published(spacing: float) -> Numerics:
    """The preset."""
    return Numerics.preset("published", spacing=spacing, allow_coarse=True)


LIMIT_NUMERICS: dict[str, Callable[[float], Numerics]] = {
    "δt = 2, S chosen": fixed_steps,
    f"tolerance {TOLERANCE:g}": partial(numerics_of, TOLERANCE),
    "published": published,
}
"""Numerics whose limits are measured, each for a lattice spacing."""


def limits(steps: int = 150) -> xr.Dataset:
    """Limit of each parameter by numerics, and what its extremes end in."""
    rows = []
    table = np.full((len(PARAMETERS), len(LIMIT_NUMERICS)), np.nan)
    for k, parameter in enumerate(PARAMETERS):
        for j, (name, chosen) in enumerate(LIMIT_NUMERICS.items()):

            def run(value: float, p: Parameter = parameter, n: Any = chosen) -> str:
                scene = p.make(value)
                numerics = n(scene.numerics.spacing)  # of a run that is not refused for being late
                return outcome(replace(scene, numerics=numerics, duration=LONG), steps)

            for value in parameter.extremes:
                begin = time.perf_counter()
                end = run(value)
                rows.append({
                    "parameter": parameter.name, "value": value, "numerics": name, "outcome": end,
                    "seconds": time.perf_counter() - begin,
                })  # fmt: skip
                print(*rows[-1].values(), flush=True)
            table[k, j] = _limit(parameter, run)
            print(parameter.name, name, "limit", table[k, j], flush=True)
    names = [p.name for p in PARAMETERS]
    coords = {"parameter": names, "numerics": list(LIMIT_NUMERICS)}
    found = xr.Dataset({"limit": (("parameter", "numerics"), table)}, coords=coords)
    return xr.merge([found, extremes_dataset(rows)], join="exact", compat="equals")


def under_control(tolerance: float = TOLERANCE, steps: int = 150) -> xr.Dataset:
    """What the extremes end in where steps have a tolerance, in the time of so many δt."""
    rows = []
    for parameter in PARAMETERS:
        for value in parameter.extremes:
            scene = parameter.make(value)
            numerics = numerics_of(tolerance, scene.numerics.spacing)
            simulation = Simulation(replace(scene, numerics=numerics))
            begin = time.perf_counter()
            end = outcome_of(simulation, steps)
            rows.append({
                "parameter": parameter.name, "value": value, "outcome": end,
                "t": simulation.time, "steps": simulation.engine.steps,
                "seconds": time.perf_counter() - begin,
            })  # fmt: skip
            print(*rows[-1].values(), flush=True)
    return extremes_dataset(rows).assign_attrs(tolerance=tolerance)


def _limit(parameter: Parameter, run: Callable[[float], str]) -> float:
    """Last stable value on the way to the bound, to 2 %; the bound itself where that is stable."""
    if run(parameter.usual) != STABLE:
        return np.nan
    if run(parameter.bound) == STABLE:
        return parameter.bound
    if parameter.usual == 0:
        return bisect(lambda v: run(v) == STABLE, 0.0, parameter.bound, 1.0)
    logs = np.log([parameter.usual, parameter.bound])
    found = bisect(lambda v: run(float(np.exp(v))) == STABLE, logs[0], logs[1], 0.02)
    return float(np.exp(found))


LAG_SCENES = {"relaxing": relaxing, "adhering": adhering, "walled": walled, "embryo": embryo}
LAG_STEPS = (2.0, 4.0, 8.0, 16.0, 32.0, 64.0, 256.0, 1024.0)
LAG_TIMES = (16.0, 64.0, 256.0, 1024.0, 4096.0)
LAG_HEAD = """
## Long steps

By `benchmarks/stability.py --only lag`, with the band solver and S = 6: the error of the fields at
the end of a run, as a share of what has changed since its start (∫abs(Δφ), all cells), against
δt = 0.5; in brackets what `morphosim.scene.stability.missed` says, (1 - exp(-T/L)) L/T with the lag
L = S δt²/τ. Bold is what is refused, or warned of: more than 15 %, unless L is at most 16 τ/2γc =
42.

"""


CONTROL_HEAD = """
## Extremes under error control

By `benchmarks/stability.py --tolerance {tolerance:g}`, with the preset `standard` and steps of that
tolerance: how the extremes end at t = 300 and three steps later, in which none may flip, or before,
and in how many steps. Steps of δt = 2 would be 150; of the least length, 9600.

"""


def lags() -> xr.Dataset:
    """Share of the change that is wrong over scene, δt and the run's time."""
    wrong = np.full((len(LAG_SCENES), len(LAG_STEPS), len(LAG_TIMES)), np.nan)
    for i, (name, make) in enumerate(LAG_SCENES.items()):
        scene = replace(make().with_numerics(solver="band", S=6.0), duration=LONG)
        right = _states_at(scene.with_numerics(dt=0.5))
        for j, dt in enumerate(LAG_STEPS):
            for t, state in _states_at(scene.with_numerics(dt=dt)).items():
                if t:
                    share = difference(state, right[t]) / difference(right[t], right[0.0])
                    wrong[i, j, LAG_TIMES.index(t)] = share
            print(name, f"δt = {dt:g}", wrong[i, j].round(3), flush=True)
    coords = {"scene": list(LAG_SCENES), "dt": list(LAG_STEPS), "time": list(LAG_TIMES)}
    return xr.Dataset({"wrong": (("scene", "dt", "time"), wrong)}, coords=coords)


def _states_at(scene: Scene) -> dict[float, list[CellField]]:
    """Fields at the start and at those of the times that have a step and are not too far off."""
    simulation = Simulation(scene)
    found = {0.0: fields_of(simulation)}
    for t in LAG_TIMES:
        if t >= scene.numerics.dt and (t <= 1024 or len(scene.cells) < 8):
            simulation.run(until=t)
            found[t] = fields_of(simulation)
    return found


def lag_markdown(data: xr.Dataset) -> str:
    """The table of long steps."""
    rows = []
    for name, dt in product(data.scene.values.tolist(), data.dt.values.tolist()):
        scene = LAG_SCENES[name]().with_numerics(dt=dt, S=6.0)
        runs = [replace(scene, duration=t) for t in data.time.values.tolist()]
        shares = zip(data.wrong.sel(scene=name, dt=dt).values, runs, strict=True)
        cells = [_late_text(float(share), run) for share, run in shares]
        rows.append([name, f"{dt:g}", f"{lag(scene):.3g}", *cells])
    times = [f"T = {t:g}, %" for t in data.time.values]
    return LAG_HEAD + markdown_table(["scene", "δt", "lag L", *times], rows)


def control_markdown(data: xr.Dataset) -> str:
    """The table of the extremes under error control."""
    names = ("parameter", "value", "outcome", "t", "steps")
    columns = [data[f"extreme_{name}"].values.tolist() for name in names]
    rows = [
        [v if isinstance(v, str) else f"{v:.4g}" for v in row] for row in zip(*columns, strict=True)
    ]
    head = CONTROL_HEAD.format(tolerance=data.attrs["tolerance"])
    return head + markdown_table(names, rows)


def _late_text(share: float, run: Scene) -> str:
    if np.isnan(share):
        return "–"
    text = f"{100 * share:.1f} ({100 * missed(run):.0f})"
    return f"**{text}**" if is_late(run) else text


def map_markdown(data: xr.Dataset) -> str:
    """The table of the smallest S."""
    rows = []
    for walls in WALLS:
        for scheme in SCHEMES:
            at = data.sel(walls=walls, scheme=scheme)
            pairs = zip(at.smallest_S.values, at.predicted_S.values, strict=True)
            cells = [f"{found:.1f} ({predicted:.1f})" for found, predicted in pairs]
            rows.append([walls, scheme, *cells])
    return HEAD + markdown_table(
        ["walls", "scheme", *(f"δt = {d:g}" for d in data.dt.values)], rows
    )


def limits_markdown(data: xr.Dataset) -> str:
    """The table of limits."""
    rows = []
    for parameter in PARAMETERS:
        values = data["limit"].sel(parameter=parameter.name).values
        rows.append([parameter.name, *(_limit_text(parameter, float(v)) for v in values)])
    return LIMIT_HEAD + markdown_table(["parameter", *data.numerics.values.tolist()], rows)


def _limit_text(parameter: Parameter, value: float) -> str:
    if np.isnan(value):
        return "unstable"
    direction = "down to" if parameter.bound < parameter.usual else "up to"
    beyond = " and beyond" if value == parameter.bound else ""
    return f"{direction} {value:.3g}{' ' + parameter.unit if parameter.unit else ''}{beyond}"


def extremes_dataset(rows: Sequence[Mapping[str, Any]]) -> xr.Dataset:
    """The extremes as variables over one dimension."""
    return xr.Dataset({
        f"extreme_{key}": ("extreme", [row[key] for row in rows]) for key in rows[0]
    })  # fmt: skip


def random_ends(count: int, tolerance: float | None) -> Counter[str]:
    """How runs of random extreme scenes end; each that ends wrongly is printed."""
    sys.path.append(str(Path(__file__).parents[1]))
    from tests.extremes import outcome, random_scene

    command = str(Path(sys.executable).with_name("morphosim"))

    def call(words: list[str]) -> tuple[int, str]:
        done = subprocess.run([command, *words], capture_output=True, text=True, check=False)
        return done.returncode, done.stderr

    ends: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(count):
            scene = random_scene(random.Random(seed))
            if tolerance is not None:
                scene["numerics"]["tolerance"] = tolerance
            end = outcome(scene, Path(folder) / "scene", call)
            ends[end.partition(",")[0].partition(":")[0]] += 1
            if end.startswith("WRONG"):
                print(f"seed {seed}: {end}", flush=True)
    return ends


PARTS: dict[str, tuple[Callable[[], xr.Dataset], Callable[[xr.Dataset], str]]] = {
    "map": (stable_map, map_markdown),
    "limits": (limits, limits_markdown),
    "lag": (lags, lag_markdown),
    "control": (under_control, control_markdown),
}
"""How each part is measured, and told; in the order of stability.md."""
PICTURES = {"map": ("stability.png", stability_picture), "limits": ("limits.png", limits_picture)}


def write(output: Path) -> None:
    """Tables and pictures of the parts that have been measured."""
    parts = {
        part: xr.load_dataset(path) for part in PARTS if (path := output / f"{part}.nc").exists()
    }
    text = "".join(PARTS[part][1](data) for part, data in parts.items())
    (output / "stability.md").write_text(text, encoding="utf-8")
    print(text)
    for part, data in parts.items():
        if part in PICTURES:
            name, draw = PICTURES[part]
            draw(data, output / name)


def main() -> None:
    """Measure and write the results."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", type=Path, default=Path("runs/stability"))
    parser.add_argument("--only", nargs="*", choices=PARTS, default=list(PARTS), metavar="PART",
                        help="parts to measure: " + ", ".join(PARTS))  # fmt: skip
    parser.add_argument("--tolerance", type=float, help="only run extremes, with this tolerance")
    parser.add_argument("--random", type=int, default=0, help="random extreme scenes to run alone")
    options = parser.parse_args()
    if options.random:
        ends = random_ends(options.random, options.tolerance)
        print(", ".join(f"{n} {end}" for end, n in ends.most_common()))
        sys.exit("WRONG" in ends)
    warnings.simplefilter("ignore")  # it goes beyond the limits on purpose
    if options.tolerance:
        print(control_markdown(under_control(options.tolerance)))
        return
    options.output.mkdir(parents=True, exist_ok=True)
    for part in options.only:
        data = PARTS[part][0]().assign_attrs(machine=str(machine()))
        data.to_netcdf(options.output / f"{part}.nc")
    write(options.output)


if __name__ == "__main__":
    main()
