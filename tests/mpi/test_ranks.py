"""Scenes over 1, 2 and 4 ranks against the same on none."""

import importlib.util
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

from morphosim import (
    Cell,
    Numerics,
    Physics,
    Scene,
    Sphere,
    open_run,
    save_scene,
)

DRIVE = Path(__file__).with_name("drive.py")
SCENES = ["moving", "staged", "controlled", "growing", "vanishing", "stopping"]
RANKS = [1, 2, 4]
pytestmark = [
    pytest.mark.skipif(shutil.which("mpirun") is None, reason="mpirun is not installed"),
    pytest.mark.skipif(
        importlib.util.find_spec("mpi4py") is None, reason="mpi4py is not installed"
    ),
]


def launch(ranks: int, *command: str | Path) -> "subprocess.CompletedProcess[str]":
    """Run Python on so many ranks."""
    start = ["mpirun", "--oversubscribe", "--allow-run-as-root", "-n", str(ranks)]
    environment = os.environ | {"OMPI_MCA_mpi_yield_when_idle": "1"}
    return subprocess.run(
        [*start, sys.executable, *map(str, command)], capture_output=True, text=True, timeout=240,
        env=environment, check=False,
    )  # fmt: skip


@pytest.fixture(scope="module")
def alone(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Results of `Simulation`."""
    folder = tmp_path_factory.mktemp("alone")
    subprocess.run([sys.executable, DRIVE, folder, "--alone"], check=True, timeout=240)
    return folder


@pytest.fixture(scope="module", params=RANKS)
def over(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Results over some ranks."""
    folder = tmp_path_factory.mktemp(f"ranks{request.param}")
    done = launch(request.param, DRIVE, folder)
    assert done.returncode == 0, done.stderr
    return folder


def ranks(folder: Path) -> list[dict[str, Any]]:
    return list(json.loads((folder / "ranks.json").read_text()))


@pytest.mark.parametrize("scene", SCENES)
def test_same_state_as_on_one_rank(scene: str, alone: Path, over: Path) -> None:
    with np.load(alone / f"{scene}.npz") as expected, np.load(over / f"{scene}.npz") as found:
        assert set(found.files) == set(expected.files)
        for name in expected.files:
            if expected[name].dtype.kind == "f":
                np.testing.assert_allclose(found[name], expected[name], rtol=0, atol=1e-6)
            else:
                np.testing.assert_array_equal(found[name], expected[name])
        for name in set(expected.files) & {"phi", "heading", "polarity"}:
            np.testing.assert_array_equal(found[name], expected[name])
        assert scene != "growing" or {"born", "generation", "polarity"} <= set(expected.files)
    assert scene != "staged" or {"heading", "course", "age", "swims"} <= set(expected.files)


@pytest.mark.parametrize("scene", SCENES)
def test_same_cells_events_and_error_as_on_one_rank(scene: str, alone: Path, over: Path) -> None:
    name = f"{scene}.json"
    assert json.loads((over / name).read_text()) == json.loads((alone / name).read_text())


def test_same_saved_run_also_after_going_on(alone: Path, over: Path) -> None:
    with open_run(alone / "run") as expected, open_run(over / "run") as found:
        assert found.sizes == expected.sizes
        assert found.attrs.pop("run_id") != expected.attrs.pop("run_id")
        assert found.attrs == expected.attrs
        xr.testing.assert_equal(found, expected)


def test_every_rank_owns_cells_and_holds_ghost_cells(over: Path) -> None:
    found = ranks(over)
    assert sum(rank["own"] for rank in found) == 11
    assert min(rank["own"] for rank in found) >= 1
    if len(found) == 1:
        assert found[0]["held"] == 11
        assert found[0]["sent"] == 0
    else:
        assert all(rank["held"] > rank["own"] and rank["sent"] > 0 for rank in found)


def test_all_ranks_stop_where_an_observer_fails(over: Path) -> None:
    first, *others = [rank["stopped"] for rank in ranks(over)]
    assert first == ["OSError", "no room", 3]
    assert all(other == ["StoppedError", "no room", 3] for other in others)


def test_all_ranks_stop_after_the_same_step_when_interrupted(over: Path) -> None:
    assert all(rank["interrupted"] == [2] for rank in ranks(over))


def test_all_ranks_stop_after_the_same_step_whichever_asks_for_it(over: Path) -> None:
    found = ranks(over)
    expected = [[f"by rank {by}", 2, f"stop: by rank {by}"] for by in (0, len(found) - 1)]
    assert all(rank["halted"] == expected for rank in found)


COMMAND = """
import sys
from pathlib import Path
from morphosim import Cell, Numerics, Physics, Scene, Sphere
from morphosim.mpi.run import go
from morphosim.mpi.distributed_simulation import DistributedSimulation
count, output = int(sys.argv[1]), Path(sys.argv[2])
cells = [Cell(name=f"c{k}", shape=Sphere(center=(8 * k, 0, 0), radius=4)) for k in range(count)]
try:
    physics = Physics(sigma=0.3, kappa=0.05)
    numerics = Numerics(solver="band", threads=1)
    scene = Scene(cells=cells, physics=physics, numerics=numerics, duration=6, save_every=4)
    status = go(
        lambda: DistributedSimulation(scene), output, lambda text, err=False: print(text),
        summary=lambda simulation, bar, path: f"{len(simulation.volumes)} cells at {path.name}",
    )
except (ValueError, OSError) as error:
    print("error:", error)
    status = 2
sys.exit(status)
"""


LACKING = """
def lacking(scene, rank):
    from mpi4py import MPI
    if MPI.COMM_WORLD.rank == rank:
        raise FileNotFoundError("no such file here")
    return DistributedSimulation(scene)
try:"""


def test_run_saves_and_tells_once(tmp_path: Path) -> None:
    done = launch(2, "-c", COMMAND, "3", tmp_path / "run")
    assert done.returncode == 0, done.stderr
    assert done.stdout.split("\n") == ["3 cells at run", ""]
    with open_run(tmp_path / "run") as run:
        assert run["time"].values.tolist() == [0, 4, 6]
    again = launch(2, "-c", COMMAND, "3", tmp_path / "run")
    assert again.returncode == 2
    assert again.stdout.count("already holds a run") == 1


@pytest.mark.parametrize("failing", [0, 1])
def test_what_one_rank_lacks_at_the_start_is_told_once(tmp_path: Path, failing: int) -> None:
    lacks = COMMAND.replace(
        "lambda: DistributedSimulation(scene)", f"lambda: lacking(scene, {failing})"
    ).replace("try:", LACKING, 1)
    done = launch(2, "-c", lacks, "3", tmp_path / "run")
    assert done.returncode == 2, done.stderr
    assert done.stdout.split("\n") == ["error: no such file here", ""]


TERMS = """
from dataclasses import dataclass
from morphosim import Term

@dataclass(frozen=True)
class FailsForOne(Term):
    cell: str = "c0"
    early: bool = False

    def start(self, cells, numerics):
        if self.early and self.cell in cells.names:
            raise RuntimeError("no start for " + self.cell)

    def update(self, cells, step, forces):
        own = cells["name"][~cells["frozen"]].tolist()
        if step.number == 2 and self.cell in own:
            raise RuntimeError("no force for " + self.cell)
"""
STOPPED = """
from mpi4py import MPI
from morphosim import Cell, Numerics, Physics, RunWriter, Scene, Sphere
from morphosim.mpi.distributed_simulation import DistributedSimulation, RootObserver
cells = [Cell(name=f"c{k}", shape=Sphere(center=(20 * k, 0, 0), radius=4)) for k in range(2)]
terms = [FailsForOne(cell=sys.argv[2])]
physics = Physics(sigma=0.3, kappa=0.05, terms=terms)
numerics = Numerics(solver="band", threads=1)
scene = Scene(cells=cells, physics=physics, numerics=numerics, duration=20)
simulation = DistributedSimulation(scene)
error = None
try:
    simulation.run(observers=[RootObserver(lambda: [RunWriter(sys.argv[1], every=2)])])
except Exception as raised:
    error = raised
told = [type(error).__name__, str(error), simulation.engine.steps, simulation.whole]
everyone = MPI.COMM_WORLD.gather(told)
if MPI.COMM_WORLD.rank == 0:
    print(json.dumps(everyone), flush=True)
MPI.COMM_WORLD.barrier()
raise error
"""


@pytest.mark.parametrize("failing", [0, 1])
def test_all_ranks_stop_where_the_step_of_one_fails(tmp_path: Path, failing: int) -> None:
    script = "import json, sys\n" + TERMS + STOPPED
    done = launch(2, "-c", script, tmp_path / "run", f"c{failing}")
    text = f"force term FailsForOne failed at t = 4: RuntimeError: no force for c{failing}"
    assert json.loads(done.stdout) == [["TermError", text, 2, False]] * 2, done.stderr
    assert done.returncode == 1
    assert text in done.stderr
    with open_run(tmp_path / "run") as run:
        assert run["time"].values.tolist() == [0, 2, 4]


@pytest.mark.parametrize(
    ("failing", "early", "status", "text"),
    [
        (0, False, 1, "RuntimeError: no force for c0"),
        (1, False, 1, "RuntimeError: no force for c1"),
        (1, True, 2, "error: no start for c1"),
    ],
)
def test_the_command_tells_an_error_of_one_rank_once(
    tmp_path: Path, failing: int, early: bool, status: int, text: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    (tmp_path / "failing_terms.py").write_text(TERMS)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    cells = [Cell(name=f"c{k}", shape=Sphere(center=(20 * k, 0, 0), radius=4)) for k in range(2)]
    physics = Physics(sigma=0.3, kappa=0.05)
    scene = Scene(cells=cells, physics=physics, numerics=Numerics(solver="band"), duration=20)
    save_scene(scene, tmp_path / "scene.toml")
    text_of_scene = (tmp_path / "scene.toml").read_text()
    values = f'cell = "c{failing}", early = {str(early).lower()}'
    term = f'[physics]\nterms = [{{ use = "failing_terms:FailsForOne", {values} }}]'
    (tmp_path / "scene.toml").write_text(text_of_scene.replace("[physics]", term))
    start = "from morphosim.cli import main; main()"
    done = launch(2, "-c", start, "run", tmp_path / "scene.toml", "-o", tmp_path / "run", "--mpi")
    assert done.returncode == status
    assert done.stderr.count(text) == 1, done.stderr
    assert "MPI_ABORT" not in done.stderr


def test_more_ranks_than_cells_are_refused(tmp_path: Path) -> None:
    done = launch(2, "-c", COMMAND, "1", tmp_path / "run")
    assert done.returncode == 2
    assert "1 cells on 2 ranks: every rank needs a cell" in done.stdout
