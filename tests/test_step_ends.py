"""Where steps end whose lengths follow from a tolerance: at saves, checks, rules and ends."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from morphosim import (
    Cell,
    Duration,
    Numerics,
    QuasiSteady,
    RunWriter,
    Scene,
    Simulation,
    Sphere,
    Stage,
    When,
    open_run,
)
from morphosim.engine.engine import Engine

STEP = 1000


@pytest.fixture(autouse=True)
def _long_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    """Steps of `STEP` ticks, or of as many as are allowed; cells stand still."""

    def step(engine: Engine, most: int) -> None:
        engine.aim(engine.time)
        engine.ticks += min(most, STEP)
        engine.steps += 1

    monkeypatch.setattr(Engine, "step", step)


def scene(**options: Any) -> Scene:
    cell = Cell(name="a", shape=Sphere(center=(0, 0, 0), radius=4))
    numerics = Numerics(threads=1, tolerance=5.0)
    return Scene(**({"cells": [cell], "numerics": numerics, "duration": 1e3} | options))


def ends(simulation: Simulation, *observers: Any, until: float | None = None) -> list[float]:
    """Times at which steps end."""
    found: list[float] = []
    simulation.run(until=until, observers=[*observers, lambda s: found.append(s.time)])
    return found


def test_steps_that_nothing_waits_for_are_as_long_as_they_can_be() -> None:
    simulation = Simulation(scene(duration=70.0))
    assert ends(simulation) == [31.25, 62.5, 70.0]
    assert (simulation.steps, simulation.ticks, simulation.tick) == (3, 70 * 32, 1 / 32)
    assert simulation.finished


def test_a_run_in_two_parts_goes_through_all_ends_of_both() -> None:
    simulation = Simulation(scene(duration=70.0))
    assert [*ends(simulation, until=40), *ends(simulation)] == [31.25, 40, 70]


def test_saves_are_made_at_their_times_and_speeds_measured_over_the_last_ten(
    tmp_path: Path,
) -> None:
    simulation = Simulation(scene(duration=45.0))
    assert ends(simulation, RunWriter(tmp_path, 19.9)) == [9.90625, 19.90625, 29.8125, 39.8125, 45]
    with open_run(tmp_path) as run:
        assert run["time"].values.tolist() == [0, 19.90625, 39.8125, 45]
        assert run["step"].values.tolist() == [0, 2, 4, 5]


def test_an_observer_is_told_at_the_times_that_it_names() -> None:
    class Waits:
        said = iter([3.0, 3.0, None, 50.0, 50.0, 50.0, 1e6, 1e6])

        def start(self, simulation: Simulation) -> None: ...

        def next_time(self, simulation: Simulation) -> float | None:
            return next(self.said)

        def after_step(self, simulation: Simulation) -> None: ...

        def finish(self, simulation: Simulation) -> None: ...

    found = ends(Simulation(scene(duration=100.0)), Waits())
    assert found == [3.0, 3.03125, 34.28125, 50.0, 50.03125, 50.0625, 81.3125, 100.0]


def test_a_time_that_is_none_is_refused() -> None:
    class Waits:
        def start(self, simulation: Simulation) -> None: ...

        def next_time(self, simulation: Simulation) -> float:
            return float("nan")

        def after_step(self, simulation: Simulation) -> None: ...

        def finish(self, simulation: Simulation) -> None: ...

    with pytest.raises(ValueError, match="next_time of Waits = nan is not allowed"):
        Simulation(scene()).run(observers=[Waits()])


class Applied:
    """A rule that notes when it is applied."""

    def __init__(self) -> None:
        self.times: list[float] = []

    def apply(self, simulation: Simulation) -> None:
        """Note the time."""
        self.times.append(simulation.time)

    def rehearse(self, rehearsal: Any) -> None:
        """Nothing to tell."""


def test_stages_end_and_rules_are_applied_at_their_times() -> None:
    rule = Applied()
    stages = [
        Stage(name="one", end=Duration(43.3), rules=[rule], rules_every=20.0),
        Stage(name="two", end=When(lambda _: False), limit=25.0),
        Stage(name="three", end=Duration(100.0), limit=40.0),
    ]
    simulation = Simulation(scene(stages=stages))
    first = [20, 40, 43.3125]
    second = [first[-1] + t for t in (10, 20, 25)]
    assert ends(simulation) == [*first, *second, second[-1] + 31.25, second[-1] + 40]
    assert rule.times == [0, 20, 40]


def test_ends_that_look_at_speeds_look_every_ten(monkeypatch: pytest.MonkeyPatch) -> None:
    speeds = iter([5.0, 3.0, 2.0, 4.0])
    monkeypatch.setattr(
        "morphosim.simulation.stage_runner.root_mean_square", lambda _: next(speeds)
    )
    simulation = Simulation(scene(stages=[Stage(name="q", end=QuasiSteady())]))
    assert ends(simulation) == [10, 20, 30, 30]  # at 40 it goes back
    assert (simulation.time, simulation.steps) == (30, 3)


@pytest.mark.parametrize("dt", [2.0, 0.3, 1 / 3])
@pytest.mark.parametrize("ticks", [1, 7, 12345, 10**7 + 1, 10**9 + 1])
def test_a_tick_is_found_by_its_time(dt: float, ticks: int) -> None:
    for numerics in (Numerics(dt=dt), Numerics(dt=dt, tolerance=1.0)):
        assert numerics.ticks_to(ticks * numerics.tick) == ticks


def test_a_run_goes_on_from_between_two_multiples_of_dt(tmp_path: Path) -> None:
    simulation = Simulation(scene(duration=45.0))
    simulation.run(until=31.25, observers=[RunWriter(tmp_path, 40)])
    again = Simulation.from_run(tmp_path)
    assert (again.time, again.ticks, again.steps) == (31.25, 1000, 2)
    assert ends(again, RunWriter(tmp_path, 40, resume=True)) == [40, 45]
    with open_run(tmp_path) as run:
        assert run["time"].values.tolist() == [0, 31.25, 40, 45]
        assert np.isfinite(run["speed"].values[1:]).all()
