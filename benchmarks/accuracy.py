"""Error against cost of every numerical knob, and of their useful combinations.

Run as `python benchmarks/accuracy.py` (about an hour; the converged solutions are half of it and
are kept in the output folder). Three scenes: one cell relaxing, two adhering, and the eight-cell
embryo. The first two are compared with the paper's scheme on a full grid (Fourier derivatives,
double precision, h = 0.25 µm, δt = 0.25), the embryo with this engine at h = 0.25 µm, δt = 0.25,
sixth order, double precision. Cost is the time of the embryo per unit of *in silico* time, all
variants in turn, as a ratio to `fixed steps`: the defaults with S = 6.

Writes accuracy.nc, accuracy.md and accuracy.png into the output folder.

With `--front` it races presets, the presets as they were before steps knew their error (`former`)
and runs with a tolerance instead, to t = 480 and to t = 15000 (hours; finished races are kept,
`--until` and `--only` choose). Errors are those of centroids against converged courses: h = 0.25
µm, δt = 0.25 to t = 480; h = 0.25 µm, tolerance = 1 to t = 15000. Writes front.json, .md and .png.
"""

import argparse
import time
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from _common import alternating_medians, machine, markdown_table, stepper
from _front import STRETCH
from _front import markdown as front_markdown
from _front import measure as measure_front
from _pictures import front_picture, pareto_picture
from _scenes import adhering, embryo, relaxing
from _states import State, cached, errors, full_grid_states, states

from morphosim import Numerics, Simulation
from morphosim.errors import SimulationError
from morphosim.numerics.parameters import PRESETS

TIMES = {"relaxing": (60.0,), "adhering": (60.0,), "embryo": (120.0, 480.0)}
SCENES = {"relaxing": relaxing, "adhering": adhering, "embryo": embryo}
BASE = "fixed steps"
GIVEN = {"S": 6.0}
"""What variants have besides the defaults: S would be chosen for each, and not one knob vary."""
CONVERGED: dict[str, Any] = {
    "spacing": 0.25, "dt": 0.25, "S": 4.0, "precision": "double", "box_tolerance": 1e-5,
}  # fmt: skip
"""The embryo's; S is the least that its walls need at this spacing."""


def knobs() -> dict[str, dict[str, dict[str, Any]]]:
    """Variants by knob; each names what differs from `BASE`."""
    fine = {"dt": 0.5}
    return {
        "δt": {f"δt = {dt:g}": {"dt": dt} for dt in (0.5, 1.0, 1.5, 2.5, 3.0, 4.0, 6.0)},
        "S": {f"S = {S:g}": {"S": S} for S in (3.0, 4.0, 8.0, 12.0, 20.0, 40.0)},
        "scheme": {
            "imex1, δt = 0.1, S = 0": {"scheme": "imex1", "dt": 0.1, "S": 0.0},
            "imex1, δt = 0.5, S = 0": {"scheme": "imex1", "dt": 0.5, "S": 0.0},
            "imex1, δt = 1, S = 2": {"scheme": "imex1", "dt": 1.0, "S": 2.0},
            "imex1, δt = 2, S = 3": {"scheme": "imex1", "dt": 2.0, "S": 3.0},
            "euler, δt = 0.08": {"scheme": "euler", "dt": 0.08},
        },
        "spacing": {
            f"h = {h:.3g}, δt = 0.5": fine | {"spacing": h, "S": max(6.0, 3 * (0.5 / h) ** 2)}
            for h in (0.25, 1 / 3, 0.4, 0.5, 0.6, 2 / 3, 0.75, 1.0)
        },
        "order": {
            "order 2": {"order": 2},
            "order 4": {"order": 4},
            "order 2, δt = 0.5": fine | {"order": 2},
            "order 4, δt = 0.5": fine | {"order": 4},
            "fitted": {"order": "fitted"},
            "fitted, δt = 0.5": fine | {"order": "fitted"},
        },
        "Laplacian": {
            "stencil's symbol": {"laplacian": "stencil"},
            "stencil's symbol, δt = 0.5": fine | {"laplacian": "stencil"},
        },
        "walls": {
            "stepped walls": {"walls": "stepped", "S": 12.0},
            "stepped walls, δt = 0.5": fine | {"walls": "stepped", "S": 9.0},
        },
        "box tolerance": {
            f"tolerance {t:g}": {"box_tolerance": t} for t in (1e-5, 1e-4, 3e-3, 1e-2, 3e-2)
        },
        "precision": {"double precision": {"precision": "double"}},
        "transform": {"pyFFTW": {"transform": "pyfftw"}, "SciPy": {"transform": "scipy"}},
        "combination": {
            "h = 0.75, δt = 2": {"spacing": 0.75},
            "h = 0.75, δt = 3": {"spacing": 0.75, "dt": 3.0},
            "h = 0.75, δt = 4": {"spacing": 0.75, "dt": 4.0},
            "h = 2/3, δt = 3": {"spacing": 2 / 3, "dt": 3.0},
            "h = 2/3, δt = 4, tol. 3e-3": {"spacing": 2 / 3, "dt": 4.0, "box_tolerance": 3e-3},
            "δt = 3, tol. 3e-3": {"dt": 3.0, "box_tolerance": 3e-3},
            "δt = 4, tol. 3e-3": {"dt": 4.0, "box_tolerance": 3e-3},
            "h = 0.4, δt = 1": {"spacing": 0.4, "dt": 1.0},
            "h = 0.4, δt = 0.5, tol. 1e-4": {"spacing": 0.4, "dt": 0.5, "box_tolerance": 1e-4},
            "h = 1/3, δt = 1, S = 8": {"spacing": 1 / 3, "dt": 1.0, "S": 8.0},
        },
    }  # fmt: skip


def variants() -> dict[str, tuple[str, Numerics]]:
    """Name → (knob, numerics) of all that is measured."""
    found = {BASE: (BASE, Numerics(**GIVEN))}
    found |= {name: ("preset", Numerics.preset(name)) for name in PRESETS}
    for knob, members in knobs().items():
        for name, changes in members.items():
            found[name] = (knob, Numerics(**(GIVEN | {"allow_coarse": True} | changes)))
    return found


def converged(folder: Path) -> dict[str, list[State]]:
    """Converged states of all scenes; computed once per folder."""
    return {
        name: cached(folder / f"converged-{name}.pickle", lambda name=name: _converge(name))
        for name in SCENES
    }


def _converge(name: str) -> list[State]:
    print(f"converged solution of {name} …", flush=True)
    if name == "embryo":
        return states(Simulation(embryo().with_numerics(**CONVERGED)), TIMES[name])
    return full_grid_states(SCENES[name](), TIMES[name], spacing=0.25, dt=0.25)


def measure(
    name: str, numerics: Numerics, truth: dict[str, list[State]]
) -> tuple[dict[tuple[str, float, str], float], Simulation | None]:
    """Errors by (scene, time, measure); and the embryo's simulation, unless it failed."""
    found, last = {}, None
    for scene, make in SCENES.items():
        simulation = Simulation(replace(make(), numerics=numerics))
        begin = time.perf_counter()
        try:
            for state, true in zip(states(simulation, TIMES[scene]), truth[scene], strict=True):
                found |= {(scene, true.time, k): v for k, v in errors(state, true).items()}
            last = simulation
        except SimulationError as error:
            print(f"  {scene}: {error}")
            last = None
        seconds = time.perf_counter() - begin
    key = ("embryo", TIMES["embryo"][-1], "centroid_rms_nm")
    print(f"{name:32} {found.get(key, np.nan):8.2f} nm  {seconds:6.1f} s", flush=True)
    return found, last


def costs(simulations: dict[str, Simulation], rounds: int) -> dict[str, float]:
    """Seconds per unit of time up to the end of the embryo's course, each variant in turn."""
    rates = {name: s.engine.steps / s.time for name, s in simulations.items()}
    actions = {name: stepper(simulation) for name, simulation in simulations.items()}
    medians = alternating_medians(actions, rounds, warm_up=1)
    return {name: seconds * rates[name] for name, seconds in medians.items()}


def dataset(
    found: dict[str, dict[tuple[str, float, str], float]], cost: dict[str, float]
) -> xr.Dataset:
    """Everything measured: error (variant, place, measure) and cost (variant)."""
    names = list(found)
    places = [(scene, t) for scene, times in TIMES.items() for t in times]
    measures = sorted({key[2] for values in found.values() for key in values})
    table = np.full((len(names), len(places), len(measures)), np.nan)
    for i, name in enumerate(names):
        for j, (scene, t) in enumerate(places):
            for k, measure_name in enumerate(measures):
                table[i, j, k] = found[name].get((scene, t, measure_name), np.nan)
    known = variants()
    return xr.Dataset(
        {
            "error": (("variant", "place", "measure"), table),
            "cost": ("variant", [cost.get(n, np.nan) / cost[BASE] for n in names]),
            "seconds_per_time": ("variant", [cost.get(n, np.nan) for n in names]),
            "knob": ("variant", [known[n][0] for n in names]),
            "numerics": ("variant", [repr(known[n][1]) for n in names]),
        },
        coords={
            "variant": names,
            "place": [f"{scene} t={t:g}" for scene, t in places],
            "measure": measures,
        },
        attrs={"machine": str(machine())},
    )


def merged(new: xr.Dataset, old: xr.Dataset) -> xr.Dataset:
    """Old results with the new ones in their places."""
    kept = old.drop_sel(variant=new.variant.values, errors="ignore")
    order = [name for name in variants() if name in {*kept.variant.values, *new.variant.values}]
    return xr.concat([kept, new], "variant", data_vars="minimal").sel(variant=order)


def pareto(cost: np.ndarray, error: np.ndarray) -> np.ndarray:
    """Whether no other variant is both cheaper and more accurate."""
    order = np.lexsort((error, cost))
    front, best = np.zeros(len(cost), bool), np.inf
    for i in order:
        if np.isfinite(error[i]) and np.isfinite(cost[i]) and error[i] < best:
            front[i], best = True, error[i]
    return front


HEAD = """# Error against cost

Measured by `benchmarks/accuracy.py`; see [choosing numerics](choosing-numerics.md). Each variant is
a preset, or `fixed steps` (the defaults, with S = 6) with the change that its name says. Errors of
the embryo at t = 480 unless another scene is named: centroids root mean square and largest, the
largest relative error of volume and surface, of a contact area, and of the field. Variants on the
Pareto front are bold.

Weights fitted to the interface (`order = "fitted"`, see `numerics/stencils.py`) leave 0.64, 0.71
and 0.80 of the embryo's error at h = 2/3, 0.5 and 0.4 µm with `tolerance = 1`: 42 and 27 nm, 8.8
and 6.3, 5.1 and 4.1. Walls as Eq. 9 has them, at most 4γ/h² strong, hide the gain.

"""
COLUMNS = (
    ("embryo t=480", "centroid_rms_nm", "centroid, nm", ".3g"),
    ("embryo t=480", "centroid_max_nm", "largest, nm", ".3g"),
    ("embryo t=480", "volume_max", "volume, 1", ".1e"),
    ("embryo t=480", "surface_max", "surface, 1", ".1e"),
    ("embryo t=480", "contact_max_um2", "contact, µm²", ".2g"),
    ("embryo t=480", "field_share", "∫abs(Δφ)/V", ".1e"),
    ("relaxing t=60", "field_share", "relaxing ∫abs(Δφ)/V", ".1e"),
    ("adhering t=60", "centroid_rms_nm", "adhering centroid, nm", ".3g"),
    ("embryo t=480", "contacts_equal", "contacts equal", "contacts"),
)


def front_of(data: xr.Dataset) -> np.ndarray:
    """Which variants are on the Pareto front of the first column."""
    place, measure_name = COLUMNS[0][:2]
    error = data["error"].sel(place=place, measure=measure_name).values
    return pareto(data["cost"].values, error)


def markdown(data: xr.Dataset, front: np.ndarray) -> str:
    """The table; variants on the Pareto front are bold."""
    head = ["knob", "variant", "cost", *(title for *_, title, _ in COLUMNS)]
    rows = []
    for i, name in enumerate(data["variant"].values):
        shown = f"**{name}**" if front[i] else name
        row = [str(data["knob"].values[i]), shown, _text(float(data["cost"][i]), ".2f")]
        for place, measure_name, _, form in COLUMNS:
            value = data["error"].sel(place=place, measure=measure_name).values[i]
            row.append(_text(float(value), form))
        rows.append(row)
    return HEAD + markdown_table(head, rows)


def _text(value: float, form: str) -> str:
    if not np.isfinite(value):
        return "–"
    if form == "contacts":
        return "yes" if value else "no"
    return format(value, form)


def draw_front(options: argparse.Namespace) -> None:
    """Race, and write what `_front` and `_pictures` make of it."""
    found = measure_front(options.output, options.until, options.only or (), options.rounds)
    text = "".join(front_markdown(rows, until) for until, rows in found.items())
    (options.output / "front.md").write_text(text, encoding="utf-8")
    print(text)
    front_picture(found, options.output / "front.png")


def main() -> None:
    """Measure all variants and write the results."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", type=Path, default=Path("runs/accuracy"))
    parser.add_argument("--rounds", type=int, default=9, help="rounds of the timing")
    parser.add_argument("--table", action="store_true", help="only redraw table and picture")
    parser.add_argument("--only", nargs="+", help="measure these variants anew, keep the others")
    parser.add_argument("--front", action="store_true", help="only race old against new settings")
    parser.add_argument(
        "--until", nargs="+", type=float, default=list(STRETCH), choices=list(STRETCH),
        help="where races end",
    )  # fmt: skip
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    if options.front:
        draw_front(options)
        return
    path = options.output / "accuracy.nc"
    if not options.table:
        warnings.simplefilter("ignore")  # some variants are at the edge of stability on purpose
        truth, known = converged(options.output), variants()
        chosen = [BASE, *options.only] if options.only else list(known)
        results = {name: measure(name, known[name][1], truth) for name in chosen}
        alive = {name: s for name, (_, s) in results.items() if s is not None}
        cost = costs(alive, options.rounds)
        data = dataset({name: found for name, (found, _) in results.items()}, cost)
        if options.only:
            data = merged(data, xr.load_dataset(path))
        data.to_netcdf(path)
    with xr.open_dataset(path) as data:
        front = front_of(data)
        text = markdown(data, front)
        (options.output / "accuracy.md").write_text(text, encoding="utf-8")
        print(text)
        pareto_picture(data, front, options.output / "accuracy.png")


if __name__ == "__main__":
    main()
