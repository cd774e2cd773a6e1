"""`morphosim bench`: its table, its JSON, and what it refuses."""

import json
import math
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from morphosim import Numerics, bench
from morphosim.cli import app, main

END = 8.0
RUN_PRESETS = bench.RUN_PRESETS


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Few cells, a small array, and one run of an embryo whose end is near."""
    copy, scene = bench.copy_bandwidth, bench.built_in_scene
    monkeypatch.setattr(bench, "CELLS", 3)
    monkeypatch.setattr(bench, "RUN_PRESETS", ("draft",))
    monkeypatch.setattr(bench, "copy_bandwidth", lambda threads: copy(threads, megabytes=8))
    monkeypatch.setattr(bench, "built_in_scene", lambda name: scene(name, {"duration": END}))


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
        "3 cells, band: 2 threads against 1: ", "celegans-8 to t = 8, preset draft: ",
        "3 cells, 6667 steps", "inferred), linearised: ",
        "93.8 min on a Tesla P100, 706.1 min on a Xeon CPU",
    ):  # fmt: skip
        assert expected in result.output
    found = json.loads(path.read_text(encoding="utf-8"))
    assert [(r["scene"], r["solver"], r["dt"], r["threads"]) for r in found["rows"]] == [
        (scene, solver, dt, threads)
        for scene, dt in (("3 cells", 1.5), ("celegans-8", 2.0))
        for solver in ("dct", "band", "linearised")
        for threads in (1, 2)
    ]
    assert found.pop("load at start") >= 0
    assert all(math.isfinite(n) and n > 0 for n in numbers(found))
    minutes = found["estimates"]["min"]
    assert list(minutes) == ["dct", "band", "linearised"]
    assert minutes["band"] == pytest.approx(6667 / 60e3 * found["rows"][3]["ms per step"])


@pytest.mark.usefixtures("small")
def test_whole_runs_of_presets_are_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    """To the end of the scene, in steps of their own; nothing is multiplied."""
    taken = []

    class Counted(bench.Simulation):
        def step_to(self, *args: Any) -> None:
            super().step_to(*args)
            taken.append((self.scene.numerics, self.steps, self.time))

    monkeypatch.setattr(bench, "Simulation", Counted)
    runs = [bench.whole_run(preset, 1) for preset in RUN_PRESETS]
    assert [run["preset"] for run in runs] == ["draft", "fast", "standard"]
    assert taken == [(Numerics.preset(run["preset"], threads=1), run["steps"], END) for run in runs]
    assert all(run["end"] == END and run["s"] > 0 for run in runs)


@pytest.mark.usefixtures("small")
def test_one_thread_is_compared_with_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bench, "BY_SOLVER", {"band": {"solver": "band"}})
    told: list[tuple[str, int, int]] = []
    result = bench.measure(0.1, 1, lambda *what: told.append(what))
    assert {row["threads"] for row in result["rows"] + result["runs"]} == {1}
    assert result["ratios"] == []
    assert "against 1" not in bench.text(result)
    assert told[0][0] == "building"
    last = {what: (done, of) for what, done, of in told}
    done, rounds = last["timing, round"]
    assert done == rounds >= bench.LEAST_ROUNDS
    assert told[-1] == ("celegans-8, preset draft, t", END, END)


def test_what_was_not_measured_is_not_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    row = {"scene": "100 cells", "solver": "band", "dt": 1.5, "threads": 1, "ms per step": 9.0}
    run = {"scene": "celegans-8", "preset": "fast", "end": 15000.0, "threads": 1, "steps": 1022,
           "s": 6.0}  # fmt: skip
    result = {
        "machine": {"cpu": "none"}, "load at start": 3.0, "copy, GB/s": {"1": 10.0},
        "rows": [row], "ratios": [], "runs": [run], "estimates": bench._estimates([row]),
    }  # fmt: skip
    monkeypatch.setattr(bench, "MEASURED", {"machine": None, "a": None})
    assert "developers" not in bench.text(result)
    monkeypatch.setattr(bench, "MEASURED", {"machine": "an abacus", "a": None, "b": 1.23456})
    shown = bench.text(result)
    assert shown.endswith("on the developers' machine:\n  machine: an abacus\n  b: 1.235")
    assert "other programs are running (load 3.0" in shown
    assert "celegans-8 to t = 15000, preset fast: 6 s on 1 thread (1022 steps)" in shown
    assert "inferred), band: 1.0 min on 1 thread" in shown


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
