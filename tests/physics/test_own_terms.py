"""Terms of the user's own: runs, saves, resume, branches, division, scans, files, errors."""

import json
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from morphosim import (
    Attraction,
    Axis,
    Cell,
    Column,
    Division,
    Duration,
    Numerics,
    Physics,
    RunWriter,
    Scene,
    Simulation,
    Sphere,
    StabilityWarning,
    Stage,
    Step,
    Term,
    load_scene,
    open_run,
    point_force,
    save_scene,
    sweep,
)
from morphosim.errors import TermError
from morphosim.kernels.points import PointForce, force_at_point, records

from .own_terms import (
    Chemotaxis,
    Floor,
    Gravity,
    Lean,
    Persistence,
    Pressure,
    PressureAtPoints,
    Stiffness,
    leaning,
    slowed,
)

OWN = Path(__file__).with_name("own_terms.py")
MODULE = Gravity.__module__


def cells(count: int = 2) -> list[Cell]:
    return [
        Cell(name=f"c{k}", type="swims"[: 5 * (k % 2)],
             shape=Sphere(center=(8.5 * k, 0, 0), radius=4.0))
        for k in range(count)
    ]  # fmt: skip


def scene(*terms: Term, **options: object) -> Scene:
    numerics = Numerics(threads=1, solver="band")
    return Scene(**({
        "cells": cells(), "physics": Physics(sigma=0.3, terms=terms), "numerics": numerics,
        "duration": 40.0, "save_every": 20.0,
    } | options))  # fmt: skip


def fields(simulation: Simulation) -> list[np.ndarray]:
    return [field.phi for field in simulation.fields]


def python(code: str, path: Path) -> None:
    """Run code with a path in a process of its own, which can import the terms of these tests."""
    head = "import sys; from morphosim import RunWriter, Simulation, load_scene\n"
    done = subprocess.run(
        [sys.executable, "-c", head + code, str(path)], capture_output=True, text=True,
        env=os.environ | {"PYTHONPATH": str(OWN.parents[2])}, cwd=path.parent,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr


def assert_same(one: Simulation, other: Simulation) -> None:
    for a, b in zip(fields(one), fields(other), strict=True):
        np.testing.assert_array_equal(a, b)


def test_a_cell_sinks_at_the_speed_that_overdamped_motion_demands() -> None:
    alone = [Cell(name="a", shape=Sphere(center=(0, 0, 0), radius=4.0))]
    physics = Physics(terms=[Gravity(weight=0.2)])
    simulation = Simulation(
        scene(cells=alone, physics=physics).with_numerics(dt=0.5, S=0.0, spacing=1 / 3)
    )
    simulation.step(40)
    begin = simulation.centroids[0, 2]
    simulation.step(80)
    speed = (begin - simulation.centroids[0, 2]) / 40
    np.testing.assert_allclose(speed, 0.2 / physics.tau, rtol=2e-3)


@pytest.mark.parametrize("solver", ["band", "dct"])
def test_a_cell_climbs_a_potential_of_space(solver: str) -> None:
    """As fast as overdamped motion demands, alone and beside others that attract it by type."""
    alone = [Cell(name="a", shape=Sphere(center=(0, 0, 0), radius=4.0))]
    physics = Physics(terms=[Chemotaxis(slope=0.2)])
    simulation = Simulation(
        scene(cells=alone, physics=physics).with_numerics(
            dt=0.5, S=0.0, spacing=1 / 3, solver=solver
        )
    )
    simulation.step(40)
    begin = simulation.centroids[0]
    simulation.step(80)
    speed = (simulation.centroids[0] - begin) / 40
    np.testing.assert_allclose(speed, np.array([0.2, 0, -0.2]) / physics.tau, rtol=3e-3, atol=1e-6)
    sigma = Attraction(types={("", ""): 0.2, ("", "swims"): 0.5, ("swims", "swims"): 0.1})
    pulled, drifting = (
        Simulation(scene(physics=Physics(sigma=sigma, terms=terms)).with_numerics(solver=solver))
        for terms in ([], [Chemotaxis(slope=0.2)])
    )
    for simulation in (pulled, drifting):
        simulation.step(40)
    moved = drifting.centroids - pulled.centroids
    np.testing.assert_allclose(moved, moved.mean(axis=0) + np.zeros((2, 3)), atol=0.05)
    assert moved[0, 0] > 1


def test_a_cell_rests_on_a_floor() -> None:
    terms = [Gravity(weight=0.3), Floor(height=-6.0)]
    simulation = Simulation(scene(*terms, cells=cells(1), physics=Physics(terms=terms)))
    simulation.run(until=200)
    low = simulation.fields[0]
    inside = np.argwhere(low.phi > 0.5)[:, 2].min() + low.origin[2]
    assert -6.5 <= inside * 0.5 <= -5.0


@pytest.mark.parametrize("solver", ["band", "dct"])
def test_a_force_at_points_is_that_of_the_kernel(solver: str) -> None:
    """P |∇φ| written as a function of φ and ∇φ, and as the pressure that the kernel has."""
    at_points, pressed, free = (
        Simulation(scene(*terms).with_numerics(solver=solver))
        for terms in ([PressureAtPoints(by=0.1)], [Pressure(by=0.1)], [])
    )
    for simulation in (at_points, pressed, free):
        simulation.step(5)
    for a, b, c in zip(*map(fields, (at_points, pressed, free)), strict=True):
        np.testing.assert_allclose(a, b, atol=2e-6)
        assert np.abs(a - c).max() > 1e-3


def test_forces_at_points_add_up() -> None:
    """Two compiled functions with values of their own, in single precision too."""
    rng = np.random.default_rng(3)
    phi, *gradient = rng.random(4)
    values = np.array([0.3, 0.2, 1.0, 0.7])
    expected = slowed(values[:3], phi, *gradient, 2.0) + leaning(values[3:], phi, *gradient, 2.0)
    found = records([(slowed, values[None, :3]), (leaning, values[None, 3:])], np.dtype(np.float64))
    given = force_at_point(found, 0, phi, *gradient, 2.0, None, None)
    np.testing.assert_allclose(given, expected, rtol=1e-14)
    both = Simulation(scene(Stiffness(), Lean()))
    both.step(4)
    assert np.isfinite(both.volumes).all()


def test_another_function_or_constant_has_another_name() -> None:
    """Compiled kernels on disk are found by it."""

    def made(constant: float) -> PointForce:
        return point_force(lambda values, phi, gx, gy, gz, laplacian: constant * phi)

    assert made(1.0).name == made(1.0).name != made(2.0).name
    assert slowed.name != leaning.name


def test_state_of_a_term_is_divided_saved_and_gone_on_with(tmp_path: Path) -> None:
    """Bit for bit, in a process that imports the term by itself."""
    division = Division(cell="c1", daughters=("x", "y"), axis=(0, 1, 0))
    stages = [
        Stage(name="one", end=Duration(10)), Stage(name="two", end=Duration(30), events=[division]),
    ]  # fmt: skip
    whole = scene(Persistence(type="swims"), Gravity(), Lean(), stages=stages, save_every=4.0)
    unbroken = Simulation(whole)
    unbroken.run()
    table = unbroken.engine.cells
    assert table.names == ["c0", "x", "y"]
    assert table["age"].tolist() == [40, 30, 30]
    assert table["tired"].tolist() == [40, 35, 35]
    np.testing.assert_allclose(np.linalg.norm(table["heading"], axis=1), 1)
    assert np.ptp(table["heading"][1:], axis=0).max() > 0.1  # by their ids

    broken = Simulation(whole)
    broken.run(until=20, observers=[RunWriter(tmp_path / "run", 4.0)])
    python(
        "simulation = Simulation.from_run(sys.argv[1])\n"
        "simulation.run(observers=[RunWriter(sys.argv[1], 4.0, resume=True)])\n",
        tmp_path / "run",
    )
    again = Simulation.from_run(tmp_path / "run")
    assert again.time == 40
    assert_same(again, unbroken)
    for column in ("heading", "age", "tired"):
        np.testing.assert_array_equal(again.engine.cells[column], table[column])
    branch = Simulation.from_run(tmp_path / "run", time=20)
    assert branch.physics.terms == whole.physics.terms
    assert branch.engine.cells["age"].tolist() == [0, 0, 0]
    with open_run(tmp_path / "run") as run:
        said = json.loads(run.attrs["physics"])["terms"]
    assert said[0] == {"use": f"{MODULE}:Persistence", "type": "swims", "speed": 0.05, "turn": 0.1}


def test_a_script_defines_a_term_and_its_run_goes_on(tmp_path: Path) -> None:
    """The script's own classes; the command line goes on with it from elsewhere."""
    text = (
        OWN.read_text().replace('"""Force terms', '"""Script')
        + """

if __name__ == "__main__":
    import sys
    from morphosim import Cell, Numerics, Physics, RunWriter, Scene, Simulation, Sphere

    cells = [Cell(name="a", shape=Sphere(center=(0, 0, 0), radius=4))]
    scene = Scene(
        cells=cells, physics=Physics(terms=[Gravity(weight=0.3)]), duration=20,
        numerics=Numerics(threads=1, solver="band"),
    )
    simulation = Simulation(scene)
    simulation.run(until=float(sys.argv[2]), observers=[RunWriter(sys.argv[1], 10)])
    print(simulation.centroids[0, 2])
"""
    )
    script = tmp_path / "sinking.py"
    script.write_text(text)
    folder, elsewhere = tmp_path / "run", tmp_path / "elsewhere"
    elsewhere.mkdir()

    def do(*command: str) -> str:
        done = subprocess.run(
            [sys.executable, *command], capture_output=True, text=True, cwd=elsewhere
        )
        assert done.returncode == 0, done.stderr
        return done.stdout

    whole = float(do(str(script), str(tmp_path / "whole"), "20"))
    do(str(script), str(folder), "10")
    do("-c", "from morphosim.cli import main; main()", "run", "--resume", str(folder))
    again = Simulation.from_run(folder)
    assert again.centroids[0, 2] == whole < -1
    script.unlink()
    del sys.modules[str(script)]
    with pytest.raises(ValueError, match=r"terms\[0\].use = .*sinking.py:Gravity' cannot be loa"):
        Simulation.from_run(folder)
    moved = tmp_path / "moved.py"
    moved.write_text(text)
    saved_scene = (folder / "scene.toml").read_text()
    (folder / "scene.toml").write_text(saved_scene.replace(str(script), str(moved)))
    assert Simulation.from_run(folder).centroids[0, 2] == whole
    with open_run(folder) as run:  # to look at it needs no term
        assert run.sizes["time"] == 3


def test_scene_files_say_terms(tmp_path: Path) -> None:
    given = scene(Persistence(type="swims", speed=0.2), Gravity())
    save_scene(given, tmp_path / "s.toml")
    text = (tmp_path / "s.toml").read_text()
    assert f'use = "{MODULE}:Gravity"' in text
    assert load_scene(tmp_path / "s.toml").physics == given.physics
    by_path = text.replace(MODULE, str(OWN))
    (tmp_path / "p.toml").write_text(by_path)
    assert [t.name for t in load_scene(tmp_path / "p.toml").physics.terms] == [
        "Persistence", "Gravity",
    ]  # fmt: skip
    changed = load_scene(tmp_path / "s.toml", {"physics.terms.1.weight": 0.7})
    assert changed.physics.terms[1] == Gravity(weight=0.7)


def test_terms_are_scanned(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(OWN.parents[2])  # so that workers can import the term
    alone = scene(Gravity(), cells=cells(1), duration=20.0)
    result = sweep(
        alone, {"physics.terms.0.weight": Axis(values=[0.1, 0.4])}, figures=["centroid"],
        directory=tmp_path / "scan", progress=False,
    )  # fmt: skip
    light, heavy = result["centroid"].sel(axis="z").isel(cell=0).values
    assert heavy < light - 0.5


WRONG = {
    "use = 'nowhere_at_all:Gravity'": r"terms\[0\].use = 'nowhere_at_all:Gravity' cannot be load",
    "use = 'MODULE:Missing'": "cannot be loaded .*has no attribute 'Missing'",
    "use = 'MODULE:MODULE'": "cannot be loaded",
    "use = 'math:pi'": "is no force term",
    "use = 'gone.py:Gravity'": "there is no file .*gone.py",
    "use = 'MODULE:Gravity', wieght = 1.0": "did you mean 'weight'",
    "use = 'MODULE:Gravity', weight = nan": "weight = nan; it must be finite",
    "use = 'MODULE:Persistence'": "type",
    "weight = 1.0": "expected a table with a kind out of .* or with use = 'module:Class'",
    "use = 3": "expected a table with a kind out of .* or with use",
    "kind = 'gravty'": "did you mean 'gravity'",
    "kind = 'gravity', wieght = 1.0": "did you mean 'weight'",
    "use = 'MODULE:Persistence', type = 'none'": "'none' is not one of",
}


@pytest.mark.parametrize("row", WRONG)
def test_wrong_terms_fail_before_the_first_step(row: str, tmp_path: Path) -> None:
    save_scene(scene(), tmp_path / "s.toml")
    text = (tmp_path / "s.toml").read_text()
    line = f"[physics]\nterms = [{{ {row.replace('MODULE', MODULE)} }}]"
    (tmp_path / "w.toml").write_text(text.replace("[physics]", line))
    with pytest.raises(ValueError, match=WRONG[row]) as caught:
        load_scene(tmp_path / "w.toml")
    assert "\n" not in str(caught.value)


def test_terms_must_be_terms_with_columns_of_their_own() -> None:
    with pytest.raises(TypeError, match=r"physics.terms\[0\] = 3"):
        Physics(terms=[3])  # type: ignore[list-item]
    with pytest.raises(ValueError, match="Persistence and Persistence both have a column 'headi"):
        Physics(terms=[Persistence(type=""), Persistence(type="swims")])
    with pytest.raises(ValueError, match="two columns of the cell table are named 'target'"):
        Simulation(scene(Aiming()))
    later = Stage(name="s", end=Duration(4), physics={"terms": [Aiming()]})
    with pytest.raises(ValueError, match="two columns of the cell table are named 'target'"):
        Simulation(scene(stages=[later]))
    with pytest.raises(ValueError, match="column name = 'phi' is not allowed"):
        Column("phi")
    with pytest.raises(ValueError, match="Shares: column 'heat' is shared"):
        Physics(terms=[Shares()])
    with pytest.raises(ValueError, match="two attractions"):
        Simulation(scene(Attraction(default=0.1)))
    with pytest.raises(ValueError, match="is no force at a point; it must take"):
        point_force(lambda phi: phi)


def test_a_term_of_a_function_cannot_be_written(tmp_path: Path) -> None:
    @dataclass(frozen=True)
    class Local(Term):
        """Defined where no file can name it."""

    with pytest.raises(ValueError, match="Local cannot be written to a scene file"):
        save_scene(scene(Local()), tmp_path / "s.toml")


def test_stability_counts_a_terms_rate() -> None:
    strong = scene(Stiffness(bending=0.3)).with_numerics(S=6.0)
    with pytest.warns(StabilityWarning, match="Stiffness 21.7"):
        Simulation(strong)


def test_a_stage_brings_a_term() -> None:
    """With state of its own, which begins then."""
    swims = [Persistence(type="swims")]
    stages = [
        Stage(name="rest", end=Duration(10)),
        Stage(name="swim", end=Duration(10), physics={"terms": swims}),
    ]
    simulation = Simulation(scene(stages=stages, duration=20.0))
    simulation.step(5)
    assert "age" not in simulation.engine.cells
    simulation = Simulation(scene(stages=stages, duration=20.0))
    simulation.run()
    assert simulation.engine.cells["age"].tolist() == [10, 10]


def test_an_absent_term_has_no_column_and_no_call(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise AssertionError

    for method in ("prepare", "update", "start", "surround"):
        monkeypatch.setattr(Absent, method, fail, raising=False)
    simulation = Simulation(scene(Absent()))
    simulation.step(2)
    assert "nothing" not in simulation.engine.cells
    plain = Simulation(scene())
    plain.step(2)
    assert simulation.engine.nbytes == plain.engine.nbytes
    assert_same(simulation, plain)


def test_a_term_that_fails_is_named_and_the_state_before_is_saved(tmp_path: Path) -> None:
    simulation = Simulation(scene(Fails()))
    expected = "force term Fails failed at t = 6: ZeroDivisionError"
    with pytest.raises(TermError, match=expected):
        simulation.run(observers=[RunWriter(tmp_path, 20)])
    with open_run(tmp_path) as run:
        assert run["time"].values.tolist() == [0, 6]
        assert expected in run.attrs["error"]


def test_a_wall_says_whose_it_is_if_it_is_wrong() -> None:
    with pytest.raises(ValueError, match="Floor: its wall is -2 somewhere; it must be ≥ 0"):
        Simulation(scene(Floor(height=0.0, strength=-2.0)))
    with pytest.raises(ValueError, match="Chemotaxis: its function of space is not finite"):
        Simulation(scene(Chemotaxis(slope=np.nan)))


@dataclass(frozen=True)
class Fails(Term):
    """A term that fails after three steps."""

    def update(self, cells: Any, step: Step, forces: Any) -> None:
        """Divide by zero."""
        forces.pressure += 1 / (3 - step.number)


@dataclass(frozen=True)
class Aiming(Term):
    """A term with a column of the engine's name."""

    columns = (Column("target"),)


@dataclass(frozen=True)
class Shares(Term):
    """A term with a column that all ranks should know."""

    columns = (Column("heat", shared=True),)


@dataclass(frozen=True)
class Absent(Term):
    """A term that does not act."""

    columns = (Column("nothing"),)

    @property
    def present(self) -> bool:
        """Never."""
        return False
