"""The synNotch scenes: Table 2, their stages, and what the rules and the noise do."""

from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from morphosim import (
    Attraction,
    Cell,
    Differentiation,
    Duration,
    Numerics,
    Physics,
    RunWriter,
    Scene,
    Simulation,
    Sphere,
    Stage,
    built_in_scene,
    load_scene,
    open_run,
    save_scene,
)
from morphosim.cli import app
from morphosim.library.synnotch import DURATION, SCENES
from morphosim.scene.fingerprint import settings

TABLE_2 = {
    "asymmetric-3": ({"R": 80, "G": 40}, {("R", "R"): 0.9, ("R", "G"): 0.5, ("G", "G"): 0.9}),
    "asymmetric-2": ({"R": 62, "G": 62}, {("R", "R"): 0.9, ("R", "G"): 0.5, ("G", "G"): 0.9}),
    "symmetric": ({"G": 50, "B": 75}, {("G", "G"): 0.9, ("G", "B"): 0.5, ("B", "B"): 0.3}),
    "repair": ({"G": 50, "B": 75}, {("G", "G"): 0.9, ("G", "B"): 0.5, ("B", "B"): 0.3}),
    "dissociation": ({"G": 50, "B": 75}, {("G", "G"): 0.9, ("G", "B"): 0.5, ("B", "B"): 0.3}),
}


@pytest.mark.parametrize("name", TABLE_2)
def test_scenes_are_those_of_table_2(name: str, tmp_path: Path) -> None:
    counts, sigma = TABLE_2[name]
    scene = built_in_scene(f"synnotch-{name}")
    assert Counter(scene.types) == counts
    for pair, value in sigma.items():
        assert scene.physics.attraction.of_types(*pair) == value
    assert scene.physics.kappa == pytest.approx(np.sqrt(5) / 10)
    assert (scene.numerics.dt, scene.numerics.spacing) == (1.25, 0.5)
    low, high = scene.confinement.bounds()
    assert (high - low).tolist() == [64, 64, 64]
    assert all(cell.shape.radius == 5 for cell in scene.cells)
    assert sum(stage.end.time for stage in scene.stages) == scene.duration
    save_scene(scene, tmp_path / "scene.toml")
    again = load_scene(tmp_path / "scene.toml")
    assert settings(again)["stages"] == settings(scene)["stages"]
    assert again.physics == scene.physics
    assert set(SCENES) == {f"synnotch-{n}" for n in TABLE_2}


def test_the_seed_is_that_of_places_and_of_motion() -> None:
    one, other = (built_in_scene("synnotch-symmetric", {"numerics.seed": seed}) for seed in (0, 3))
    assert other.numerics.seed == 3
    assert one.cells[0].shape.center != other.cells[0].shape.center
    same = built_in_scene("synnotch-symmetric", {"numerics.seed": 3})
    assert same.cells == other.cells


def test_blue_cells_have_the_mechanics_of_red_ones() -> None:
    sigma = built_in_scene("synnotch-asymmetric-3").physics.attraction
    for other in "RGB":
        assert sigma.of_types("B", other) == sigma.of_types("R", other)
        assert sigma.of_types(other, "B") == sigma.of_types(other, "R")


def small(threads: int = 1, **physics: object) -> Scene:
    """Three red and three green cells in a heap."""
    places = [(x, y, 0.0) for x in (0.0, 9.0, 18.0) for y in (0.0, 9.0)]
    cells = [
        Cell(name=f"{kind}{k}", type=kind, shape=Sphere(center=place, radius=5))
        for k, (kind, place) in enumerate(zip("RGRGRG", places, strict=True))
    ]
    sigma = Attraction(types={("R", "R"): 0.9, ("G", "G"): 0.3, ("R", "G"): 0.5})
    numerics = Numerics(solver="band", dt=1.25, threads=threads, seed=5)
    return Scene(
        cells=cells, physics=Physics(**({"sigma": sigma, "kappa": 0.22} | physics)),
        numerics=numerics,
    )  # fmt: skip


def test_one_and_two_threads_give_the_same_run() -> None:
    one, two = (Simulation(small(threads)) for threads in (1, 2))
    for simulation in (one, two):
        simulation.step(40)
    for a, b in zip(one.fields, two.fields, strict=True):
        np.testing.assert_array_equal(a.origin, b.origin)
        np.testing.assert_array_equal(a.phi, b.phi)


def test_motility_by_type() -> None:
    """Only red cells move, with the κ of their type, also after a change of type."""
    scene = small(sigma=0.0, g=0.0, kappa=0.0, kappa_by_type={"R": 0.22})
    simulation, all_move = Simulation(scene), Simulation(small(sigma=0.0, g=0.0, kappa=0.22))
    before = simulation.centroids
    simulation.step(20)
    all_move.step(20)
    moved = np.linalg.norm(simulation.centroids - before, axis=1)
    assert (moved[0::2] > 0.1).all()
    assert (moved[1::2] < 1e-3).all()
    np.testing.assert_allclose(simulation.centroids[0], all_move.centroids[0], atol=1e-6)
    simulation.change_cells(["R0"], type="G")
    simulation.step(20)  # what it still has of its velocity
    before = simulation.centroids
    simulation.step(20)
    assert np.linalg.norm(simulation.centroids[0] - before[0]) < 0.02


def test_motility_of_unknown_types_is_refused() -> None:
    with pytest.raises(ValueError, match=r"type in physics.kappa_by_type = 'X'"):
        small(kappa_by_type={"X": 1.0})
    with pytest.raises(ValueError, match=r"physics.kappa_by_type\['R'\] = -1"):
        small(kappa_by_type={"R": -1.0})


def marked(scene: Scene, **options: object) -> Scene:
    """The scene with a second stage from t = 25 on, in which R that touch G become B."""
    rule = Differentiation(of="R", touching="G", into="B")
    stages = [
        Stage(name="wait", end=Duration(25)),
        Stage(name="mark", end=Duration(25), rules=[rule], rules_every=5, **options),
    ]
    return replace(scene, stages=stages, duration=50.0, save_every=12.5)


def test_types_change_by_rule_from_a_time_on(tmp_path: Path) -> None:
    scene = marked(small())
    Simulation(scene).run(observers=[RunWriter(tmp_path / "run", every=12.5)])
    with open_run(tmp_path / "run") as run:
        counts = [Counter(row.tolist()) for row in run["type"].values]
        assert [c["R"] for c in counts][:3] == [3, 3, 3]
        assert counts[-1]["B"] == 3
        assert "change of type" in run["events"].values[3]


def test_rules_are_applied_again_and_again() -> None:
    """A cell that comes into contact later is marked then, and not before."""
    cells = [
        Cell(name="r", type="R", shape=Sphere(center=(0, 0, 0), radius=5), frozen=True),
        Cell(name="g", type="G", shape=Sphere(center=(12.2, 0, 0), radius=5)),
    ]
    rule = Differentiation(of="R", touching="G", into="B", area=1.0)
    scene = Scene(
        cells=cells, numerics=Numerics(threads=1, dt=1.25),
        stages=[Stage(name="live", end=Duration(500), rules=[rule], rules_every=10)], duration=500,
        physics=Physics(kappa=0.0),
    )  # fmt: skip
    simulation = Simulation(scene)
    simulation.run(until=20)
    assert simulation.cells[0].type == "R"
    shift = simulation.engine.pool.origin
    shift[1, 0] -= 5  # 2.5 µm nearer
    simulation.engine.restart()
    simulation.run(until=40)
    assert simulation.cells[0].type == "B"


def test_a_run_with_rules_goes_on_to_the_same_bits(tmp_path: Path) -> None:
    scene = marked(small())
    whole, first = Simulation(scene), Simulation(scene)
    whole.run()
    first.run(until=37.5, observers=[RunWriter(tmp_path / "run", every=12.5)])
    second = Simulation.from_run(tmp_path / "run")
    second.run()
    assert [c.type for c in second.cells] == [c.type for c in whole.cells]
    for a, b in zip(second.fields, whole.fields, strict=True):
        np.testing.assert_array_equal(a.phi, b.phi)


def test_a_type_that_only_a_rule_makes_can_be_named_and_others_cannot() -> None:
    sigma = Attraction(types={("R", "R"): 0.9, ("B", "B"): 0.3})
    with pytest.raises(ValueError, match=r"type in sigma.types"):
        small(sigma=sigma)
    scene = replace(marked(small()), physics=Physics(sigma=sigma, kappa_by_type={"B": 0.1}))
    assert scene.possible_types == ["B", "G", "R"]


def test_a_scene_from_a_later_stage() -> None:
    scene = built_in_scene("synnotch-repair").from_stage("repair")
    assert [stage.name for stage in scene.stages] == ["repair"]
    assert scene.duration == DURATION
    with pytest.raises(ValueError, match="'assembly', 'repair'"):
        scene = built_in_scene("synnotch-repair").from_stage("cut")


def test_repair_and_dissociation_from_a_saved_assembly(tmp_path: Path) -> None:
    """By command line: the cut leaves the upper half, dissociation takes away attraction."""
    run = CliRunner().invoke
    assembly = tmp_path / "assembly"
    options = ["--threads", "1", "--until", "5", "--save-every", "5", "-o"]
    assert run(app, ["run", "synnotch-symmetric", *options, str(assembly)]).exit_code == 0
    for scene in ("repair", "dissociation"):
        branch = ["run", f"synnotch-{scene}", "--from", str(assembly), "--stage", scene]
        result = run(app, [*branch, *options, str(tmp_path / scene)])
        assert result.exit_code == 0, result.output
    with open_run(tmp_path / "repair") as data:
        there = data["volume"].isel(time=-1).notnull()
        assert 10 < int(there.sum()) < 75
        left = data["centroid"].isel(time=-1).where(there, drop=True)
        assert float(left.sel(axis="z").min()) > -1
        assert "removal of" in data["events"].values[1]
        assert data["stage"].values.tolist() == ["", "repair"]
    with open_run(tmp_path / "dissociation") as data:
        assert '"types"' not in data.attrs["physics"]
        assert int(data["volume"].isel(time=-1).notnull().sum()) == 125
    refused = run(app, ["run", "synnotch-repair", "--stage", "repair", "-o", str(tmp_path / "x")])
    assert "give the run by --from" in str(refused.exception)
