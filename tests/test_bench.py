"""`morphosim bench`: its table, its JSON, and what it refuses."""

import json
import math
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from morphosim import bench
from morphosim.cli import app, main


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Few cells and a small array."""
    copy = bench.copy_bandwidth
    monkeypatch.setattr(bench, "CELLS", 3)
    monkeypatch.setattr(bench, "copy_bandwidth", lambda threads: copy(threads, megabytes=8))


def numbers(value: Any) -> list[float]:
    """All numbers in a result."""
    if isinstance(value, dict):
        value = list(value.values())
    if isinstance(value, list):
        return [number for item in value for number in numbers(item)]
    return [value] if isinstance(value, int | float) else []


@pytest.mark.usefixtures("small")
def test_table_and_json(tmp_path: Path) -> None:
    path = tmp_path / "new" / "bench.json"
    words = ["bench", "--seconds", "0.5", "--threads", "2", "--json", str(path)]
    result = CliRunner().invoke(app, words, catch_exceptions=False)
    assert result.exit_code == 0, result.output
    for expected in (
        "cpu: ", "GB/s on 1 thread", "GB/s on 2 threads", "us per cell and step", "MB per cell",
        "3 cells, fast: 2 threads against 1: ", "embryo to t = 15000, draft: ",
        "3 cells, 6667 steps", "93.8 min on a Tesla P100, 706.1 min on a Xeon CPU",
    ):  # fmt: skip
        assert expected in result.output
    found = json.loads(path.read_text(encoding="utf-8"))
    rows = found["rows"]
    assert [(r["scene"], r["preset"], r["threads"]) for r in rows] == [
        (scene, preset, threads)
        for scene, presets in (
            ("3 cells", ("standard", "fast")), ("celegans-8", ("draft", "fast", "standard")),
        )
        for preset in presets
        for threads in (1, 2)
    ]  # fmt: skip
    assert {(r["preset"], r["solver"]) for r in rows} >= {("standard", "dct"), ("fast", "band")}
    assert found.pop("load at start") >= 0
    assert all(math.isfinite(n) and n > 0 for n in numbers(found))
    seconds = found["estimates"]["embryo, s"]["standard"]
    assert seconds == pytest.approx(7.5 * rows[-1]["ms per step"])


@pytest.mark.usefixtures("small")
def test_one_thread_is_compared_with_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bench, "EMBRYO_PRESETS", ("draft",))
    told: list[tuple[str, int, int]] = []
    result = bench.measure(0.1, 1, lambda *what: told.append(what))
    assert {row["threads"] for row in result["rows"]} == {1}
    assert result["ratios"] == []
    assert "against 1" not in bench.text(result)
    assert told[0][0] == "building"
    last = told[-1]
    assert last[0] == "timing, round"
    assert last[1] == last[2] >= bench.LEAST_ROUNDS


def test_what_was_not_measured_is_not_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    row = {"scene": "celegans-8", "preset": "fast", "dt": 2.0, "threads": 1, "ms per step": 4.0}
    result = {
        "machine": {"cpu": "none"}, "load at start": 3.0, "copy, GB/s": {"1": 10.0},
        "rows": [row], "ratios": [], "estimates": bench._estimates([row]),
    }  # fmt: skip
    monkeypatch.setattr(bench, "MEASURED", {"machine": None, "a": None})
    assert "developers" not in bench.text(result)
    monkeypatch.setattr(bench, "MEASURED", {"machine": "an abacus", "a": None, "b": 1.23456})
    shown = bench.text(result)
    assert shown.endswith("on the developers' machine:\n  machine: an abacus\n  b: 1.235")
    assert "other programs are running (load 3.0" in shown
    assert "embryo to t = 15000, fast: 30 s on 1 thread" in shown


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["--seconds", "0"], "seconds = 0.0 is not allowed: it must be finite and > 0"),
        (["--seconds", "nan"], "seconds = nan is not allowed"),
        (["--threads", "-1"], "threads = -1 is not allowed"),
    ],
)
def test_wrong_input_is_one_line_and_exit_code_2(
    words: list[str], expected: str, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.setattr("sys.argv", ["morphosim", "bench", *words])
    with pytest.raises(SystemExit) as end:
        main()
    error = capsys.readouterr().err.strip()
    assert end.value.code == 2
    assert error.startswith("error: ")
    assert expected in error
    assert "\n" not in error


def test_it_is_loaded_by_the_command_alone() -> None:
    code = "import sys, morphosim.cli, morphosim; sys.exit('morphosim.bench' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code]).returncode == 0
