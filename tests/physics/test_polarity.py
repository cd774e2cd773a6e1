"""Polarity: walks and order against closed forms, cues, inheritance, files, runs, limits."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import ive

from morphosim import (
    BoxWalls,
    Cell,
    CellTable,
    Division,
    Duration,
    Forces,
    Numerics,
    Physics,
    Polarity,
    RunWriter,
    Scene,
    Simulation,
    Sphere,
    StabilityWarning,
    Stage,
    Step,
    load_scene,
    open_run,
    save_scene,
)
from morphosim.physics.directions import aligned, diffused, unit
from morphosim.scene.stability import concerns

TAU = 2.0
X = (1.0, 0.0, 0.0)


def table(term: Polarity, count: int, first: int = 0) -> CellTable:
    """Cells with the columns of a term, begun; ids from `first` on."""
    cells = CellTable(term.columns)
    cells.next_id = first
    cells.add({"name": [f"c{k}" for k in range(count)]}, [""] * count)
    term.start(cells, Numerics(seed=3))
    term.prepare(cells, Numerics(seed=3))
    return cells


def step_of(number: int, dt: float, count: int = 1) -> Step:
    time = number * dt
    return Step(number, time, time, dt, dt, 3, np.full(count, 268.0), TAU)


def forces_on(count: int) -> Forces:
    return Forces(np.zeros(count), np.zeros((count, 3)), np.zeros(count))


def advance(term: Polarity, cells: CellTable, steps: int, dt: float) -> np.ndarray:
    """Where drift alone takes cells, at the end of each step: (steps, N, 3)."""
    places = np.zeros((steps + 1, len(cells), 3))
    for number in range(steps):
        forces = forces_on(len(cells))
        term.update(cells, step_of(number, dt, len(cells)), forces)
        places[number + 1] = places[number] - forces.drift * dt / TAU
    return places[1:]


@pytest.mark.parametrize("dt", [0.5, 1.0, 2.0])
@pytest.mark.parametrize("plane", [None, (0.0, 1.0, 1.0)])
def test_a_persistent_walk_is_ballistic_and_then_diffusive(dt: float, plane: Any) -> None:
    """⟨r²⟩ = 2 v² T² (t/T - 1 + exp(-t/T)), T = 1/2D, or 1/D in a plane; within 2 %."""
    term = Polarity(alpha=0.2, diffusion=0.03, plane=plane)
    places = advance(term, table(term, 16000), int(100 / dt), dt)
    persistence, speed = (1 if plane is None else 2) / 0.06, 0.2 / TAU
    for time in (6.0, 24.0, 100.0):
        x = time / persistence
        expected = 2 * (speed * persistence) ** 2 * (x - 1 + np.exp(-x))
        found = (places[int(time / dt) - 1] ** 2).sum(axis=1).mean()
        assert found == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize("spread", [0.02, 0.3, 2.0])
def test_diffusion_forgets_at_its_rate_however_long_the_step(spread: float) -> None:
    rng = np.random.default_rng(1)
    p, u = unit(rng.normal(size=(2, 40000, 3)))[0], rng.normal(size=(40000, 3))
    normal = np.array([0.6, 0.0, 0.8])
    flat = unit(p - (p @ normal)[:, None] * normal)
    for before, within, rate in ((p, None, 2.0), (flat, normal, 1.0)):
        after = diffused(before, u, spread, within)
        np.testing.assert_allclose(np.linalg.norm(after, axis=1), 1, rtol=1e-12)
        cosine = (before * after).sum(axis=1)
        assert cosine.mean() == pytest.approx(np.exp(-rate * spread), abs=0.012)
        assert np.abs((after - cosine.mean() * before).mean(axis=0)).max() < 0.02
    np.testing.assert_allclose(diffused(flat, u, spread, normal) @ normal, 0, atol=1e-12)


def test_alignment_is_the_same_in_one_step_and_in_many() -> None:
    """dp/dt = (1 - p p·) h for a time, also where h is strong, none, or against p."""
    rng = np.random.default_rng(2)
    p, h = unit(rng.normal(size=(50, 3))), rng.normal(size=(50, 3))
    h[0], h[1] = 0, -p[1]
    by_euler = p.copy()
    for _ in range(20000):
        by_euler += 1e-4 * (h - (h * by_euler).sum(axis=1, keepdims=True) * by_euler)
    once = aligned(p, h, 2.0)
    np.testing.assert_allclose(once, by_euler, atol=1e-3)
    np.testing.assert_allclose(once, aligned(aligned(p, h, 0.5), h, 1.5), atol=1e-9)
    np.testing.assert_array_equal(once[0], p[0])
    np.testing.assert_allclose(once[1], p[1])
    np.testing.assert_allclose(aligned(p, h, 1e6)[2:], unit(h)[2:], atol=1e-6)


def langevin(k: float) -> float:
    return float(1 / np.tanh(k) - 1 / k)


def in_plane(k: float) -> float:
    return float(ive(1, k) / ive(0, k))


@pytest.mark.parametrize("dt", [0.5, 1.0, 2.0])
@pytest.mark.parametrize(
    ("plane", "order"), [(None, langevin), ((0.0, 0.0, 1.0), in_plane)], ids=["space", "plane"]
)
def test_order_of_cells_that_align_with_all_is_that_of_mean_field(
    dt: float, plane: Any, order: Any
) -> None:
    """M = order(β m / D), which has a solution from β / D = 3 on, or 2 in a plane; within 2 %."""
    diffusion, count, found = 0.05, 5000, {}
    for ratio, initial in ((1.0, "random"), (5.0, X)):
        term = Polarity(diffusion=diffusion, plane=plane, initial=initial)
        cells = table(term, count)
        p, orders = cells["polarity"], []
        for number in range(int(120 / dt)):
            mean = p.mean(axis=0)
            pull = np.tile(ratio * diffusion * mean, (count, 1))
            p[:] = term.turned(p, pull, cells["id"], step_of(number, dt))
            if number * dt >= 40:
                orders.append(np.linalg.norm(p.mean(axis=0)))
        found[ratio] = float(np.mean(orders))
    expected = brentq(lambda m: order(5.0 * m) - m, 0.1, 1.0)
    assert found[5.0] == pytest.approx(expected, rel=0.02)
    assert found[1.0] < 0.05


def test_directions_follow_from_seed_step_and_id() -> None:
    """Whatever other cells there are; and they are other numbers than those of motility."""
    term = Polarity(alpha=0.1, diffusion=0.1)
    all_cells, some = table(term, 6), table(term, 2, first=4)
    np.testing.assert_array_equal(all_cells["polarity"][4:], some["polarity"])
    for cells in (all_cells, some):
        advance(term, cells, 3, 1.0)
    np.testing.assert_array_equal(all_cells["polarity"][4:], some["polarity"])
    physics = Physics(kappa=1.0, terms=[Polarity(alpha=1.0)])
    cells = CellTable(physics.columns)
    cells.add({"name": [f"c{k}" for k in range(2000)]}, [""] * 2000)
    drifts = []
    for each in physics.active_terms[-2:]:
        each.start(cells, Numerics())
        each.prepare(cells, Numerics())
        forces = forces_on(2000)
        each.update(cells, step_of(0, 1.0, 2000), forces)
        drifts.append(forces.drift)
    assert abs(np.corrcoef(drifts[0].ravel(), drifts[1].ravel())[0, 1]) < 0.06


def scene(*terms: Polarity, count: int = 2, **options: Any) -> Scene:
    """Balls in a row, that touch if there are more than one."""
    cells = [
        Cell(name=f"c{k}", type="AB"[k % 2], shape=Sphere(center=(7.0 * k, 0, 0), radius=4.0))
        for k in range(count)
    ]  # fmt: skip
    numerics = Numerics(threads=1, solver="band", seed=5)
    return Scene(**({
        "cells": cells, "physics": Physics(sigma=0.3, terms=terms), "numerics": numerics,
        "duration": 40.0, "save_every": 10.0,
    } | options))  # fmt: skip


@pytest.mark.parametrize(("tolerance", "within"), [(None, 3e-3), (20.0, 2e-2)])
def test_a_cell_moves_along_its_polarity_at_the_speed_of_overdamped_motion(
    tolerance: float | None, within: float
) -> None:
    term = Polarity(alpha_by_type={"A": 0.2}, initial=(0.0, 3.0, 4.0))
    simulation = Simulation(
        scene(term, count=1).with_numerics(dt=0.5, spacing=0.4, tolerance=tolerance)
    )
    simulation.run(until=15)
    begin = simulation.centroids[0]
    simulation.run(until=40)
    velocity = (simulation.centroids[0] - begin) / 25
    expected = 0.2 / simulation.physics.tau * np.array([0, 0.6, 0.8])
    np.testing.assert_allclose(velocity, expected, rtol=within, atol=1e-5)


def pulls(term: Polarity, steps: int = 3, **options: Any) -> tuple[Simulation, np.ndarray]:
    simulation = Simulation(scene(term, **options))
    simulation.step(steps)
    return simulation, simulation.column("polarity_pull")


def climb(x: Any, y: Any, z: Any) -> Any:
    """A concentration."""
    return np.exp(0.1 * y) + 0 * (x + z)


def test_cells_turn_away_from_contacts_by_the_share_of_their_surface() -> None:
    simulation, pull = pulls(Polarity(align={"contacts": 0.5}, initial=(0, 1, 0), look_every=2.0))
    touched = 1 - simulation.measured().exposed_fraction
    assert touched.min() > 0.05
    np.testing.assert_allclose(pull[:, 0], [-0.5, 0.5] * touched, rtol=0.1)
    np.testing.assert_allclose(pull[:, 1:], 0, atol=1e-3)
    assert simulation.column("polarity")[0, 0] < -0.05
    assert simulation.column("polarity")[1, 0] > 0.05


def test_cells_align_with_neighbours_by_the_share_of_their_surface() -> None:
    term = Polarity(align={"neighbours": 0.5}, diffusion=0.01, look_every=2.0)
    simulation = Simulation(scene(term))
    simulation.step(2)
    before = simulation.column("polarity").copy()
    simulation.step(1)
    touched = 1 - simulation.measured().exposed_fraction
    expected = 0.5 * touched[:, None] * before[::-1]
    np.testing.assert_allclose(simulation.column("polarity_pull"), expected, rtol=0.1)


def test_cells_align_with_their_velocity_in_their_free_speed() -> None:
    """What moves as p says is drawn by all of the rate; a cell that is held, by none."""
    term = Polarity(alpha=0.2, initial=X, align={"velocity": 0.3}, look_every=4.0)
    _, pull = pulls(term, 30, count=1)
    assert 0.95 * 0.3 < pull[0, 0] <= 0.3
    wall = BoxWalls(lower=(-20, -20, -20), upper=(4.5, 20, 20))
    slow = replace(term, align={"velocity": 1e-3})  # p stays
    _, pull = pulls(slow, 60, count=1, confinement=wall)
    assert np.linalg.norm(pull[0]) < 1e-4


def test_cells_turn_up_a_gradient_and_towards_a_direction() -> None:
    _, pull = pulls(Polarity(align={"attractant": 0.2}, attractant=climb), count=1)
    np.testing.assert_allclose(pull, [[0, 0.2, 0]], atol=1e-9)
    constant = Polarity(align={"direction": 0.1}, direction=(0, 0, 2.0), initial=X)
    cells = table(constant, 1)
    advance(constant, cells, 10, 1.0)
    tilt = np.tanh(1.0)
    np.testing.assert_allclose(cells["polarity"], [[np.sqrt(1 - tilt**2), 0, tilt]], rtol=1e-9)
    flat = Polarity(align={"direction": 0.1}, direction=(1, 0, 9.0), plane=(0, 0, 1), initial=X)
    cells = table(flat, 1)
    advance(flat, cells, 10, 1.0)
    np.testing.assert_allclose(cells["polarity"], [X])


def test_where_a_cell_is_exposed_or_at_a_wall_it_moves() -> None:
    free = Simulation(scene(Polarity(alpha=0.01, where="free", look_every=2.0)))
    free.step(3)
    np.testing.assert_allclose(
        free.column("polarity_share"), free.measured().exposed_fraction, atol=0.02
    )
    term = Polarity(alpha=0.2, initial=X, where="wall", plane=(0, 0, 1))
    floor = BoxWalls(lower=(-30, -30, -4.2), upper=(60, 30, 40))
    balls = [
        Cell(name=name, shape=Sphere(center=(0, y, z), radius=4.0))
        for name, y, z in (("down", 0.0, 0.0), ("up", 12.0, 6.0))
    ]
    simulation = Simulation(scene(term, cells=balls, confinement=floor))
    simulation.step(25)
    assert simulation.column("polarity_share").tolist() == [1, 0]
    moved = simulation.centroids[:, 0]
    assert moved[0] > 2
    assert abs(moved[1]) < 0.05


@pytest.mark.parametrize("rule", ["inherit", "opposite", "random"])
def test_daughters_have_polarity_by_rule(rule: str) -> None:
    division = Division(cell="c0", daughters=("x", "y"), axis=(1, 0, 0))
    stage = Stage(name="one", end=Duration(8), events=[division])
    term = Polarity(initial=(0, 0, 1), alpha=0.1, daughters=rule)
    simulation = Simulation(scene(term, stages=[stage]))
    simulation.run(until=4)
    kept, x, y = simulation.column("polarity")
    np.testing.assert_array_equal(kept, (0, 0, 1))
    np.testing.assert_allclose(np.linalg.norm([x, y], axis=1), 1)
    if rule == "random":
        assert abs(x @ y) < 0.999
        assert abs(x[2]) < 0.999
    else:
        np.testing.assert_array_equal([x, y], [kept, kept if rule == "inherit" else -kept])


def test_runs_have_polarity_and_go_on_bit_for_bit(tmp_path: Path) -> None:
    term = Polarity(
        alpha=0.1, alpha_by_type={"B": 0.05}, diffusion=0.02, attractant=climb,
        align={"velocity": 0.1, "neighbours": 0.1, "contacts": 0.1, "attractant": 0.05},
        where="free", look_every=3.0,
    )  # fmt: skip
    whole = scene(term, count=3)
    save_scene(whole, tmp_path / "scene.toml")
    assert 'kind = "polarity"' in (tmp_path / "scene.toml").read_text()
    read = load_scene(tmp_path / "scene.toml")
    assert read.physics.terms == (term,)
    unbroken = Simulation(read.with_numerics(threads=2))
    unbroken.run()
    Simulation(whole).run(until=20, observers=[RunWriter(tmp_path / "run", 10.0)])
    again = Simulation.from_run(tmp_path / "run")
    again.run(observers=[RunWriter(tmp_path / "run", 10.0, resume=True)])
    for column in ("polarity", "polarity_pull", "polarity_seen", "polarity_share"):
        np.testing.assert_array_equal(again.column(column), unbroken.column(column))
    for one, other in zip(again.fields, unbroken.fields, strict=True):
        np.testing.assert_array_equal(one.phi, other.phi)
    with open_run(tmp_path / "run") as run:
        assert run["polarity"].dims == ("time", "cell", "axis")
        np.testing.assert_array_equal(run["polarity"][-1], again.column("polarity"))
    branch = Simulation.from_run(tmp_path / "run", time=20)
    assert branch.physics.terms == (term,)
    with open_run(_without(tmp_path)) as run:
        assert "polarity" not in run


def _without(folder: Path) -> Path:
    plain = scene(count=1)
    Simulation(plain).run(until=2, observers=[RunWriter(folder / "plain", 2.0)])
    return folder / "plain"


def test_a_stage_may_bring_polarity() -> None:
    stages = [
        Stage(name="still", end=Duration(4)),
        Stage(name="moving", end=Duration(20), physics={"terms": [Polarity(alpha=0.2, initial=X)]}),
    ]
    simulation = Simulation(scene(count=1, stages=stages))
    simulation.run()
    assert simulation.centroids[0, 0] > 0.5


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"alpha": -1}, "polarity.alpha = -1"),
        ({"alpha_by_type": {"A": np.nan}}, "alpha_by_type['A']"),
        ({"diffusion": -0.1}, "polarity.diffusion"),
        ({"align": {"gradient": 1.0}}, "velocity"),
        ({"align": {"velocity": np.inf}}, "align['velocity']"),
        ({"align": {"attractant": 0.1}}, "polarity: attractant = None with align.attractant = 0.1"),
        ({"direction": X}, "no align.direction; give both"),
        ({"align": {"attractant": 1}, "attractant": lambda x: x}, "called with 3 arguments"),
        ({"initial": "up"}, "'random', or a direction"),
        ({"initial": (0, 0, 0)}, "polarity.initial = (0, 0, 0) has no direction"),
        ({"initial": (0, 0, 2), "plane": (0, 0, 1)}, "is normal to polarity.plane"),
        ({"plane": (1, 0)}, "polarity.plane"),
        ({"where": "below"}, "everywhere"),
        ({"daughters": "both"}, "opposite"),
        ({"look_every": 0}, "look_every"),
    ],
)  # fmt: skip
def test_bad_values_are_told(values: Any, said: str) -> None:
    with pytest.raises((ValueError, TypeError)) as told:
        Polarity(**values)
    assert said in str(told.value)
    assert "\n" not in str(told.value)


def test_what_a_scene_lacks_is_told() -> None:
    with pytest.raises(ValueError, match=r"polarity\.alpha_by_type"):
        scene(Polarity(alpha_by_type={"C": 1.0}))
    with pytest.raises(ValueError, match="no confinement"):
        Simulation(scene(Polarity(alpha=0.1, where="wall")))
    with pytest.raises(ValueError, match="polarity"):
        scene(Polarity(alpha=0.1), Polarity(alpha=0.2))


def test_steps_that_are_too_long_are_told() -> None:
    def told(dt: float = 2.0, S: float | None = None, **values: Any) -> list[str]:
        whole = scene(Polarity(**values), count=1).with_numerics(dt=dt, S=S)
        return [text for text in concerns(whole) if "polarity" in text]

    assert not told(alpha=0.2, diffusion=0.05)
    assert "0.38 interface widths" in told(alpha=0.5, S=0.0)[0]
    assert "off the surface tension" in told(alpha=0.25, S=10.0)[0]
    assert not told(alpha=0.25, S=10.0, dt=0.5)
    assert "within 1.7 steps" in told(diffusion=0.15)[0]
    assert not told(diffusion=0.15, plane=(0, 0, 1))
    assert "Take look_every and dt of at most 2.5" in told(align={"neighbours": 0.8})[0]
    with pytest.warns(StabilityWarning, match="interface widths"):
        Simulation(scene(Polarity(alpha=0.6), count=1))


def test_without_volume_a_cell_pulls_at_nothing() -> None:
    """A cell that fades away has no place; the others go on."""
    term = Polarity(alpha=0.1, align={"contacts": 0.5, "velocity": 0.1}, look_every=2.0)
    faint = replace(scene(term), on_vanish="remove")
    simulation = Simulation(faint)
    simulation.engine.pool.box(1)[:] = 0
    simulation.step(2)
    assert np.isfinite(simulation.column("polarity")).all()
    assert np.isfinite(simulation.volumes).all()
