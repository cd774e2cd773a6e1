"""Command line, further cases: interruption, damaged files, texts as values, the entry point."""

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from morphosim import Simulation, load_scene, open_run
from morphosim.cli import main

from .helpers import ONE_CELL


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Working directory with a scene file of one cell."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "one.toml").write_text(ONE_CELL)
    return tmp_path


@pytest.fixture
def call(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    """Call the command line in this process: exit code, output, error output."""

    def of_words(*words: str) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["morphosim", *words])
        with pytest.raises(SystemExit) as end:
            main()
        captured = capsys.readouterr()
        return int(end.value.code or 0), captured.out, captured.err

    return of_words


def test_an_interruption_saves_and_says_so(call, monkeypatch: pytest.MonkeyPatch) -> None:
    step = Simulation._step

    def interrupted(self: Simulation, most: int) -> None:
        if self.time >= 6:
            raise KeyboardInterrupt
        step(self, most)

    monkeypatch.setattr(Simulation, "_step", interrupted)
    code, out, err = call("run", "one.toml", "-o", "run")
    assert code == 130
    assert "interrupted at t = 6; saved" in err
    assert "saved in run" in out
    assert "is not at its end: morphosim run --resume run" in call("info", "run")[1]
    with open_run("run") as data:
        assert data["time"].values.tolist() == [0, 4, 6]


def test_a_run_in_the_background_saves_at_sigterm(folder: Path) -> None:
    command = str(Path(sys.executable).with_name("morphosim"))
    words = [command, "run", "one.toml", "-o", "run", "--until", "1e7"]
    ignore = signal.signal(signal.SIGINT, signal.SIG_IGN)  # as a shell does for `command &`
    try:
        run = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    finally:
        signal.signal(signal.SIGINT, ignore)
    end = time.monotonic() + 240
    while not (folder / "run" / "save-000001.nc").exists() and time.monotonic() < end:
        time.sleep(0.05)
    run.terminate()
    out, err = run.communicate(timeout=240)
    assert run.returncode == 130
    assert "interrupted at t = " in err
    assert "saved in run" in out


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (["run", "one.toml", "-o", "one.toml/run"], "one.toml"),
        (["run", "one.toml", "-o", "r", "--threads", "999"], "numerics.threads = 999"),
        (["run", "one.toml", "-o", "r", "--set", 'confinement="box"'], "confinement = 'box'"),
        (["run", "one.toml", "-o", "r", "--set", "physics=3"], "physics = 3"),
        (["run", "one.toml", "-o", "r", "--set", "numerics.dt=fast"], "numerics.dt = 'fast'"),
        (["run", "one.toml", "-o", "r", "--until", "-1"], "scene.duration = -1"),
        (["run", ".", "-o", "r"], "scene.toml does not exist"),
        (["contacts", ".", "--json"], "holds no run"),
        (["info", "damaged"], "damaged"),
    ],
)
def test_wrong_input_is_one_line(call, folder: Path, words: list[str], named: str) -> None:
    (folder / "damaged").mkdir()
    (folder / "damaged" / "save-000000.nc").write_text("no netCDF")
    code, out, err = call(*words)
    assert code == 2
    assert out == ""
    assert err.startswith("error: ")
    assert err.count("\n") == 1
    assert named in err
    assert not (folder / "r").exists()


@pytest.mark.parametrize(
    "words", [["run", "one.toml"], ["run", "one.toml", "-o", "r", "--dt", "x"]]
)
def test_wrong_usage_has_exit_code_2_and_no_traceback(call, words: list[str]) -> None:
    code, _, err = call(*words)
    assert code == 2
    assert "Usage" in err
    assert "Traceback" not in err


def test_the_scene_of_a_run_says_what_was_set(call) -> None:
    words = ["--set", "name=a text", "--set", "physics.gamma=0.3", "--dt", "1", "--until", "2"]
    assert call("run", "one.toml", "-o", "run", *words)[0] == 0
    scene = load_scene("run/scene.toml")
    assert (scene.name, scene.physics.gamma) == ("a text", 0.3)
    assert (scene.numerics.dt, scene.duration) == (1, 2)


def test_one_cell_has_no_contacts(call) -> None:
    assert call("run", "one.toml", "-o", "run", "--until", "0")[0] == 0
    assert json.loads(call("contacts", "run", "--json")[1]) == {"time": 0, "contacts": []}


def test_the_entry_point_is_installed() -> None:
    command = [str(Path(sys.executable).with_name("morphosim")), "scenes"]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    assert "celegans-8-strong" in done.stdout


@pytest.mark.parametrize(
    ("words", "error"),
    [
        (["--until", "1e308", "--dt", "1e-10"], "scene.duration = 1e+308 is out of range"),
        (["--until", "1e20", "--dt", "1e-10"], "takes 1e+30 steps of numerics.dt = 1e-10"),
        (["--save-every", "1e-320"], "scene.save_every = 1e-320 is out of range"),
        (["--save-every", "1e-30"], "save_every = 1e-30 is far shorter than a step of numerics.dt"),
        (["--dt", "1000", "--until", "4000"], "numerics.dt = 1000 is too long for a run of 4000"),
        (["--dt", "1000", "--until", "4000", "--dry-run"], "numerics.dt = 1000 is too long for a"),
        (["--until", "1e30"], "scene.duration = 1e+30 takes 5e+29 steps of numerics.dt = 2"),
        (["--set", "numerics.spacing=1e-9"], "numerics.spacing = 1e-09 µm"),
        (["--set", "numerics.spacing=1e-5"], "GB of memory"),
        (["--set", f"numerics.seed={2**64}"], f"numerics.seed = {2**64} is not allowed"),
        (["--set", "stages=" + "[" * 3000], "stages = '[[["),
        (["--set", "duration=" + "9" * 5000], "scene.duration = '9999"),
        (["--set", "duration=1\ncells=[]"], "scene.duration = '1\\ncells=[]' is not a number"),
        (["--set", f"cells.{'9' * 5000}.name=b"], "key of a value to set = 'cells.9999"),
        (["--set", "cells.0.name=\x1b[31mred"], r"'\x1b[31mred' has a control character"),
        (["--set", "physics.sigma.types=[[[], {}, 1]]"], "sigma.types: [[], {}, 1]; expected"),
    ],
)
def test_a_value_that_cannot_be_ends_in_one_line(call, words: list[str], error: str) -> None:
    code, out, err = call("run", "one.toml", "-o", "run", *words)
    assert (code, out) == (2, "")
    assert err.startswith("error: ")
    assert error in err
    assert err.count("\n") == 1
    assert not Path("run").exists()


@pytest.mark.parametrize("seed", ["-1", "x", "1.5", str(2**64)])
def test_the_seed_of_a_random_scene_is_checked_before_it_is_made(call, seed: str) -> None:
    code, _, err = call("run", "synnotch-repair", "-o", "run", "--set", f"numerics.seed={seed}")
    assert code == 2
    assert err.startswith("error: numerics.seed = ")


def test_a_port_is_one(call) -> None:
    code, _, err = call("app", "--port", "99999", "--no-open")
    assert (code, err) == (
        2, "error: port = 99999 is not allowed: it must be >= 0 and <= 65535\n"
    )  # fmt: skip


@pytest.mark.parametrize(
    ("raised", "words"),
    [
        (MemoryError("3 TB"), "error: there is not enough memory (3 TB)"),
        (OverflowError("too\nlarge"), "error: OverflowError: too large. This comes from a value"),
        (KeyError("phi"), "error: KeyError: 'phi'. This comes from"),
        (RecursionError(), "error: RecursionError: "),
        (ValueError("two\nlines\x1b[2J"), "error: two lines\ufffd[2J\n"),
    ],
)
def test_what_nothing_has_checked_is_one_line_too(
    call, monkeypatch: pytest.MonkeyPatch, raised: Exception, words: str
) -> None:
    def fail(*args: object) -> None:
        raise raised

    monkeypatch.setattr(Simulation, "__post_init__", fail)
    code, _, err = call("run", "one.toml", "-o", "run")
    assert code == 2
    assert err.startswith(words)
    assert err.count("\n") == 1
    if not isinstance(raised, ValueError | MemoryError):
        assert "Traceback" in call("run", "one.toml", "-o", "run", "--verbose")[2]
