"""`benchmarks/compare.py`: its statistics, and the worker that it asks."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import _pairs
import numpy as np
import pytest

BENCHMARKS = Path(__file__).resolve().parents[1] / "benchmarks"


def test_ratios_are_taken_pair_by_pair() -> None:
    found = _pairs.paired_ratios([1, 2, 40, 4, 5], [2, 4, 80, 8, 15])
    assert found == {"before": 4, "after": 8, "ratio": 2, "low": 2, "high": 2}


def test_a_slow_spell_leaves_the_ratio_alone() -> None:
    spell = np.where(np.arange(40) < 15, 3.0, 1.0)
    noise = np.random.default_rng(0).normal(1, 0.01, (2, 40))
    found = _pairs.paired_ratios(spell * noise[0], 0.8 * spell * noise[1])
    assert found["ratio"] == pytest.approx(0.8, abs=0.01)
    assert found["low"] < found["ratio"] < found["high"]
    assert found["high"] - found["low"] < 0.03


@pytest.mark.parametrize(("before", "after"), [([], []), ([1.0], [1.0, 2.0])])
def test_series_that_are_not_pairs(before: list, after: list) -> None:
    with pytest.raises(ValueError, match="expected as many pairs"):
        _pairs.paired_ratios(before, after)


def test_fields_differ_by_what_lies_outside_of_a_box_too() -> None:
    field = np.full((4, 4, 4), 0.5, np.float32)
    field[0, 0, 0] = 0.75
    whole = np.array([2, 3, 4]), field
    cut = np.array([3, 3, 4]), field[1:]
    moved = np.array([1, 3, 4]), np.pad(field, ((1, 0), (0, 0), (0, 2)))
    assert _pairs.largest_difference({"a": whole}, {"a": whole}) == 0
    assert _pairs.largest_difference({"a": whole}, {"a": moved}) == 0
    assert _pairs.largest_difference({"a": whole, "b": whole}, {"a": cut, "b": whole}) == 0.75
    assert _pairs.largest_difference({}, {}) == 0


def test_fields_that_are_not_finite_differ() -> None:
    bad = np.zeros(3, int), np.full((2, 2, 2), np.nan)
    good = np.zeros(3, int), np.ones((2, 2, 2))
    assert np.isnan(_pairs.largest_difference({"a": good, "b": bad}, {"a": good, "b": good}))


def test_other_cells_are_refused() -> None:
    box = np.zeros(3, int), np.ones((2, 2, 2))
    with pytest.raises(ValueError, match="cells b are in one set"):
        _pairs.largest_difference({"a": box}, {"a": box, "b": box})


def asked(requests: list[dict[str, Any]]) -> list[Any]:
    """What a worker of this environment answers."""
    done = subprocess.run(
        [sys.executable, "-I", BENCHMARKS / "_compare_worker.py"], env=dict(os.environ),
        input="".join(f"{json.dumps(r)}\n" for r in requests), check=True,
        capture_output=True, text=True,
    )  # fmt: skip
    return [json.loads(line) for line in done.stdout.splitlines()]


def test_the_worker_steps_and_tells_the_bits(tmp_path: Path) -> None:
    start = {
        "do": "start", "points": [[0, 0, 0]], "radius": 4.0,
        "numerics": {"dt": 1.5, "solver": "dct", "threads": 1},
    }  # fmt: skip
    step, digest = {"do": "step", "steps": 2}, {"do": "digest"}
    save = {"do": "save", "path": str(tmp_path / "fields.npz")}
    found = asked(
        [start, digest, step, digest, save, {"do": "memory"}, start, digest, step, digest]
    )
    first, later, again, again_later = (found[k] for k in (1, 3, 7, 9))
    assert (first, later) == (again, again_later)
    assert first != later
    assert found[2] > 0
    with np.load(tmp_path / "fields.npz") as file:
        assert sorted(file.files) == ["origin c0", "phi c0"]
        assert file["phi c0"].max() == pytest.approx(1, abs=0.1)
