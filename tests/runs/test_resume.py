"""Going on with saved runs: to the same bits, or with another scene."""

import json
import shutil
import signal
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import numpy as np
import pytest
from typer.testing import CliRunner

from morphosim import (
    Attraction,
    BoxWalls,
    Cell,
    CellChange,
    DivergenceError,
    Division,
    Duration,
    Numerics,
    Physics,
    RunWriter,
    Scene,
    Simulation,
    Sphere,
    Stage,
    VolumeCourse,
    load_scene,
    open_run,
    save_scene,
)
from morphosim.cli import app
from morphosim.errors import DamageWarning
from morphosim.runs import checkpoint
from morphosim.runs.checkpoint import Checkpoint
from morphosim.runs.save_facts import SaveFacts
from morphosim.scene.fingerprint import first_difference, settings

from ..helpers import EXPECTED_TO_FAIL, built_in_scenes


def scene(**options: Any) -> Scene:
    """Three cells that move, push, pull, grow and make noise."""
    course = VolumeCourse(times=[0, 200], volumes=[113, 180])
    cells = [
        Cell(name="a", shape=Sphere(center=(0, 0, 0), radius=3), volume=course),
        Cell(name="b", shape=Sphere(center=(5.5, 0, 0), radius=3), gamma=0.3),
        Cell(name="c", shape=Sphere(center=(0, 5.5, 0), radius=3)),
    ]
    numerics = {"threads": 1, "seed": 3} | options.pop("numerics", {})
    physics = {"sigma": 0.5, "kappa": 0.2} | options.pop("physics", {})
    return Scene(
        **({"cells": cells, "duration": 120.0, "save_every": 20.0} | options),
        numerics=Numerics(**numerics), physics=Physics(**physics),
    )  # fmt: skip


def run(chosen: Scene, folder: Path, until: float | None = None) -> Simulation:
    simulation = Simulation(chosen)
    simulation.run(until=until, observers=[RunWriter(folder, chosen.save_every)])
    return simulation


def assert_same_state(a: Simulation, b: Simulation) -> None:
    first, second = a.checkpoint(), b.checkpoint()
    assert first.arrays.keys() == second.arrays.keys()
    for name, values in first.arrays.items():
        np.testing.assert_array_equal(values, second.arrays[name], err_msg=name)
    for name in ("names", "steps", "stage", "removed"):
        assert getattr(first, name) == getattr(second, name), name


@pytest.mark.parametrize("solver", ["dct", "band"])
def test_a_run_goes_on_to_the_same_bits(tmp_path: Path, solver: str) -> None:
    chosen = scene(numerics={"solver": solver})
    whole = run(chosen, tmp_path / "whole")
    run(chosen, tmp_path / "parts", until=50)
    again = Simulation.from_run(tmp_path / "parts")
    assert again.time == 50
    again.run(observers=[RunWriter(tmp_path / "parts", 20, resume=True)])
    assert_same_state(whole, again)
    with open_run(tmp_path / "whole") as data, open_run(tmp_path / "parts") as parts:
        assert parts["time"].values.tolist() == [0, 20, 40, 50, 60, 80, 100, 120]
        common = parts.sel(time=data["time"])
        for name in data.variables:
            if {"box", "sample"}.isdisjoint(data[name].dims):
                np.testing.assert_array_equal(data[name], common[name], err_msg=str(name))
        size = int(data["row_size"][-3:].sum())
        np.testing.assert_array_equal(data["phi"][-size:].values, parts["phi"][-size:].values)


def test_a_run_goes_on_from_its_very_start(tmp_path: Path) -> None:
    chosen = scene(duration=6.0)
    run(chosen, tmp_path / "parts", until=0)
    again = Simulation.from_run(tmp_path / "parts")
    assert again.column("fresh").all()
    again.run()
    assert_same_state(run(chosen, tmp_path / "whole"), again)


def older(arrays: dict[str, Any]) -> None:
    """As states were written before steps could be of different lengths."""
    for name in ("acceleration", "ahead"):
        del arrays[name]
    facts = json.loads(str(arrays["facts"]))
    del facts["ticks"], facts["explicit_rate"]
    arrays["facts"] = np.array(json.dumps(facts))


def test_an_older_run_goes_on(tmp_path: Path) -> None:
    chosen = scene(duration=40.0, numerics={"S": 6.0})
    whole = run(chosen, tmp_path / "whole")
    run(chosen, tmp_path / "parts", until=20)
    rewritten(tmp_path / "parts" / "restart-000001.npz", older)
    again = Simulation.from_run(tmp_path / "parts")
    assert again.ticks == again.steps == 10
    again.run()
    for one, other in zip(whole.fields, again.fields, strict=True):
        np.testing.assert_array_equal(one.phi, other.phi)


def test_removed_cells_and_stage_are_remembered(tmp_path: Path) -> None:
    cells = [
        Cell(name=name, shape=Sphere(center=(x, 0, 0), radius=radius))
        for name, x, radius in (("small", 0.0, 3.0), ("large", 20.0, 6.0))
    ]
    old = {"c": 1.0, "volume_constraint": "absolute", "sigma": 0.0, "kappa": 0.0}
    chosen = scene(cells=cells, physics=old, on_vanish="remove", duration=300.0, save_every=100.0)
    simulation = Simulation(chosen)
    simulation.stage = "waiting"
    simulation.run(until=250, observers=[RunWriter(tmp_path, 100)])
    assert [name for _, name in simulation.removed] == ["small"]
    again = Simulation.from_run(tmp_path)
    assert again.names == ["large"]
    assert_same_state(simulation, again)
    with open_run(tmp_path) as data:
        assert set(data["stage"].values) == {"waiting"}


def test_what_a_killed_process_leaves_is_cleared_away(tmp_path: Path) -> None:
    chosen = scene()
    run(chosen, tmp_path, until=20)
    for number in (2, 7):  # what is written again, and what is not
        (tmp_path / f"save-00000{number}.nc.partial").write_bytes(b"half")
        (tmp_path / f"restart-00000{number}.npz.partial").write_bytes(b"half")
    again = Simulation.from_run(tmp_path)
    again.run(until=40, observers=[RunWriter(tmp_path, 20, resume=True)])
    names = {p.name for p in tmp_path.iterdir()}
    states = {f"restart-00000{k}.npz" for k in (1, 2)}  # of two saves, if one is damaged
    saves = {f"save-00000{k}.nc" for k in range(3)}
    assert names == {"lock", "saves.index", "scene.toml", *states} | saves
    assert Checkpoint.read(tmp_path / "restart-000002.npz").steps == 20


def test_two_runs_into_one_directory_are_refused(tmp_path: Path) -> None:
    class Second:
        def start(self, simulation: Simulation) -> None:
            with pytest.raises(FileExistsError, match="already holds a run"):
                RunWriter(tmp_path, 20)
            with pytest.raises(FileExistsError, match="another run is being written"):
                RunWriter(tmp_path, 20, resume=True).start(simulation)

        def after_step(self, simulation: Simulation) -> None:
            pass

        def finish(self, simulation: Simulation) -> None:
            pass

    Simulation(scene()).run(until=0, observers=[RunWriter(tmp_path, 20), Second()])


def test_another_simulation_does_not_go_on_with_a_run(tmp_path: Path) -> None:
    run(scene(), tmp_path, until=20)
    with pytest.raises(ValueError, match=r"holds the run of another simulation; take Simulation"):
        Simulation(scene()).run(observers=[RunWriter(tmp_path, 20, resume=True)])


@EXPECTED_TO_FAIL
def test_a_run_that_diverged_does_not_go_on(tmp_path: Path) -> None:
    with pytest.raises(DivergenceError):
        run(scene(physics={"M": 1e6}).with_numerics(S=6.0), tmp_path, until=300)
    with pytest.raises(ValueError, match=r"ended by an error and cannot go on: cell .* diverged"):
        Simulation.from_run(tmp_path)
    other = Simulation.from_run(tmp_path, scene=scene(), time=0)
    other.run(until=10)


def test_a_scene_file_that_was_changed_does_not_go_on(tmp_path: Path) -> None:
    run(scene(), tmp_path, until=20)
    text = (tmp_path / "scene.toml").read_text()
    (tmp_path / "scene.toml").write_text(text.replace("dt = 2.0", "dt = 1.0"))
    with pytest.raises(ValueError, match=r"numerics\.dt is 1\.0, the run had 2\.0"):
        Simulation.from_run(tmp_path)


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ('on_vanish = "stop"', 'on_vanish = "remove"'),
        ("upper = [9, 9, 9]", "upper = [9, 9, 8.5]"),
        ("time = 10", "time = 12"),
    ],
    ids=["vanish", "walls", "stages"],
)
def test_walls_and_stages_must_stay_too(tmp_path: Path, before: str, after: str) -> None:
    chosen = scene(
        confinement=BoxWalls(lower=(-9, -9, -9), upper=(9, 9, 9)),
        stages=[Stage(name="s", end=Duration(10)), Stage(name="t", end=Duration(10))],
    )
    run(chosen, tmp_path, until=4)
    Simulation.from_run(tmp_path)
    text = (tmp_path / "scene.toml").read_text().replace(
        "upper = [\n    9,\n    9,\n    9,\n]", "upper = [9, 9, 9]"
    )  # fmt: skip
    assert before in text
    (tmp_path / "scene.toml").write_text(text.replace(before, after))
    named = r"(on_vanish|confinement\.upper\[2\]|stages\[0\]\.end\.time) is .*, the run had"
    with pytest.raises(ValueError, match=named):
        Simulation.from_run(tmp_path)


def test_a_cell_that_has_vanished_does_not_end_a_run(tmp_path: Path) -> None:
    physics = {"volume_constraint": "absolute", "kappa": 0.0}
    cells = [
        Cell(name="small", shape=Sphere(center=(0, 0, 0), radius=3)),
        Cell(name="large", shape=Sphere(center=(15, 0, 0), radius=5)),
    ]
    chosen = scene(cells=cells, physics=physics, on_vanish="ignore", duration=220.0)
    whole = run(chosen, tmp_path / "whole")
    run(chosen, tmp_path / "part", until=200)
    again = Simulation.from_run(tmp_path / "part")
    assert again.engine.vanished().tolist() == [0]
    again.run(observers=[RunWriter(tmp_path / "part", 20, resume=True)])
    assert_same_state(again, whole)


@pytest.mark.parametrize(
    ("before", "after", "named"),
    [
        ("radius = 3", "radius = 4", r"cells\.a\.shape\.radius is 4, the run had 3"),
        ("gamma = 0.3", "gamma = 0.4", r"cells\.b\.gamma is 0\.4, the run had 0\.3"),
        ("    180,", "    181,", r"cells\.a\.volume\.volumes\[1\] is 181, the run had 180"),
        ('name = "c"', 'name = "c"\nfrozen = true', r"cells\.c\.frozen is True, the run had False"),
        ('name = "c"', 'name = "d"', r"cells\.c is not there, the run had it"),
        ('name = "c"', 'name = "c"\ntype = "x"', r"cells\.c\.type is 'x', the run had ''"),
    ],
    ids=["radius", "gamma", "volume", "frozen", "name", "type"],
)
def test_cells_must_stay_too(tmp_path: Path, before: str, after: str, named: str) -> None:
    run(scene(), tmp_path, until=4)
    path = tmp_path / "scene.toml"
    text = path.read_text()
    assert before in text
    path.write_text(text.replace(before, after, 1))
    edited = path.read_bytes()
    words = ["run", "--resume", str(tmp_path), "--until", "200"]
    with pytest.raises(ValueError, match=named):
        CliRunner().invoke(app, words, catch_exceptions=False)
    assert path.read_bytes() == edited
    path.write_text(text.replace("save_every = 20", "save_every = 10"))  # what may change
    assert Simulation.from_run(tmp_path).time == 4


def test_every_built_in_scene_goes_on_from_its_file(tmp_path: Path) -> None:
    """What the state says of a scene is what its file says."""
    for chosen in built_in_scenes():
        save_scene(chosen, tmp_path / "scene.toml")
        said = json.loads(json.dumps(settings(chosen)))
        loaded = load_scene(tmp_path / "scene.toml")
        assert first_difference(said, settings(loaded)) is None, chosen.name


def test_a_run_without_its_states_does_not_go_on(tmp_path: Path) -> None:
    run(scene(), tmp_path, until=20)
    states = sorted(tmp_path.glob("restart-*.npz"))
    for state in states:
        state.write_bytes(state.read_bytes()[:1000])
    with pytest.raises(ValueError, match=r"restart-000001\.npz cannot be read.* --from"):
        Simulation.from_run(tmp_path)
    for state in states:
        state.unlink()
    with pytest.raises(FileNotFoundError, match="Start a new run from its fields"):
        Simulation.from_run(tmp_path)


# --- damage ------------------------------------------------------------------------------------


def rewritten(path: Path, change: Callable[[dict[str, Any]], None], anew: bool = True) -> None:
    """Change the arrays of a state; `anew`, with a digest that fits them."""
    with np.load(path) as file:
        arrays = {name: file[name] for name in file.files}
    digest = arrays.pop(checkpoint.DIGEST).decode()
    change(arrays)
    np.savez(path, **arrays)
    with ZipFile(path, "a") as archive:
        archive.writestr(checkpoint.DIGEST, checkpoint._digest(archive) if anew else digest)


def facts_set(**values: Any) -> Callable[[dict[str, Any]], None]:
    def change(arrays: dict[str, Any]) -> None:
        arrays["facts"] = np.array(json.dumps(json.loads(str(arrays["facts"])) | values))

    return change


def history_lost(arrays: dict[str, Any]) -> None:
    arrays["history"][7] = np.nan


def swapped(arrays: dict[str, Any]) -> None:
    arrays["name"] = arrays["name"][[1, 0, 2]]


def moved(arrays: dict[str, Any]) -> None:
    arrays["origin"] = arrays["origin"][[1, 0, 2]]


def cut(arrays: dict[str, Any]) -> None:
    arrays["phi"] = arrays["phi"][:-5]


STATE_FAULTS = {
    "cut short": (lambda path: path.write_bytes(path.read_bytes()[:5000]), "cannot be read"),
    "empty": (lambda path: path.write_bytes(b""), "cannot be read"),
    "changed": (lambda path: rewritten(path, history_lost, anew=False), "has been changed since"),
    "NaN": (lambda path: rewritten(path, history_lost), "history of the saved state is not finite"),
    "step": (lambda path: rewritten(path, facts_set(steps=-5)), "is at step -5"),
    "other step": (lambda path: rewritten(path, facts_set(steps=7)), "step 7, where the save has"),
    "names": (
        lambda path: rewritten(path, swapped),
        r"cells \['b', 'a', 'c'\], where the save has",
    ),
    "places": (lambda path: rewritten(path, moved), "cell 'a' is elsewhere"),
    "fields": (lambda path: rewritten(path, cut), "fields of the saved state do not fit"),
}


@pytest.mark.parametrize("fault", STATE_FAULTS)
def test_a_damaged_state_costs_one_interval(tmp_path: Path, whole: Simulation, fault: str) -> None:
    run(scene(), tmp_path, until=40)
    damage, why = STATE_FAULTS[fault]
    damage(tmp_path / "restart-000002.npz")
    expected = rf"restart-000002\.npz.*{why}.*; the run goes on from restart-000001\.npz"
    with pytest.warns(DamageWarning, match=expected) as told:
        again = Simulation.from_run(tmp_path)
    assert [warning.filename for warning in told] == [__file__]
    assert "\n" not in str(told[0].message)
    assert again.time == 20
    again.run(until=60, observers=[RunWriter(tmp_path, 20, resume=True)])
    assert_same_state(whole, again)
    with open_run(tmp_path) as data:
        assert data["time"].values.tolist() == [0, 20, 40, 60]


@pytest.fixture(scope="module")
def whole() -> Simulation:
    """The run at t = 60 without a fault."""
    simulation = Simulation(scene())
    simulation.run(until=60)
    return simulation


def test_the_state_of_another_run_is_refused(tmp_path: Path) -> None:
    run(scene(), tmp_path / "a", until=20)
    run(scene(), tmp_path / "b", until=20)
    for name in ("restart-000000.npz", "restart-000001.npz"):
        shutil.copy(tmp_path / "b" / name, tmp_path / "a" / name)
    with pytest.raises(ValueError, match=r"restart-000001\.npz is of another run than the saves"):
        Simulation.from_run(tmp_path / "a")


def test_a_run_of_many_saves_goes_on_from_the_last_ones(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run(scene(), tmp_path / "run", until=40)
    for kind, first in (("save", 0), ("restart", 1)):
        for number in range(2, first - 1, -1):
            path = next((tmp_path / "run").glob(f"{kind}-{number:06d}.*"))
            path.rename(path.with_stem(f"{kind}-{number + 200:06d}"))
    for number in range(200):
        shutil.copy(tmp_path / "run" / "save-000200.nc", tmp_path / "run" / f"save-{number:06d}.nc")
    opened: list[Path] = []
    read = SaveFacts._read
    monkeypatch.setattr(
        SaveFacts, "_read", classmethod(lambda cls, path: opened.append(path) or read(path))
    )
    again = Simulation.from_run(tmp_path / "run")
    assert again.time == 40
    again.run(until=40, observers=[RunWriter(tmp_path / "run", 20, resume=True)])
    assert len(opened) < 30


def test_a_state_newer_than_the_last_save_is_used(tmp_path: Path, whole: Simulation) -> None:
    for damage in (lambda path: path.unlink(), lambda path: path.write_bytes(b"")):
        run(scene(), tmp_path / "run", until=40)
        damage(tmp_path / "run" / "save-000002.nc")
        again = Simulation.from_run(tmp_path / "run")
        assert again.time == 40
        again.run(until=60, observers=[RunWriter(tmp_path / "run", 20, resume=True)])
        assert_same_state(whole, again)
        with open_run(tmp_path / "run") as data:
            assert data["time"].values.tolist() == [0, 20, 40, 60]
            assert np.isfinite(data["speed"].values[2]).all()
        shutil.rmtree(tmp_path / "run")


def test_no_run_and_no_scene(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"has no scene\.toml"):
        Simulation.from_run(tmp_path)


def test_a_state_of_another_version_is_refused(tmp_path: Path) -> None:
    """Version 0.1.0 wrote format 1, and did not say which version it was."""
    simulation = Simulation(scene())
    path = tmp_path / "state.npz"
    simulation.checkpoint().write(path)
    with np.load(path) as file:
        arrays = {name: file[name] for name in file.files}
    facts = json.loads(str(arrays["facts"])) | {"format": 1}
    del facts["version"]
    np.savez(path, **(arrays | {"facts": np.array(json.dumps(facts))}))
    expected = r"written by version 0\.1\.0 of morphosim.*go on with that version.*--from"
    with pytest.raises(ValueError, match=expected):
        Checkpoint.read(path)


# --- branches ----------------------------------------------------------------------------------


def test_another_scene_starts_from_a_save(tmp_path: Path) -> None:
    simulation = run(scene(), tmp_path / "first", until=40)
    saved = dict(zip(simulation.names, simulation.centroids, strict=True))
    weak = scene(cells=scene().cells[:2], physics={"sigma": 0.0}, duration=20.0)
    branch = Simulation.from_run(tmp_path / "first", scene=weak)
    assert branch.time == 0
    assert branch.names == ["a", "b"]
    assert branch.scene.physics.attraction.default == 0
    for name, at in zip(branch.names, branch.centroids, strict=True):
        np.testing.assert_allclose(at, saved[name], atol=2e-3)
    assert branch.targets[0] == 113  # the scene's, at t = 0
    branch.run(observers=[RunWriter(tmp_path / "second", 20)])
    repeated = Simulation(load_scene(tmp_path / "second" / "scene.toml"))
    repeated.run()
    assert_same_state(branch, repeated)


def test_a_branch_from_an_earlier_save(tmp_path: Path) -> None:
    run(scene(), tmp_path / "first", until=60)
    with open_run(tmp_path / "first") as data:
        wanted, run_id = data["centroid"].sel(time=20).values, data.attrs["run_id"]
    branch = Simulation.from_run(tmp_path / "first", time=22)
    np.testing.assert_allclose(branch.centroids, wanted, atol=2e-3)
    branch.run(until=0, observers=[RunWriter(tmp_path / "second", 20)])
    again = Simulation.from_run(tmp_path / "second")
    again.run(until=4, observers=[RunWriter(tmp_path / "second", 20, resume=True)])
    with open_run(tmp_path / "second") as data:
        assert data.attrs["run_id"] == branch.identity.id != run_id
        assert data.attrs["from_run"] == str(tmp_path / "first")
        assert data.attrs["from_run_id"] == run_id
        assert data.attrs["from_time"] == 20


def test_a_time_at_which_nothing_was_saved_is_told(tmp_path: Path) -> None:
    run(scene(), tmp_path, until=60)
    assert Simulation.from_run(tmp_path, time=69).identity.source_time == 60
    for far in (71, 500, 1e20):
        with pytest.raises(
            ValueError, match=r"time = .*: the run has no save near it.* 0, 20, 40, 60"
        ):
            Simulation.from_run(tmp_path, time=far)
    for wrong in (-5, np.nan, np.inf):
        with pytest.raises(ValueError, match=r"time = .* is not allowed: it must be finite"):
            Simulation.from_run(tmp_path, time=wrong)


def test_a_branch_has_the_cells_as_they_were(tmp_path: Path) -> None:
    course = VolumeCourse(times=[0, 40], volumes=[500, 600])
    cells = [
        Cell(name="m", shape=Sphere(center=(0, 0, 0), radius=5), type="x", gamma=0.4),
        Cell(name="n", shape=Sphere(center=(11, 0, 0), radius=5), type="x", volume=course),
    ]
    divides = [Division(cell="m", daughters=("a", "b"), axis=(0, 0, 1), types=("x", "z"))]
    changes = CellChange(cells=["n"], values={"type": "y"})
    sigma = Attraction(types={("x", "y"): 0.2, ("x", "x"): 0.5})
    chosen = scene(
        cells=cells,
        physics={"sigma": sigma, "kappa_by_type": {"y": 0.1}},
        stages=[
            Stage(name="one", end=Duration(10), events=divides),
            Stage(name="two", end=Duration(20)),
            Stage(name="three", end=Duration(10), events=[changes]),
        ],
    )
    run(chosen, tmp_path)
    branch = Simulation.from_run(tmp_path, time=30)
    assert [(c.name, c.type, c.parent, c.gamma) for c in branch.cells] == [
        ("n", "x", "", None), ("a", "x", "m", 0.4), ("b", "z", "m", 0.4),
    ]  # fmt: skip
    assert branch.targets[0] == pytest.approx(575)
    branch.step(10)
    assert branch.targets[0] == 600
    assert branch.physics.attraction.types == {("x", "x"): 0.5}


def test_a_branch_has_the_volumes_and_physics_that_events_have_made(tmp_path: Path) -> None:
    change = CellChange(cells=["a"], values={"volume": 140.0})  # its course is over
    chosen = scene(
        stages=[
            Stage(name="one", end=Duration(20)),
            Stage(name="two", end=Duration(20), events=[change], physics={"g": 2.0}),
        ],
    )  # fmt: skip
    run(chosen, tmp_path)
    early, late = (Simulation.from_run(tmp_path, time=time) for time in (0, 40))
    assert (early.physics.g, early.targets[0]) == (1.6, 113)
    assert (late.physics.g, late.targets[0]) == (2.0, 140)
    late.step(5)
    assert late.targets[0] == 140


def test_a_branch_on_another_lattice(tmp_path: Path) -> None:
    simulation = run(scene(), tmp_path, until=20)
    branch = Simulation.from_run(tmp_path, scene=scene(numerics={"spacing": 0.4}))
    np.testing.assert_allclose(branch.centroids, simulation.centroids, atol=0.02)
    np.testing.assert_allclose(branch.volumes, simulation.volumes, rtol=0.02)


def test_a_cell_that_the_run_does_not_have(tmp_path: Path) -> None:
    run(scene(), tmp_path, until=0)
    cells = [*scene().cells, Cell(name="d", shape=Sphere(center=(20, 0, 0), radius=3))]
    with pytest.raises(ValueError, match=r"field of a cell of scene 'scene' = 'd' is not known"):
        Simulation.from_run(tmp_path, scene=scene(cells=cells))


# --- interruption ------------------------------------------------------------------------------


def interrupt_soon(times: int) -> threading.Thread:
    """Press Ctrl-C some time after the steps have begun."""

    def press() -> None:
        time.sleep(0.2)
        for _ in range(times):
            signal.raise_signal(signal.SIGINT)

    thread = threading.Thread(target=press)
    thread.start()
    return thread


def test_ctrl_c_waits_for_the_step_and_saves(tmp_path: Path) -> None:
    chosen = scene(duration=1e6, save_every=1e5)
    simulation = Simulation(chosen)
    simulation.step(2)
    thread = interrupt_soon(1)
    with pytest.raises(KeyboardInterrupt):
        simulation.run(observers=[RunWriter(tmp_path, 1e5)])
    thread.join()
    assert simulation.engine.whole
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    again = Simulation.from_run(tmp_path)
    assert_same_state(simulation, again)


def test_a_step_that_is_broken_off_is_not_saved(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    simulation = Simulation(scene())

    def broken() -> None:
        if simulation.time >= 40:
            raise KeyboardInterrupt

    monkeypatch.setattr(simulation.engine, "_refit", broken)
    with pytest.raises(KeyboardInterrupt):
        simulation.run(observers=[RunWriter(tmp_path, 20)])
    assert not simulation.engine.whole
    with open_run(tmp_path) as data:
        assert data["time"].values.tolist() == [0, 20]
