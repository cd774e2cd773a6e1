"""How many threads a simulation has where nobody says it, and where somebody does."""

import math
import os
from pathlib import Path

import numpy as np
import pytest

from morphosim import Cell, Numerics, Scene, Simulation, Sphere
from morphosim.engine.scheduling import LONG_ENOUGH, UNCOUNTED, ThreadCount
from morphosim.numerics import threads


@pytest.fixture(autouse=True)
def machine(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """Eight processors for Numba and for this process, without a control group."""
    monkeypatch.setattr("numba.config.NUMBA_NUM_THREADS", 8)
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: range(8), raising=False)
    monkeypatch.setattr(threads, "GROUPS", tmp_path)
    return tmp_path


@pytest.mark.parametrize(("numba_has", "expected"), [(1, 1), (3, 3), (8, 8), (64, 8)])
def test_automatic_is_what_numba_allows(
    numba_has: int, expected: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("numba.config.NUMBA_NUM_THREADS", numba_has)
    assert Numerics().worker_count == expected
    assert Numerics(threads=2).worker_count == 2


def test_automatic_is_what_the_affinity_allows(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {5}, raising=False)
    assert Numerics().worker_count == 1


@pytest.mark.parametrize(
    ("files", "expected"),
    [
        ({"cpu.max": "200000 100000\n"}, 2),
        ({"cpu.max": "50000 100000\n"}, 1),
        ({"cpu.max": "150000 100000\n"}, 2),
        ({"cpu.max": "max 100000\n"}, math.inf),
        ({"cpu.max": "9900000 100000\n"}, 99),
        ({"cpu/cpu.cfs_quota_us": "300000\n", "cpu/cpu.cfs_period_us": "100000\n"}, 3),
        ({"cpu/cpu.cfs_quota_us": "-1\n", "cpu/cpu.cfs_period_us": "100000\n"}, math.inf),
        ({"cpu.max": "nonsense"}, math.inf),
    ],
)
def test_automatic_is_what_a_container_allows(
    files: dict[str, str], expected: float, machine: Path
) -> None:
    for name, text in files.items():
        (machine / name).parent.mkdir(exist_ok=True)
        (machine / name).write_text(text)
    assert Numerics().worker_count == min(expected, 8)


def test_numba_must_have_a_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("numba.config.NUMBA_NUM_THREADS", 0)
    with pytest.raises(ValueError, match="NUMBA_NUM_THREADS = 0 allows no thread"):
        threads.automatic_threads()


def test_more_threads_than_numba_has_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("numba.config.NUMBA_NUM_THREADS", 1)
    ball = Cell(name="a", shape=Sphere(center=(0, 0, 0), radius=3))
    with pytest.raises(ValueError, match=r"^numerics.threads = 2 is more than the 1 that Numba"):
        Simulation(Scene(cells=[ball], numerics=Numerics(threads=2)))


def run_steps(count: ThreadCount, steps: int, seconds: dict[int, float]) -> list[int]:
    """Threads of each of so many steps, which take a time that depends on their number."""
    used = []
    for _ in range(steps):
        used.append(count.now)
        count.took(seconds[count.now])
    return used


def test_all_threads_work_where_that_is_faster() -> None:
    used = run_steps(ThreadCount(2), 4000, {1: 1.9, 2: 1.0})
    assert 4 <= used.count(1) < 0.01 * len(used)


def test_fewer_threads_work_where_more_do_not_pay_and_more_once_they_do() -> None:
    count = ThreadCount(2)
    assert run_steps(count, 100, {1: 1.0, 2: 1.5})[50:].count(2) <= 4
    assert run_steps(count, 4000, {1: 1.9, 2: 1.0})[-100:].count(1) <= 2


def test_number_of_threads_is_looked_for_step_by_step() -> None:
    seconds = {n: 1.0 + 0.2 * abs(n - 5) for n in range(1, 9)}
    assert set(run_steps(ThreadCount(8), 2000, seconds)[-500:]) <= {4, 5, 6}


def test_short_steps_are_tried_until_they_last_long_enough() -> None:
    used = run_steps(ThreadCount(2), 400, {1: 0.0019, 2: 0.001})
    first = used.index(1)
    assert used[first : first + 10].count(1) > UNCOUNTED + LONG_ENOUGH / 0.0019 - 1


def test_one_thread_stays_one() -> None:
    assert set(run_steps(ThreadCount(1), 500, {1: 1.0})) == {1}


def test_results_do_not_depend_on_how_many_threads_take_part() -> None:
    balls = [
        Cell(name=name, shape=Sphere(center=(x, 0, 0), radius=3))
        for name, x in (("a", -3.0), ("b", 3.0), ("c", 9.0))
    ]
    scene = Scene(cells=balls, numerics=Numerics(threads=1))
    alone, changing = Simulation(scene), Simulation(scene.with_numerics(threads=2))
    for k in range(6):
        changing.engine._threads.now = 1 + k % 2
        alone.step()
        changing.step()
    for one, other in zip(alone.fields, changing.fields, strict=True):
        assert np.array_equal(one.phi, other.phi)
