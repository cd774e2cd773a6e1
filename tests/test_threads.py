"""How many threads a simulation has where nobody says it, and where somebody does."""

import math
import os
from pathlib import Path

import pytest

from morphosim import Cell, Numerics, Scene, Simulation, Sphere
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
