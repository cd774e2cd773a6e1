"""Tissues that live: growth, proliferation and apoptosis by rule."""

from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from morphosim import (
    Apoptosis,
    Cell,
    CellCount,
    CellVanishedError,
    Column,
    Division,
    Duration,
    Ellipsoid,
    Growth,
    Numerics,
    Physics,
    Proliferation,
    RunWriter,
    Scene,
    Simulation,
    Sphere,
    Stage,
    built_in_scene,
    load_scene,
    measured,
    open_run,
    save_scene,
)
from morphosim.cli.plan import plan_text
from morphosim.geometry import phase_field
from morphosim.kernels.noise import normal_vectors
from morphosim.runs.measured_state import MeasuredState
from morphosim.scene.events.living import spread_out, uniform

RADIUS = 5.0
BALL = 4 / 3 * np.pi * RADIUS**3


def cell(name: str = "a", x: float = 0.0, **options: Any) -> Cell:
    return Cell(**({"name": name, "shape": Sphere(center=(x, 0, 0), radius=RADIUS)} | options))


def scene(
    *rules: Any, cells: Any = None, every: float = 10.0, time: float = 1e4, **options: Any
) -> Scene:
    """Cells, by default one, under rules that are looked at every 10 units of time."""
    numerics = {"threads": 1, "spacing": 1.0, "allow_coarse": True} | options.pop("numerics", {})
    stage = Stage(name="life", end=Duration(time), rules=rules, rules_every=every)
    given = {"cells": cells or [cell()], "stages": [stage], "duration": time}
    return Scene(**(given | options), numerics=Numerics(**numerics))


def started(*rules: Any, **options: Any) -> Simulation:
    """A simulation that has taken a step, so that its rules have been looked at once."""
    simulation = Simulation(scene(*rules, **options))
    simulation.run(until=2.0)
    return simulation


def spheroid(**numerics: Any) -> Scene:
    """A cell that becomes 16 or so, with all kinds of rules."""
    rules = (
        Proliferation(volume=800.0, spread=0.1, share_spread=0.05, axis="random"),
        Apoptosis(rate=2e-3, over=30.0),
        Growth(doubling_time=50.0, spread=0.2, pressure=0.5),
    )
    return scene(*rules, numerics={"solver": "band", "seed": 5} | numerics, save_every=50.0,
                 physics=Physics(sigma=0.3, kappa=0.1), time=250.0)  # fmt: skip


def state(simulation: Simulation) -> dict[str, Any]:
    return simulation.engine.contents()


def same(one: Simulation, other: Simulation) -> None:
    had, has = state(one), state(other)
    assert had.keys() == has.keys()
    for name in had:
        np.testing.assert_array_equal(had[name], has[name])
    assert one.removed == other.removed


def test_a_free_cell_doubles_in_the_given_time() -> None:
    simulation = Simulation(scene(Growth(doubling_time=200.0)))
    simulation.run(until=40)
    target, volume = simulation.targets[0], simulation.volumes[0]
    seen: list[float] = []
    simulation.run(until=240, observers=[lambda s: seen.append(float(s.targets[0]))])
    assert simulation.targets[0] / target == pytest.approx(2, rel=1e-12)
    assert simulation.volumes[0] / volume == pytest.approx(2, rel=0.01)
    steps = np.array(seen[1:]) / seen[:-1]  # without jumps where rules are looked at
    np.testing.assert_allclose(steps, 2 ** (2.0 / 200), rtol=1e-12)
    assert simulation.cells[0].volume == simulation.targets[0]


def test_linear_growth_stops_at_its_limit() -> None:
    simulation = Simulation(scene(Growth(rate=0.5, law="linear", limit=560.0)))
    simulation.run(until=30)
    assert simulation.targets[0] == pytest.approx(BALL + 15, rel=1e-12)
    simulation.run(until=100)
    at_limit = simulation.targets[0]
    assert at_limit == pytest.approx(560, rel=1e-12)
    simulation.run(until=150)
    assert simulation.targets[0] == at_limit
    beyond = started(Growth(rate=0.01, limit=400.0))
    assert beyond.targets[0] == pytest.approx(BALL, rel=1e-12)


def test_daughters_have_the_limit_of_their_mother() -> None:
    rules = [Proliferation(when=once), Growth(rate=0.02, limit=400.0)]
    for order in (rules, rules[::-1]):
        simulation = Simulation(scene(*order))
        simulation.run(until=50)
        np.testing.assert_allclose(simulation.targets, [400, 400], rtol=1e-12)


def test_pressure_slows_growth_as_the_volume_constraint_feels_it() -> None:
    """Of the rate r, 1 - p / p_max is left; p is the constraint's pressure over M'."""
    squeezed = cell(volume=1.2 * BALL)
    simulation = started(Growth(rate=1e-3, pressure=0.5), cells=[squeezed, cell("b", 30.0)])
    simulation.run(until=10.0)
    p = simulation.pressures
    np.testing.assert_allclose(simulation.column("growth_rate"), 1e-3 * (1 - p / 0.5), rtol=1e-12)
    simulation.engine.settle()
    felt = simulation.engine.step_state().terms.pressure
    np.testing.assert_allclose(felt, 8 * (1 - simulation.volumes / simulation.targets), rtol=1e-5)
    stopped = started(Growth(rate=1e-3, pressure=0.1), cells=[cell(volume=1.4 * BALL)])
    assert stopped.column("growth_rate")[0] == 0


def test_contact_slows_growth() -> None:
    cells = [cell("a"), cell("b", 8.5), cell("c", 40.0)]
    simulation = started(Growth(rate=1e-3, contact=0.4), cells=cells)
    simulation.run(until=10.0)
    touched = 1 - simulation.measured().exposed_fraction
    expected = 1e-3 * np.clip(1 - touched / 0.4, 0, 1)
    np.testing.assert_allclose(simulation.column("growth_rate"), expected, rtol=1e-12)
    assert expected[0] < 0.9e-3
    assert expected[2] == 1e-3


def test_who_does_not_grow() -> None:
    """Other types, frozen cells, and cells whose volume is a function of time."""
    cells = [
        cell("a", type="x"), cell("b", 20.0), cell("c", 40.0, type="x", frozen=True),
        cell("d", 60.0, type="x", volume=lambda t: BALL + t),
    ]  # fmt: skip
    simulation = started(Growth(rate=0.01, types=["x"]), cells=cells)
    simulation.run(until=20)
    expected = [BALL * np.exp(0.2), BALL, BALL, BALL + 20]
    np.testing.assert_allclose(simulation.targets, expected, rtol=1e-12)
    simulation.change_cells(["a"], type="y")
    simulation.change_cells(["d"], volume=500.0)
    simulation.run(until=32)  # the next look is at 30
    expected = [BALL * np.exp(0.2), BALL, BALL, 500 * np.exp(0.02)]
    np.testing.assert_allclose(simulation.targets, expected, rtol=1e-12)


def test_growth_ends_with_its_stage() -> None:
    grows = Stage(name="one", end=Duration(50), rules=[Growth(rate=0.01)])
    simulation = Simulation(
        replace(scene(), stages=[grows, Stage(name="two", end=Duration(50))], duration=100.0)
    )
    simulation.run()
    assert simulation.targets[0] == pytest.approx(BALL * np.exp(0.5), rel=1e-12)


def test_chance_has_the_distributions_that_are_stated() -> None:
    drawn = np.empty((100_000, 3))
    normal_vectors(np.uint64(7), np.uint64(1 << 63), np.arange(len(drawn), dtype=np.uint64), drawn)
    values = spread_out(3.0, 0.2, drawn[:, 0])
    assert values.mean() == pytest.approx(3, rel=0.003)
    assert values.std() == pytest.approx(0.6, rel=0.01)
    assert (spread_out(3.0, 0.0, drawn[:, 0]) == 3).all()
    counts, _ = np.histogram(uniform(drawn), bins=10, range=(0, 1))
    assert counts.sum() == len(drawn)
    np.testing.assert_allclose(counts, 10_000, rtol=0.04)


def test_chance_belongs_to_the_seed_the_cell_and_the_purpose() -> None:
    cells = [cell("a"), cell("b", 20.0), cell("c", 40.0)]
    simulation, other = (Simulation(scene(cells=cells, numerics={"seed": seed})) for seed in (1, 2))
    own = simulation.chance("x")
    assert len(np.unique([own, simulation.chance("y"), other.chance("x")])) == 27
    again = simulation.chance("x", again=True)
    simulation.step()
    assert (simulation.chance("x") == own).all()
    assert (simulation.chance("x", again=True) != again).all()
    simulation.remove(["a"])
    np.testing.assert_array_equal(simulation.chance("x"), own[1:])


def test_cells_divide_at_the_stated_volume_and_are_named_by_number() -> None:
    simulation = Simulation(
        scene(Proliferation(volume=800.0), Growth(doubling_time=100.0), every=4.0)
    )
    seen: list[Any] = []

    def watch(simulation: Simulation) -> None:
        seen.append((simulation.names, simulation.volumes.copy(), simulation.targets.copy()))

    simulation.run(until=290, observers=[watch])
    for (names, volumes, _), (later, _, _) in pairwise(seen):
        gone = np.array([name not in later for name in names])
        # within what they grow in the 4 units of time between two looks, and a step
        assert (volumes[gone] >= 800 * 2**-0.02).all()
        assert (volumes[gone] < 800 * 2**0.06).all()
    assert simulation.names == [f"a.{k}" for k in range(8, 16)]
    assert simulation.parents == [f"a.{k // 2}" for k in range(8, 16)]
    assert simulation.column("generation").tolist() == [3] * 8
    born = simulation.column("born")
    assert (born > 200).all()
    assert [text for _, text in simulation.events] == [
        "division of a into a.2 and a.3", "division of 2 cells: a.2, a.3",
        "division of 4 cells: a.4, a.5, a.6, a.7",
    ]  # fmt: skip
    growth = 2 ** (simulation.time / 100)
    assert simulation.targets.sum() == pytest.approx(BALL * growth, rel=1e-12)
    assert simulation.volumes.sum() == pytest.approx(simulation.targets.sum(), rel=0.04)


def test_daughters_begin_with_their_own_rates() -> None:
    simulation = started(
        Proliferation(when=once), Growth(rate=1e-3, spread=0.3), cells=[cell("a"), cell("b", 20.0)]
    )
    drawn = spread_out(1e-3, 0.3, simulation.chance("growth")[:, 0])
    assert len(set(drawn)) == 4
    np.testing.assert_array_equal(simulation.column("growth_rate"), drawn)


def once(simulation: Simulation) -> np.ndarray:
    """All cells of the start."""
    return simulation.column("generation") == 0


def first(simulation: Simulation) -> np.ndarray:
    return np.array(simulation.names) == "a"


def test_cells_divide_at_an_age_of_their_own() -> None:
    cells = [cell(name, 20.0 * k) for k, name in enumerate("abcdef")]
    simulation = Simulation(scene(Proliferation(age=30.0, spread=0.3), cells=cells, every=2.0))
    due = spread_out(30.0, 0.3, simulation.chance("proliferation: age")[:, 0])
    simulation.run(until=26)
    alive = {name for name in simulation.names if "." not in name}
    assert 0 < len(alive) < 6
    assert alive == {c.name for c, age in zip(cells, due, strict=True) if age > 26}
    ages = simulation.time - simulation.column("born")
    assert set(ages[simulation.column("generation") == 0]) == {26}
    assert ages.min() < 26


def test_chances_per_time_add_up_whatever_the_interval() -> None:
    """Of many cells exp(-rate t) have not been picked, and a stage's start is no chance."""
    cells = [cell(f"c{k}", 20.0 * k, shape=Sphere(center=(20.0 * k, 0, 0), radius=3))
             for k in range(60)]  # fmt: skip
    left = []
    for every in (2.0, 10.0):
        simulation = Simulation(scene(Apoptosis(rate=0.02, over=1e3), cells=cells, every=every))
        simulation.run(until=2)
        assert every == 2 or not simulation.column("dying").any()
        simulation.run(until=32)
        left.append(60 - int(simulation.column("dying").sum()))
    expected, deviation = 60 * np.exp(-0.6), np.sqrt(60 * np.exp(-0.6) * (1 - np.exp(-0.6)))
    assert np.abs(np.array(left) - expected).max() < 3 * deviation
    assert left[0] != 60


def test_crowded_cells_do_not_divide() -> None:
    cells = [cell(name, 8.5 * k) for k, name in enumerate("abc")]
    simulation = started(Proliferation(when=once, neighbours=1), cells=cells)
    assert "b" in simulation.names
    assert len(simulation.names) == 5


@pytest.mark.parametrize(
    ("axis", "along"),
    [
        ("long", (0, 1, 0)), ("short", (1, 0, 0)), ((0, 0, 2), (0, 0, 1)),
        (lambda simulation, rows: np.tile([3, 0, 0], (len(rows), 1)), (1, 0, 0)),
    ],
)  # fmt: skip
def test_cells_divide_along_the_stated_axis(axis: Any, along: Any) -> None:
    egg = Ellipsoid(center=(1, 2, 3), semi_axes=(4.5, 8, 6))
    simulation = started(Proliferation(when=once, axis=axis), cells=[cell(shape=egg)])
    apart = simulation.centroids[0] - simulation.centroids[1]
    across = apart / np.linalg.norm(apart)
    assert abs(across @ along) / np.linalg.norm(along) == pytest.approx(1, abs=1e-3)


def test_cells_divide_towards_the_free_surface_or_across_that() -> None:
    cells = [cell("a"), cell("b", 9.0), cell("c", 18.0)]
    for axis, expected in (("outward", 1.0), ("tangential", 0.0)):
        simulation = started(Proliferation(when=first, axis=axis), cells=cells)
        apart = np.diff(simulation.centroids[-2:], axis=0)[0]
        cosine = -apart[0] / np.linalg.norm(apart)
        assert abs(cosine) == pytest.approx(expected, abs=0.05)
        if axis == "outward":
            assert simulation.centroids[-2, 0] < simulation.centroids[-1, 0]


def test_random_axes_are_those_of_the_cells() -> None:
    cells = [cell("a"), cell("b", 20.0)]
    simulation = started(Proliferation(when=once, axis="random"), cells=cells)
    apart = simulation.centroids[0::2] - simulation.centroids[1::2]
    cosine = (apart[0] @ apart[1]) / np.prod(np.linalg.norm(apart, axis=1))
    assert abs(cosine) < 0.99


def test_daughters_get_their_shares_and_types() -> None:
    cells = [cell("a", type="stem"), cell("b", 20.0, type="skin"), cell("c", 40.0, type="stem")]
    rule = Proliferation(
        when=once, share=0.6, into={"stem": ("stem", "skin")}, types=["stem", "skin"]
    )
    simulation = started(rule, cells=cells)
    assert simulation.types == ["stem", "skin", "skin", "skin", "stem", "skin"]
    assert simulation.names == ["a.2", "a.3", "b.2", "b.3", "c.2", "c.3"]
    np.testing.assert_allclose(simulation.targets, BALL * np.array([0.6, 0.4] * 3), rtol=1e-12)
    never = started(replace(rule, probability=0.0), cells=cells)
    assert never.types == ["stem", "stem", "skin", "skin", "stem", "stem"]
    varied = started(replace(rule, share_spread=0.1), cells=cells)
    shares = varied.targets[::2] / BALL
    assert len(set(shares)) == 3
    assert ((shares > 0.1) & (shares < 0.9)).all()


def test_cells_too_small_for_the_lattice_do_not_divide() -> None:
    simulation = Simulation(scene(Proliferation(rate=10.0), every=2.0))
    simulation.run(until=12)
    assert len(simulation.names) == 8, "sixteen would be of 33 points, which is too few"


def test_a_dying_cell_shrinks_steadily_and_is_gone() -> None:
    rules = (Apoptosis(when=first, over=40.0), Proliferation(when=once), Growth(rate=1e-3))
    simulation = started(*rules, cells=[cell("a"), cell("b", 20.0)])
    assert simulation.names == ["a", "b.2", "b.3"], "who dies does not divide"
    assert not simulation.ready()[0]
    way = BALL - 54  # of which the lattice needs the half
    assert simulation.targets[0] == pytest.approx(BALL - way / 20, rel=1e-12)
    simulation.run(until=20)
    assert simulation.targets[0] == pytest.approx(BALL - way / 2, rel=1e-12)
    assert simulation.volumes[0] == pytest.approx(simulation.targets[0], rel=0.1)
    simulation.run(until=42)
    assert simulation.names == ["b.2", "b.3"]
    assert [name for _, name in simulation.removed] == ["a"]
    assert [text for _, text in simulation.events] == [
        "death of a", "division of b into b.2 and b.3", "removal of a",
    ]  # fmt: skip


def test_the_last_cell_that_dies_ends_the_run() -> None:
    simulation = Simulation(scene(Apoptosis(age=1.0, over=20.0), every=2.0))
    with pytest.raises(CellVanishedError, match="the last cells have died at t = 22: a"):
        simulation.run()


def test_several_divisions_at_once_are_as_one_after_the_other() -> None:
    cells = [cell("a", type="x"), cell("b", 20.0), cell("c", 40.0, volume=lambda t: BALL + t)]
    one, batch = (Simulation(scene(Growth(rate=1e-3), cells=cells)) for _ in range(2))
    for simulation in (one, batch):
        simulation.run(until=6)
    one.divide("a", ("p", "q"), axis=(0, 0, 1), fraction=0.6)
    one.divide("c", ("r", "s"), axis=(0, 1, 0), fraction=0.5, types=("y", "z"))
    batch.divide_cells(
        ["a", "c"], [("p", "q"), ("r", "s")], axes=[(0, 0, 1), (0, 1, 0)], fractions=[0.6, 0.5],
        types=[("x", "x"), ("y", "z")],
    )  # fmt: skip
    for simulation in (one, batch):
        simulation.run(until=12)
    same(one, batch)
    with pytest.raises(ValueError, match="daughter 'p' of 'b': a cell has or had this name"):
        batch.divide_cells(["b", "q"], [("p", "t"), ("u", "v")], axes=np.eye(3)[:2])
    with pytest.raises(ValueError, match="daughter 'k' occurs twice"):
        batch.divide_cells(["b", "q"], [("k", "t"), ("k", "v")], axes=np.eye(3)[:2])
    assert "b" in batch.names


def test_a_growing_tissue_goes_on_bit_for_bit(tmp_path: Path) -> None:
    whole = Simulation(spheroid())
    whole.run(observers=[RunWriter.of(whole.scene, tmp_path / "whole")])
    assert len(whole.names) > 8
    assert whole.removed
    broken = Simulation(spheroid())
    broken.run(until=134, observers=[RunWriter.of(broken.scene, tmp_path / "broken")])
    resumed = Simulation.from_run(tmp_path / "broken")
    resumed.run(observers=[RunWriter.of(resumed.scene, tmp_path / "broken", resume=True)])
    same(whole, resumed)
    with open_run(tmp_path / "whole") as run:
        last = run.isel(time=-1).dropna("cell", subset=["volume"])
        np.testing.assert_allclose(last["pressure"], 1 - last["volume"] / last["target_volume"])
        assert last["generation"].max() >= 3
        ages = dict(zip(whole.names, whole.time - whole.column("born"), strict=True))
        assert {str(name): float(age) for name, age in last["age"].to_series().items()} == ages
        tree = run.morpho.lineage()
        assert "a" in str(tree)


def test_a_growing_tissue_is_the_same_on_two_threads() -> None:
    one, two = (Simulation(spheroid(threads=count)) for count in (1, 2))
    for simulation in (one, two):
        simulation.run(until=180)
    same(one, two)


def test_steps_by_a_tolerance_keep_to_the_course() -> None:
    simulation = Simulation(
        scene(Proliferation(volume=800.0), Growth(doubling_time=100.0),
              numerics={"tolerance": 50.0})
    )  # fmt: skip
    simulation.run(until=190)
    assert len(simulation.names) == 4
    assert simulation.targets.sum() == pytest.approx(BALL * 2**1.9, rel=1e-12)


def test_scene_files_say_rules(tmp_path: Path) -> None:
    rules = (
        Proliferation(volume=800.0, axis="outward", into=["p", "q"]),
        Proliferation(age=9.0, axis=[0, 1, 0], into={"p": ["p", "q"]}, types=["p"]),
        Proliferation(when=once, axis=along_x, types=["q"]),
        Apoptosis(rate=1e-3, types=["q"]), Apoptosis(when=once),
        Growth(doubling_time=100.0, spread=0.1, limit=900.0), Growth(rate=0.1, law="linear"),
    )  # fmt: skip
    given = scene(*rules)
    save_scene(given, tmp_path / "scene.toml")
    assert load_scene(tmp_path / "scene.toml").stages == given.stages


def along_x(simulation: Simulation, rows: np.ndarray) -> np.ndarray:
    return np.tile([1.0, 0, 0], (len(rows), 1))


def test_scenes_without_rules_keep_and_save_nothing_of_them(tmp_path: Path) -> None:
    plain = scene()
    simulation = Simulation(plain)
    simulation.run(until=2, observers=[RunWriter.of(plain, tmp_path / "run")])
    assert not {"born", "generation", "grown_from", "dying"} & set(state(simulation))
    with open_run(tmp_path / "run") as run:
        assert not {"age", "generation", "pressure"} & set(run)


@dataclass(frozen=True, kw_only=True)
class Tired:
    """Cells of one's own, that count how often they have been looked at, and stop."""

    columns = (Column("looks", shared=True), *Apoptosis.columns)

    def apply(self, simulation: Simulation) -> None:
        simulation.column("looks")[:] += 1
        tired = simulation.column("looks") >= 3
        simulation.die(np.array(simulation.names)[tired].tolist(), over=20.0)


def test_rules_of_ones_own_have_columns() -> None:
    simulation = Simulation(scene(Tired(), Proliferation(when=once), every=2.0))
    simulation.run(until=2)
    assert simulation.column("looks").tolist() == [2, 2], "daughters inherit"
    simulation.run(until=6)
    assert simulation.column("dying").all()


def test_variables_of_ones_own_may_be_of_the_state_of_a_rule(own_variables: None) -> None:
    @measured(dims=("time", "cell"), units="1", text="looks", column="looks")
    def looked_at(state: Any) -> Any:
        return state.simulation.column("looks")

    assert MeasuredState(started(Tired())).table["looked_at"].tolist() == [1]
    assert "looked_at" not in MeasuredState(started(Apoptosis(age=1e3))).table


@dataclass(frozen=True, kw_only=True)
class Named:
    """An event of one's own that names cells, and is rehearsed."""

    dies: str = "a"
    divides: str = "b"
    columns = Proliferation.columns

    def apply(self, simulation: Any) -> None:
        simulation.die([self.dies], over=10.0)
        simulation.divide_cells([self.divides], [("p", "q")], axes=[(1, 0, 0)])
        simulation.remove(["p"])

    rehearse = apply


def test_events_of_ones_own_are_rehearsed() -> None:
    cells = [cell("a"), cell("b", 20.0)]
    given = replace(scene(cells=cells), stages=[Stage(name="x", end=Duration(4), events=[Named()])])
    simulation = Simulation(given)
    simulation.run()
    assert simulation.names == ["a", "q"]
    for wrong, words in ((Named(dies="z"), "cell = 'z'"), (Named(divides="z"), "cell = 'z'")):
        later = Stage(name="x", end=Duration(4), events=[wrong])
        with pytest.raises(ValueError, match=rf"stage 'x': events\[0\]: {words} is not known"):
            Simulation(replace(given, stages=[later]))


def test_a_frozen_cell_stops_growing() -> None:
    simulation = started(Growth(rate=0.01), cells=[cell("a"), cell("b", 20.0)])
    simulation.change_cells(["a"], frozen=True)
    now = simulation.targets[0]
    simulation.run(until=20)
    assert simulation.targets[0] == now
    assert simulation.targets[1] > now


def test_a_stated_volume_takes_the_place_of_a_course_from_which_growth_goes_on() -> None:
    simulation = started(Growth(rate=0.01))
    simulation.change_cells(["a"], volume=600.0)
    assert simulation.targets[0] == 600
    simulation.run(until=20)
    assert simulation.targets[0] == pytest.approx(600 * np.exp(0.1), rel=1e-12)


def test_daughters_of_another_type_do_not_grow_as_their_mother() -> None:
    rules = [Growth(rate=0.01, types=["x"]), Proliferation(when=once, into=["x", "y"])]
    simulation = started(*rules, cells=[cell(type="x")])
    simulation.run(until=20)
    expected = BALL / 2 * np.array([np.exp(0.2), 1])
    np.testing.assert_allclose(simulation.targets, expected, rtol=1e-12)


def test_names_of_the_start_may_end_in_numbers() -> None:
    simulation = started(Proliferation(when=once), cells=[cell("a.2"), cell("b.1", 20.0)])
    assert simulation.names == ["a.2.2", "a.2.3", "b.1.2", "b.1.3"]


def test_who_is_just_born_has_had_no_time_to_die() -> None:
    rules = [Proliferation(age=10.0), Apoptosis(rate=100.0, over=50.0, types=[""])]
    simulation = Simulation(scene(*rules, every=10.0))
    simulation.run(until=10)
    assert simulation.names == ["a.2", "a.3"]
    assert not simulation.column("dying").any()


def test_a_tissue_that_would_not_fit_into_memory_is_refused_at_its_start() -> None:
    life = replace(scene().stages[0], end=CellCount(10**8))
    with pytest.raises(ValueError, match=r"the 100000000 cells to which a stage goes on, .* GB"):
        Simulation(replace(scene(), stages=[life]))


def test_memory_that_cells_of_a_tissue_need_is_told_at_its_start(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """26.6 GB were measured for the fields of 100 000 cells of a spheroid."""
    monkeypatch.setattr(phase_field, "memory", lambda: 10e9)
    with pytest.raises(ValueError, match=r"100000 cells .* at least 1[0-9.]+ GB") as told:
        Simulation(built_in_scene("spheroid", {"stages.0.end.cells": 100_000}))
    assert "there are 10 GB" in str(told.value)


def test_cells_of_a_sheet_have_six_neighbours_on_average() -> None:
    """As in any tiling of the plane by cells that meet in threes (Euler); fewer at the rim."""
    chosen = {"stages.0.end.cells": 64, "numerics.threads": 1}
    simulation = Simulation(built_in_scene("epithelium", chosen))
    simulation.run()
    places = simulation.centroids
    assert np.abs(places[:, 2]).max() < 0.1, "one layer"
    radius = np.linalg.norm(places[:, :2] - places[:, :2].mean(axis=0), axis=1)
    counts = np.bincount(simulation.measured().contacts.ravel(), minlength=len(radius))
    inner = radius < 0.7 * radius.max()
    assert inner.sum() > 25
    assert counts[inner].mean() == pytest.approx(6, abs=0.35)
    assert counts[~inner].mean() < 5.5


def test_what_would_run_is_told_with_the_cells_to_come() -> None:
    told = plan_text(Simulation(built_in_scene("spheroid", {"numerics.threads": 1})))
    assert "growth: every 40 Proliferation, Growth; until CellCount (cells 100)" in told
    assert "a save at the start" in told
    assert "MB at 100 cells, besides Python" in told


def test_a_stage_ends_with_a_number_of_cells() -> None:
    rules = [Proliferation(when=lambda s: s.column("generation") < 9), Growth(rate=0.02)]
    life = Stage(name="life", end=CellCount(4), rules=rules, rules_every=30.0)
    simulation = Simulation(replace(scene(), stages=[life]))
    simulation.run()
    assert len(simulation.names) == 4
    assert simulation.time == 32


WRONG: dict[str, tuple[Any, tuple[str, ...]]] = {
    "no rate": (lambda: Growth(), ("rate = None and doubling_time = None", "one of the two")),
    "two rates": (lambda: Growth(rate=1.0, doubling_time=2.0), ("give one of the two",)),
    "linear doubling": (
        lambda: Growth(doubling_time=2.0, law="linear"), ("doubling_time = 2.0", "give rate"),
    ),
    "law": (lambda: Growth(rate=1.0, law="cubic"), ("law = 'cubic'", "'exponential', 'linear'")),
    "negative": (lambda: Growth(rate=-1.0), ("growth: rate = -1.0 is not allowed", "> 0")),
    "spread": (lambda: Growth(rate=1.0, spread=2.0), ("growth: spread = 2.0", "<= 1")),
    "contact": (lambda: Growth(rate=1.0, contact=1.5), ("growth: contact = 1.5", "<= 1")),
    "pressure": (lambda: Growth(rate=1.0, pressure="x"), ("growth: pressure = 'x'", "number")),
    "types": (lambda: Growth(rate=1.0, types="x"), ("growth: types = 'x' is not a list",)),
    "nothing": (lambda: Proliferation(axis="long"), ("nothing says who divides",)),
    "axis": (lambda: Proliferation(rate=1.0, axis="lnog"), ("axis = 'lnog'", "mean 'long'")),
    "no axis": (lambda: Proliferation(rate=1.0, axis=(0, 0, 0)), ("has no direction",)),
    "share": (lambda: Proliferation(rate=1.0, share=0.0), ("share = 0.0", ">= 0.1")),
    "into": (lambda: Proliferation(rate=1.0, into=["x"]), ("into", "expected 2 texts")),
    "into of": (lambda: Proliferation(rate=1.0, into={"x": "y"}), ("into['x'] = 'y'",)),
    "neighbours": (lambda: Proliferation(rate=1.0, neighbours=1.5), ("neighbours = 1.5",)),
    "probability": (lambda: Proliferation(rate=1.0, probability=2), ("probability = 2",)),
    "when": (lambda: Proliferation(when=3), ("when = 3 cannot be called",)),
    "nobody": (lambda: Apoptosis(), ("nothing says who dies", "rate, age or when")),
    "over": (lambda: Apoptosis(rate=1.0, over=0.0), ("over = 0.0", "> 0")),
    "unknown type": (
        lambda: Simulation(scene(Growth(rate=1.0, types=["x"]))),
        ("stage 'life': rules[0]: growth: types = 'x' is not known",),
    ),
    "unknown mother": (
        lambda: Simulation(scene(Proliferation(rate=1.0, into={"x": ("", "")}))),
        ("proliferation: into = 'x' is not known",),
    ),
    "numbered name": (
        lambda: Simulation(scene(Proliferation(rate=1.0), cells=[cell("a"), cell("a.2", 20.0)])),
        ("cell 'a.2' has a name that a descendant of 'a' may get",),
    ),
    "stated number": (
        lambda: started(Proliferation(age=1e3)).divide("a", ("b.2", "c"), axis=(1, 0, 0)),
        ("daughter 'b.2' of 'a': names that end in a number",),
    ),
    "beyond all numbers": (
        lambda: started(Growth(rate=100.0)).run(), ("cell 'a': volume at t =", "a smaller rate"),
    ),
    "no state": (
        lambda: Simulation(scene()).die(["a"], over=10.0), ("die:", "Growth or Apoptosis"),
    ),
    "no numbers": (
        lambda: Simulation(scene()).divide_cells(["a"], axes=[(1, 0, 0)]),
        ("divide_cells without names", "Proliferation"),
    ),
    "who dies": (
        lambda: started(Growth(rate=1e-3)).die(["b"], over=10.0), ("cell = 'b' is not known",),
    ),
    "dying mother": (
        lambda: started(Apoptosis(when=first)).divide("a", ("b", "c"), axis=(1, 0, 0)),
        ("cell 'a' is dying; it cannot divide",),
    ),
    "axes of others": (
        lambda: started(Proliferation(age=1e3)).divide_cells(["a"], axes=np.eye(3)),
        ("divide_cells: axes", "expected 1 axes, not 3"),
    ),
    "flags": (
        lambda: started(Apoptosis(when=lambda s: [1.0])), ("apoptosis: when gave [1.0]", "1 times"),
    ),
    "axes": (
        lambda: started(Proliferation(when=once, axis=lambda s, rows: np.zeros((len(rows), 3)))),
        ("an axis that the function gives has no direction",),
    ),
    "column": (
        lambda: scene(type("Own", (), {"apply": lambda self, s: None,
                                       "columns": (Column("own"),)})()),
        ("column 'own' of a rule must be known to all ranks: shared=True",),
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", WRONG)
def test_what_cannot_be_is_told(case: str) -> None:
    attempt, words = WRONG[case]
    with pytest.raises((TypeError, ValueError)) as caught:
        attempt()
    for word in words:
        assert word in str(caught.value)


def test_stated_divisions_are_born_and_counted_too() -> None:
    division = Division(cell="a", daughters=("b", "c"), axis=(1, 0, 0))
    later = Stage(name="two", end=Duration(10), events=[division])
    given = scene(Proliferation(age=1e3), time=10.0)
    simulation = Simulation(replace(given, stages=[*given.stages, later], duration=20.0))
    simulation.run()
    assert simulation.names == ["b", "c"]
    assert simulation.column("born").tolist() == [10, 10]
    assert simulation.column("generation").tolist() == [1, 1]
