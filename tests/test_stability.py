"""Warnings before the first step, divergence soon after it, and sound ends at the extremes."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from morphosim import (
    Attraction,
    BoxWalls,
    Cell,
    CellVanishedError,
    DivergenceError,
    Division,
    Duration,
    Numerics,
    Physics,
    QuasiSteady,
    RunWriter,
    Scene,
    Simulation,
    Sphere,
    StabilityWarning,
    Stage,
    VolumeCourse,
    built_in_scene,
    open_run,
    relaxed,
)
from morphosim.geometry import phase_field
from morphosim.geometry.shapes import Shape
from morphosim.numerics.parameters import PRESETS
from morphosim.scene import stability
from morphosim.scene.ends import End
from morphosim.scene.stability import concerns, explicit_rates
from morphosim.simulation import start

from .helpers import EXPECTED_TO_FAIL, built_in_scenes

TIGHT = BoxWalls(lower=(-4.1, -3.6, -3.7), upper=(12.3, 3.8, 3.6))


def pair(distance: float = 8.3, radius: float = 4.0, **physics: object) -> Scene:
    """Two cells beside each other in open space; S is chosen."""
    cells = [
        Cell(name=name, shape=Sphere(center=(x, 0.0, 0.0), radius=radius))
        for name, x in (("left", 0.0), ("right", distance))
    ]
    return Scene(cells=cells, physics=Physics(**({"sigma": 0.5} | physics)))


def with_6(scene: Scene, **numerics: object) -> Scene:
    """Scene with S = 6 as given, and other numerics."""
    return scene.with_numerics(**({"S": 6.0} | numerics))


def pressed(**numerics: object) -> Scene:
    """The pair in a box in which it must flatten."""
    return replace(pair(), confinement=TIGHT, numerics=Numerics(**numerics))


def shrinking() -> Scene:
    """A free cell that is to shrink to 22 µm³."""
    cell = Cell(
        name="cell",
        shape=Sphere(center=(0, 0, 0), radius=4),
        volume=VolumeCourse(times=[0, 100], volumes=[268, 22]),
    )
    return Scene(cells=[cell])


def growth(scheme: str, rate: float, dt: float, S: float) -> float:
    """Factor per step of τ φ' = -rate φ taken explicitly, by Eq. 8 or 9; τ = 2.62."""
    r = 2.62 / dt
    if scheme == "imex1":
        return abs((r + S - rate) / (r + S))
    step = np.roots([1.5 * r + S, -(2 * r + 2 * S - 2 * rate), r / 2 + S - rate])
    return float(np.abs(step).max())


@pytest.mark.parametrize("scheme", ["bdf2", "imex1"])
@pytest.mark.parametrize("dt", [0.3, 1.0, 2.0, 4.0])
def test_least_S_is_where_the_scheme_stops_growing(scheme: str, dt: float) -> None:
    scene = pressed(scheme=scheme, dt=dt, walls="stepped")
    rate, S = stability.explicit_rate(scene), stability.least_S(scene)
    assert S > 0 or growth(scheme, rate, dt, 0.0) <= 1
    if S > 0:
        assert growth(scheme, rate, dt, 1.001 * S) < 1
        assert growth(scheme, rate, dt, 0.999 * S) > 1


@EXPECTED_TO_FAIL
@pytest.mark.parametrize("walls", ["resolved", "stepped"])
@pytest.mark.parametrize("scheme", ["bdf2", "imex1"])
def test_cells_pressed_to_walls_need_about_least_S(scheme: str, walls: str) -> None:
    scene = pressed(scheme=scheme, walls=walls)
    least = stability.least_S(scene)
    Simulation(scene.with_numerics(S=least + 0.5)).step(100)
    with pytest.raises(DivergenceError):
        Simulation(scene.with_numerics(S=0.6 * least)).step(100)


@EXPECTED_TO_FAIL
def test_largest_step_of_explicit_euler() -> None:
    scene = pair().with_numerics(scheme="euler")
    limit = stability.largest_euler_step(scene)
    Simulation(scene.with_numerics(dt=0.95 * limit)).step(200)
    with pytest.raises(DivergenceError):
        Simulation(scene.with_numerics(dt=1.4 * limit)).step(200)


def test_presets_with_resolved_walls_raise_no_concern() -> None:
    for name in ("draft", "standard", "reference"):
        for scene in (*built_in_scenes(), pair(), pressed()):
            numerics = Numerics.preset(name)
            if scene.physics.kappa:  # as published, the noise grows with the step
                numerics = replace(numerics, dt=min(numerics.dt, scene.numerics.dt))
            assert stability.concerns(replace(scene, numerics=numerics)) == []


def test_all_stages_count() -> None:
    division = Division(cell="a", daughters=("b", "c"), axis=(1, 0, 0))
    ball = Cell(name="a", shape=Sphere(center=(0, 0, 0), radius=5))
    alone = Scene(cells=[ball], physics=Physics(M=0.0))
    divides = replace(alone, stages=[Stage(name="s", end=Duration(10), events=[division])])
    assert "cells" in explicit_rates(divides)
    assert "cells" not in explicit_rates(alone)
    strong = Stage(name="t", end=Duration(10), physics={"M": 60.0, "kappa": 3.0})
    told = concerns(with_6(replace(alone, stages=[strong])))
    assert len(told) == 2
    assert "volume constraint" in told[0]
    assert "physics.kappa = 3" in told[1]
    assert concerns(alone) == concerns(divides) == []


def test_walls_are_those_of_the_mean_tension_of_all_cells() -> None:
    """As they are made, so that frozen cells count."""
    soft, stiff = pair().cells
    boxed = replace(pressed(), cells=[soft, replace(stiff, gamma=1.0)])
    half_frozen = replace(boxed, cells=[soft, replace(stiff, gamma=1.0, frozen=True)])
    assert rate_of_walls(half_frozen) == rate_of_walls(boxed) > rate_of_walls(pressed()) == 4


def rate_of_walls(scene: Scene) -> float:
    """What the walls alone act at."""
    (walls,) = [term for term in scene.physics.active_terms if term.name == "walls"]
    return walls.explicit_rate(stability.conditions(scene, scene.physics))


def test_what_does_not_act_does_not_count() -> None:
    shape = Sphere(center=(0, 9, 0), radius=1.5)
    stone = Cell(name="stone", shape=shape, gamma=8.0, frozen=True)
    scene = pair()
    assert stability.concerns(replace(scene, cells=[*scene.cells, stone])) == []
    moving = replace(stone, frozen=False)
    assert stability.concerns(replace(scene, cells=[*scene.cells, moving])) != []
    assert stability.concerns(pair(sigma=3.5).with_numerics(dt=0.5)) == []
    assert stability.concerns(pair(sigma=Attraction(default=9.0, types={("", ""): 0.5}))) == []


def between_walls(half: float, **numerics: object) -> Scene:
    """The pair at rest, with walls at this distance around, µm."""
    walls = BoxWalls(lower=(-half, -half, -half), upper=(8.3 + half, half, half))
    return replace(pair(), confinement=walls, numerics=Numerics(**numerics))


@EXPECTED_TO_FAIL
def test_walls_that_do_not_press_need_less() -> None:
    published = Numerics.preset("published")
    free, near = (
        replace(between_walls(half), numerics=published) for half in (4.6, 4.3)
    )  # fmt: skip
    assert concerns(free) == []
    Simulation(free).step(100)
    assert len(concerns(near)) == len(concerns(pressed(walls="stepped", S=12.0))) == 1
    with pytest.raises(DivergenceError):
        Simulation(pressed(walls="stepped", S=12.0)).step(100)
    growing = [replace(cell, volume=400.0) for cell in free.cells]
    assert len(concerns(replace(free, cells=growing))) == 1
    assert len(concerns(free.with_numerics(S=11.5))) == 1


@pytest.mark.parametrize("half", [4.6, 4.4, 4.3, 3.9])
def test_each_start_field_is_made_once_and_tells_how_walls_press(
    half: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    stone = Cell(name="stone", shape=Sphere(center=(0, 0, half - 0.4), radius=1.5), frozen=True)
    scene = between_walls(half)
    scene = replace(scene, cells=[*scene.cells, stone])
    shares = [stability._outside(cell, scene) for cell in scene.cells]
    assert shares[2] > max(shares[:2])
    made: list[str] = []

    def counted(shape: Shape, name: str, *others: Any) -> Any:
        made.append(name)
        return phase_field.lattice_field(shape, name, *others)

    for module in (start, stability):
        monkeypatch.setattr(module, "lattice_field", counted)
    simulation = Simulation(scene)
    assert made == ["left", "right", "stone"]
    assert simulation.engine.explicit_rate == stability.start_rate(scene)
    press = (max(shares[:2]) - stability.TOUCHING) / (stability.PRESSING - stability.TOUCHING)
    assert stability.pressing(scene) == pytest.approx(np.clip(press, 0, 1), abs=1e-12)


def test_fields_are_not_made_to_see_what_is_no_matter(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = between_walls(4.3)
    given = scene.with_numerics(S=8.0)
    crowded = replace(scene, physics=Physics(sigma=0.5, g=100.0))
    monkeypatch.setattr(stability, "_outside", lambda *_: pytest.fail("a field was made"))
    assert stability.start_rate(given) > 0
    assert stability.start_rate(crowded) > 0
    stability.check(scene.with_numerics(tolerance=5.0))
    with pytest.raises(pytest.fail.Exception):
        stability.start_rate(scene)


@pytest.mark.parametrize(
    ("scene", "words"),
    [
        (pressed(S=2.0), ("numerics.S = 2", "at least 4.4", "dt = 2", "walls 6.61")),
        (pressed(walls="stepped", S=6.0), ("at least 12.9", "walls 17.9", "walls = 'resolved'")),
        (with_6(pair(M=30.0)), ("numerics.S = 6", "(volume constraint 22.6)", "at least 15.7")),
        (with_6(pair(g=100.0)), ("numerics.S = 6", "at least 74.6")),
        (with_6(pair(gamma=4.0)), ("numerics.S = 6", "double well 16")),
        (with_6(shrinking()), ("numerics.S = 6", "volume constraint 13.8")),
        (pair(sigma=4.0), ("physics.sigma = 4", "tension 0.25")),
        (pair(kappa=1.0), ("physics.kappa = 1", "1.1 interface widths")),
        (pair().with_numerics(scheme="euler", dt=0.3), ("numerics.dt = 0.3", "take at most 0.22")),
    ],
)
def test_a_likely_divergence_is_told_with_what_to_change(scene: Scene, words: tuple) -> None:
    with pytest.warns(StabilityWarning) as caught:
        Simulation(scene)
    text = " ".join(str(warning.message) for warning in caught)
    for word in words:
        assert word in text


def test_a_lattice_that_does_not_resolve_the_interface_is_refused() -> None:
    with pytest.raises(ValueError, match=r"spacing = 0\.8 µm does not resolve .* at most 1\.5"):
        Simulation(pair().with_numerics(spacing=0.8))
    with pytest.raises(ValueError, match=r"physics\.c = 18: .* 0\.25 µm is allowed"):
        Simulation(pair(c=18.0))
    Simulation(pair().with_numerics(spacing=0.75))
    Simulation(pair().with_numerics(spacing=0.8, allow_coarse=True)).step()


# --- steps that are too long for the run ---------------------------------------------------------


@pytest.mark.parametrize(("dt", "S", "tau"), [(2, 6, 2.62), (0.5, 3, 0.2), (40, 1, 26)])
def test_the_lag_is_that_of_the_scheme(dt: float, S: float, tau: float) -> None:
    """Eq. 9 from rest under a constant force: φ is that of S δt²/τ before, and of BDF2's δt/2."""
    before, now, force, steps = 0.0, 0.0, 0.7, 4000
    rate = tau / (2 * dt)
    for _ in range(steps):
        new = (4 * rate * now - rate * before + S * (2 * now - before) + force) / (3 * rate + S)
        before, now = now, new
    scene = pair(tau=tau).with_numerics(dt=dt, S=S)
    late = (steps - 0.5) * dt - now * tau / force
    assert late == pytest.approx(stability.lag(scene), rel=1e-6)


@EXPECTED_TO_FAIL
def test_at_most_so_much_is_missing_as_is_told() -> None:
    end = 96.0
    fine = replace(with_6(pair(), solver="band"), duration=end)
    long = fine.with_numerics(dt=8.0)
    start, right, late = centroids_of(fine, 0.0), centroids_of(fine, end), centroids_of(long, end)
    missing = np.linalg.norm(late - right) / np.linalg.norm(right - start)
    assert 0.1 < missing < stability.missed(long) < 0.9


def centroids_of(scene: Scene, until: float) -> np.ndarray:
    """Centroids at a time, µm."""
    simulation = Simulation(scene)
    simulation.run(until=until)
    return simulation.centroids


def staged(end: End, dt: float) -> Scene:
    """The pair in two stages that end alike."""
    stages = [Stage(name=name, end=end) for name in ("first", "second")]
    return with_6(replace(pair(), stages=stages, duration=1e6), dt=dt)


LONG = with_6(replace(pair(), duration=4000.0))


@pytest.mark.parametrize(
    ("scene", "words"),
    [
        (LONG.with_numerics(dt=1000.0), ("a run of 4000", "2.29e+06 later", "at most 16, ")),
        (LONG.with_numerics(dt=2.0, S=1e6), ("numerics.dt = 2 ", "S = 1e+06", "0.039,")),
        (with_6(pair(tau=1e-6)), ("numerics.dt = 2 ", "at most 0.0015", "duration of 1.6e+08")),
        (LONG.with_numerics(dt=1000.0, scheme="imex1"), ("numerics.dt = 1000 ", "slower")),
        (staged(QuasiSteady(), dt=250.0), ("stages of about 419:", "Take at most 5.2")),
    ],
)
def test_steps_too_long_for_the_run_are_refused(scene: Scene, words: tuple[str, ...]) -> None:
    with pytest.raises(ValueError, match=r"^numerics\.dt = \S+ .*of what changes") as caught:
        Simulation(scene)
    for word in words:
        assert word in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("scene", "words"),
    [
        (
            LONG.with_numerics(dt=32.0),
            ("numerics.dt = 32 ", "2.35e+03 later", "duration of 1.6e+04"),
        ),
        (with_6(pair(), dt=8.0), ("a run of 100", "at most 4.2", "duration of 980")),
        (with_6(pair(), scheme="imex1"), ("5.58 times slower", "scheme = 'bdf2'")),
        (staged(Duration(500.0), dt=8.0), ("stages of 500 on average", ", or stages of 980")),
        (staged(QuasiSteady(), dt=8.0), ("stages of about 419:", "Take at most 5.2")),
    ],
)
def test_steps_long_for_the_run_are_warned_of(scene: Scene, words: tuple[str, ...]) -> None:
    with pytest.warns(StabilityWarning) as caught:
        Simulation(scene)
    for word in words:
        assert word in str(caught[0].message)


@pytest.mark.parametrize("call", [Simulation, lambda scene: relaxed(scene, 2.0)])
def test_a_warning_points_to_the_line_of_the_user(call: Callable[[Scene], object]) -> None:
    with pytest.warns(StabilityWarning) as caught:
        call(with_6(pair(M=30.0)))
    assert caught[0].filename == __file__


def test_what_is_proposed_is_enough() -> None:
    for end, dt, duration in ((4000.0, 16.0, 1.6e7), (100.0, 4.2, 1.6e7)):
        scene = with_6(replace(pair(), duration=end), dt=1000.0)
        assert stability.is_late(scene)
        assert not stability.is_late(scene.with_numerics(dt=dt))
        assert not stability.is_late(replace(scene, duration=duration))


def test_steps_count_in_units_of_the_viscosity() -> None:
    for dt, end in ((2.0, 20.0), (8.0, 300.0), (30.0, 3000.0)):
        thin = with_6(replace(pair(), duration=end), dt=dt)
        thick = with_6(replace(pair(tau=26.2), duration=10 * end), dt=10 * dt)
        assert stability.missed(thick) == pytest.approx(stability.missed(thin))
        assert stability.lag(thick) == pytest.approx(10 * stability.lag(thin))


@pytest.mark.parametrize(
    ("values", "end", "share"),
    [({"S": 1e-300, "dt": 1e-20}, 1e-12, 0.0), ({"dt": 1000.0}, 5e-324, 1.0)],
)
def test_the_smallest_numbers_have_a_share(values: dict, end: float, share: float) -> None:
    scene = replace(pair(), duration=end).with_numerics(**values)
    assert stability.missed(scene) == pytest.approx(share, abs=1e-12)


def test_short_runs_of_presets_are_not_warned_of() -> None:
    for scene in (*built_in_scenes(), pair(), pressed()):
        for name in PRESETS:
            chosen = stability.with_S(replace(scene, numerics=Numerics.preset(name)))
            for end in (1.0, 10.0, 100.0, scene.duration):
                assert not stability.is_late(replace(chosen, duration=end))
    assert not stability.is_late(replace(LONG.with_numerics(dt=1000.0), duration=0.0))


# --- divergence ----------------------------------------------------------------------------------


@EXPECTED_TO_FAIL
@pytest.mark.parametrize(
    "scene",
    [
        pressed(S=2.0),
        with_6(pair(M=30.0)),
        with_6(pair(g=40.0, distance=5.0)),
        with_6(pair(sigma=4.0)),
        with_6(pair(kappa=2.0)),
    ],
    ids=["walls", "volume", "overlap", "attraction", "noise"],
)
def test_divergence_is_noticed_within_ten_steps(scene: Scene) -> None:
    simulation = Simulation(scene)
    unsound = first_unsound_step(simulation)
    last = simulation.engine.steps
    assert last - unsound <= 10
    assert all(np.isfinite(f.phi).all() for f in simulation.fields)


def first_unsound_step(simulation: Simulation) -> int:
    """Run until it diverges; the step at which |φ| first exceeded 1.6."""
    found = None
    for _ in range(400):
        try:
            simulation.step()
        except DivergenceError:
            return simulation.engine.steps if found is None else found
        peak = max(float(np.abs(f.phi).max()) for f in simulation.fields)
        if found is None and peak > 1.6:
            found = simulation.engine.steps
    pytest.fail("did not diverge")


def test_a_value_that_is_not_finite_is_noticed_in_the_next_step() -> None:
    simulation = Simulation(pair(distance=40.0))
    simulation.step(3)
    simulation.engine.pool.box(1)[5, 6, 7] = np.nan
    with pytest.raises(DivergenceError) as caught:
        simulation.step()
    assert caught.value.cell == "right"


EXTREMES = {
    "weak and strong volume constraint": [pair(M=m) for m in (0.0, 1000.0)],
    "repulsion": [pair(g=g, distance=5.0) for g in (0.0, 1e4)],
    "walls": [replace(pressed(), physics=Physics(g_e=g)) for g in (0.0, 1e4)],
    "attraction": [pair(sigma=s) for s in (3.0, 30.0)],
    "noise": [pair(kappa=k) for k in (3.0, 100.0)],
    "surface tension": [pair(gamma=g) for g in (0.25 / 16, 4.0)],
    "double well": [pair(c=18.0).with_numerics(spacing=0.2), pair(c=0.5)],
    "small cells": [pair(radius=2.5, distance=5.0), pair(radius=1.5, distance=3.0)],
    "start overlap": [pair(distance=1.6), pair(distance=0.0)],
    "long steps": [
        replace(pressed(dt=dt), duration=end, save_every=end)
        for dt, end in ((100.0, 1e5), (1e6, 1e13))
    ],
}


@EXPECTED_TO_FAIL
@pytest.mark.parametrize("name", EXTREMES)
def test_extremes_end_finite_or_in_an_error(name: str) -> None:
    for scene in EXTREMES[name]:
        simulation = Simulation(with_6(scene))
        try:
            simulation.step(30)
        except (DivergenceError, CellVanishedError) as error:
            assert error.time == simulation.time  # noqa: PT017
        for field in simulation.fields:
            assert np.isfinite(field.phi).all()
        assert np.isfinite(simulation.volumes).all()


# --- S that is chosen ----------------------------------------------------------------------------


def on_the_band(scene: Scene, **numerics: object) -> Scene:
    """Scene for a quick and long run, whatever its lag."""
    chosen = {"solver": "band", "threads": 1} | numerics
    return replace(scene, duration=1e9).with_numerics(**chosen)


@pytest.mark.parametrize(("c", "needed"), [(6.0, 3.5), (8.0, 3.74), (9.0, 3.93), (10.0, 4.13)])
def test_where_cells_meet_more_is_needed_than_there_and_for_the_whole_alone(
    c: float, needed: float
) -> None:
    """S measured for two cells that adhere, with √(2c) h = 1; alone 3.2, or 3.6 at c = 10."""
    assert stability.least_S(pair(c=c)) == pytest.approx(needed, rel=0.02)


def thick_walls() -> Scene:
    """The pair between walls that are soft in themselves."""
    return replace(pressed(), confinement=replace(TIGHT, width=1.0))


SOUND = {
    "volume constraint": pair(M=200.0),
    "overlap": pair(g=100.0, distance=5.0),
    "walls": pressed(),
    "squeezed": replace(pressed(), physics=Physics(M=32.0)),
    "stepped walls": pressed(walls="stepped"),
    "soft walls": thick_walls(),
    "surface tension": pair(gamma=4.0),
    "small cells": pair(radius=2.6, distance=5.2),
    "larger than their targets": replace(pair(), cells=[replace(pair().cells[0], volume=120.0)]),
    "first order": pressed(scheme="imex1"),
    "long steps": pressed(dt=8.0),
}


@pytest.mark.filterwarnings("ignore:numerics.dt")  # first order is late, which is told
@pytest.mark.parametrize("name", SOUND)
def test_the_S_that_is_chosen_keeps_extremes_sound(name: str) -> None:
    simulation = Simulation(on_the_band(SOUND[name]))
    simulation.step(60)
    before = [field.phi.copy() for field in simulation.fields]
    simulation.step()
    for field, phi in zip(simulation.fields, before, strict=True):
        assert -0.3 < field.phi.min() < field.phi.max() < 1.5
        if field.phi.shape == phi.shape:
            assert np.abs(field.phi - phi).max() < 0.1


def test_the_S_that_is_chosen_is_little_more_than_is_needed() -> None:
    """Measured needs at δt = 2: 2.8, 2.9 and 4.0."""
    for scene, needed in ((built_in_scene("celegans-8"), 2.8), (pair(), 2.9), (pressed(), 4.0)):
        assert needed < stability.chosen_S(scene) < 1.3 * needed
    assert stability.chosen_S(pair().with_numerics(dt=0.3)) == 0
    assert stability.chosen_S(pair().with_numerics(S=7.0)) == 7
    assert stability.chosen_S(pair().with_numerics(scheme="euler", dt=0.1)) == 0


def test_the_error_is_less_than_with_more_S() -> None:
    settings: tuple[dict, ...] = ({"dt": 0.25}, {}, {"S": 6.0})
    paths = [centroids_of(on_the_band(pair(), **numerics), 48.0) for numerics in settings]
    right, chosen, more = paths
    assert np.abs(chosen - right).max() < 0.75 * np.abs(more - right).max()


def test_other_physics_have_another_S() -> None:
    simulation = Simulation(on_the_band(pair()))
    simulation.step(5)
    simulation.change_physics(M=60.0)
    assert simulation.S == Simulation(on_the_band(pair(M=60.0))).S > 20
    simulation.step(40)
    simulation.change_physics(M=8.0)
    assert simulation.S == Simulation(on_the_band(pair())).S


@pytest.mark.parametrize("solver", ["band", "dct"])
def test_cells_that_need_more_S_get_it_and_others_keep_their_history(solver: str) -> None:
    simulation = Simulation(on_the_band(pair(radius=5.0, distance=10.3), solver=solver))
    simulation.step(5)
    first = simulation.S
    simulation.change_cells(["left"], gamma=1.0)
    second = simulation.S
    assert second > 1.2 * first
    assert not simulation.column("fresh").any()
    simulation.step(40)
    simulation.change_cells(["left"], gamma=0.25)  # needs less, which is no reason for a change
    assert second == simulation.S
    simulation.divide("right", ("a", "b"), axis=(0, 1, 0), fraction=0.75)
    assert simulation.column("fresh").tolist() == [False, True, True]
    third = simulation.S
    assert third > second
    simulation.step(5)


def test_more_S_costs_less_than_a_start_without_history() -> None:
    """What the history lacks of it is made up for."""
    still, changed, restarted = (Simulation(on_the_band(pair(distance=8.0))) for _ in range(3))
    for simulation in (still, changed, restarted):
        simulation.step(10)
    rate = 1.3 * still.engine.explicit_rate
    changed.engine.stabilise(rate)
    restarted.engine.explicit_rate = rate
    restarted.engine.restart()
    for simulation in (still, changed, restarted):
        simulation.step(3)
    late, lost = (np.abs(s.centroids - still.centroids).max() for s in (changed, restarted))
    assert 0 < late < 0.4 * lost


def test_a_volume_that_shrinks_as_no_table_says_gets_the_S_it_needs() -> None:
    (cell,) = shrinking().cells
    course = VolumeCourse(times=[0, 100], volumes=[268, 70])
    known, unknown = (
        Simulation(on_the_band(replace(shrinking(), cells=[replace(cell, volume=volume)])))
        for volume in (course, lambda t: course(t))
    )
    before = unknown.S
    assert 1.5 * before < known.S
    unknown.step(80)
    assert 1.5 * before < unknown.S


def test_a_given_S_that_changes_make_too_small_is_warned_of_once() -> None:
    simulation = Simulation(on_the_band(pair(), S=4.0))
    simulation.step(2)
    with pytest.warns(StabilityWarning, match=r"from t = 4 on: numerics\.S = 4 may diverge"):
        simulation.change_physics(M=30.0)
    assert simulation.S == 4
    simulation.change_physics(M=29.0)  # less than has been told of
    simulation.change_cells(["left"], volume=260.0)
    again = Simulation(on_the_band(pair(M=29.0), S=16.0))
    again.change_physics(M=29.5)


def test_a_run_goes_on_with_the_S_it_had(tmp_path: Path) -> None:
    def changed(simulation: Simulation) -> None:
        if simulation.time == 6:
            simulation.change_physics(M=30.0)

    whole = Simulation(on_the_band(pair()))
    whole.run(until=24.0, observers=[changed])
    part = Simulation(on_the_band(pair()))
    part.run(until=12.0, observers=[changed, RunWriter(tmp_path, 100)])
    with open_run(tmp_path) as run:
        assert run.attrs["S"] == part.S
    again = Simulation.from_run(tmp_path)
    assert again.S == part.S == whole.S > 15
    again.run(until=24.0)
    for one, other in zip(whole.fields, again.fields, strict=True):
        np.testing.assert_array_equal(one.phi, other.phi)


def test_what_is_shown_says_whether_S_is_chosen() -> None:
    assert "S chosen by the run" in repr(pair())
    assert "S = 7" in repr(pair().with_numerics(S=7.0))
    assert "3.75 (chosen)" in repr(Simulation(pair()))
    assert "(chosen)" not in repr(Simulation(pair().with_numerics(S=7.0)))
    assert "(chosen)" not in repr(Simulation(pair().with_numerics(tolerance=5.0)))


def test_velocities_do_not_flip_from_step_to_step_where_S_is_chosen() -> None:
    # A quasi-steady stage ends at the first local minimum of v̄, so there may be one alone.
    simulation = Simulation(built_in_scene("celegans-8", {"numerics.tolerance": 10.0}))
    places = [simulation.centroids]
    for check in range(1, 61):
        simulation.run(until=10.0 * check)
        places.append(simulation.centroids)
    moved = np.linalg.norm(np.diff(places, axis=0), axis=2)
    rises = np.diff(np.sqrt((moved**2).mean(axis=1))) > 0
    assert rises.any()
    assert rises[np.argmax(rises) :].all()
