"""Scenes of embryos: that their stages follow the lineage, and that a small species runs."""

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from morphosim import (
    Duration,
    EllipsoidShell,
    Numerics,
    Simulation,
    built_in_scene,
    load_scene,
    save_scene,
)
from morphosim.cli import app
from morphosim.importers.lineage import read_lineage
from morphosim.importers.lineage.scene import lineage_scene
from morphosim.library.celegans.scenes import celegans_1_to_8, celegans_1_to_102

SPECIES = """name,parent,volume_um3,axis_x,axis_y,axis_z,group
egg,,3000,1,0,0,1
left,egg,1800,0,1,0,2
right,egg,1200,,,,
up,left,900,,,,
down,left,900,,,,
"""


def test_the_first_eight_cells_come_in_order() -> None:
    scene = celegans_1_to_8()
    divided = [event.cell for stage in scene.stages for event in stage.events]
    assert divided == ["P0", "AB", "P1", "ABa", "ABp", "EMS", "P2"]
    assert scene.names == ["P0"]
    eight = scene.stages[-1].physics["sigma"]
    assert eight.pairs == {("ABpl", "E"): 0.0}
    assert not celegans_1_to_8(weak=False).stages[-1].physics["sigma"].pairs
    assert scene.stages[-1].end == Duration(15000.0)


def test_the_measured_axis_of_ab_is_at_hand() -> None:
    axes = [
        scene.stages[2].events[0].axis
        for scene in (celegans_1_to_8(), celegans_1_to_8(measured=["AB"]))
    ]
    assert np.degrees(np.arccos(np.dot(*axes))) == pytest.approx(43, abs=1)


def test_102_cells_in_24_groups() -> None:
    stages = celegans_1_to_102().stages
    events = [len(stage.events) for stage in stages if stage.events]
    assert len(events) == 24
    assert 1 + sum(events) == 102
    assert [stage.name for stage in stages][-1] == "102-cell"


def test_any_lineage_table_makes_a_scene(tmp_path: Path) -> None:
    (tmp_path / "species.csv").write_text(SPECIES, encoding="utf-8")
    lineage = read_lineage(tmp_path / "species.csv")
    shell = EllipsoidShell(center=(0, 0, 0), semi_axes=(12, 9, 9))
    scene = lineage_scene(
        lineage, shell, (0, 0, 0), end=Duration(30.0), numerics=Numerics(threads=1),
    )  # fmt: skip
    simulation = Simulation(scene)
    simulation.run()
    assert simulation.names == ["right", "up", "down"]
    np.testing.assert_allclose(simulation.volumes, [1200, 900, 900], rtol=0.05)
    at = dict(zip(simulation.names, simulation.centroids, strict=True))
    assert at["right"][0] < at["up"][0]
    assert at["up"][1] > at["down"][1] + 3


def test_a_table_needs_no_code(tmp_path: Path) -> None:
    (tmp_path / "species.csv").write_text(SPECIES, encoding="utf-8")
    words = ["import-lineage", tmp_path / "species.csv", "-o", tmp_path / "scene"]
    words += ["--shell", 12, 9, 9, "--cut", 8, "--limit", 20]
    done = CliRunner().invoke(app, [str(word) for word in words], catch_exceptions=False)
    assert "3 stages: 1-cell, 2-cell, 3-cell" in done.output
    scene = load_scene(tmp_path / "scene" / "scene.toml")
    assert scene.names == ["egg"]
    assert scene.confinement.cut[2] == 8
    assert [event.cell for event in scene.stages[2].events] == ["left"]
    assert scene.stages[2].limit == 20


@pytest.mark.parametrize("name", ["celegans-1-to-8", "celegans-1-to-102"])
def test_scenes_that_are_made_are_built_in_and_go_through_files(name: str, tmp_path: Path) -> None:
    scene = built_in_scene(name, {"numerics.threads": 1, "save_every": 50.0})
    assert (scene.numerics.threads, scene.save_every) == (1, 50)
    save_scene(scene, tmp_path / "scene.toml")
    again = load_scene(tmp_path / "scene.toml")
    assert [stage.name for stage in again.stages] == [stage.name for stage in scene.stages]
    assert again.stages[-1].physics == scene.stages[-1].physics
    first, second = (s.stages[1].events[0] for s in (scene, again))
    assert first == second


def test_the_egg_fills_its_shell_at_its_volume() -> None:
    scene = built_in_scene("celegans-1-to-8", {"numerics.threads": 1})
    simulation = Simulation(scene)
    assert simulation.volumes[0] == pytest.approx(20768.97, rel=1e-3)
    assert simulation.names == ["P0"]
