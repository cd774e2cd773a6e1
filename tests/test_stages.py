"""Stages: when they end, what they start with, in runs and in scene files."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from morphosim import (
    Attraction,
    Cell,
    CellChange,
    Differentiation,
    Division,
    Duration,
    Numerics,
    Physics,
    PhysicsChange,
    QuasiSteady,
    Removal,
    RunWriter,
    Scene,
    Simulation,
    Sphere,
    Stage,
    Steady,
    When,
    load_scene,
    open_run,
    save_scene,
)

DIVISION = Division(cell="m", daughters=("a", "b"), axis=(1, 0, 0), fraction=0.55)


def scene(*stages: Stage, **options: Any) -> Scene:
    cells = [Cell(name="m", shape=Sphere(center=(0, 0, 0), radius=5), type="x")]
    return Scene(
        **({"cells": cells, "physics": Physics(kappa=0.05), "duration": 1e4} | options),
        numerics=Numerics(threads=1), stages=stages,
    )  # fmt: skip


def ran(chosen: Scene, folder: Path, until: float | None = None) -> Simulation:
    simulation = Simulation(chosen)
    simulation.run(until=until, observers=[RunWriter(folder, 50)])
    return simulation


def test_a_run_goes_through_its_stages(tmp_path: Path) -> None:
    simulation = ran(
        scene(
            Stage(name="one", end=Duration(15)),
            Stage(name="two", end=Duration(30), events=[DIVISION], physics={"sigma": 0.3}),
        ),
        tmp_path,
    )
    assert simulation.time == 46
    assert simulation.names == ["a", "b"]
    assert simulation.physics.attraction.default == 0.3
    with open_run(tmp_path) as run:
        assert run["time"].values.tolist() == [0, 16, 46]
        assert run["stage"].values.tolist() == ["", "one", "two"]
        said = "division of m into a and b; change of sigma"
        assert run["events"].values.tolist() == ["", "", said]
        alive = np.isfinite(run["volume"].values)
        assert alive.tolist() == [[True, False, False]] * 2 + [[False, True, True]]
        lineage = run.morpho.lineage()
        assert set(lineage.edges) == {("m", "a"), ("m", "b")}


def test_a_steady_stage_ends_when_cells_rest() -> None:
    quiet = scene(
        Stage(name="two", end=Steady(2e-3), events=[DIVISION]), physics=Physics(kappa=0.0)
    )
    simulation = Simulation(quiet)
    speeds, before = [], None

    class Look:
        def start(self, simulation: Simulation) -> None:
            pass

        def after_step(self, simulation: Simulation) -> None:
            nonlocal before
            if simulation.time % 10 == 0:
                now = simulation.centroids
                if before is not None:
                    moved = ((now - before) ** 2).sum(axis=1)
                    speeds.append(np.sqrt(moved.mean()) / 10)
                before = now

        def finish(self, simulation: Simulation) -> None:
            pass

    simulation.run(observers=[Look()])
    assert speeds[-1] < 2e-3
    assert min(speeds[:-1]) > 2e-3


def test_a_quasi_steady_stage_ends_with_the_state_of_the_minimum(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    speeds = iter([5.0, 3.0, 2.0, 4.0])
    monkeypatch.setattr(
        "morphosim.simulation.stage_runner.root_mean_square", lambda _: next(speeds)
    )
    chosen = scene(Stage(name="q", end=QuasiSteady()))
    simulation = Simulation(chosen)
    simulation.run(observers=[RunWriter(tmp_path, 4)])
    assert simulation.time == 30  # found at 40
    plain = Simulation(chosen)
    plain.step(15)
    np.testing.assert_array_equal(simulation.fields[0].phi, plain.fields[0].phi)
    with open_run(tmp_path) as run:
        assert run["time"].values.tolist() == [*range(0, 30, 4), 30]
        assert np.isfinite(run["rms_speed"].values[1:]).all()


@pytest.mark.parametrize(
    ("speeds", "reached"),
    [
        ([3, 2, 4], True),
        ([5, 3, 2, 2], True),  # no slower than at the next check
        ([5, 3, 3, 2], False),
        ([2, 2, 2], False),
        ([2, 2, 3], False),  # it was as slow before
        ([3, 2], False),
        ([], False),
    ],
)
def test_the_first_local_minimum_of_the_speed(speeds: list[float], reached: bool) -> None:
    """Ties: it begins with the first of equal speeds."""
    simulation = Simulation(scene())
    assert QuasiSteady().reached(speeds, 10.0 * len(speeds), simulation) is reached


def test_speeds_of_the_stage_before_do_not_count(monkeypatch: pytest.MonkeyPatch) -> None:
    speeds = iter([5.0, 1e-5, 3.0, 2.0, 4.0])
    monkeypatch.setattr(
        "morphosim.simulation.stage_runner.root_mean_square", lambda _: next(speeds)
    )
    simulation = Simulation(
        scene(Stage(name="s", end=Steady(1e-4)), Stage(name="q", end=QuasiSteady()))
    )
    simulation.run()
    assert simulation.time == 40  # 20 of the first, and the minimum after 20 of the second


class Note:
    """A rule that notes when it is applied."""

    def __init__(self) -> None:
        self.times: list[float] = []

    def apply(self, simulation: Simulation) -> None:
        self.times.append(simulation.time)


def test_rules_are_applied_at_the_start_and_at_their_intervals() -> None:
    note = Note()
    Simulation(scene(Stage(name="s", end=Duration(20), rules=[note], rules_every=6.0))).run()
    assert note.times == [0, 6, 12, 18]


def test_physics_of_a_stage_follow_its_events() -> None:
    simulation = Simulation(
        scene(Stage(name="s", end=Duration(4), events=[DIVISION], physics={"g": 2.0}))
    )
    simulation.run()
    assert [text.split()[0] for _, text in simulation.events] == ["division", "change"]


class Rename:
    """Give a cell another type at a time."""

    def __init__(self, time: float, kind: str) -> None:
        self.time, self.kind = time, kind

    def apply(self, simulation: Simulation) -> None:
        if simulation.time == self.time:
            simulation.change_cells(simulation.names[:1], type=self.kind)


@pytest.mark.parametrize("every", [8, 10])
def test_what_a_stage_undoes_has_not_happened(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, every: int
) -> None:
    speeds = iter([5.0, 3.0, 2.0, 4.0])
    monkeypatch.setattr(
        "morphosim.simulation.stage_runner.root_mean_square", lambda _: next(speeds)
    )
    rules = [Rename(28.0, "early"), Rename(30.0, "now"), Rename(36.0, "late")]
    chosen = scene(Stage(name="q", end=QuasiSteady(), rules=rules, rules_every=2.0))
    simulation = Simulation(chosen)
    simulation.run(observers=[RunWriter(tmp_path, every)])  # saves of 30 and later are dropped
    assert simulation.time == 30
    assert simulation.cells[0].type == "early"
    assert [time for time, _ in simulation.events] == [28.0]
    with open_run(tmp_path) as run:
        assert run["time"].values.tolist() == [*range(0, 30, every), 30]
        assert run["events"].values.tolist()[-1] == "change of type of m"
        assert set(run["events"].values.tolist()[:-1]) == {""}
        assert run["type"].values[-1].tolist() == ["early"]
        assert run.attrs["finished"] == 1


def test_a_limit_and_a_condition_end_a_stage() -> None:
    limited = Simulation(scene(Stage(name="s", end=Steady(1e-9), limit=25.0)))
    limited.run()
    assert limited.time == 26
    asked = Simulation(scene(Stage(name="w", end=When(lambda s: s.time > 12))))
    asked.run()
    assert asked.time == 20  # the next check


@pytest.mark.parametrize("until", [16.0, 24.0, 60.0])
def test_a_staged_run_goes_on_to_the_same_bits(tmp_path: Path, until: float) -> None:
    chosen = scene(
        Stage(name="one", end=Duration(15)),
        Stage(name="two", end=QuasiSteady(), limit=200, events=[DIVISION]),
        Stage(
            name="three", end=Duration(10), physics={"sigma": Attraction(default=0.5, sisters=0.1)}
        ),
    )  # fmt: skip
    whole = ran(chosen, tmp_path / "whole")
    ran(chosen, tmp_path / "parts", until)
    again = Simulation.from_run(tmp_path / "parts")
    again.run(observers=[RunWriter(tmp_path / "parts", 50, resume=True)])
    first, second = whole.checkpoint(), again.checkpoint()
    assert first.names == second.names == ["a", "b"]
    assert (first.steps, first.stage, first.physics) == (second.steps, second.stage, second.physics)
    for name, values in first.arrays.items():
        np.testing.assert_array_equal(values, second.arrays[name], err_msg=name)
    with open_run(tmp_path / "parts") as run:
        assert set(run["stage"].values) == {"", "one", "two", "three"}
    with pytest.raises(ValueError, match="daughter 'm' of 'a': a cell has or had this name"):
        again.divide("a", ("m", "c"), axis=(1, 0, 0))


def test_a_run_that_goes_on_can_go_back_to_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The minimum was at the last check before the save."""
    speeds = iter([5.0, 3.0, 2.0, 4.0])
    monkeypatch.setattr(
        "morphosim.simulation.stage_runner.root_mean_square", lambda _: next(speeds)
    )
    chosen = scene(Stage(name="q", end=QuasiSteady()))
    assert ran(chosen, tmp_path, until=36).time == 36
    again = Simulation.from_run(tmp_path)
    again.run()
    plain = Simulation(chosen)
    plain.step(15)
    assert again.time == plain.time == 30
    np.testing.assert_array_equal(again.fields[0].phi, plain.fields[0].phi)


def test_a_branch_from_within_the_stages(tmp_path: Path) -> None:
    chosen = scene(
        Stage(name="one", end=Duration(20)),
        Stage(name="two", end=Duration(40), events=[DIVISION], physics={"sigma": 0.3}),
    )
    ran(chosen, tmp_path)
    first = Simulation.from_run(tmp_path, time=20)
    assert (first.names, first.physics.attraction.default, first.scene.stages) == (["m"], 0, ())
    later = Simulation.from_run(tmp_path, time=60)
    assert (later.names, later.physics.attraction.default) == (["a", "b"], 0.3)
    assert [cell.parent for cell in later.cells] == ["m", "m"]
    assert [cell.type for cell in later.cells] == ["x", "x"]
    with open_run(tmp_path) as run:
        wanted = run["target_volume"].isel(time=-1).sel(cell=["a", "b"])
        np.testing.assert_allclose(later.targets, wanted)
    later.run(until=4)


def test_stages_in_a_scene_file(tmp_path: Path) -> None:
    sigma = Attraction(default=0.5, sisters=0.0, pairs={("a", "b"): 0.2})
    stages = (
        Stage(name="one", end=Duration(15.0), events=[Removal(cells=["n"])]),
        Stage(
            name="two", end=QuasiSteady(), limit=200.0, physics={"sigma": sigma, "g": 2.0},
            events=[
                Division(cell="m", daughters=("a", "b"), axis=[1.0, 0, 0], types=("x", "y")),
                Differentiation(of="x", touching="y", into="z", area=2.0),
                CellChange(cells=["a"], values={"gamma": 0.5}),
                PhysicsChange(values={"kappa": 0.1}),
            ],
        ),
        Stage(name="three", end=Steady(2e-4)),
    )  # fmt: skip
    save_scene(scene(*stages), tmp_path / "scene.toml")
    read = load_scene(tmp_path / "scene.toml").stages
    assert [stage.name for stage in read] == ["one", "two", "three"]
    assert [stage.end for stage in read] == [stage.end for stage in stages]
    assert read[1].physics == stages[1].physics
    division, *others = read[1].events
    assert (division.cell, division.daughters, list(division.types)) == (
        "m",
        ("a", "b"),
        ["x", "y"],
    )
    assert others == list(stages[1].events[1:])


def test_a_file_says_what_a_stage_resets(tmp_path: Path) -> None:
    reset = {"kappa_by_type": {}, "volume_constraint": "absolute", "M": None}
    chosen = scene(
        Stage(name="one", end=Duration(10), physics={"kappa_by_type": {"x": 0.2}}),
        Stage(name="two", end=Duration(10), physics=reset),
    )
    save_scene(chosen, tmp_path / "scene.toml")
    said = load_scene(tmp_path / "scene.toml").stages[1].physics
    assert said == reset | {"M": 0.0016}
    bare = scene(Stage(name="one", end=Duration(10), physics={"M": None}))
    with pytest.raises(ValueError, match="M = None cannot be written without volume_constraint"):
        save_scene(bare, tmp_path / "other.toml")


def test_a_stage_that_goes_back_keeps_changes_before(monkeypatch: pytest.MonkeyPatch) -> None:
    speeds = iter([5.0, 3.0, 2.0, 4.0])
    monkeypatch.setattr(
        "morphosim.simulation.stage_runner.root_mean_square", lambda _: next(speeds)
    )

    def course(time: float) -> float:
        return 500.0 + time

    cells = [Cell(name="m", shape=Sphere(center=(0, 0, 0), radius=5), type="x")]
    change = CellChange(cells=["m"], values={"type": "y", "volume": course})
    simulation = Simulation(scene(Stage(name="q", end=QuasiSteady(), events=[change]), cells=cells))
    simulation.run()
    assert simulation.time == 30
    assert simulation.cells[0].type == "y"
    assert simulation.targets[0] == 530


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ('end = {kind = "steady"}', "'name' is missing"),
        ('name = "s"\nend = {kind = "stedy"}', "did you mean 'steady'"),
        ('name = "s"\nend = {kind = "duration", time = -1}', "duration = -1"),
        ('name = "s"\nend = "steady"', "expected a table with a kind"),
        ('name = "s"\nend = {kind = "steady"}\nevents = [{kind = "fission"}]', "'fission'"),
        ('name = "s"\nend = {kind = "steady"}\nphysics = {gama = 1}', "'gamma'"),
    ],
)
def test_wrong_stages_in_a_file(tmp_path: Path, text: str, error: str) -> None:
    cell = '[[cells]]\nname = "m"\nshape = {kind = "sphere", center = [0, 0, 0], radius = 5}\n'
    (tmp_path / "scene.toml").write_text(f"{cell}[[stages]]\n{text}\n", encoding="utf-8")
    with pytest.raises(ValueError, match=error):
        load_scene(tmp_path / "scene.toml")


def test_what_a_file_cannot_say(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"stage 'w': .* cannot be written"):
        save_scene(scene(Stage(name="w", end=When(lambda s: True))), tmp_path / "scene.toml")


@pytest.mark.parametrize(
    ("physics", "error"),
    [
        ({"sigma": Attraction(pairs={("a", "c"): 0.5})}, "'c' is not known; allowed are 'm', 'a'"),
        ({"sigma": Attraction(types={("x", "z"): 0.5})}, "'z' is not known"),
        ({"kappa_by_type": {"z": 0.1}}, "'z' is not known"),
    ],
)
def test_physics_of_a_stage_name_cells_and_types_that_may_come(physics: dict, error: str) -> None:
    divides = Stage(name="one", end=Duration(10), events=[DIVISION])
    named = {"sigma": Attraction(pairs={("a", "b"): 0.5}, types={("x", "x"): 0.3})}
    for values in (named, {"kappa_by_type": {"x": 0.1}}):
        Simulation(scene(divides, Stage(name="two", end=Duration(10), physics=values)))
    wrong = scene(divides, Stage(name="two", end=Duration(10), physics=physics))
    with pytest.raises(ValueError, match=error):
        Simulation(wrong)


def test_stages_are_checked_when_made() -> None:
    with pytest.raises(TypeError, match="is no end"):
        Stage(name="s", end="steady")
    with pytest.raises(TypeError, match="is no event"):
        Stage(name="s", end=Steady(), events=["divide"])


def test_an_end_that_needs_no_speeds_measures_none(monkeypatch: pytest.MonkeyPatch) -> None:
    """The centroids of all cells cost a growing tissue a quarter of its time."""

    def fail(*_: object) -> None:
        raise AssertionError

    monkeypatch.setattr("morphosim.engine.cell_view.centroids", fail)
    ends = [Duration(20), When(lambda simulation: simulation.time >= 30)]
    stages = [Stage(name=str(k), end=end) for k, end in enumerate(ends)]
    simulation = Simulation(scene(*stages))
    simulation.run(until=40)
    assert simulation.stages_ended == 2
    with pytest.raises(AssertionError):
        Simulation(scene(Stage(name="q", end=Steady()))).run(until=12)


class Once:
    """Rule that does something once, at a time."""

    def __init__(self, time: float, event: Any) -> None:
        self.time, self.event = time, event

    def apply(self, simulation: Any) -> None:
        if simulation.time == self.time:
            self.event.apply(simulation)


def test_cells_that_are_all_new_have_no_speed() -> None:
    divides = Once(12.0, Division(cell="a", daughters=("b", "c"), axis=(1, 0, 0)))
    stage = Stage(name="s", end=Steady(1e-9), rules=[divides], rules_every=2.0, limit=40.0)
    cell = Cell(name="a", shape=Sphere(center=(0, 0, 0), radius=5))
    simulation = Simulation(
        Scene(cells=[cell], stages=[stage], duration=30.0, numerics=Numerics(threads=1))
    )
    simulation.run()
    assert simulation.names == ["b", "c"]
    speeds = simulation._stages.speeds  # at t = 10, 20 and 30
    assert np.isfinite(speeds).tolist() == [True, False, True]
