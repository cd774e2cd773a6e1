"""Manners of the command line: what it prints where, what it replaces, what it tells beforehand."""

import io
import json
import os
import subprocess
import sys
from collections.abc import Callable
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import SimpleNamespace

import pytest
from numba.core import event

import morphosim
from morphosim import built_in_scene, load_scene, open_run, scene_names
from morphosim.cli import main
from morphosim.kernels import _jit
from morphosim.scene.fingerprint import settings
from morphosim.simulation.compilation import compilation_told

from .helpers import ONE_CELL

NAME = "зел-細胞"
DIVISION = """
[[stages]]
name = "one"
end = { kind = "duration", time = 4 }
[[stages]]
name = "two"
end = { kind = "duration", time = 4 }
events = [{ kind = "division", cell = "a", daughters = ["b", "c"], axis = [1, 0, 0] }]
"""
LINEAGE = """name,parent,volume_um3,axis_x,axis_y,axis_z,group
P0,,9000,1,0,0,1
AB,P0,5000,,,,
P1,P0,4000,,,,
"""
Call = Callable[..., tuple[int, str, str]]


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Working directory with scene files: of one cell, of one that divides, of one with a name."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "one.toml").write_text(ONE_CELL)
    (tmp_path / "two.toml").write_text(ONE_CELL.replace("radius = 3", "radius = 4") + DIVISION)
    (tmp_path / "named.toml").write_text(ONE_CELL.replace('"a"', f'"{NAME}"'), encoding="utf-8")
    return tmp_path


@pytest.fixture
def call(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Call:
    """Call the command line in this process: exit code, output, error output."""

    def of_words(*words: object) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["morphosim", *map(str, words)])
        with pytest.raises(SystemExit) as end:
            main()
        captured = capsys.readouterr()
        return int(end.value.code or 0), captured.out, captured.err

    return of_words


@pytest.fixture
def often(monkeypatch: pytest.MonkeyPatch) -> None:
    """Lines of progress come without waiting."""
    monkeypatch.setattr("morphosim.progress.FIRST", 0.0)
    monkeypatch.setattr("morphosim.progress.LONGEST", 0.0)


# --- what is printed ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("encoding", "expected"), [("ascii", "???-??"), ("cp1252", "???-??"), ("utf-8", NAME)]
)
def test_letters_that_a_console_lacks_are_replaced(
    encoding: str, expected: str, call: Call, monkeypatch: pytest.MonkeyPatch
) -> None:
    raw = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(raw, encoding=encoding))
    assert call("run", "named.toml", "-o", "run", "--until", 2)[0] == 0
    assert call("info", "run")[0] == 0
    assert raw.getvalue().decode(encoding).count(f"\n{expected}  ") == 2


def test_nobody_who_reads_on_is_no_error(call: Call, monkeypatch: pytest.MonkeyPatch) -> None:
    read, write = os.pipe()
    os.close(read)
    with os.fdopen(write, "w") as pipe:
        monkeypatch.setattr(sys, "stdout", pipe)
        assert call("run", "one.toml", "-o", "run", "--until", 2) == (0, "", "")
        assert call("scenes") == (0, "", "")
    with open_run("run") as data:
        assert data.attrs["finished"]


@pytest.mark.skipif(sys.platform != "linux", reason="the device is Linux's")
def test_a_full_disk_for_its_output_ends_no_run(
    call: Call, monkeypatch: pytest.MonkeyPatch
) -> None:
    for words, status in ((("run", "one.toml", "-o", "run", "--until", 2), 0), (("scenes",), 2)):
        with open("/dev/full", "w") as full:
            monkeypatch.setattr(sys, "stdout", full)
            status_now, _, told = call(*words)
            assert (status_now, "No space left" in told) == (status, status == 2)
            os.dup2(os.open(os.devnull, os.O_WRONLY), full.fileno())


@pytest.mark.parametrize("stream", [None, "closed", "full"])
def test_a_run_goes_on_without_standard_error(
    stream: str | None, often: None, call: Call, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Full(io.StringIO):
        def write(self, text: str) -> int:
            raise OSError(28, "No space left on device")

    streams = {None: None, "closed": io.StringIO(), "full": Full()}
    streams["closed"].close()
    monkeypatch.setattr(sys, "stderr", streams[stream])
    assert call("run", "one.toml", "-o", "run")[0] == 0


def test_names_of_others_do_nothing_to_a_terminal(call: Call) -> None:
    import netCDF4

    call("run", "one.toml", "-o", "run", "--until", 2)
    for file in Path("run").glob("save-*.nc"):
        with netCDF4.Dataset(file, "a") as data:
            data.title = "MorphoSim run of \x1b[2J\x9b31m"
    assert "\x1b" not in call("info", "run")[1]
    assert "\x9b" not in call("info", "run")[1]


def test_lines_now_and_then_without_a_terminal(often: None, call: Call) -> None:
    code, out, err = call("run", "one.toml", "-o", "run")
    lines = err.splitlines()
    assert code == 0
    assert lines[0] == "t = 2 of 8, 1 cell"
    assert lines[1].startswith("t = 4 of 8, 1 cell, ")
    assert lines[1].endswith(" s left")
    assert " steps/s, " in lines[1]
    assert "saved in run" in out


def test_lines_of_a_run_with_stages_tell_the_stage(often: None, call: Call) -> None:
    err = call("run", "two.toml", "-o", "run", "-v")[2]
    assert "t = 2, stage 'one' (1 of 2), 1 cell" in err
    assert "t = 8, stage 'two' (2 of 2), 2 cells" in err
    assert "t = 4: division of a into b and c\n" in err
    assert err.count("saved t = 8 in run") == 1


def test_the_time_left_follows_steps_that_grow() -> None:
    from morphosim import progress

    left = progress.Remaining(10.0)
    assert left.seconds(100.0) is None
    left.note(1.0, 12.0)
    assert left.seconds(100.0) == pytest.approx(44)
    for second in range(2, 100):  # ten times as fast from now on
        left.note(float(second), 12.0 + 20 * (second - 1))
    assert left.seconds(2972.0) == pytest.approx(50)
    assert len(left._marks) < 20


def test_lines_become_rarer(monkeypatch: pytest.MonkeyPatch) -> None:
    from morphosim import progress

    clock = SimpleNamespace(now=0.0)
    monkeypatch.setattr("time.monotonic", lambda: clock.now)
    pace, told = progress.Pace(), []
    for clock.now in range(4000):
        told += [clock.now] * pace.due()
    assert told == [10, 30, 70, 150, 310, 630, 1230, 1830, 2430, 3030, 3630]


def test_the_time_left_of_long_commands_follows_their_pace(
    often: None, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from morphosim import progress

    clock = SimpleNamespace(now=0.0)
    monkeypatch.setattr("time.monotonic", lambda: clock.now)
    with progress.progress_line() as tell:
        for clock.now, done in ((0.0, 0), (10.0, 10), (20.0, 1010), (30.0, 2010)):
            tell("embryo, t", done, 3010)
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == "embryo, t: 0 of 3010"
    assert lines[-1] == "embryo, t: 2010 of 3010, 10 s left"


def test_long_commands_tell_lines_too(often: None, call: Call) -> None:
    call("run", "one.toml", "-o", "run", "-q")
    assert "packing: " in call("pack", "run", "run.nc")[2]
    assert "export to csv: 3 of 3" in call("export", "run", "--to", "csv")[2]


def test_quiet_tells_nothing_but_errors(often: None, call: Call) -> None:
    assert call("run", "one.toml", "-o", "run", "-q") == (0, "", "")
    assert call("pack", "run", "run.nc", "--quiet") == (0, "", "")
    code, out, err = call("run", "one.toml", "-o", "run", "-q")
    assert (code, out) == (2, "")
    assert err.startswith("error: run already holds a run")
    assert "Traceback" not in err


def test_verbose_tells_where_an_error_arises(call: Call) -> None:
    err = call("info", "nowhere", "--verbose")[2]
    assert "Traceback" in err
    assert err.splitlines()[-1].startswith("error: ")
    assert call("info", "nowhere", "-v", "-q")[2].startswith("error: --quiet and --verbose exclude")


def test_version(call: Call) -> None:
    assert call("--version")[1] == f"morphosim {morphosim.__version__}\n"
    done = subprocess.run(
        [sys.executable, "-m", "morphosim", "--version"], capture_output=True, text=True,
        cwd=Path(morphosim.__file__).parents[1],
    )  # fmt: skip
    assert done.stdout == f"morphosim {morphosim.__version__}\n"


# --- what is compiled --------------------------------------------------------------------------


def test_what_is_compiled_is_told_and_what_is_loaded_is_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "made.py"
    file.write_text(
        "from morphosim.kernels._jit import kernel\n\n"
        "@kernel()\ndef double(x):\n    return 2 * x\n\n"
        "@kernel()\ndef triple(x):\n    return 3 * x\n"
    )

    def told() -> list[str]:
        texts: list[str] = []
        spec = spec_from_file_location("morphosim.kernels.made", file)
        module = module_from_spec(spec)
        spec.loader.exec_module(module)
        with compilation_told(texts.append):
            assert (module.double(2), module.triple(2)) == (4, 6)
        return texts

    for kept in (True, False):
        folder = tmp_path / str(kept)
        cache = _jit.Cache(str(folder), kept)
        monkeypatch.setattr(_jit, "CACHE", cache)
        monkeypatch.setattr("morphosim.simulation.compilation.CACHE", cache)
        (text,) = told()
        assert "20 to 60 s" in text
        assert ("later runs take them from " + str(folder) in text) == kept
        assert ("at every start" in text and "NUMBA_CACHE_DIR" in text) != kept
        assert told() == []
        assert not event._registered["numba:compile"]


# --- what is replaced --------------------------------------------------------------------------


def content(folder: Path) -> dict[str, bytes]:
    """All files below a folder."""
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


@pytest.mark.parametrize("name", ["scene.toml", "scene.npz", "shell.npz"])
def test_a_scene_written_by_hand_is_not_replaced(name: str, folder: Path, call: Call) -> None:
    Path("mine").mkdir()
    Path("mine", name).write_text("mine")
    Path("tree.csv").write_text(LINEAGE)
    before = content(folder)
    for words in (
        ["run", "one.toml", "-o", "mine"],
        ["import-lineage", "tree.csv", "-o", "mine", "--shell", 25, 17, 12],
        ["import-labels", "no.tif", "-o", "mine"],
        ["import-matlab", "no.mat", "--table", "no.csv", "-o", "mine"],
    ):
        code, out, err = call(*words)
        assert (code, out) == (2, "")
        assert err.startswith(f"error: mine/{name} exists and would be replaced")
        assert "--overwrite" in err
        assert err.count("\n") == 1
    assert content(folder) == before


def test_an_import_replaces_a_scene_if_asked_but_never_that_of_a_run(call: Call) -> None:
    words = ["import-lineage", "tree.csv", "-o", "run", "--shell", 25, 17, 12, "--overwrite"]
    Path("tree.csv").write_text(LINEAGE)
    Path("run").mkdir()
    Path("run/scene.toml").write_text("mine")
    assert call(*words)[0] == 0
    assert load_scene("run/scene.toml").cells[0].name == "P0"
    Path("run/scene.toml").unlink()
    call("run", "one.toml", "-o", "run", "--until", 2)
    code, _, err = call(*words)
    assert code == 2
    assert "already holds a run" in err


def test_overwriting_a_run_replaces_its_files_and_no_others(folder: Path, call: Call) -> None:
    call("run", "one.toml", "-o", "run")
    Path("run/notes.txt").write_text("mine")
    Path("run/save-of-mine.txt").write_text("mine")
    before = content(folder)
    assert call("run", "one.toml", "-o", "run", "--until", 4)[0] == 2
    assert content(folder) == before
    assert call("run", "one.toml", "-o", "run", "--until", 4, "--overwrite")[0] == 0
    with open_run("run") as data:
        assert data["time"].values.tolist() == [0, 4]
    assert Path("run/notes.txt").read_text() == Path("run/save-of-mine.txt").read_text() == "mine"
    assert load_scene("run/scene.toml").duration == 4


def test_overwriting_keeps_the_run_where_the_new_one_cannot_start(folder: Path, call: Call) -> None:
    call("run", "one.toml", "-o", "run", "--until", 4)
    before = content(folder)
    for words in (["--dt", -1], ["--threads", 999], ["--from", "run"]):
        assert call("run", "one.toml", "-o", "run", "--overwrite", *words)[0] == 2
        assert content(folder) == before
    assert call("run", "one.toml", "-o", "run", "--overwrite", "--dry-run")[0] == 0
    assert call("run", "--resume", "run", "--overwrite")[0] == 2
    assert content(folder) == before


@pytest.mark.parametrize("name", ["scene.toml", "save-000009.nc"])
def test_overwriting_deletes_nothing_where_a_directory_stands(name: str, call: Call) -> None:
    call("run", "one.toml", "-o", "run", "--until", 4)
    Path("run", name).unlink(missing_ok=True)
    Path("run", name).mkdir()
    before = sorted(Path("run").iterdir())
    status, _, told = call("run", "one.toml", "-o", "run", "--overwrite")
    assert (status, told.count("\n")) == (2, 1)
    assert f"{name} is a directory, which is not replaced" in told
    assert sorted(Path("run").iterdir()) == before


def test_files_that_exist_are_replaced_only_if_asked(folder: Path, call: Call) -> None:
    call("run", "one.toml", "-o", "run", "--until", 2)
    Path("run-csv").mkdir()
    taken = ["a.png", "a.gif", "view.html", "a.nc", "a.json", "a.toml", "run-csv/cells.csv"]
    for name in taken:
        Path(name).write_text("mine")
    before = content(folder)
    commands = [
        ["plot", "run", "-o", "a.png"], ["film", "run", "-o", "a.gif"], ["show", "run"],
        ["pack", "run", "a.nc"], ["bench", "--json", "a.json"],
        ["quality-control", "run", "--json", "a.json"],
        ["scenes", "--show", "single-cell", "-o", "a.toml"],
        ["export", "run", "--to", "csv"],
    ]  # fmt: skip
    for words in commands:
        code, out, err = call(*words)
        assert (code, out) == (2, ""), words
        assert "--overwrite" in err
        assert err.count("\n") == 1
        assert content(folder) == before
    assert "run is a directory" in call("pack", "run", "run", "--overwrite")[2]
    assert content(folder) == before
    for words in (commands[2], commands[3], *commands[6:]):
        assert call(*words, "--overwrite")[0] == 0, words
    replaced = {
        name for name, data in content(folder).items() if before.get(name) not in (None, data)
    }
    assert replaced == {"view.html", "a.nc", "a.toml", "run-csv/cells.csv"}


# --- what is told beforehand and afterwards ----------------------------------------------------


def test_a_dry_run_tells_what_would_run_and_writes_nothing(folder: Path, call: Call) -> None:
    before = content(folder)
    code, out, err = call(
        "run", "two.toml", "--dry-run", "--dt", 1, "-o", "run", "--set", "physics.gamma=0.3"
    )
    facts = dict(line.split(":", 1) for line in out.splitlines())
    told = {key: value.strip() for key, value in facts.items()}
    assert (code, err) == (0, "")
    assert content(folder) == before
    assert not Path("run").exists()
    assert told["cells"] == "1"
    assert "gamma 0.3" in told["physics"]
    assert told["numerics"] == "defaults, with dt 1; S = 2.44 (chosen)"
    assert told["steps"] == "8 of dt = 1, from t = 0 to 8"
    assert told["stage 2"] == "two: Division; until Duration (time 4)"
    assert told["saves"] == "about 5, every 4"
    assert told["stability"].startswith("S = 2.44 is chosen, ")
    assert "MB" in told["memory"]
    assert "kB" in told["disk"]


def test_a_dry_run_does_not_know_how_many_steps_a_tolerance_takes(folder: Path, call: Call) -> None:
    words = ["two.toml", "--dt", 1, "--tolerance", 5, "--save-every", 0.5]
    code, out, err = call("run", *words, "--dry-run")
    assert (code, err) == (0, "")
    assert "as many as the tolerance takes, of 0.015625 to 16 each, from t = 0 to 8" in out
    assert "tolerance 5" in out
    assert "about 19, every 0.5" in out
    assert call("run", *words, "-o", "controlled")[0] == 0
    code, out, _ = call("info", "controlled")
    assert "tolerance 5" in out
    with open_run("controlled") as run:
        assert run["time"].values.tolist() == [k / 2 for k in range(17)]


def test_a_dry_run_tells_what_may_diverge(call: Call) -> None:
    with pytest.warns(UserWarning, match="may diverge"):
        out = call("run", "celegans-8", "--dry-run", "--set", "numerics.S=0")[1]
    assert "numerics.S = 0 may diverge" in out


@pytest.mark.parametrize(
    "name", ["single-cell", "celegans-8", "celegans-1-to-8", "synnotch-symmetric"]
)
def test_a_built_in_scene_is_shown_as_a_file_that_says_the_same(name: str, call: Call) -> None:
    assert name in scene_names()
    assert call("scenes", "--show", name, "-o", "mine.toml")[0] == 0
    assert settings(load_scene("mine.toml")) == settings(built_in_scene(name))
    assert load_scene("mine.toml").names == built_in_scene(name).names
    assert call("scenes", "--show", name)[1] == Path("mine.toml").read_text(encoding="utf-8")


def test_a_scene_that_is_not_known_is_not_shown(call: Call) -> None:
    assert "'celegans-8'" in call("scenes", "--show", "celegans-9")[2]
    assert call("scenes", "-o", "mine.toml")[0] == 2


def test_info_of_a_run_with_stages(call: Call) -> None:
    call("run", "two.toml", "-o", "run", "--preset", "draft")
    out = call("info", "run")[1]
    assert "MorphoSim run of two" in out
    assert "physics: tau 2.62, gamma 0.25" in out
    assert "numerics: draft\n" in out
    assert "stage: two\n" in out
    assert "; written from " in out
    assert "\nfinished\n" in out
    assert "2 cells; 1 that were there before have divided or are gone" in out
    assert "nan" not in out
    assert [line.split()[0] for line in out.splitlines()[-2:]] == ["b", "c"]


def test_info_of_a_run_that_started_from_another(call: Call) -> None:
    call("run", "one.toml", "-o", "run")
    call("run", "one.toml", "-o", "more", "--from", "run", "--time", 4, "--until", 2)
    assert f"started from {Path('run').resolve()} at its t = 4\n" in call("info", "more")[1]


def test_info_advises_to_resume_only_what_can(call: Call, monkeypatch: pytest.MonkeyPatch) -> None:
    step = morphosim.Simulation._step

    def interrupted(self: morphosim.Simulation, most: int) -> None:
        if self.time >= 4:
            raise KeyboardInterrupt
        step(self, most)

    monkeypatch.setattr(morphosim.Simulation, "_step", interrupted)
    assert call("run", "one.toml", "-o", "run")[0] == 130
    assert "is not at its end: morphosim run --resume run\n" in call("info", "run")[1]
    call("pack", "run", "run.nc")
    out = call("info", "run.nc")[1]
    assert "is not at its end; it cannot go on" in out
    assert "--resume" not in out


def test_json_is_all_that_is_printed_where_it_is_asked_for(call: Call) -> None:
    call("run", "named.toml", "-o", "run", "--until", 2)
    assert json.loads(call("contacts", "run", "--json")[1])["contacts"] == []
