"""Pictures: every cell where it should be, in its colour, with its name; errors of one line."""

import sys
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import xarray as xr
from numpy.typing import NDArray

from morphosim import BoxWalls, EllipsoidShell
from morphosim.accessor import MorphoAccessor
from morphosim.pictures import needs, sight
from morphosim.pictures.camera import MARGIN, View, camera, directions, swept, turned
from morphosim.pictures.film import film
from morphosim.pictures.plot import draw, plot, render
from morphosim.pictures.show import show

from .made import BOX, GREEN, HIGH, LOW, PAIR, RED, Ball, all_touch, crowd, made_run

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.text import Text
    from matplotlib.transforms import BboxBase

    from morphosim.pictures.painter import Panel

pytestmark = pytest.mark.skipif(
    not all(map(find_spec, ("pyvista", "matplotlib"))), reason="the extra pictures is not installed"
)

SIZE = 240
COLOURS = {"R": RED, "G": GREEN}
FROM_FRONT: dict[str, Any] = {"by": "type", "colours": COLOURS, "bounds": BOX, "size": (SIZE, SIZE)}


@pytest.fixture(scope="module")
def pair() -> xr.Dataset:
    return made_run([PAIR], {("low", "high"): 12.0})


def where(image: NDArray, band: int) -> tuple[float, float]:
    """Middle (column, row) of what is of a primary colour; at least a few pixels are."""
    others = np.delete(image.astype(int), band, axis=2).max(axis=2)
    rows, columns = np.nonzero(image[..., band].astype(int) > others + 60)
    assert len(rows) > 50
    return (columns.min() + columns.max()) / 2, (rows.min() + rows.max()) / 2


def expected(right: float, up: float) -> tuple[float, float]:
    """Pixel of a point so far (µm) to the right and up of the middle of `BOX`."""
    per_micrometre = SIZE * (1 - 2 * MARGIN) / 30
    return SIZE / 2 + right * per_micrometre, SIZE / 2 - up * per_micrometre


@pytest.mark.parametrize(
    ("view", "mirror", "right", "up"),
    [
        ("z", False, (0, 1), (1, 1)), ("x", False, (2, -1), (1, 1)), ("y", False, (0, 1), (2, -1)),
        ("-z", False, (0, -1), (1, 1)), ("-x", False, (2, 1), (1, 1)),
        ("-y", False, (0, 1), (2, 1)),
        ("z", True, (0, 1), (1, 1)), ("x", True, (2, 1), (1, 1)), ("y", True, (0, 1), (2, 1)),
        ((0, 0, 2.5), False, (0, 1), (1, 1)),
    ],
)  # fmt: skip
def test_cells_are_where_they_should_be(
    pair: xr.Dataset, view: str, mirror: bool, right: tuple[int, int], up: tuple[int, int]
) -> None:
    image = render(pair, view=view, mirror=mirror, **FROM_FRONT)
    assert image.shape == (SIZE, SIZE, 3)
    assert image.dtype == np.uint8
    for band, center in enumerate((LOW, HIGH)):
        offset = np.array(center) - 15
        place = expected(right[1] * offset[right[0]], up[1] * offset[up[0]])
        np.testing.assert_allclose(where(image, band), place, atol=1.5)


def test_what_is_in_front_hides_what_is_behind_and_mirroring_swaps_them() -> None:
    run = made_run([{"near": Ball((15, 15, 22), type="R"), "far": Ball((15, 15, 8), type="G")}])
    front, mirrored = (
        render(run, mirror=mirror, **FROM_FRONT)[SIZE // 2, SIZE // 2].astype(int)
        for mirror in (False, True)
    )
    assert front[0] > front[1] + 60
    assert mirrored[1] > mirrored[0] + 60


def test_nothing_of_a_deep_scene_is_cut_off() -> None:
    ends = {"near": Ball((5, 5, 2500), type="R"), "far": Ball((25, 25, -2500), type="G")}
    image = render(made_run([ends]), by="type", colours=COLOURS, bounds=BOX, size=(SIZE, SIZE))
    for band, side in enumerate((-10, 10)):
        np.testing.assert_allclose(where(image, band), expected(side, side), atol=1.5)


def test_all_that_by_may_be_gives_other_pictures() -> None:
    balls = {"AB": Ball(LOW, type="R"), "P1": Ball(HIGH, type="G", error=-3)}
    run = made_run([balls], stages=["two"])
    images = [render(run, by=by, size=(120, 120)) for by in ("cell", "type", "volume", "stage")]
    for k, image in enumerate(images):
        assert all((image != other).any() for other in images[:k])


def test_a_picture_without_cells_is_white() -> None:
    run = made_run([{"faint": Ball((5, 5, 5), 0.5)}])
    run["phi"] *= 0.5
    assert (render(run, size=(64, 64)) == 255).all()


@pytest.fixture
def confined(monkeypatch: pytest.MonkeyPatch) -> Iterator[dict]:
    """Runs that are made are confined by `["walls"]`."""
    known: dict = {"walls": None}
    monkeypatch.setattr(sight, "run_confinement", lambda run: known["walls"])
    return known


def test_the_shell_is_seen_through_and_the_box_is_black_lines(
    pair: xr.Dataset, confined: dict
) -> None:
    options = FROM_FRONT | {"bounds": ((-1, -1, -1), (31, 31, 31))}
    bare = render(pair, **options).astype(int)
    confined["walls"] = EllipsoidShell(center=(15, 15, 15), semi_axes=(15, 15, 15))
    shell = render(pair, **options).astype(int)
    middle = shell[SIZE // 2, SIZE // 2]
    assert (middle > 150).all()
    assert (middle < 250).all()
    for band in (0, 1):
        np.testing.assert_allclose(
            where(shell.astype(np.uint8), band), where(bare.astype(np.uint8), band), atol=1.5
        )
    confined["walls"] = BoxWalls(lower=BOX[0], upper=BOX[1])
    box = render(pair, **options).astype(int)
    dark = (box.max(axis=2) < 100) & (bare.min(axis=2) > 250)
    per_micrometre = SIZE * (1 - 2 * MARGIN) / 32
    rows, columns = np.nonzero(dark)
    assert columns.max() - columns.min() == pytest.approx(30 * per_micrometre, abs=3)
    assert rows.max() - rows.min() == pytest.approx(30 * per_micrometre, abs=3)
    hidden = render(pair, shell=False, **options)
    np.testing.assert_array_equal(hidden, bare)


def drawn(run: xr.Dataset, size: float = 4, **options: Any) -> tuple["Figure", "Panel"]:
    """Figure of one panel, and the panel."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(size, size), dpi=100)
    FigureCanvasAgg(figure)
    panel = MorphoAccessor(run).draw(figure.add_axes((0, 0, 1, 1)), **options)
    return figure, panel


def boxes_of(figure: "Figure", names: set[str]) -> dict[str, "BboxBase"]:
    """Where in the figure texts are that are names."""
    figure.canvas.draw()
    texts = figure.axes[0].texts
    return {text.get_text(): text.get_window_extent() for text in texts if text.get_text() in names}


def test_names_lie_on_their_cells_and_do_not_overlap() -> None:
    balls = crowd(25)
    figure, panel = drawn(made_run([balls]), 6)
    boxes = boxes_of(figure, set(balls))
    assert set(boxes) == set(balls)
    height = panel.seen.shape[0]
    for name, box in boxes.items():
        column, row = (box.x0 + box.x1) / 2, height - (box.y0 + box.y1) / 2
        assert panel.names[panel.seen[round(row), round(column)]] == name
        assert not any(box.overlaps(other) for key, other in boxes.items() if key != name)


def test_names_are_in_front_of_walls_that_cross_them(confined: dict) -> None:
    confined["walls"] = BoxWalls(lower=(15, 15, 0), upper=(30, 30, 30))  # an edge in the middle
    run = made_run([{"a name on an edge": Ball((15, 15, 15), 10, type="R")}])
    figure, panel = drawn(run, bounds=BOX, by="type", colours={"R": (0.9, 0.9, 0.2)})
    assert panel.lines is not None
    (box,) = boxes_of(figure, {"a name on an edge"}).values()
    height, ((column, row),) = panel.seen.shape[0], panel.camera.pixels([(15, 15, 30)]).round()
    at, beside = int(row), slice(int(column) + 5, int(column) + 60)
    assert panel.lines[at - 2 : at + 3, beside].any(axis=0).all()
    assert (panel.seen[at, beside] == 0).all()  # in front of the cell
    rows = slice(round(height - box.y1), round(height - box.y0))
    assert not panel.lines[rows, round(box.x0) : round(box.x1)].any()
    (text,) = (one for one in figure.axes[0].texts if one.get_text() == "a name on an edge")
    assert text.get_path_effects()  # a rim, where there is no other place


@pytest.mark.parametrize(("size", "count"), [((5, 4), 30), ((3, 3), 9), ((2, 2), 9), (None, 30)])
def test_figures_of_any_size_have_no_text_over_another(
    size: tuple[float, float] | None, count: int
) -> None:
    names = [f"a cell of the second lineage, no. {k:06d}" for k in range(count)]
    balls = {
        name: ball._replace(type=f"type {k:02d}")
        for k, (name, ball) in enumerate(zip(names, crowd(count).values(), strict=True))
    }
    figure = plot(made_run([balls], all_touch(names)), by="type", size=size)
    figure.draw_without_rendering()
    texts = [
        text
        for ax in figure.axes
        for text in (*ax.texts, ax.title, *(_ticks(ax) if ax.axison else ()))
    ]
    (legend,) = figure.legends
    texts += [*legend.get_texts(), figure._suptitle]  # type: ignore[attr-defined]
    boxes = [text.get_window_extent() for text in texts if text.get_text()]
    assert len(boxes) > 3
    assert not any("e+" in text.get_text() for text in texts)  # scale bars say what can be seen
    for k, box in enumerate(boxes):
        assert figure.bbox.x0 - 1 <= box.x0 < box.x1 <= figure.bbox.x1 + 1
        assert figure.bbox.y0 - 1 <= box.y0 < box.y1 <= figure.bbox.y1 + 1
        assert not any(_cover(box, other) for other in boxes[:k])


def test_hidden_cells_have_no_names_and_small_ones_have_them_beside() -> None:
    balls = {
        "front": Ball((15, 15, 22), 6),
        "behind": Ball((15, 15, 8), 5),
        "speck": Ball((3, 3, 15), 0.6),
    }
    figure, _ = drawn(made_run([balls]), bounds=BOX)
    boxes = boxes_of(figure, set(balls))
    assert set(boxes) == {"front", "speck"}
    bare, _ = drawn(made_run([balls]), bounds=BOX, names=False)
    assert boxes_of(bare, set(balls)) == {}


def test_the_scale_bar_is_as_long_as_it_says(pair: xr.Dataset) -> None:
    figure, panel = drawn(pair, bounds=BOX)
    (text,) = [t.get_text() for t in figure.axes[0].texts if t.get_text().endswith("µm")]
    (bar,) = figure.axes[0].lines
    left, right = bar.get_xdata()
    assert (right - left) * panel.camera.scale == pytest.approx(float(text.split()[0]))
    assert float(text.split()[0]) == 5


def test_a_whole_figure_says_time_stage_types_and_contacts(tmp_path: Path) -> None:
    run = made_run([PAIR, PAIR], {("low", "high"): 12.0}, stages=["early", "late"])
    path = tmp_path / "picture.png"
    figure = plot(run, by="type", path=path)
    assert path.read_bytes()[:4] == b"\x89PNG"
    assert figure._suptitle.get_text() == "made, t = 10, late"  # type: ignore[attr-defined]
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == ["G", "R"]
    matrix = next(ax for ax in figure.axes if ax.get_title().startswith("contact area"))
    assert [t.get_text() for t in matrix.get_yticklabels()] == ["high", "low"]
    np.testing.assert_array_equal(matrix.images[0].get_array(), [[0, 12], [12, 0]])
    assert [t.get_text() for t in matrix.texts] == ["12", "12"]
    assert len([ax for ax in figure.axes if ax.images and ax is not matrix]) == 3
    assert figure._repr_png_()[:4] == b"\x89PNG"


def test_no_text_of_a_figure_is_cut_or_over_another() -> None:
    names = [f"ABplap{k:02d}" for k in range(14)]
    balls = dict(zip(names, crowd(14).values(), strict=True))
    figure = plot(made_run([balls], all_touch(names)), by="volume")
    figure.canvas.draw()
    whole = figure.bbox
    boxes = [
        text.get_window_extent()
        for ax in figure.axes
        for text in (*ax.texts, ax.title, *(_ticks(ax) if ax.axison else ()))
        if text.get_text() and text.get_visible()
    ]
    assert len(boxes) > 50
    for k, box in enumerate(boxes):
        assert whole.x0 <= box.x0
        assert whole.y0 <= box.y0
        assert box.x1 <= whole.x1
        assert box.y1 <= whole.y1
        assert not any(_cover(box, other) for other in boxes[:k])


def _ticks(ax: "Axes") -> "list[Text]":
    return [*ax.get_xticklabels(), *ax.get_yticklabels()]


def _cover(a: "BboxBase", b: "BboxBase") -> bool:
    """Whether two boxes share more than a pixel's rim."""
    wide = min(a.x1, b.x1) - max(a.x0, b.x0)
    high = min(a.y1, b.y1) - max(a.y0, b.y0)
    return wide > 1 and high > 1


@pytest.mark.parametrize(("views", "count"), [("corner", 1), (["z", (1, 1, 1)], 2), ((1, 0, 0), 1)])
def test_views_may_be_one_or_several_and_a_size_given(
    pair: xr.Dataset, views: object, count: int
) -> None:
    figure = plot(pair, views=views, matrix=False, size=(5, 4))  # type: ignore[arg-type]
    assert len(figure.axes) == count
    assert figure.get_size_inches().tolist() == [5, 4]


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"by": "age"}, ValueError, "by = 'age' is not known; allowed are 'cell'"),
        ({"views": "top"}, ValueError, "views = 'top' is not known"),
        ({"views": ["z", "w"]}, ValueError, "view = 'w' is not known"),
        ({"views": (0, 0, 0)}, ValueError, r"view = \(0, 0, 0\) is no direction"),
        ({"views": []}, ValueError, "views is empty"),
        ({"mirror": "yes"}, TypeError, "mirror = 'yes' is not true or false"),
        ({"size": (1, 4)}, ValueError, "size = 1.0 is not allowed"),
        ({"time": "last"}, TypeError, "time = 'last' is not a number"),
        ({"path": "picture.bmp2"}, ValueError, "extension of picture.bmp2 = '.bmp2' is not known"),
        ({"path": "nowhere/picture.png"}, FileNotFoundError, "there is no directory nowhere"),
    ],
)
def test_errors(pair: xr.Dataset, options: dict, error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        plot(pair, **options)


def test_one_time_of_a_run_is_refused(pair: xr.Dataset, tmp_path: Path) -> None:
    one = pair.isel(time=-1)
    for picture in (plot, lambda run: film(run, tmp_path / "a.mp4"), show):
        with pytest.raises(ValueError, match="the whole run"):
            picture(one)


def test_bounds_that_are_none_are_refused(pair: xr.Dataset) -> None:
    with pytest.raises(ValueError, match="the second corner must exceed the first"):
        render(pair, bounds=((0, 0, 0), (1, 0, 1)))


def test_sizes_that_cannot_be_drawn_are_refused(pair: xr.Dataset) -> None:
    with pytest.raises(ValueError, match="size = 1000000 is not allowed: it must be >= 8 and <= 8"):
        render(pair, size=(10**6, 64))
    with pytest.raises(ValueError, match=r"size = 49\.0 is not allowed: .* >= 2 and <= 48"):
        plot(pair, size=(49, 5))
    with pytest.raises(ValueError, match="height = 100000 is not allowed"):
        show(pair, 1, height=100_000)
    from matplotlib.figure import Figure

    ax = Figure(figsize=(90, 90), dpi=100).add_axes((0, 0, 1, 1))
    with pytest.raises(ValueError, match="size = 9000 is not allowed"):
        draw(ax, pair)


@pytest.mark.parametrize("factor", [1e-300, 1e25])
def test_a_direction_may_have_any_length(factor: float) -> None:
    expected = directions((1, 2, 3))
    np.testing.assert_allclose(directions(np.array([1, 2, 3]) * factor), expected)


@pytest.mark.parametrize("package", ["pyvista", "matplotlib"])
def test_a_missing_package_is_named(
    pair: xr.Dataset, package: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    message = rf"needs the package {package}; in a clone: pip install '\.\[pictures\]'"
    with pytest.raises(ImportError, match=message):
        plot(pair)


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have what it takes")
def test_a_system_without_a_library_to_draw_with_says_so(
    pair: xr.Dataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(needs, "OFF_SCREEN", ("libNone.so.1",))
    monkeypatch.delenv("DISPLAY", raising=False)
    with pytest.raises(
        OSError, match="needs the library EGL or OSMesa, and the system has neither"
    ):
        render(pair)


@pytest.mark.parametrize("view", ["z", "corner", (1, 0.2, -1)])
def test_a_camera_that_goes_around_neither_zooms_nor_cuts(view: View) -> None:
    points = np.array([LOW, HIGH, (1.0, 2.0, 30.0)])
    held = swept(points)
    first = camera(view, held, (SIZE, SIZE))
    for angle in (0, 33, 90, 200):
        now = camera(turned(view, angle), held, (SIZE, SIZE))
        assert now.scale == pytest.approx(first.scale, rel=0.005)
        assert now.pixels(points).min() > 0
        assert now.pixels(points).max() < SIZE
