"""Scans on processes of this machine and on a cluster, stopped, killed and gone on with."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from morphosim import save_scene
from morphosim.cli import main
from morphosim.sweeps.axes import Range
from morphosim.sweeps.run import sweep
from morphosim.sweeps.scheduler import cluster_client, local_client, shares
from morphosim.sweeps.store import Store
from morphosim.sweeps.sweepfile import read_sweep

from .scenes import pair, plan, task

distributed = pytest.importorskip("distributed", reason="scans need Dask")
AXES = {"physics.sigma.default": [0.0, 0.5], "numerics.dt": [1.0, 2.0]}
FILE = """
scene = "pair.toml"
figures = ["volume", "contact_area"]
[axes]
physics.sigma.default = [0.0, 0.2, 0.4, 0.6]
numerics.dt = [0.5, 1.0]
[overrides]
duration = 60.0
"""
SHORT = {"duration": 60.0}
COMMAND = "from morphosim.cli import main; main()"


@pytest.fixture(scope="module")
def scan(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Directory of a finished scan on two processes."""
    directory = tmp_path_factory.mktemp("scan") / "here"
    sweep(pair(), AXES, directory=directory, workers=1, progress=False)
    return directory


def test_a_scan_is_one_dataset(scan: Path) -> None:
    with xr.open_dataset(scan / "sweep.nc") as result:
        assert result["volume"].dims == (*AXES, "cell")
        assert (result["error"] == "").all()
        touch = result["contact_area"].sel(cell="left", neighbour="right")
        assert (touch.sel({"physics.sigma.default": 0.5}) > touch[0].max()).all()


def test_what_is_finished_is_not_run_again(scan: Path) -> None:
    store = Store(scan)
    before = {k: store.member(k).stat().st_mtime_ns for k in range(4)}
    first = store.read(2)
    store.forget(2)
    result = sweep(pair(), AXES, directory=scan, workers=1, progress=False)
    after = {k: store.member(k).stat().st_mtime_ns for k in range(4)}
    assert [k for k in range(4) if after[k] != before[k]] == [2]
    np.testing.assert_array_equal(result["volume"].values[1, 0], first["volume"].values)


def test_another_scan_is_refused(scan: Path) -> None:
    with pytest.raises(ValueError, match=r"axes: numerics.dt is \[1.0, 2.0\] there"):
        sweep(pair(), AXES | {"numerics.dt": [1.0]}, directory=scan)
    with pytest.raises(ValueError, match="another scene"):
        sweep(pair(duration=30.0), AXES, directory=scan)


@pytest.mark.parametrize(
    ("axes", "options", "expected"),
    [
        ({"physics.gama": [1]}, {}, "axis 'physics.gama' = 1: key of physics"),
        ({"physics.gamma": [0.2, -1.0]}, {}, "axis 'physics.gamma' = -1.0"),
        ({"numerics.dt": [2.0, 1e3]}, {}, "axis 'numerics.dt' = 1000.0: numerics.dt = 1000 is too"),
        ({"duration": [20.0, 1e30]}, {}, "axis 'duration' = 1e+30: scene.duration = 1e+30 takes"),
        ({"numerics.dt": Range(low=-1, high=1)}, {"samples": 2}, "axis 'numerics.dt' = -"),
        ({"physics.gamma": [0.2]}, {"overrides": {"numerics.S": -1}}, "overrides: numerics.S"),
        ({"cell": [0.2]}, {}, "axis 'cell': a figure or a dimension"),
        ({"a/b": [0.2]}, {}, "name 'a/b' has a '/'"),
        ({"physics.gamma": [0.2]}, {"figures": {"error": "volume"}}, "figure 'error': the Dataset"),
        ({"physics.gamma": [0.2]}, {"overrides": {"numerics.threads": 2}}, "threads_per_member"),
        ({"physics.gamma": [0.2]}, {"replicates": 2}, "which nothing in this scene uses"),
        ({"physics.gamma": [0.2]}, {"keep": "runs"}, "needs a directory"),
        ({"physics.gamma": [0.2]}, {"keep": "all"}, "keep = 'all'"),
        ({"physics.gamma": [0.2]}, {"workers": 2, "address": "tcp://x:1"}, "has its own"),
        ({"physics.gamma": [0.2]}, {"workers": 10000}, "10000 workers"),
    ],
)
def test_wrong_choices_fail_before_the_first_member(
    axes: dict, options: dict, expected: str
) -> None:
    with pytest.raises(ValueError, match=r"\S") as caught:
        sweep(pair(), axes, **options)
    assert expected in str(caught.value)


def test_cores_are_shared_without_more_threads_than_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("morphosim.sweeps.scheduler.available_processors", lambda: 8)
    monkeypatch.setattr("numba.config.NUMBA_NUM_THREADS", 8)
    assert shares(100, None, None) == (8, 1)
    assert shares(2, None, None) == (2, 4)
    assert shares(100, None, 3) == (2, 3)
    assert shares(100, 2, None) == (2, 4)
    with pytest.raises(ValueError, match="more than the 8 cores"):
        shares(100, 3, 4)
    monkeypatch.setattr("numba.config.NUMBA_NUM_THREADS", 1)
    assert shares(2, None, None) == (2, 1)
    with pytest.raises(ValueError, match="threads_per_member = 4 is more than the 1 that Numba"):
        shares(2, None, 4)


def test_processes_import_nothing_from_a_folder_that_anyone_can_make(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", None)
    with local_client(1) as client:
        paths = [*sys.path, *client.submit(lambda: __import__("sys").path).result()]
    inside = [Path(path) for path in paths if path.startswith(str(tmp_path))]
    assert inside
    assert {path.relative_to(tmp_path).parts[0][:10] for path in inside} == {"morphosim-"}
    assert list(tmp_path.iterdir()) == [], "left there"


def test_without_dask_the_error_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(ImportError, match=r"pip install '\.\[sweep\]'"):
        sweep(pair(), AXES)


def test_replicates_on_a_cluster_by_its_address(tmp_path: Path) -> None:
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, protocol="tcp", dashboard_address=":0"
    ) as cluster:
        result = sweep(
            pair(duration=4.0), {"physics.kappa": [0.0, 0.5]}, figures=["centroid"], replicates=2,
            directory=tmp_path / "scan", address=cluster.scheduler_address, progress=False,
        )  # fmt: skip
    assert result.sizes["replicate"] == 2
    still, moving = result["centroid"].values
    np.testing.assert_array_equal(still[0], still[1])
    assert np.abs(moving[0] - moving[1]).max() > 1e-3


def test_workers_that_take_several_members_are_refused() -> None:
    with (
        distributed.LocalCluster(
            n_workers=1, threads_per_worker=2, processes=False, protocol="tcp",
            dashboard_address=":0",
        ) as cluster,
        pytest.raises(ValueError, match="--nthreads 1"),
        cluster_client(cluster.scheduler_address),
    ):  # fmt: skip
        pass


def test_a_worker_that_dies_leaves_its_error(tmp_path: Path) -> None:
    result = sweep(
        pair(duration=2.0), {"numerics.dt": [1.0]}, figures={"gone": lambda run: os._exit(1)},
        directory=tmp_path / "scan", progress=False,
    )  # fmt: skip
    assert "KilledWorker" in result["error"].item()
    assert Store(tmp_path / "scan").finished() == set()


def finished(directory: Path) -> dict[str, int]:
    """Results there are, with the time of their writing."""
    return {p.name: p.stat().st_mtime_ns for p in directory.glob("members/*.nc")}


def test_a_scan_that_is_killed_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.path", list(sys.path))
    save_scene(pair(), tmp_path / "pair.toml")
    file = tmp_path / "sweep.toml"
    file.write_text(FILE, encoding="utf-8")
    words = [sys.executable, "-c", COMMAND, "sweep", str(file), "-o"]
    process = subprocess.Popen([*words, str(tmp_path / "parts")], stderr=subprocess.DEVNULL)
    deadline = time.monotonic() + 240
    while len(finished(tmp_path / "parts")) < 2 and time.monotonic() < deadline:
        assert process.poll() is None
        time.sleep(0.05)
    process.send_signal(signal.SIGKILL)
    process.wait()
    kept = finished(tmp_path / "parts")
    assert 2 <= len(kept) < 8
    time.sleep(1)  # what the processes had under way ends with them
    kept = finished(tmp_path / "parts")
    out = subprocess.run(
        [*words, str(tmp_path / "parts")], check=True, capture_output=True, text=True
    )
    assert "8 members (physics.sigma.default 4 x numerics.dt 2)" in out.stdout
    assert kept.items() <= finished(tmp_path / "parts").items()
    alone = task(tmp_path / "parts", keep_runs=True)
    with xr.open_dataset(tmp_path / "parts" / "sweep.nc") as result:
        assert (result["error"] == "").all()
        for place, member in enumerate(plan(read_sweep(file)["axes"], fixed=SHORT).members):
            if place in (0, 7):
                alone(member)
                once = Store(tmp_path / "parts").read(place)["contact_area"]
                found = result["contact_area"].values.reshape(8, 2, 2)[place]
                np.testing.assert_array_equal(found, once)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("scene = 'single-cell'", "has no 'axes'"),
        ("scene = 'single-cell'\naxis = 1", "did you mean 'axes'"),
        ("scene = [", "is not a TOML file"),
        ("scene = 'single-cell'\n[axes]\nphysics.gamma = {low = 1.0}", "has no 'high'"),
        ("scene = 'single-cell'\n[axes]\nphysics.gamma = {values = [1], set = 2}", "'sets'"),
        ("scene = 'single-cel'\n[axes]\nphysics.gamma = [1]", "'single-cell'"),
        ("scene = 'single-cell'\n[axes]\nphysics.gama = [1]", "axis 'physics.gama' = 1"),
    ],
)
def test_a_wrong_file_is_one_line_and_exit_code_2(
    text: str, expected: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    (tmp_path / "sweep.toml").write_text(text, encoding="utf-8")
    words = ["morphosim", "sweep", str(tmp_path / "sweep.toml"), "-o", str(tmp_path / "scan")]
    monkeypatch.setattr("sys.argv", words)
    monkeypatch.setattr("sys.path", list(sys.path))
    with pytest.raises(SystemExit) as end:
        main()
    error = capsys.readouterr().err
    assert end.value.code == 2
    assert expected in error
    assert error.count("\n") == 1
    assert not (tmp_path / "scan").exists()


def test_a_file_says_what_python_says(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.path", list(sys.path))
    (tmp_path / "sweep.toml").write_text(
        FILE + '[axes.w]\nvalues = [1]\nsets = { "physics.g" = "{value}" }\n'
        '[axes."physics.tau"]\nlow = 1\nhigh = 2\nlog = true\n', encoding="utf-8",
    )  # fmt: skip
    found = read_sweep(tmp_path / "sweep.toml")
    assert found["scene"] == str(tmp_path / "pair.toml")
    assert found["axes"]["numerics.dt"] == [0.5, 1.0]
    assert found["axes"]["physics.tau"] == Range(low=1, high=2, log=True)
    assert found["axes"]["w"].sets == {"physics.g": "{value}"}
    assert found["overrides"] == SHORT
