"""What the README and the examples say works."""

import re
import runpy
from pathlib import Path

import numpy as np
import pytest

import morphosim
from morphosim import Simulation, export, load_scene, scene_names
from morphosim.exports.formats import FORMATS
from morphosim.geometry.confinement import CONFINEMENTS
from morphosim.geometry.shapes import SHAPES, Point
from morphosim.scene.ends import ENDS
from morphosim.scene.events import EVENTS

ROOT = Path(__file__).resolve().parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
PROTOCOLS = (ROOT / "docs" / "protocols.md").read_text(encoding="utf-8")
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


@pytest.mark.parametrize(
    "path",
    [
        *(page for page in PAGES if page.stem not in ("architecture", "contributing")),
        *sorted((ROOT / "examples").glob("*.[pi][yp]*")),
    ],
    ids=lambda path: path.name,
)
def test_what_users_read_imports_public_names_only(path: Path) -> None:
    text = path.read_text(encoding="utf-8").replace("\\n", "\n")
    assert re.findall(r"(?:from|import) morphosim\.\S+", text) == []
    for names in re.findall(r"from morphosim import (\([^)]*\)|[^\n`\"]*)", text):
        for name in re.findall(r"\w+", names):
            assert name in morphosim.__all__, name


@pytest.mark.parametrize(
    ("text", "kinds"),
    [(README, CONFINEMENTS), (README, SHAPES), (PROTOCOLS, ENDS), (PROTOCOLS, EVENTS)],
)
def test_documents_name_every_kind_of_a_scene_file(text: str, kinds: dict[str, type]) -> None:
    for cls in kinds.values():
        if cls not in (type(None), Point):  # said as "none" and as "a point"
            assert f"`{cls.__name__}" in text
            assert cls.__name__ in morphosim.__all__


@pytest.mark.parametrize("name", FORMATS)
def test_documents_name_every_format_of_an_export(name: str) -> None:
    assert re.search(rf"morphosim export .*\b{name}`", README)
    assert export.__doc__ is not None
    assert f'"{name}"' in export.__doc__
