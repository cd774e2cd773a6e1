"""What objects show of themselves: short, quickly, and safe in a notebook."""

import re
import time
from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import morphosim as ms
from morphosim import (
    Attraction,
    Cell,
    Division,
    Duration,
    Field,
    LabelImage,
    Mask,
    MaskWalls,
    Numerics,
    Physics,
    Removal,
    RunWriter,
    Scene,
    Simulation,
    Sphere,
    Stage,
    VolumeCourse,
)
from morphosim.cell_field import CellField
from morphosim.pictures.show import Page

LONGEST = 500
COUNTS = (1, 100, 10_000)
LONG = "a name of 96 characters " * 4  # 100 are allowed
HOSTILE = "<script>alert('x')</script>&amp;"


def scene(count: int, prefix: str = "c", **options: Any) -> Scene:
    cells = [
        Cell(name=f"{prefix}{k}", type="AB"[k % 2], shape=Sphere(center=(9.0 * k, 0, 0), radius=3))
        for k in range(count)
    ]
    return Scene(cells=cells, **options)


def simulation(names: list[str], **options: Any) -> Simulation:
    cells = [
        Cell(name=name, shape=Sphere(center=(9.0 * k, 0, 0), radius=3))
        for k, name in enumerate(names)
    ]
    return Simulation(Scene(cells=cells, numerics=Numerics(S=7, threads=1), **options))


class Tags(HTMLParser):
    """Tags of a page, and its texts."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.tags, self.texts, self.open = [], [], 0
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: Any) -> None:
        self.tags.append(tag)
        self.open += tag != "br"

    def handle_endtag(self, tag: str) -> None:
        self.open -= 1

    def handle_data(self, data: str) -> None:
        self.texts.append(data)


@pytest.mark.parametrize("count", COUNTS)
def test_a_scene_says_its_main_facts_in_a_few_lines(count: int) -> None:
    shown = scene(count, name="tissue", duration=250, physics=Physics(sigma=0.5))
    begin = time.perf_counter()
    text, page = repr(shown), shown._repr_html_()
    assert time.perf_counter() - begin < 0.5
    assert len(text) < LONGEST
    assert len(page) < 4000
    for fact in ("'tissue'", f"{count}: c0", "σ = 0.5", "δt = 2", "open space", "250"):
        assert fact in text
    texts = Tags(page).texts
    assert {"Scene 'tissue'", "c0", "Sphere", "113.1"} <= set(texts)
    more = [text for text in texts if "more" in text]
    assert more == ([] if count == 1 else [f"{count}: c0, c1, c2, c3, … and {count - 4} more",
                                           f"and {count - 8} more"])  # fmt: skip


@pytest.mark.parametrize("count", [1, 12])
def test_a_simulation_says_where_it_is(count: int) -> None:
    shown = simulation([f"c{k}" for k in range(count)], name="tissue")
    shown.step(3)
    shown.stage = "sorting"
    text, page = repr(shown), shown._repr_html_()
    assert len(text) < LONGEST
    for fact in ("'tissue'", "t = 6", "3 of δt = 2", f"{count}: c0", "sorting"):
        assert fact in text
        assert any(fact in part for part in Tags(page).texts)
    texts = Tags(page).texts
    assert f"{shown.volumes[0]:.4g}" in texts
    assert "113.1" in texts
    assert "type" not in texts  # no cell has one
    if count > 1:
        shown.remove(["c3"])
        assert "c3" in repr(shown).split("removed")[1]
        assert repr(shown.cells) == "<11 living: c0, c1, c2, c4, … and 7 more>"


def test_what_is_long_is_cut() -> None:
    parts = [Stage(name=f"{LONG}{k:02}", end=Duration(10)) for k in range(50)]
    shown = scene(30, LONG, name=LONG, description=LONG, stages=parts)
    assert len(repr(shown)) < LONGEST
    assert len(shown._repr_html_()) < 8000
    told = simulation([LONG, "b"], name=LONG)
    told.error = told.stage = 9 * LONG
    assert len(repr(told)) < LONGEST
    assert len(told._repr_html_()) < 4000


def test_names_are_escaped_in_notebooks() -> None:
    for shown in (scene(2, HOSTILE, name=HOSTILE), simulation([HOSTILE, "b"], name=HOSTILE)):
        page = Tags(shown._repr_html_())
        assert "script" not in page.tags
        assert set(page.tags) <= {"div", "b", "table", "tr", "td", "th"}
        assert page.open == 0
        assert HOSTILE in "".join(page.texts)


def field(n: int) -> np.ndarray:
    return np.pad(np.ones((n, n, n)), 2)


NAMES = [f"c{k}" for k in range(120)]
MATRIX = np.random.default_rng(0).uniform(0, 1, (120, 120))
MANY: dict[str, Callable[[], Any]] = {
    "attraction": lambda: Attraction.from_matrix(NAMES, MATRIX),
    "physics": lambda: Physics(
        sigma=Attraction.from_matrix(NAMES, MATRIX), kappa_by_type=dict.fromkeys(NAMES, 0.1)
    ),
    "numerics": Numerics,
    "mask": lambda: Mask(mask=field(40)),
    "field": lambda: Field(phi=field(40)),
    "cell of a mask": lambda: Cell(name="a", shape=Mask(mask=field(40)), volume=lambda t: 100 + t),
    "cell of a point": lambda: Scene.from_points(
        NAMES, MATRIX[:, :3] * 60, np.full(120, 50.0)
    ).cells[7],
    "course": lambda: VolumeCourse(times=np.arange(1e4), volumes=np.full(10_000, 9.0)),
    "walls": lambda: MaskWalls(inside=field(40)),
    "stage": lambda: Stage(
        name="s", end=Duration(9), physics={"kappa_by_type": dict.fromkeys(NAMES, 0.1)},
        events=[Division(cell=n, daughters=(f"{n}a", f"{n}p"), axis=(1, 0, 0)) for n in NAMES],
    ),
    "removal": lambda: Removal(cells=NAMES),
    "label image": lambda: LabelImage(labels=np.ones((50, 50, 50), int), spacing=0.5),
    "axis of a scan": lambda: ms.Axis(values=np.arange(1e5)),
    "field of a cell": lambda: CellField("a", np.zeros(3, np.int64), field(40)),
    "measurement": lambda: ms.measure_fields(simulation(["a", "b"]).fields, 0.5),
    "checkpoint": lambda: simulation(["a", "b"]).checkpoint(),
    "page": lambda: Page("<html>" * 10_000, 500),
    "lineage": lambda: ms.read_lineage(),
}  # fmt: skip


@pytest.mark.parametrize("kind", list(MANY))
def test_what_holds_much_is_shown_in_little(kind: str) -> None:
    shown = MANY[kind]()
    text = repr(shown)
    assert text.startswith(type(shown).__name__ + "(")
    assert len(text) < LONGEST
    assert "\n" not in text


def test_values_that_are_few_are_shown_as_they_are() -> None:
    cell = Cell(name="a", shape=Sphere(center=(1, 2, 3), radius=4), volume=250.0)
    assert repr(cell) == (
        "Cell(name='a', shape=Sphere(center=(1, 2, 3), radius=4), volume=250.0, type='', "
        "gamma=None, frozen=False, parent='')"
    )
    assert repr(VolumeCourse(times=np.array([0, 9.0]), volumes=(5, 6))) == (
        "VolumeCourse(times=[0.0, 9.0], volumes=(5, 6))"
    )
    mask = repr(Mask(mask=field(40)))
    assert "mask=<bool array of shape (44, 44, 44)>, origin=(0.0, 0.0, 0.0), spacing=0.5" in mask
    removal = repr(Removal(cells=NAMES))
    assert re.search(r"cells=\('c0', 'c1', 'c2', 'c3', … and 116 more\)", removal)


def test_a_writer_says_where_it_writes(tmp_path: Path) -> None:
    assert repr(RunWriter(tmp_path / "run", every=50)) == (
        f"RunWriter('{tmp_path / 'run'}', every=50, fields='packed')"
    )
