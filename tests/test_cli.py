"""The command line: what its commands do, and what they say when input is wrong."""

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from morphosim import Numerics, load_scene, open_run
from morphosim.cli import app, main, run_facts

from .helpers import EXPECTED_TO_FAIL

SCENE = """
duration = 20.0
save_every = 10.0
[physics]
sigma = 0.5
[numerics]
threads = 1
[[cells]]
name = "left"
shape = { kind = "sphere", center = [0, 0, 0], radius = 3.0 }
[[cells]]
name = "right"
shape = { kind = "sphere", center = [5.5, 0, 0], radius = 3.0 }
"""


def call(*words: object) -> str:
    result = CliRunner().invoke(app, [str(word) for word in words], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.output


@pytest.fixture(scope="module")
def run_directory(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of two cells that touch."""
    folder = tmp_path_factory.mktemp("cli")
    (folder / "pair.toml").write_text(SCENE, encoding="utf-8")
    out = call("run", folder / "pair.toml", "-o", folder / "run", "--set", "physics.gamma=0.3")
    assert "ms per step" in out
    assert "left" in out
    return folder / "run"


def test_scenes_are_listed() -> None:
    out = call("scenes")
    for name in ("single-cell", "celegans-8", "celegans-8-strong"):
        assert name in out


def test_info_tells_saves_and_cells(run_directory: Path) -> None:
    out = call("info", run_directory)
    assert "3 saves, t = 0 to 20" in out
    assert "right" in out
    assert "--resume" not in out


def test_info_lists_some_of_many_cells(
    run_directory: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run_facts, "MOST_LISTED", 1)
    *_, first, rest = call("info", run_directory).splitlines()
    assert first.startswith("left")
    assert rest == "... and 1 more: see morphosim export --to csv"


def test_contacts_as_table_and_as_json(run_directory: Path) -> None:
    assert "left" in call("contacts", run_directory)
    found = json.loads(call("contacts", run_directory, "--time", 10, "--json"))
    assert found["time"] == 10
    (pair,) = found["contacts"]
    assert pair["cells"] == ["left", "right"]
    assert pair["touching_voxels"] > 0
    assert 1 < pair["area_um2"] < 28


def test_contacts_of_a_run_without_fields_are_areas_alone(
    run_directory: Path, tmp_path: Path
) -> None:
    call("run", run_directory / "scene.toml", "-o", tmp_path, "--set", "save_fields=none")
    known = json.loads(call("contacts", run_directory, "--json"))
    (pair,) = json.loads(call("contacts", tmp_path, "--json"))["contacts"]
    assert pair == known["contacts"][0] | {"touching_voxels": None}
    head, line = call("contacts", tmp_path).splitlines()
    assert head == "t = 20: 1 pairs have contact area; what touches, saved fields tell"
    assert line.split()[:3] == ["left", "right", "?"]


def test_a_run_repeats_itself(run_directory: Path, tmp_path: Path) -> None:
    call("run", run_directory, "-o", tmp_path / "again")
    with open_run(run_directory) as first, open_run(tmp_path / "again") as second:
        assert (first["phi"].values == second["phi"].values).all()


def test_options_change_the_scene(run_directory: Path, tmp_path: Path) -> None:
    call(
        "run", run_directory, "-o", tmp_path / "run", "--until", 6, "--dt", 1, "--save-every", 2,
        "--threads", 1,
    )  # fmt: skip
    with open_run(tmp_path / "run") as data:
        assert data["time"].values.tolist() == [0, 2, 4, 6]
        assert data.attrs["dt"] == 1


def test_a_run_goes_on_from_where_it_stopped(run_directory: Path, tmp_path: Path) -> None:
    call("run", run_directory, "-o", tmp_path / "parts", "--until", 10)
    with open_run(tmp_path / "parts") as data:
        assert data.attrs["duration"] == 10
    call("run", "--resume", tmp_path / "parts", "--until", 20, "--threads", 1)
    with open_run(run_directory) as first, open_run(tmp_path / "parts") as second:
        assert second["time"].values.tolist() == [0, 10, 20]
        assert (first["phi"].values == second["phi"].values).all()
    assert load_scene(tmp_path / "parts" / "scene.toml").duration == 20


def test_a_run_goes_on_with_nothing_else_to_do(run_directory: Path) -> None:
    before = {p.name: p.read_bytes() for p in run_directory.glob("save-*.nc")}
    call("run", "--resume", run_directory)
    assert {p.name: p.read_bytes() for p in run_directory.glob("save-*.nc")} == before


def test_a_scene_starts_from_a_saved_run(run_directory: Path, tmp_path: Path) -> None:
    call(
        "run", run_directory, "-o", tmp_path / "weak", "--from", run_directory, "--time", 10,
        "--set", "physics.sigma=0.1", "--until", 4,
    )  # fmt: skip
    with open_run(run_directory) as first, open_run(tmp_path / "weak") as second:
        before = first.sel(time=10)["volume"].values
        np.testing.assert_allclose(second["volume"].values[0], before, rtol=1e-3)
    assert load_scene(tmp_path / "weak" / "scene.toml").physics.attraction.default == 0.1


def test_a_run_is_packed_into_one_file(run_directory: Path, tmp_path: Path) -> None:
    assert "MB" in call("pack", run_directory, tmp_path / "run.nc")
    with open_run(run_directory) as first, open_run(tmp_path / "run.nc") as second:
        assert (first["phi"].values == second["phi"].values).all()
    assert "3 saves, t = 0 to 20" in call("info", tmp_path / "run.nc")
    assert "left" in call("contacts", tmp_path / "run.nc")


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["run", "celegans-9", "-o", "run"], "'celegans-8'"),
        (["run", "no_such.toml", "-o", "run"], "does not exist"),
        (["run", "single-cell", "-o", "run", "--set", "physics.gama=1"], "'gamma'"),
        (["run", "single-cell", "-o", "run", "--set", "gamma"], "key=value"),
        (["run", "single-cell", "-o", "run", "--dt", "-1"], "numerics.dt = -1.0"),
        (["info", "nowhere"], "holds no run"),
        (["run", "single-cell", "-o", "run", "--time", "3"], "--from"),
        (["run", "--resume", "run", "--dt", "1"], "numerics.dt cannot change"),
        (["run", "single-cell", "--resume", "run"], "--until and --threads alone"),
        (["run", "--resume", "run"], "has no scene.toml"),
        (["run", "single-cell", "-o", "run", "--from", "nowhere"], "holds no run"),
        (["pack", "nowhere", "run.nc"], "holds no run"),
    ],
)
def test_wrong_input_is_one_line_and_exit_code_2(
    words: list[str], expected: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.argv", ["morphosim", *words])
    with pytest.raises(SystemExit) as end:
        main()
    error = capsys.readouterr().err
    assert end.value.code == 2
    assert error.startswith("error: ")
    assert expected in error
    assert error.count("\n") == 1


def test_a_directory_that_holds_a_run_is_refused(
    run_directory: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    before = {p.name: p.read_bytes() for p in run_directory.iterdir()}
    monkeypatch.setattr("sys.argv", ["morphosim", "run", "single-cell", "-o", str(run_directory)])
    with pytest.raises(SystemExit):
        main()
    assert "already holds a run" in capsys.readouterr().err
    assert {p.name: p.read_bytes() for p in run_directory.iterdir()} == before


@EXPECTED_TO_FAIL
def test_a_run_that_diverges_saves_and_says_so(run_directory: Path, tmp_path: Path) -> None:
    words = ["run", run_directory, "-o", tmp_path / "run", "--set", "numerics.S=0"]
    words += ["--set", "numerics.dt=10.0", "--until", "5000"]
    result = CliRunner().invoke(app, [str(word) for word in words])
    assert result.exit_code == 1
    assert "diverged" in result.output
    with open_run(tmp_path / "run") as data:
        assert data["time"].values[-1] > 0


def test_a_preset_is_chosen_on_the_command_line(tmp_path: Path) -> None:
    words = ["run", "single-cell", "-o", tmp_path, "--preset", "draft", "--until", "8"]
    assert CliRunner().invoke(app, [str(word) for word in words]).exit_code == 0
    assert load_scene(tmp_path / "scene.toml").numerics == Numerics.preset("draft")


def test_import_labels(tmp_path: Path) -> None:
    labels = np.zeros((30, 20, 20), np.uint8)
    labels[3:12, 5:15, 5:15], labels[12:21, 5:15, 5:15] = 1, 2
    np.save(tmp_path / "pair.npy", labels)
    result = CliRunner().invoke(
        app,
        ["import-labels", str(tmp_path / "pair.npy"), "-o", str(tmp_path / "scene"), "--spacing",
         "0.5", "0.5", "0.5", "--active", "cell2", "--shell", "--sigma", "0.5"],
    )  # fmt: skip
    assert result.exit_code == 0, result.output
    assert "2 cells, 1 of them frozen: cell1, cell2" in result.output
    scene = load_scene(tmp_path / "scene" / "scene.toml")
    assert [cell.frozen for cell in scene.cells] == [True, False]
    assert scene.confinement is not None
    assert scene.physics.attraction.default == 0.5
