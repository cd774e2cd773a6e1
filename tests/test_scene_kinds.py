"""Objects that a scene file names: those of the tables, and a user's own."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from morphosim import (
    Cell,
    Division,
    Duration,
    PhysicsChange,
    Removal,
    Scene,
    Sphere,
    Stage,
    Steady,
    When,
    load_scene,
    save_scene,
)
from morphosim.geometry.confinement import CONFINEMENTS
from morphosim.geometry.shapes import SHAPES
from morphosim.scene.ends import ENDS
from morphosim.scene.events import EVENTS
from morphosim.scene.fingerprint import settings

MODULE = '''
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

if TYPE_CHECKING:
    from decimal import Decimal


@dataclass(frozen=True, kw_only=True)
class Tube:
    """Walls of a tube along x."""

    radius: float
    length: float = 20.0

    def depth(self, x, y, z):
        return np.minimum(self.radius - np.hypot(y, z), self.length / 2 - np.abs(x))

    def field(self, x, y, z):
        return 1.0 * (self.depth(x, y, z) <= 0)

    def bounds(self):
        high = np.array([self.length / 2, self.radius, self.radius])
        return -high, high


@dataclass(frozen=True, kw_only=True, eq=False)
class Cloud:
    """Balls about points."""

    points: NDArray[np.float64]
    radii: NDArray[np.float64] | None = None
    shift: ArrayLike = (0.0, 0.0, 0.0)
    exact = True

    @property
    def volume(self):
        return 100.0

    def depth(self, x, y, z):
        return 5 - np.sqrt(x**2 + y**2 + z**2)

    def bounds(self):
        return np.full(3, -5.0), np.full(3, 5.0)


@dataclass(frozen=True)
class AtCount:
    """Ends with a number of cells."""

    count: int
    looks_back = False
    every_step = True

    def reached(self, speeds, elapsed, simulation):
        return len(simulation.names) >= self.count


@dataclass(frozen=True, eq=False)
class Weigh:
    weights: NDArray[np.float64]

    def apply(self, simulation):
        pass


@dataclass(frozen=True)
class Freeze:
    cells: tuple = ()

    def apply(self, simulation):
        simulation.change_cells(self.cells, frozen=True)


@dataclass
class Foreign:
    value: "Decimal" = 0

    def apply(self, simulation):
        pass


class Bare:
    def apply(self, simulation):
        pass


def crowded(simulation):
    return len(simulation.names) > 3


def outer(simulation):
    return []


class Holder:
    def ask(self, simulation):
        return True
'''


@pytest.fixture
def mine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """A user's module, which can be imported."""
    (tmp_path / "tissue_parts.py").write_text(MODULE, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    import tissue_parts  # type: ignore[import-not-found]

    return tissue_parts


def scene(*events: Any, end: Any = None, shape: Any = None, **options: Any) -> Scene:
    shape = shape or Sphere(center=(0, 0, 0), radius=4)
    stages = [Stage(name="s", end=end or Duration(10), events=events)]
    return Scene(cells=[Cell(name="m", shape=shape, volume=100.0)], stages=stages, **options)


def round_trip(chosen: Scene, folder: Path) -> Scene:
    save_scene(chosen, folder / "scene.toml")
    return load_scene(folder / "scene.toml")


def test_classes_of_a_users_module_survive_a_file(mine: Any, tmp_path: Path) -> None:
    walls, event, end = mine.Tube(radius=9.0), mine.Freeze(cells=("m",)), mine.AtCount(2)
    shape = mine.Cloud(points=np.arange(6.0).reshape(2, 3), radii=np.array([1.0, 2.0]))
    loaded = round_trip(scene(event, end=end, shape=shape, confinement=walls), tmp_path)
    assert loaded.confinement == walls
    assert loaded.stages[0].end == end
    assert loaded.stages[0].events[0].cells == ["m"]
    read = loaded.cells[0].shape
    assert type(read) is mine.Cloud
    np.testing.assert_array_equal(read.points, shape.points)
    np.testing.assert_array_equal(read.radii, shape.radii)
    assert 'use = "tissue_parts:Tube"' in (tmp_path / "scene.toml").read_text(encoding="utf-8")


def test_a_fingerprint_tells_a_users_classes_apart(mine: Any) -> None:
    def said(radius: float, count: int, weights: Any) -> Any:
        chosen = scene(
            mine.Weigh(weights), end=mine.AtCount(count), confinement=mine.Tube(radius=radius)
        )
        return settings(chosen)

    first = said(9.0, 2, np.zeros(3))
    assert first == said(9.0, 2, np.zeros(3))
    assert first["confinement"] != said(8.0, 2, np.zeros(3))["confinement"]
    assert first["stages"] != said(9.0, 3, np.zeros(3))["stages"]
    assert first["stages"] != said(9.0, 2, np.ones(3))["stages"]


def test_functions_of_a_module_survive_a_file(mine: Any, tmp_path: Path) -> None:
    chosen = scene(Removal(rule=mine.outer), end=When(mine.crowded))
    loaded = round_trip(chosen, tmp_path)
    assert loaded.stages[0].end == When(mine.crowded)
    assert loaded.stages[0].events == (Removal(rule=mine.outer, cells=[]),)


def test_a_row_of_a_table_is_all_that_a_kind_needs(
    mine: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for table, kind, cls in (
        (CONFINEMENTS, "tube", mine.Tube),
        (SHAPES, "cloud", mine.Cloud),
        (ENDS, "count", mine.AtCount),
        (EVENTS, "freeze", mine.Freeze),
    ):
        monkeypatch.setitem(table, kind, cls)
    shape = mine.Cloud(points=np.zeros((1, 3)))
    chosen = scene(
        mine.Freeze(("m",)), end=mine.AtCount(2), shape=shape, confinement=mine.Tube(radius=9.0)
    )
    loaded = round_trip(chosen, tmp_path)
    text = (tmp_path / "scene.toml").read_text(encoding="utf-8")
    for kind in ("tube", "cloud", "count", "freeze"):
        assert f'kind = "{kind}"' in text
    assert settings(loaded) == settings(chosen)
    (tmp_path / "scene.toml").write_text(text.replace('"tube"', '"tub"'), encoding="utf-8")
    with pytest.raises(ValueError, match=r"confinement\.kind = 'tub' .* did you mean 'tube'"):
        load_scene(tmp_path / "scene.toml")


CELL = '[[cells]]\nname = "m"\nshape = {kind = "sphere", center = [0, 0, 0], radius = 5}\n'


@pytest.mark.parametrize(
    ("table", "error"),
    [
        ('use = "no_such_module:Tube"', r"confinement\.use = 'no_such_module:Tube' cannot be loa"),
        ('use = "tissue_parts:Tub"', r"'tissue_parts:Tub' .*has no attribute 'Tub'.*PYTHONPATH"),
        ('use = "tissue_parts"', r"'tissue_parts' cannot be loaded as module:name"),
        ('use = "broken_parts:Tube"', r"'broken_parts:Tube' .*division by zero"),
        ('use = "tissue_parts:crowded"', r"'tissue_parts:crowded' is not a dataclass; decorate"),
        ('use = "tissue_parts:Bare"', r"'tissue_parts:Bare' is not a dataclass; decorate"),
        ('use = "tissue_parts:Tube"\nradis = 3', r"key of confinement = 'radis' .*'radius'\?"),
        ('use = "tissue_parts:Tube"\nkind = "box"', r"expected a table with a kind out of .* or"),
        ('use = "tissue_parts:Tube"', r"confinement: .*'radius'"),
        ('use = "tissue_parts:Freeze"', r"is not a confinement \(with field, depth and bounds\)"),
        ('use = "tissue_parts:Foreign"', r"tissue_parts:Foreign: name 'Decimal' is not defined"),
        ('kind = "none"\nradius = 3', r"key of confinement = 'radius' .* allowed are none"),
    ],
)
def test_what_a_scene_file_uses_is_checked(
    mine: Any, tmp_path: Path, table: str, error: str
) -> None:
    (tmp_path / "broken_parts.py").write_text("1 / 0\n")
    (tmp_path / "scene.toml").write_text(f"[confinement]\n{table}\n{CELL}", encoding="utf-8")
    with pytest.raises((ValueError, TypeError), match=error):
        load_scene(tmp_path / "scene.toml")


def test_what_no_file_can_say_is_named(mine: Any, tmp_path: Path) -> None:
    def local(simulation: Any) -> bool:
        return True

    for chosen, error in (
        (scene(end=When(local)), r"stage 's': <function .*local.* cannot be written"),
        (scene(end=When(mine.Holder().ask)), r"stage 's': <bound method .* cannot be written"),
        (scene(mine.Bare()), r"stage 's': .*Bare.* it can say \['division', .* and dataclasses"),
        (scene(PhysicsChange(values={"M": None})), "M = None cannot be written"),
    ):
        with pytest.raises(ValueError, match=error):
            save_scene(chosen, tmp_path / "scene.toml")
        assert not (tmp_path / "scene.toml").exists()


def test_an_array_that_is_no_image_may_be_said_in_the_file(mine: Any, tmp_path: Path) -> None:
    shape = 'shape = {use = "tissue_parts:Cloud", points = [[0, 0, 0], [1, 2, 3]]}\n'
    (tmp_path / "scene.toml").write_text(f'[[cells]]\nname = "m"\n{shape}', encoding="utf-8")
    read = load_scene(tmp_path / "scene.toml").cells[0].shape
    np.testing.assert_array_equal(read.points, [[0, 0, 0], [1, 2, 3]])


def test_values_of_a_division_may_be_arrays(tmp_path: Path) -> None:
    division = Division(cell="m", daughters=("a", "b"), axis=np.array([0.0, 1.0, 0.0]))
    loaded = round_trip(scene(division, end=Steady()), tmp_path)
    assert loaded.stages[0].events[0].axis == [0, 1, 0]
