"""Simulations: runs and observers, divergence, vanishing, targets, frozen cells, memory, import."""

import subprocess
import sys
import tracemalloc
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from morphosim import (
    Cell,
    CellVanishedError,
    DivergenceError,
    Numerics,
    Physics,
    Scene,
    Simulation,
    Sphere,
    VolumeCourse,
)

from .helpers import EXPECTED_TO_FAIL

ABSOLUTE = {"volume_constraint": "absolute", "c": 1.0}
"""With these a cell of R = 3 µm vanishes (paper, Fig. 3)."""
TOO_STRONG = {"M": 1e6}


def ball(name: str = "a", x: float = 0.0, radius: float = 3.0, **options: Any) -> Cell:
    return Cell(name=name, shape=Sphere(center=(x, 0, 0), radius=radius), **options)


def start(*cells: Cell, physics: dict | None = None, **options: Any) -> Simulation:
    """Simulation of some cells, one ball by default, with δt = 2."""
    model, numerics = Physics(**(physics or {})), Numerics(S=6.0, threads=1)
    scene = Scene(cells=cells or [ball()], physics=model, numerics=numerics, **options)
    return Simulation(scene)


class Recorder:
    """Observer that writes down what it is told, and may raise after a step."""

    def __init__(self, log: list, name: str = "", error: BaseException | None = None) -> None:
        self.log, self.name, self.error = log, name, error

    def start(self, simulation: Simulation) -> None:
        self.log.append((self.name + "start", simulation.time))

    def after_step(self, simulation: Simulation) -> None:
        self.log.append((self.name + "step", simulation.time))
        if self.error is not None and simulation.time >= 4:
            raise self.error

    def finish(self, simulation: Simulation) -> None:
        self.log.append((self.name + "finish", simulation.time))


def finishes(log: Sequence[tuple[str, float]]) -> list[tuple[str, float]]:
    return [entry for entry in log if "finish" in entry[0]]


# --- time and observers ------------------------------------------------------------------------


def test_steps_advance_time() -> None:
    simulation = start()
    assert simulation.time == 0
    simulation.step()
    simulation.step(3)
    assert simulation.time == 8


@pytest.mark.parametrize(("until", "time"), [(7, 8), (8, 8), (8.1, 10), (0, 0), (None, 6)])
def test_a_run_ends_at_the_first_step_that_reaches_its_end(until: Any, time: float) -> None:
    simulation = start(duration=6)
    simulation.run(until=until)
    assert simulation.time == time
    simulation.run(until=time - 4)  # in the past: nothing to do
    assert simulation.time == time


def test_steps_and_runs_give_the_same_fields() -> None:
    by_steps, by_runs = start(), start()
    by_steps.step(5)
    by_runs.run(until=4)
    by_runs.run(until=10)
    np.testing.assert_array_equal(by_steps.fields[0].phi, by_runs.fields[0].phi)


def test_a_long_run_counts_steps_without_rounding() -> None:
    simulation = start()
    simulation = Simulation(simulation.scene.with_numerics(dt=0.1))
    simulation.run(until=0.1 * 3)  # 0.30000000000000004
    assert simulation.engine.steps == 3


def test_state_is_that_of_the_start_shapes() -> None:
    simulation = start(ball("a"), ball("b", x=20, radius=4, volume=300.0))
    assert simulation.names == ["a", "b"]
    np.testing.assert_allclose(simulation.centroids, [(0, 0, 0), (20, 0, 0)], atol=1e-3)
    sums = [f.phi.sum(dtype=float) * 0.125 for f in simulation.fields]
    np.testing.assert_allclose(simulation.volumes, sums)
    np.testing.assert_allclose(simulation.targets, [36 * np.pi, 300])


def test_observers_are_told_of_all_steps() -> None:
    log: list = []
    start().run(until=4, observers=[Recorder(log, "1 "), Recorder(log, "2 ")])
    events = [("start", 0), ("step", 2), ("step", 4), ("finish", 4)]
    assert log == [(f"{k} {event}", time) for event, time in events for k in (1, 2)]


@pytest.mark.parametrize("error", [KeyboardInterrupt(), RuntimeError("full disk")])
def test_observers_are_told_of_the_end_when_one_raises(error: BaseException) -> None:
    log: list = []
    simulation = start()
    with pytest.raises(type(error)):
        simulation.run(until=20, observers=[Recorder(log, "1 ", error), Recorder(log, "2 ")])
    assert finishes(log) == [("1 finish", 4), ("2 finish", 4)]
    assert ("2 step", 4) not in log


@EXPECTED_TO_FAIL
def test_observers_are_told_of_the_end_when_a_run_fails() -> None:
    log: list = []
    simulation = start(physics=TOO_STRONG)
    with pytest.raises(DivergenceError):
        simulation.run(until=200, observers=[Recorder(log)])
    assert finishes(log) == [("finish", simulation.time)]


def test_observers_are_told_of_the_end_when_another_does_not_start() -> None:
    class Broken(Recorder):
        def start(self, simulation: Simulation) -> None:
            raise OSError

    log: list = []
    with pytest.raises(OSError):  # noqa: PT011
        start().run(until=4, observers=[Recorder(log), Broken(log)])
    assert ("finish", 0) in log


def test_observers_are_told_of_the_end_when_another_does_not_finish() -> None:
    class Broken(Recorder):
        def finish(self, simulation: Simulation) -> None:
            raise OSError

    log: list = []
    with pytest.raises(OSError):  # noqa: PT011
        start().run(until=4, observers=[Broken(log), Recorder(log)])
    assert ("finish", 4) in log


def test_a_run_goes_on_after_an_interruption() -> None:
    simulation, other = start(), start()
    with pytest.raises(KeyboardInterrupt):
        simulation.run(until=20, observers=[Recorder([], error=KeyboardInterrupt())])
    simulation.run(until=20)
    other.run(until=20)
    np.testing.assert_array_equal(simulation.fields[0].phi, other.fields[0].phi)


# --- divergence --------------------------------------------------------------------------------


@pytest.fixture
def diverged() -> tuple[Simulation, DivergenceError]:
    """Two cells of which the second, too far from its target volume, blows up."""
    cells = ball("calm"), ball("wild", x=7, volume=1e9)
    simulation = start(*cells, physics={"volume_constraint": "absolute", "M": 1e-6})
    with pytest.raises(DivergenceError) as caught:
        simulation.run(until=400)
    return simulation, caught.value


@EXPECTED_TO_FAIL
def test_divergence_names_time_cell_and_what_to_try(diverged: tuple) -> None:
    simulation, error = diverged
    assert (error.cell, error.time) == ("wild", simulation.time)
    step = simulation.engine.steps
    assert error.time == 2 * step
    words = "cell 'wild' diverged", f"t = {error.time:g}", f"step {step}", "numerics.dt (now 2)"
    for word in (*words, "numerics.S (now 6)", "scheme = 'imex1'"):
        assert word in str(error)


def test_fields_kept_after_divergence_are_the_last_finite_ones(diverged: tuple) -> None:
    simulation, _ = diverged
    for kept in simulation.fields:
        assert np.isfinite(kept.phi).all()
        assert np.abs(kept.phi).max() <= 4
    again = Simulation(simulation.scene)
    again.step(simulation.engine.steps - 1)
    np.testing.assert_array_equal(simulation.fields[1].phi, again.fields[1].phi)


def test_measures_after_divergence_are_those_of_the_kept_field(diverged: tuple) -> None:
    simulation, _ = diverged
    kept = [f.phi.sum(dtype=float) * 0.125 for f in simulation.fields]
    np.testing.assert_allclose(simulation.volumes, kept, rtol=1e-5)


@pytest.mark.parametrize("numerics", [{"dt": 1e5, "S": 0}, {"dt": 1e30, "S": 0}])
@EXPECTED_TO_FAIL
def test_a_huge_step_diverges_at_once_and_keeps_the_start(numerics: dict) -> None:
    simulation = Simulation(start().scene.with_numerics(**numerics))
    before = simulation.fields[0].phi.copy()
    with pytest.raises(DivergenceError) as caught:
        simulation.step()
    assert caught.value.time == numerics["dt"]
    np.testing.assert_array_equal(simulation.fields[0].phi, before)


# --- vanishing ---------------------------------------------------------------------------------


def test_a_vanishing_cell_stops_the_run() -> None:
    simulation = start(physics=ABSOLUTE)
    with pytest.raises(CellVanishedError, match=r"cell 'a' vanished at t = .*on_vanish") as caught:
        simulation.run(until=200)
    assert (caught.value.cell, caught.value.time) == ("a", simulation.time)
    assert 10 < simulation.time < 100
    assert simulation.fields[0].phi.max() < 0.5


@pytest.mark.parametrize(
    ("radius", "physics"),
    [
        (5.0, ABSOLUTE),  # large enough
        (3.0, {"volume_constraint": "relative", "c": 2.0}),  # the paper's two remedies
    ],
)
def test_a_larger_cell_or_the_relative_constraint_does_not_vanish(
    radius: float, physics: dict
) -> None:
    simulation = start(ball(radius=radius), physics=physics)
    simulation.run(until=200)
    assert simulation.fields[0].phi.max() > 0.9


def test_a_vanished_cell_is_removed_and_the_rest_goes_on() -> None:
    other = ball("b", 15, 5, gamma=0.5)
    simulation = start(ball("small"), other, physics=ABSOLUTE, on_vanish="remove")
    alone = start(other, physics=ABSOLUTE)
    simulation.run(until=200)
    alone.run(until=200)
    assert simulation.names == ["b"]
    assert len(simulation.engine) == len(simulation.fields) == len(simulation.targets) == 1
    ((time, name),) = simulation.removed
    assert name == "small"
    assert 10 < time < 100
    np.testing.assert_allclose(simulation.volumes, alone.volumes, rtol=1e-4)
    np.testing.assert_allclose(simulation.centroids, alone.centroids, atol=1e-3)


def test_a_vanished_cell_is_ignored() -> None:
    simulation = start(ball("small"), ball("b", 15, 5), physics=ABSOLUTE, on_vanish="ignore")
    simulation.run(until=200)
    assert simulation.names == ["small", "b"]
    assert simulation.removed == []
    assert abs(simulation.volumes[0]) < 1
    assert np.isfinite(simulation.fields[0].phi).all()


def test_the_last_cell_that_vanishes_ends_the_run() -> None:
    simulation = start(physics=ABSOLUTE, on_vanish="remove")
    with pytest.raises(CellVanishedError):
        simulation.run(until=200)


# --- targets and frozen cells ------------------------------------------------------------------


def test_a_volume_follows_its_course() -> None:
    course = VolumeCourse(times=[0, 100], volumes=[140, 200])
    simulation = start(ball(volume=course))
    simulation.run(until=50)
    assert simulation.targets[0] == 170
    middle = simulation.volumes[0]
    simulation.run(until=300)
    assert simulation.targets[0] == 200
    assert middle < simulation.volumes[0] - 20
    # 1 - v/V = 2 γ / (R M') balances pressure and surface tension.
    radius = np.cbrt(3 * 200 / (4 * np.pi))
    assert simulation.volumes[0] == pytest.approx(200 * (1 - 0.5 / (8 * radius)), rel=0.02)


def test_a_volume_function_is_asked_for_every_step() -> None:
    times: list[float] = []
    simulation = start(ball(volume=lambda t: times.append(t) or 120.0))
    times.clear()
    simulation.step(3)
    assert times == [0, 2, 4]


def test_a_frozen_cell_stays_and_is_felt_by_its_neighbour() -> None:
    free, held = start(ball("a", x=5)), start(ball("a", x=5), ball("wall", frozen=True))
    before = held.fields[1].phi.copy()
    for simulation in (free, held):
        simulation.step(20)
    np.testing.assert_array_equal(held.fields[1].phi, before)
    np.testing.assert_array_equal(held.fields[1].origin, start(ball()).fields[0].origin)
    assert free.centroids[0, 0] == pytest.approx(5, abs=1e-3)
    assert held.centroids[0, 0] > 5.05


def test_a_scene_of_frozen_cells_stands_still() -> None:
    simulation = start(ball(frozen=True))
    before = simulation.fields[0].phi.copy()
    simulation.step(3)
    np.testing.assert_array_equal(simulation.fields[0].phi, before)
    assert simulation.time == 6


# --- memory and import -------------------------------------------------------------------------


def test_cells_10_mm_apart_need_no_more_memory_than_cells_that_touch() -> None:
    close, apart = start(ball(), ball("b", x=5.5)), start(ball(), ball("b", x=1e4))
    for simulation in (close, apart):
        simulation.step(3)
    assert apart.engine.nbytes <= close.engine.nbytes
    np.testing.assert_allclose(apart.centroids[1], (1e4, 0, 0), atol=0.01)


def test_steps_do_not_take_more_and_more_memory() -> None:
    start(ball(), ball("b", x=5.5)).step(62)  # all kernels are compiled and loaded
    simulation = start(ball(), ball("b", x=5.5))
    simulation.step(40)
    before = simulation.engine.nbytes
    tracemalloc.start()
    try:
        simulation.step(2)
        first = tracemalloc.get_traced_memory()[0]
        simulation.step(20)
        grown = tracemalloc.get_traced_memory()[0] - first
    finally:
        tracemalloc.stop()
    assert simulation.engine.nbytes == before
    assert grown < 32_768  # one box has 100 kB


def python(code: str) -> str:
    """Output of a new Python process; its warnings are errors."""
    command = [sys.executable, "-W", "error", "-c", code]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()


def test_import_is_quick_and_loads_nothing_heavy() -> None:
    code = """
import sys, time
start = time.perf_counter()
import morphosim
print(time.perf_counter() - start < 1)
print([name for name in ("numba", "numpy", "scipy", "netCDF4", "xarray") if name in sys.modules])
"""
    assert python(code) == "True\n[]"


def test_public_names_load_when_used() -> None:
    code = """
import morphosim
for name in morphosim.__all__:
    assert getattr(morphosim, name) is not None, name
assert set(morphosim.__all__) == set(dir(morphosim)), dir(morphosim)
try:
    morphosim.Simulaton
except AttributeError as error:
    print(error)
"""
    assert "no attribute 'Simulaton'" in python(code)
