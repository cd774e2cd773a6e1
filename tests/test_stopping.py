"""What watches a run, and how it ends a run before its end: `Simulation.stop`."""

import sys
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from morphosim import (
    Cell,
    Division,
    Duration,
    Numerics,
    ProgressBar,
    RunWriter,
    Scene,
    Simulation,
    Sphere,
    Stage,
    When,
    open_run,
    save_scene,
)
from morphosim.cli import main

EXPECTED_STEPS = [(2.0, "egg"), (4.0, "egg"), (6.0, "two"), (8.0, "two")]


def scene(**options: Any) -> Scene:
    cell = Cell(name="P0", shape=Sphere(center=(0, 0, 0), radius=4))
    given = {"cells": [cell], "duration": 20.0, "save_every": 4.0} | options
    return Scene(**given, numerics=Numerics(threads=1, dt=2.0))


def staged(end: Any = None) -> Scene:
    division = Division(cell="P0", daughters=("AB", "P1"), axis=(-1, 0, 0))
    return scene(
        stages=[
            Stage(name="egg", end=end or Duration(time=4)),
            Stage(name="two", end=Duration(time=8), events=[division]),
        ]
    )


def stop_at(time: float, why: str = "enough") -> Any:
    """Observer that stops at a time."""

    def watch(simulation: Simulation) -> None:
        if simulation.time == time:
            simulation.stop(why)

    return watch


def final(directory: Path) -> tuple[float, dict[str, np.ndarray]]:
    with open_run(directory) as run:
        fields = {str(c): run.morpho.phi(c).values for c in run["cell"].values if c != "P0"}
        return float(run["time"][-1]), fields


# --- who watches -------------------------------------------------------------------------------


def test_a_function_is_called_after_every_step_and_not_at_the_start() -> None:
    told: list[tuple[float, str]] = []
    simulation = Simulation(staged())
    simulation.run(until=8, observers=[lambda s: told.append((s.time, s.stage))])
    assert told == EXPECTED_STEPS


def test_an_object_that_is_called_is_an_observer() -> None:
    class Counter:
        count = 0

        def __call__(self, simulation: Simulation) -> None:
            self.count += 1

    counter = Counter()
    Simulation(scene()).run(until=6, observers=(counter,))
    assert counter.count == 3


class OnlySteps:
    def after_step(self, simulation: Simulation) -> None: ...


@pytest.mark.parametrize(
    ("observers", "told"),
    [
        (3, "observers = 3 is not a list; put it into one"),
        (None, "observers = None is not a list"),
        (print, "observers = <built-in function print> is not a list; put it into one"),
        ("x", "observers = 'x' is not a list"),
        ([None], "observers[0] = None has no method 'start'; an observer is a function of the "),
        (
            [print, OnlySteps()],
            "has no method 'start'; an observer is a function of the simulation",
        ),
        ([RunWriter], "is a class; give an object of it, as RunWriter(...)"),
        ([lambda: 0], "takes (); it is called with 1 argument"),
    ],
)
def test_what_is_no_observer_is_named_before_the_first_step(observers: Any, told: str) -> None:
    simulation = Simulation(scene())
    with pytest.raises(TypeError) as caught:
        simulation.run(observers=observers)
    assert told in str(caught.value)
    assert "\n" not in str(caught.value)
    assert simulation.steps == 0


# --- stop --------------------------------------------------------------------------------------


@pytest.mark.parametrize("time", [4, 6])  # with a save, and between two
@pytest.mark.parametrize("before", [True, False])
def test_a_stopped_run_is_saved_and_says_why(time: float, before: bool, tmp_path: Path) -> None:
    writer, watch = RunWriter(tmp_path / "run", 4), stop_at(time)
    simulation = Simulation(scene())
    simulation.run(observers=[watch, writer] if before else [writer, watch])
    assert (simulation.time, simulation.stopped) == (time, "enough")
    assert simulation.events == [(time, "stop: enough")]
    with open_run(tmp_path / "run") as run:
        assert run["time"].values.tolist() == sorted({0, 4, time})
        assert run["events"].values[-1] == "stop: enough"
        assert [run.attrs[key] for key in ("stopped", "finished", "error")] == ["enough", 0, ""]


@pytest.mark.parametrize("time", [2, 4, 6, 10])  # in a stage, with the end of one, as one begins
def test_a_stopped_run_goes_on_to_the_same_end(time: float, tmp_path: Path) -> None:
    whole, parts = tmp_path / "whole", tmp_path / "parts"
    Simulation(staged()).run(observers=[RunWriter(whole, 4)])
    Simulation(staged()).run(observers=[RunWriter(parts, 4), stop_at(time)])
    assert final(parts)[0] == time
    simulation = Simulation.from_run(parts)
    simulation.run(observers=[RunWriter(parts, 4, resume=True)])
    assert (simulation.time, simulation.stopped, simulation.finished) == (12, "", True)
    (at, fields), (_, others) = final(parts), final(whole)
    assert (at, list(fields), list(others)) == (12, ["AB", "P1"], ["AB", "P1"])
    for name in fields:
        np.testing.assert_array_equal(fields[name], others[name])
    with open_run(parts) as run:
        assert run.attrs["stopped"] == ""
        events = "; ".join(run["events"].values)
    assert events.count("division of P0") == 1


class Halt:
    """Event that stops."""

    def apply(self, simulation: Simulation) -> None:
        simulation.stop("by an event")

    rehearse = apply


def _condition(simulation: Simulation) -> bool:
    if simulation.time >= 4:
        simulation.stop("by a condition")
    return False


def test_events_and_conditions_stop_after_the_present_step() -> None:
    by_event = Simulation(scene(stages=[Stage(name="a", end=Duration(time=8), events=[Halt()])]))
    by_event.run()
    assert (by_event.time, by_event.stopped, by_event.stages_ended) == (2, "by an event", 0)
    by_condition = Simulation(staged(end=When(condition=_condition)))
    by_condition.run()
    assert (by_condition.time, by_condition.stopped) == (10, "by a condition")
    assert by_condition.names == ["P0"]


def test_another_thread_stops() -> None:
    simulation = Simulation(scene(duration=2e4))
    begun = threading.Event()

    def watch(simulation: Simulation) -> None:
        begun.set()

    def wait_and_stop() -> None:
        begun.wait()
        simulation.stop("from outside")

    other = threading.Thread(target=wait_and_stop)
    other.start()
    simulation.run(observers=[watch])
    other.join()
    assert simulation.stopped == "from outside"
    assert not simulation.finished


def test_an_observer_may_stop_before_the_first_step(tmp_path: Path) -> None:
    class Refuses(OnlySteps):
        def start(self, simulation: Simulation) -> None:
            simulation.stop("not\ntoday")

        def finish(self, simulation: Simulation) -> None: ...

    simulation = Simulation(scene())
    simulation.run(observers=[RunWriter(tmp_path / "run", 4), Refuses()])
    assert (simulation.steps, simulation.stopped) == (0, "not today")
    with open_run(tmp_path / "run") as run:
        assert (run.sizes["time"], run.attrs["stopped"]) == (1, "not today")
    simulation.stop("nobody runs")  # is forgotten
    simulation.run(until=4)
    assert (simulation.time, simulation.stopped) == (4, "")


def test_the_first_reason_counts_and_all_observers_see_the_step() -> None:
    seen: list[float] = []
    simulation = Simulation(scene())
    observers = [stop_at(6, "first"), stop_at(6, "second"), lambda s: seen.append(s.time)]
    simulation.run(observers=observers)
    assert simulation.stopped == "first"
    assert seen == [2, 4, 6]


@pytest.mark.parametrize(
    ("why", "error"), [(None, TypeError), ("", ValueError), (" \n", ValueError)]
)
def test_a_stop_needs_a_reason(why: Any, error: type[Exception]) -> None:
    with pytest.raises(error, match=r"^why = "):
        Simulation(scene()).stop(why)


def test_stop_iteration_is_an_error_that_names_stop(tmp_path: Path) -> None:
    def ends(simulation: Simulation) -> None:
        raise StopIteration

    with pytest.raises(StopIteration) as caught:
        Simulation(scene()).run(observers=[RunWriter(tmp_path / "run", 4), ends])
    assert caught.value.__notes__ == ['to end a run, call simulation.stop("why")']
    assert final(tmp_path / "run")[0] == 2


# --- what users read ---------------------------------------------------------------------------

GUARD = """
from dataclasses import dataclass

@dataclass(frozen=True, kw_only=True)
class Guard:
    time: float
    every_step = True
    looks_back = False
    uses_speeds = False

    def reached(self, speeds, elapsed, simulation):
        if simulation.time == self.time:
            simulation.stop("the guard has seen enough")
        return elapsed >= 12
"""

STAGE = """
[[stages]]
name = "guarded"
end = { use = "guard.py:Guard", time = 6.0 }
"""


def test_the_command_line_says_why_and_how_to_go_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("guard.py").write_text(GUARD)
    save_scene(scene(), Path("scene.toml"))
    with Path("scene.toml").open("a") as file:
        file.write(STAGE)

    def call(*words: str) -> str:
        monkeypatch.setattr(sys, "argv", ["morphosim", *words])
        with pytest.raises(SystemExit) as end:
            main()
        assert not end.value.code
        return capsys.readouterr().out

    stopped = "stopped at t = 6: the guard has seen enough. Go on with: morphosim run --resume run"
    assert call("run", "scene.toml", "-o", "run").splitlines()[-1] == stopped
    assert stopped in call("info", "run").splitlines()
    assert call("run", "--resume", "run").splitlines()[-1] == "saved in run"
    assert "finished" in call("info", "run").splitlines()


def test_a_progress_bar_goes_to_the_end_of_the_run(capfd: pytest.CaptureFixture[str]) -> None:
    bar, given = ProgressBar(), ProgressBar(30)
    simulation = Simulation(scene())
    for until, end in ((8, 8), (None, 20)):
        simulation.run(until=until, observers=[bar, given])
        assert f"t = {end} of {end}, 1 cell" in bar._line(simulation)
        assert f"t = {end} of 30, 1 cell" in given._line(simulation)
