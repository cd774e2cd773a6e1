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

SCENE = """
duration = 8
save_every = 4
[numerics]
threads = 1
[[cells]]
name = "a"
shape = { kind = "sphere", center = [0, 0, 0], radius = 3 }
"""


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Working directory with a scene file of one cell."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "one.toml").write_text(SCENE)
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

    def interrupted(self: Simulation) -> None:
        if self.time >= 6:
            raise KeyboardInterrupt
        step(self)

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
    end = time.monotonic() + 120
    while not (folder / "run" / "save-000001.nc").exists() and time.monotonic() < end:
        time.sleep(0.05)
    run.terminate()
    out, err = run.communicate(timeout=60)
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
