"""What the README and the examples say works."""

import re
import runpy
from pathlib import Path

import numpy as np
import pytest

from morphosim import Simulation, load_scene, scene_names

ROOT = Path(__file__).resolve().parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]


def test_readme_python_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"```python\n(.*?)```", README, flags=re.DOTALL)
    assert len(blocks) >= 2
    names: dict[str, object] = {}
    for block in blocks:
        exec(block, names)
    assert names["phi"].dims == ("x", "y", "z")


def test_readme_names_a_scene_that_exists() -> None:
    scene = re.search(r"morphosim run (\S+) -o runs/embryo", README)
    assert scene is not None
    assert scene[1] in scene_names()


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_pages_link_to_files_that_exist(page: Path) -> None:
    for path in re.findall(r"\]\((\S+?)\)", page.read_text(encoding="utf-8")):
        assert (page.parent / path).exists(), path


def test_two_cells_says_the_same_in_python_and_toml(capsys: pytest.CaptureFixture[str]) -> None:
    script = runpy.run_path(str(ROOT / "examples" / "two_cells.py"))
    assert "contact" in capsys.readouterr().out
    simulation = Simulation(load_scene(ROOT / "examples" / "two_cells.toml"))
    simulation.run(until=script["simulation"].time)
    np.testing.assert_array_equal(simulation.volumes, script["simulation"].volumes)
    np.testing.assert_array_equal(simulation.centroids, script["simulation"].centroids)
