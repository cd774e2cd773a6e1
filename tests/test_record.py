"""`benchmarks/record.py`: what it appends to the history, what it refuses, and what is drawn."""

import json
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import _history
import pytest

BENCHMARKS = Path(__file__).resolve().parents[1] / "benchmarks"
STEP = """
import json, sys
from pathlib import Path
*options, _, path = sys.argv[1:]
machine = {"cpu": "one", "known to LLVM as": "it"}
row = {"scene": "pair", "threads": 1, "ms per step": 2.0, "MB per cell": 0.5}
Path(path).write_text(json.dumps({"machine": machine, "rows": [row], "told": options}))
"""
"""A benchmark that takes no time."""
Run = Callable[..., subprocess.CompletedProcess]


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """A repository with a package, a benchmark, and the scripts of the history."""
    for name in ("record.py", "_history.py", "_revisions.py"):
        (tmp_path / "benchmarks").mkdir(exist_ok=True)
        shutil.copy(BENCHMARKS / name, tmp_path / "benchmarks")
    (tmp_path / "benchmarks" / "step.py").write_text(STEP)
    (tmp_path / "morphosim").mkdir()
    (tmp_path / "morphosim" / "__init__.py").touch()
    (tmp_path / ".gitignore").write_text("__pycache__\n")
    git(tmp_path, "init", "--quiet")
    commit(tmp_path, "first")
    return tmp_path


def git(tree: Path, *words: str) -> str:
    who = ["-c", "user.name=a", "-c", "user.email=a@b", "-c", "commit.gpgsign=false"]
    done = subprocess.run(
        ["git", *who, *words], cwd=tree, check=True, stdout=subprocess.PIPE, text=True
    )
    return done.stdout.strip()


def commit(tree: Path, message: str) -> None:
    git(tree, "add", "--all")
    git(tree, "commit", "--quiet", "-m", message)


def record(tree: Path, *words: str) -> subprocess.CompletedProcess:
    """Run the script of a tree; the package is the tree's own."""
    program = (
        "import runpy, sys; sys.path[:0] = sys.argv[1:3]; sys.argv[:3] = ['record.py']; "
        "runpy.run_module('record', run_name='__main__')"
    )
    return subprocess.run(
        [sys.executable, "-I", "-c", program, tree, tree / "benchmarks", *words],
        capture_output=True, text=True, check=False,
    )  # fmt: skip


def recorded(tree: Path) -> list[dict[str, Any]]:
    files = sorted((tree / "benchmarks" / "history").glob("*.json"))
    return [json.loads(file.read_text(encoding="utf-8")) for file in files]


def test_a_run_is_appended_with_its_commit_and_machine(tree: Path) -> None:
    done = record(tree, "step", "--cells", "8")
    assert done.returncode == 0, done.stderr
    (entry,) = recorded(tree)
    assert entry["benchmark"] == "step"
    assert entry["options"] == entry["result"]["told"] == ["--cells", "8"]
    assert entry["commit"] == git(tree, "rev-parse", "HEAD")
    assert (entry["subject"], entry["uncommitted"]) == ("first", [])
    assert entry["result"]["machine"]["cpu"] == "one"
    assert entry["others"] is None or entry["others"] >= 0
    name = Path(done.stdout.strip()).name
    assert name.endswith(f"Z-{entry['commit'][:8]}-step.json")
    assert entry["measured"].replace("-", "").replace(":", "") == name.partition("-")[0]


def test_an_entry_that_is_not_committed_yet_lets_the_next_be_recorded(tree: Path) -> None:
    assert record(tree, "step", "--cells", "8").returncode == 0
    first = recorded(tree)
    (tree / "README.md").write_text("says something else, and is no faster")
    scaling = STEP.replace('"scene": "pair"', '"cells": 2, "solver": "dct"')
    (tree / "benchmarks" / "scaling.py").write_text(scaling)
    commit(tree, "second")
    assert record(tree, "scaling").returncode == 0
    assert len(recorded(tree)) == 2
    assert first[0] in recorded(tree)


@pytest.mark.parametrize("name", ["morphosim/new.py", "benchmarks/step.py"])
def test_what_is_not_committed_is_refused_unless_asked_for(tree: Path, name: str) -> None:
    (tree / name).write_text(STEP)
    (tree / "benchmarks" / "step.py").write_text(STEP + "# changed\n")
    refused = record(tree, "step")
    assert refused.returncode == 1
    assert refused.stderr.startswith("not committed: ")
    assert name in refused.stderr
    assert refused.stderr.count("\n") == 1
    assert recorded(tree) == []
    assert record(tree, "step", "--dirty").returncode == 0
    assert name in recorded(tree)[0]["uncommitted"]


def test_a_tree_that_changes_meanwhile_is_not_recorded(tree: Path) -> None:
    change = "Path(__file__).parent.joinpath('other.py').touch()\n"
    (tree / "benchmarks" / "step.py").write_text(STEP + change)
    commit(tree, "a benchmark that changes the tree")
    done = record(tree, "step")
    assert done.returncode == 1
    assert done.stderr == "nothing is recorded: the tree has changed while it was measured\n"
    assert recorded(tree) == []


def test_a_benchmark_that_fails_leaves_no_entry(tree: Path) -> None:
    (tree / "benchmarks" / "step.py").write_text("raise SystemExit(3)")
    commit(tree, "a benchmark that fails")
    assert record(tree, "step").returncode == 3
    assert recorded(tree) == []


def test_a_benchmark_without_its_figures_leaves_no_entry(tree: Path) -> None:
    (tree / "benchmarks" / "step.py").write_text(STEP.replace("ms per step", "s per step"))
    commit(tree, "a column has another name")
    done = record(tree, "step")
    assert done.returncode == 1
    assert done.stderr.endswith("-step: a row of rows lacks 'ms per step'\n")
    assert done.stderr.count("\n") == 1
    assert recorded(tree) == []


def test_what_is_no_repository_is_told_without_a_trace(tree: Path) -> None:
    shutil.rmtree(tree / ".git")
    done = record(tree, "step")
    assert done.returncode == 1
    assert "its error stands above" in done.stderr
    assert "Traceback" not in done.stderr


def test_a_package_from_elsewhere_is_refused(tree: Path) -> None:
    shutil.rmtree(tree / "morphosim")
    commit(tree, "without a package")
    done = record(tree, "step")
    assert done.returncode == 1
    assert done.stderr.startswith("the package that is installed is not this tree: ")


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ([], "name a benchmark, one of compare, step"),
        (["--cells", "8"], "invalid choice: '8'"),
        (["step", "--json", "x"], "the result is written to the history"),
        (["--draw", "--dirty"], "name a benchmark"),
    ],
)
def test_wrong_words(tree: Path, words: list[str], expected: str) -> None:
    done = record(tree, *words)
    assert done.returncode == 2
    assert expected in done.stderr
    assert recorded(tree) == []


def entry(number: int, benchmark: str, rows: list[dict], **others: Any) -> dict[str, Any]:
    """An entry of the commit of this number, measured as many days later."""
    machine = {"cpu": "one", "known to LLVM as": "it"}
    return {
        "benchmark": benchmark, "options": [], "uncommitted": [], "others": 0.0,
        "measured": f"2026-01-{number + 1:02d}T00:00:00Z", **revision(number),
        "result": {"machine": machine, "rows": rows},
    } | others  # fmt: skip


def revision(number: int) -> dict[str, str]:
    when = f"2026-01-{number:02d}T00:00:00+02:00"
    return {"commit": f"{number:040x}", "committed": when, "subject": "s"}


def compared(before: int, after: int, ratio: float, **others: Any) -> dict[str, Any]:
    """An entry of `compare`."""
    row = {
        "cells": 8, "solver": "band", "threads": 1, "after / before": ratio,
        "lower quartile": 0.9 * ratio, "upper quartile": 1.1 * ratio,
        "before, MB per cell": 2.0, "after, MB per cell": None,
    }  # fmt: skip
    made = entry(after, "compare", [row], **others)
    made["result"]["revisions"] = [revision(before), revision(after)]
    made["result"]["starts"] = []
    return made


def step(number: int, milliseconds: float, **others: Any) -> dict[str, Any]:
    row = {"scene": "pair", "threads": 2, "ms per step": milliseconds, "MB per cell": 1.0}
    return entry(number, "step", [row], **others)


def test_entries_are_never_overwritten(tmp_path: Path) -> None:
    one = step(1, 5.0)
    path = _history.append(tmp_path / "new", one)
    with pytest.raises(FileExistsError):
        _history.append(tmp_path / "new", one | {"options": ["--other"]})
    assert _history.entries(tmp_path / "new") == [one]
    lines = path.read_text(encoding="utf-8").splitlines()
    assert sum('"ms per step"' in line for line in lines) == 1
    assert len(lines) < 20


@pytest.mark.parametrize("text", ["{", "[]", '{"benchmark": "step"}'])
def test_a_file_that_is_no_entry_is_named(tmp_path: Path, text: str) -> None:
    (tmp_path / "bad.json").write_text(text)
    with pytest.raises(ValueError, match=r"bad\.json is no entry of the history"):
        _history.entries(tmp_path)


def test_ratios_of_pairs_are_multiplied_from_commit_to_commit() -> None:
    elsewhere = compared(2, 3, 0.25)
    elsewhere["result"]["machine"] = {"cpu": "another"}
    (course,), unknown = _history.courses([compared(1, 2, 0.5), elsewhere, compared(1, 4, 2.0)])
    assert unknown == []
    assert (course.what, course.label) == ("time of a step", "8 cells, band, 1 thread")
    assert [int(point.commit, 16) for point in course.points] == [1, 2, 3, 4]
    assert [point.ratio for point in course.points] == [1, 0.5, 0.125, 2]
    last = course.points[-1]
    assert (last.low, last.high) == pytest.approx((1.8, 2.2))


def test_memory_of_few_cells_is_not_followed() -> None:
    pair = compared(1, 2, 0.5)
    (row,) = pair["result"]["rows"]
    sizes = [(8, 9.0), (100, 1.0)]
    pair["result"]["rows"] = [row | {"cells": n, "after, MB per cell": mb} for n, mb in sizes]
    found, _ = _history.courses([pair])
    (course,) = (course for course in found if course.what == "memory per cell")
    assert course.label == "100 cells, band, 1 thread"
    assert [point.ratio for point in course.points] == [1, 0.5]


def test_a_pair_of_unknown_commits_is_told() -> None:
    lost = compared(5, 6, 0.5)
    (course,), unknown = _history.courses([compared(1, 2, 0.5), lost])
    assert unknown == [_history.name(lost)]
    assert len(course.points) == 2


def test_figures_are_compared_on_like_machines_with_like_options() -> None:
    other = step(3, 8.0)
    other["result"]["machine"]["cpu"] = "two"
    measured = [
        step(1, 4.0), step(2, 2.0), other, step(4, 9.0, options=["--cells", "9"]),
        step(5, 1.0, uncommitted=["kernels/step.py"]), step(6, 1.0, others=1.7),
    ]  # fmt: skip
    times = [c for c in _history.courses(measured)[0] if c.what == "time of a step"]
    assert [[p.ratio for p in course.points] for course in times] == [[1, 0.5], [1], [1]]
    assert [_history.went_on(course) for course in times] == [True, False, False]


def test_of_a_busy_machine_only_ratios_of_pairs_are_drawn() -> None:
    measured = [
        step(1, 4.0, others=0.2), step(2, 2.0, others=0.1), step(3, 1.0, others=None),
        compared(1, 2, 0.5, others=1.9),
    ]  # fmt: skip
    single, _, pair = _history.courses(measured)[0]
    assert [(int(p.commit, 16), p.ratio, p.busy) for p in single.points] == [
        (2, 1, False), (3, 0.5, False)
    ]  # fmt: skip
    assert [point.busy for point in pair.points] == [True, True]


def test_commits_stand_in_the_order_in_which_they_were_made() -> None:
    found = _history.commits([step(4, 1.0), compared(3, 1, 1.0), step(2, 1.0)])
    assert [int(commit, 16) for commit in found] == [1, 2, 3, 4]


def test_the_history_can_be_drawn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import _pictures

    figures = []
    monkeypatch.setattr(_pictures.plt, "close", figures.append)
    measured = [compared(1, 2, 0.5, others=1.0), step(2, 4.0), step(3, 2.0)]
    drawn = [course for course in _history.courses(measured)[0] if _history.went_on(course)]
    _pictures.history_picture(drawn, _history.commits(measured), tmp_path / "history.png")
    assert (tmp_path / "history.png").stat().st_size > 10_000
    (figure,) = figures
    titles = [axes.get_title(loc="left") for axes in figure.axes]
    assert titles == [
        "time of a step (compare)", "time of a step (step)", "memory per cell (step)"
    ]  # fmt: skip
    for axes, ratios in zip(figure.axes, ([1, 0.5], [1, 0.5], [1, 1]), strict=True):
        assert axes.get_yscale() == "log"
        assert list(axes.lines[0].get_ydata()) == ratios


def test_what_is_in_the_history_has_the_figures_that_are_followed() -> None:
    kept = _history.entries(BENCHMARKS / "history")
    assert {entry["benchmark"] for entry in kept} >= {"compare"}
    found, unknown = _history.courses(kept)
    assert unknown == []
    assert any(_history.went_on(course) for course in found)
    for figure in {figure for entry in kept for figure in _history.FIGURES[entry["benchmark"]]}:
        assert any(course.what == figure.what for course in found), figure
