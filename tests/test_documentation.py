"""What the README and the examples say works."""

import doctest
import re
import runpy
import sys
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

import morphosim
from morphosim import (
    Cell,
    Numerics,
    Physics,
    RunWriter,
    Scene,
    Simulation,
    Sphere,
    export,
    load_scene,
    open_run,
)
from morphosim.exports.formats import FORMATS
from morphosim.geometry.confinement import CONFINEMENTS
from morphosim.geometry.shapes import SHAPES, Point
from morphosim.measure.variable import MEASURED
from morphosim.scene.ends import ENDS
from morphosim.scene.events import EVENTS

ROOT = Path(__file__).resolve().parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
PROTOCOLS = (ROOT / "docs" / "protocols.md").read_text(encoding="utf-8")
TERMS = (ROOT / "docs" / "terms.md").read_text(encoding="utf-8")
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_pages_link_to_files_that_exist(page: Path) -> None:
    for path in re.findall(r"\]\((\S+?)\)", page.read_text(encoding="utf-8")):
        assert (page.parent / path.partition("#")[0]).exists(), path


def test_nothing_advises_to_install_what_no_index_has() -> None:
    sources = [*(ROOT / "morphosim").rglob("*.py"), *(ROOT / "examples").glob("*.*")]
    for path in (*PAGES, *sources):
        if path.suffix in {".py", ".md", ".ipynb"}:
            text = path.read_text(encoding="utf-8")
            assert not re.search(r"pip install '?morphosim", text), path


def test_two_cells_says_the_same_in_python_and_toml(capsys: pytest.CaptureFixture[str]) -> None:
    script = runpy.run_path(str(ROOT / "examples" / "two_cells.py"))
    assert "contact" in capsys.readouterr().out
    simulation = Simulation(load_scene(ROOT / "examples" / "two_cells.toml"))
    simulation.run(until=script["simulation"].time)
    np.testing.assert_array_equal(simulation.volumes, script["simulation"].volumes)
    np.testing.assert_array_equal(simulation.centroids, script["simulation"].centroids)


def test_own_term_sinks_with_weight_over_tau(capsys: pytest.CaptureFixture[str]) -> None:
    script = runpy.run_path(str(ROOT / "examples" / "own_term.py"), run_name="__main__")
    assert "sinks by 0.0382 um per time; weight / tau is 0.0382" in capsys.readouterr().out
    assert script["speed"] == pytest.approx(0.1 / script["physics"].tau, rel=1e-3)


@pytest.fixture(scope="module")
def page_of_terms() -> Iterator[ModuleType]:
    """Module with the code of docs/terms.md, all of it run."""
    module = ModuleType("page_of_terms")
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(sys.modules, "page_of_terms", module)
        for block in re.findall(r"```python\n(.*?)```", TERMS, flags=re.DOTALL):
            exec(block, vars(module))
        yield module
        MEASURED.pop("swimming", None)


def moved_by(*terms: object, time: float = 40.0) -> np.ndarray:
    """How far a ball of type "soft" gets."""
    ball = Cell(name="a", type="soft", shape=Sphere(center=(0, 0, 0), radius=4))
    numerics = Numerics(solver="band", threads=1, dt=1.0)
    simulation = Simulation(Scene(cells=[ball], physics=Physics(terms=terms), numerics=numerics))
    begin = simulation.centroids[0]
    simulation.run(until=time)
    return simulation.centroids[0] - begin


def test_the_page_of_terms_lets_a_cell_sink(page_of_terms: ModuleType) -> None:
    gravity = page_of_terms.Gravity(weight=0.1)
    np.testing.assert_allclose(moved_by(gravity), [0, 0, -40 * 0.1 / 2.62], atol=0.15)


def test_the_page_of_terms_moves_cells_by_their_own_state(
    page_of_terms: ModuleType, tmp_path: Path
) -> None:
    far, straight = (page_of_terms.Wander(type="soft", turn=turn) for turn in (0.3, 0.0))
    np.testing.assert_allclose(moved_by(straight), [40 * 0.05 / 2.62, 0, 0], atol=0.1)
    assert np.abs(moved_by(far)[1:]).max() > 0.05
    assert np.linalg.norm(moved_by(page_of_terms.Wander(type="soft", life=0.0))) < 1e-3
    with pytest.raises(ValueError, match="Wander: type = 'hard' is none of"):
        moved_by(page_of_terms.Wander(type="hard"))
    ball = Cell(name="a", type="soft", shape=Sphere(center=(0, 0, 0), radius=4))
    simulation = Simulation(Scene(cells=[ball], physics=Physics(terms=[far])))
    simulation.run(until=20, observers=[RunWriter(tmp_path / "run", 10)])
    assert simulation.column("age").tolist() == [20]
    with open_run(tmp_path / "run") as run:
        assert run["swimming"].values.ravel().tolist() == [0, 10, 20]


def test_the_page_of_terms_holds_a_cell_with_a_floor(page_of_terms: ModuleType) -> None:
    gravity, floor = page_of_terms.Gravity(weight=0.1), page_of_terms.Floor(height=-4.5)
    free, held = moved_by(gravity, time=80), moved_by(gravity, floor, time=80)
    assert free[2] < -2.8
    assert -1.5 < held[2] < 0


def test_the_page_of_terms_holds_a_cell_in_a_well(page_of_terms: ModuleType) -> None:
    ball = Cell(name="a", shape=Sphere(center=(3, 0, 0), radius=4))
    numerics = Numerics(solver="band", threads=1, dt=0.5)
    physics = Physics(terms=[page_of_terms.Well(k=0.05)])
    simulation = Simulation(Scene(cells=[ball], physics=physics, numerics=numerics))
    simulation.run(until=20)
    begin = simulation.centroids[0, 0]
    simulation.run(until=40)
    rate = np.log(begin / simulation.centroids[0, 0]) / 20
    np.testing.assert_allclose(rate, 0.05 / physics.tau, rtol=0.03)


def test_the_page_of_terms_pushes_where_the_surface_faces(page_of_terms: ModuleType) -> None:
    moved = moved_by(page_of_terms.Protrude())
    assert moved[0] > 0.2
    np.testing.assert_allclose(moved[1:], 0, atol=1e-3)


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


def modules_with_examples() -> Iterator[str]:
    for path in sorted((ROOT / "morphosim").rglob("*.py")):
        if ">>> " in path.read_text(encoding="utf-8"):
            parts = path.relative_to(ROOT).with_suffix("").parts
            yield ".".join(parts).removesuffix(".__init__")


@pytest.mark.parametrize("name", list(modules_with_examples()))
@pytest.mark.usefixtures("own_variables")
def test_docstrings_say_what_happens(name: str) -> None:
    assert doctest.testmod(import_module(name)).failed == 0
