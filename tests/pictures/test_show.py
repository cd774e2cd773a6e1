"""The viewer's page, in a real browser: opens offline, and shows what it is asked to show."""

import base64
import gzip
import io
import json
import sys
from collections.abc import Iterator
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from numpy.typing import NDArray

from morphosim import EllipsoidShell
from morphosim.pictures.meshcode import packed
from morphosim.pictures.meshes import cell_meshes, shell_mesh
from morphosim.pictures.show import Page, save_page, show, viewer_page
from morphosim.pictures.viewerdata import frame, run_data

from .browser import chromium
from .made import PAIR, Ball, made_run

if TYPE_CHECKING:
    from playwright.sync_api import Browser
    from playwright.sync_api import Page as Tab

pytestmark = pytest.mark.skipif(
    not all(map(find_spec, ("pyvista", "imageio"))), reason="the extra pictures is not installed"
)

WIDTH, HEIGHT = 900, 600
PHONE = {"viewport": {"width": 390, "height": 800}, "has_touch": True, "is_mobile": True}
FIRST = {"low": Ball((9.0, 12.0, 15.0), 6.0, "R"), "high": Ball((22.0, 12.0, 15.0), 6.0, "G", 3.0)}
LATER = {**FIRST, "new": Ball((15.0, 24.0, 15.0), 4.0, "R", -3.0)}
TOUCHING = {("low", "high"): 12.0}


@pytest.fixture(scope="module")
def data() -> dict[str, Any]:
    return run_data(made_run([FIRST, LATER], TOUCHING, parents={"new": "high"}), triangles=300)


@pytest.fixture(scope="module")
def browser() -> "Iterator[Browser]":
    with chromium() as started:
        yield started


@pytest.fixture(scope="module")
def file(data: dict[str, Any], tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("view") / "view.html"
    path.write_text(viewer_page(data), encoding="utf-8")
    return path


@pytest.fixture
def tab(browser: "Browser", file: Path, request: pytest.FixtureRequest) -> "Iterator[Tab]":
    """Page of the run; the test fails if it says an error or asks the network for anything.

    A parameter has further options of the browser's page.
    """
    size = {"width": WIDTH, "height": HEIGHT}
    opened = browser.new_page(**({"viewport": size} | getattr(request, "param", {})))
    said: list[str] = []
    opened.on("console", lambda message: said.append(message.text))
    opened.on("pageerror", lambda error: said.append(str(error)))
    opened.on("request", lambda request: said.append(request.url))
    opened.add_init_script(
        "window.told = []; addEventListener('message', ({data}) => told.push(data))"
    )
    opened.goto(file.as_uri())
    opened.wait_for_function("told.some((one) => one.morphosim === 'ready')")
    yield opened
    opened.close()
    ours = {file.as_uri(), "data:,"}
    assert [text for text in said if text not in ours] == []


def settled(tab: "Tab") -> None:
    """Wait until what was asked for is drawn, and names stand where they should.

    Which takes some pictures of the screen, and these take their time on a busy machine.
    """
    tab.wait_for_timeout(400)
    wait_for_pictures(tab, 10)


def wait_for_pictures(tab: "Tab", count: int) -> None:
    tab.evaluate(
        "left => new Promise(done => {"
        " const next = () => left-- ? requestAnimationFrame(next) : done(); next(); })", count
    )  # fmt: skip


def picture(tab: "Tab") -> NDArray[np.uint8]:
    """The 3-D view alone: (height, width, 3)."""
    from imageio.v3 import imread

    settled(tab)
    tab.add_style_tag(content="#labels, #legend, #axes, #scale, #cut-bar { opacity: 0 }")
    shot = tab.locator("#canvas").screenshot()
    return np.asarray(imread(io.BytesIO(shot))[..., :3])


def changed(before: NDArray[np.uint8], after: NDArray[np.uint8]) -> float:
    """Share of the pixels that differ well."""
    return float((np.abs(before.astype(int) - after).max(axis=2) > 30).mean())


def post(tab: "Tab", kind: str, **values: Any) -> None:
    tab.evaluate("(message) => postMessage(message, '*')", {"morphosim": kind, **values})


def told(tab: "Tab", kind: str) -> list[dict[str, Any]]:
    """Messages that the viewer has sent, which take a moment to arrive."""
    tab.wait_for_timeout(200)
    wait_for_pictures(tab, 5)
    return [one for one in tab.evaluate("told") if one.get("morphosim") == kind]


def names_shown(tab: "Tab") -> set[str]:
    settled(tab)
    script = "all => all.filter(x => x.style.visibility === 'visible').map(x => x.textContent)"
    return set(tab.eval_on_selector_all("#labels span", script))


def middle(tab: "Tab", name: str) -> tuple[float, float]:
    """Where the name of a cell stands."""
    settled(tab)
    box = tab.locator("#labels span", has_text=name).bounding_box()
    assert box is not None
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


def slide(tab: "Tab", control: str, value: float) -> None:
    tab.eval_on_selector(
        control, "(x, to) => { x.value = to; x.dispatchEvent(new Event('input')) }", value
    )


def test_opens_with_the_last_time(tab: "Tab") -> None:
    assert tab.inner_text("#title") == "made"
    assert tab.inner_text("#when") == "t = 10 · 3 cells"
    assert names_shown(tab) == {"low", "high", "new"}
    pixels = picture(tab)
    backdrop = np.abs(pixels.astype(int) - pixels[0, 0]).max(axis=2) < 20
    assert 0.1 < 1 - backdrop.mean() < 0.7


def test_cells_are_where_their_coordinates_say(tab: "Tab") -> None:
    low, high, new = (middle(tab, name) for name in ("low", "high", "new"))
    assert low[0] < new[0] < high[0]  # x to the right
    assert new[1] < min(low[1], high[1])  # y up


def test_slider_and_keys_change_the_time(tab: "Tab") -> None:
    last = picture(tab)
    slide(tab, "#time", 0)
    first = picture(tab)
    assert tab.inner_text("#when") == "t = 0 · 2 cells"
    assert changed(last, first) > 0.01
    assert names_shown(tab) == {"low", "high"}
    tab.keyboard.press("ArrowRight")
    assert changed(last, picture(tab)) < 0.001
    assert [one["index"] for one in told(tab, "shown")] == [0, 1]


def test_plays_from_the_start_to_the_end(tab: "Tab") -> None:
    tab.click("#play")
    tab.wait_for_function("told.filter((one) => one.morphosim === 'shown').length === 2")
    assert [one["index"] for one in told(tab, "shown")] == [0, 1]
    tab.wait_for_selector("#play[aria-label=Play]")


def test_hiding_a_cell(tab: "Tab") -> None:
    before = picture(tab)
    tab.get_by_label("Show low").uncheck()
    assert changed(before, picture(tab)) > 0.02
    assert names_shown(tab) == {"high", "new"}
    tab.click("#show-all")
    assert changed(before, picture(tab)) < 0.001


def test_search_narrows_what_the_buttons_hide(tab: "Tab") -> None:
    tab.fill("#search", "ew")
    assert tab.locator("#cells li:visible").count() == 1
    tab.click("#hide-all")
    assert names_shown(tab) == {"low", "high"}


def test_click_picks_a_cell_and_tells_its_figures(tab: "Tab") -> None:
    tab.mouse.click(*middle(tab, "high"))
    assert told(tab, "picked") == [{"morphosim": "picked", "cell": "high"}]
    card = tab.inner_text("#card")
    for text in ("high", "Type", "G", "932 µm³", "905 µm³", "+3.00 %", "Contacts", "12.0"):
        assert text in card
    tab.click("#card .neighbour")
    assert tab.inner_text("#card h2") == "low"
    tab.keyboard.press("Escape")
    assert tab.locator("#card").is_hidden()
    assert told(tab, "picked")[-1]["cell"] is None


@pytest.mark.parametrize("tab", [PHONE], indirect=True)
def test_a_tap_picks_a_cell_on_a_phone(tab: "Tab") -> None:
    assert tab.locator("#cells").is_hidden()
    tab.touchscreen.tap(*middle(tab, "high"))
    assert told(tab, "picked") == [{"morphosim": "picked", "cell": "high"}]
    tab.click("#panel-button")
    assert tab.inner_text("#card h2") == "high"
    assert tab.evaluate("document.documentElement.scrollWidth") == PHONE["viewport"]["width"]


def test_a_drag_turns_and_does_not_pick(tab: "Tab") -> None:
    before = picture(tab)
    x, y = middle(tab, "high")
    tab.mouse.move(x, y)
    tab.mouse.down()
    tab.mouse.move(x + 90, y + 20, steps=4)
    tab.mouse.up()
    assert changed(before, picture(tab)) > 0.02
    assert told(tab, "picked") == []


def test_reset_ends_a_turn_that_goes_on(tab: "Tab") -> None:
    before = picture(tab)
    x, y = middle(tab, "high")
    tab.mouse.move(x, y)
    tab.mouse.down()
    tab.mouse.move(x + 200, y + 60)
    tab.mouse.up()
    tab.eval_on_selector("#reset", "x => x.click()")  # at once, and without the focus's frame
    assert changed(before, picture(tab)) < 0.001


def test_colour_by_type(tab: "Tab") -> None:
    low, new = middle(tab, "low"), middle(tab, "new")
    tab.select_option("#by", "type")
    assert tab.locator("#legend li").all_inner_texts() == ["G", "R"]
    colours = tab.locator("#cells .swatch").evaluate_all("all => all.map(x => x.style.background)")
    assert colours[0] == colours[2] != colours[1]  # low and new, high
    pixels = picture(tab)
    top = tab.locator("#canvas").bounding_box()
    assert top is not None
    a, b = (pixels[int(y - top["y"]) + 12, int(x)].astype(int) for x, y in (low, new))
    assert np.abs(a / a.max() - b / b.max()).max() < 0.1  # the same but for the light


def test_colour_by_volume_error(tab: "Tab") -> None:
    tab.select_option("#by", "volume")
    assert "Volume error, %" in tab.inner_text("#legend")
    script = "all => all.map(x => x.style.background.match(/\\d+/g).map(Number))"
    _, high, new = tab.locator("#cells .swatch").evaluate_all(script)
    assert high[0] > high[2]  # too large: red
    assert new[0] < new[2]  # too small: blue


def test_cut_plane(tab: "Tab") -> None:
    before = picture(tab)
    tab.click("#cut")
    assert tab.inner_text("#cut-value") == "z = 15.0 µm"
    cut = picture(tab)
    assert changed(before, cut) > 0.02
    x, y = middle(tab, "low")
    top = tab.locator("#canvas").bounding_box()
    assert top is not None
    around = cut[int(y - top["y"]) - 25 : int(y - top["y"]) + 25, int(x) - 25 : int(x) + 25]
    assert np.ptp(around.reshape(-1, 3), axis=0).max() == 0  # filled, and flat
    tab.mouse.click(x, y)
    assert told(tab, "picked")[-1]["cell"] == "low"
    tab.locator(".segments span", has_text="x").click()
    slide(tab, "#cut-place", 0.05)
    assert names_shown(tab) == {"low"}
    tab.click("#cut-flip")
    assert names_shown(tab) == {"low", "high", "new"}


def test_mirror_reverses_z(browser: "Browser", tmp_path: Path) -> None:
    balls = {"near": Ball((15.0, 15.0, 25.0), 4.0), "far": Ball((15.0, 15.0, 5.0), 4.0)}
    path = tmp_path / "view.html"
    save_page(made_run([balls]), path, triangles=100)
    tab = browser.new_page(viewport={"width": WIDTH, "height": HEIGHT})
    tab.goto(path.as_uri())
    tab.wait_for_selector("#notice", state="hidden")
    tab.locator("#axes g").last.click()  # look along z
    assert names_shown(tab) == {"near"}
    tab.click("#mirror")
    assert names_shown(tab) == {"far"}
    tab.close()


def test_names_and_shell_can_be_switched_off(tab: "Tab", data: dict[str, Any]) -> None:
    assert tab.locator("#shell").is_hidden()
    shell = shell_mesh(EllipsoidShell(center=(15.0, 15.0, 15.0), semi_axes=(14.0, 14.0, 14.0)))
    post(tab, "load", data={**data, "shell": packed([shell], 1000)})
    with_shell = picture(tab)
    tab.click("#shell")
    assert np.abs(with_shell.astype(int) - picture(tab)).mean() > 1
    tab.click("#names")
    assert names_shown(tab) == set()


def test_of_two_runs_at_once_the_last_is_shown(tab: "Tab", data: dict[str, Any]) -> None:
    alone = picture(tab)
    shell = shell_mesh(EllipsoidShell(center=(5.0, 5.0, 5.0), semi_axes=(4.0, 4.0, 4.0)))
    other = {**data, "title": "other", "shell": packed([shell], 1000), "bounds": [[0] * 3, [9] * 3]}
    script = "all => all.forEach((data) => postMessage({ morphosim: 'load', data }, '*'))"
    tab.evaluate(script, [other, {**data, "title": "last"}])
    assert changed(alone, picture(tab)) < 0.001
    assert tab.inner_text("#title") == "last"


def bar(tab: "Tab") -> tuple[float, float]:
    """Length of the scale bar in µm and in pixels."""
    settled(tab)
    box = tab.locator("#scale i").bounding_box()
    assert box is not None
    length, unit, depth = tab.inner_text("#scale").split()
    assert (unit, depth) == ("µm,", "mid-depth")
    return float(length), box["width"]


def test_the_scale_bar_is_true_at_mid_depth_however_the_view_is_zoomed_and_turned(
    tab: "Tab",
) -> None:
    apart = FIRST["high"].center[0] - FIRST["low"].center[0]  # both at mid-depth along z
    bars = []
    for zoom in (0, -400, 900):
        tab.get_by_label("Look along z").dispatch_event("click")
        tab.mouse.move(300, 300)
        tab.mouse.wheel(0, zoom)
        seen = abs(middle(tab, "high")[0] - middle(tab, "low")[0])
        bars.append(bar(tab))
        assert bars[-1][1] / bars[-1][0] == pytest.approx(seen / apart, rel=0.05)
        assert 30 < bars[-1][1] < 0.25 * (WIDTH - 290) + 1
    assert len({length for length, _ in bars}) > 1
    tab.mouse.down()
    tab.mouse.move(450, 380, steps=4)
    tab.mouse.up()
    assert bar(tab) == pytest.approx(bars[-1])


def test_a_legend_of_many_types_is_all_in_view(browser: "Browser", tmp_path: Path) -> None:
    name = "a type of a long name, number {:02d}"
    balls = {
        f"c{k}": Ball((6.0 * (k % 6), 6.0 * (k // 6), 5.0), 2.0, name.format(k)) for k in range(30)
    }
    save_page(made_run([balls]), tmp_path / "view.html", triangles=50)
    for width, height in ((WIDTH, HEIGHT), (1500, 900), (420, 800)):
        tab = browser.new_page(viewport={"width": width, "height": height})
        tab.goto((tmp_path / "view.html").as_uri())
        tab.wait_for_selector("#notice", state="hidden")
        tab.select_option("#by", "type")
        view = tab.locator("#view").bounding_box()
        assert view is not None
        rows = tab.locator("#legend li")
        texts = rows.all_inner_texts()
        assert len(set(texts)) == 30
        assert all(text.endswith(f"{k:02d}") for k, text in enumerate(texts))
        boxes = [rows.nth(k).bounding_box() for k in range(30)]
        for box in filter(None, boxes):
            assert view["x"] <= box["x"]
            assert box["x"] + box["width"] <= view["x"] + view["width"]
            assert box["y"] + box["height"] <= view["y"] + view["height"] - 90  # above the axes
        tab.close()


def test_picture_is_a_png(tab: "Tab") -> None:
    from imageio.v3 import imread

    before = picture(tab)
    with tab.expect_download() as saved:
        tab.click("#picture")
    assert saved.value.suggested_filename == "made-t10.png"
    pixels = imread(saved.value.path())
    assert pixels.shape[:2] == (2 * before.shape[0], 2 * before.shape[1])
    assert len(np.unique(pixels.reshape(-1, pixels.shape[-1]), axis=0)) > 500
    assert changed(before, picture(tab)) < 0.001


def test_frames_of_a_running_simulation(tab: "Tab") -> None:
    meshes = cell_meshes(made_run([{"alone": Ball((15.0, 15.0, 15.0), 5.0)}]))
    live = frame(20.0, meshes, {"alone": {"volume": 500.0}}, stage="S")
    post(tab, "append", frame=live, follow=True)
    assert names_shown(tab) == {"alone"}
    assert tab.inner_text("#when") == "t = 20 · stage S · 1 cell"
    slide(tab, "#time", 0)
    settled(tab)
    post(tab, "append", frame={**live, "time": 30.0}, follow=True)
    settled(tab)
    assert tab.inner_text("#when") == "t = 0 · 2 cells"  # who has slid back is left there
    assert tab.get_attribute("#time", "max") == "3"


def test_parent_page_chooses_time_and_cell(tab: "Tab") -> None:
    post(tab, "time", index=0)
    post(tab, "select", cell="low")
    settled(tab)
    assert tab.inner_text("#when") == "t = 0 · 2 cells"
    assert tab.inner_text("#card h2") == "low"
    post(tab, "select", cell=None)
    settled(tab)
    assert tab.locator("#card").is_hidden()
    assert told(tab, "picked") == told(tab, "shown") == []


def test_messages_are_acted_on_in_their_order(tab: "Tab", data: dict[str, Any]) -> None:
    shell = shell_mesh(EllipsoidShell(center=(15, 15, 15), semi_axes=(14, 13, 12)))
    post(tab, "load", data=data | {"title": "other", "shell": packed([shell], 3000)})
    post(tab, "time", index=0)
    settled(tab)
    assert tab.inner_text("#title") == "other"
    assert tab.inner_text("#when") == "t = 0 · 2 cells"


def test_data_that_cannot_be_read_are_said_to_be(tab: "Tab", data: dict[str, Any]) -> None:
    broken = [one | {"mesh": base64.b64encode(b"no gzip").decode()} for one in data["frames"]]
    post(tab, "load", data=data | {"title": "broken", "frames": broken})
    settled(tab)
    assert "cannot show the cells" in tab.inner_text("#notice")
    post(tab, "load", data=data)  # and the next ones are shown
    settled(tab)
    assert tab.inner_text("#when") == "t = 10 · 3 cells"
    assert tab.locator("#notice").is_hidden()


def test_controls_wait_for_cells(browser: "Browser", data: dict[str, Any], tmp_path: Path) -> None:
    (tmp_path / "view.html").write_text(viewer_page(None), encoding="utf-8")
    tab = browser.new_page(viewport={"width": WIDTH, "height": HEIGHT})
    faults: list[str] = []
    tab.on("pageerror", lambda error: faults.append(str(error)))
    tab.goto((tmp_path / "view.html").as_uri())
    tab.click("#cut", force=True)
    tab.keyboard.press("c")
    assert tab.get_attribute("#cut", "aria-pressed") == "false"
    assert "Waiting for cells" in tab.inner_text("#notice")
    post(tab, "load", data=data)
    tab.wait_for_selector("#notice", state="hidden")
    tab.click("#cut")
    assert tab.get_attribute("#cut", "aria-pressed") == "true"
    tab.close()
    assert not faults


def test_cells_that_leave_the_bounds_come_into_view(tab: "Tab") -> None:
    far = {"low": FIRST["low"], "far": Ball((90.0, 12.0, 15.0), 6.0)}
    post(tab, "append", frame=frame(20.0, cell_meshes(made_run([far]))), follow=True)
    assert names_shown(tab) == {"low", "far"}
    assert 0 < middle(tab, "low")[0] < middle(tab, "far")[0] < WIDTH - 290  # the panel's width
    tab.click("#cut")
    tab.locator("#cut-bar label", has_text="x").click()
    slide(tab, "#cut-place", 1)
    settled(tab)
    assert tab.inner_text("#cut-value") == "x = 96.0 µm"


def test_show_only_this_holds_for_cells_to_come(tab: "Tab") -> None:
    slide(tab, "#time", 0)
    tab.mouse.click(*middle(tab, "high"))
    tab.get_by_role("button", name="Show only this").click()
    tab.keyboard.press("ArrowRight")
    assert names_shown(tab) == {"high"}


def test_play_after_a_pause_is_no_faster(browser: "Browser", tmp_path: Path) -> None:
    (tmp_path / "view.html").write_text(viewer_page(run_data(made_run([FIRST] * 5), triangles=50)))
    tab = browser.new_page()
    tab.add_init_script(
        "window.shown = []; addEventListener('message', ({data}) => "
        "data.morphosim === 'shown' && shown.push([data.index, performance.now()]))"
    )
    tab.goto((tmp_path / "view.html").as_uri())
    tab.wait_for_selector("#notice", state="hidden")
    for _ in range(3):
        tab.click("#play")
    tab.wait_for_selector("#play[aria-label=Play]")
    indices, moments = zip(*tab.evaluate("shown"), strict=True)
    assert indices == (0, 1, 2, 3, 4)
    assert np.diff(moments[1:]).min() > 400  # it waits for 500 ms
    tab.close()


def test_empty_viewer_in_a_frame_waits_for_a_run(
    browser: "Browser", data: dict[str, Any], tmp_path: Path
) -> None:
    (tmp_path / "viewer.html").write_text(viewer_page(None), encoding="utf-8")
    (tmp_path / "page.html").write_text(
        "<script>told = []; onmessage = (e) => told.push(e.data)</script>"
        "<iframe src='viewer.html' width=600 height=400></iframe>"
    )
    tab = browser.new_page()
    tab.goto((tmp_path / "page.html").as_uri())
    tab.wait_for_function("told.some((one) => one.morphosim === 'ready')")
    inner = tab.frame_locator("iframe")
    assert inner.locator("#notice").is_visible()
    tab.evaluate("(data) => frames[0].postMessage({morphosim: 'load', data}, '*')", data)
    inner.locator("#notice").wait_for(state="hidden")
    assert inner.locator("#when").inner_text() == "t = 10 · 3 cells"
    tab.close()


def test_nothing_is_wider_than_a_phone(browser: "Browser", file: Path) -> None:
    tab = browser.new_page(viewport={"width": 360, "height": 640})
    tab.goto(file.as_uri())
    tab.wait_for_selector("#notice", state="hidden")
    assert names_shown(tab) == {"low", "high", "new"}
    assert tab.evaluate("document.documentElement.scrollWidth") == 360
    assert tab.locator("#panel").is_hidden()
    tab.click("#panel-button")
    assert tab.locator("#cells li").first.is_visible()
    tab.close()


@pytest.mark.parametrize(
    "tab", [PHONE, PHONE | {"viewport": {"width": 640, "height": 360}}], indirect=True
)
def test_cells_fit_beside_the_panel_of_a_phone(tab: "Tab") -> None:
    tab.click("#panel-button")
    assert names_shown(tab) == {"low", "high", "new"}
    canvas = tab.locator("#canvas").bounding_box()
    assert canvas is not None
    assert min(canvas["width"], canvas["height"]) > 150


def unpacked(text: str) -> list[tuple[NDArray, NDArray]]:
    """Corners in µm and volume of packed meshes, read as the page does it: positions, faces."""
    raw = gzip.decompress(base64.b64decode(text))
    count = int(np.frombuffer(raw, "<u4", 1)[0])
    heads = [np.frombuffer(raw, "<u4", 2, 4 + 24 * k).astype(int) for k in range(count)]
    scales = [np.frombuffer(raw, "<f4", 4, 12 + 24 * k) for k in range(count)]
    at, total = 4 + 24 * count, sum(int(v) for v, _ in heads)
    places = _planes(raw[at : at + 6 * total])
    codes = _planes(raw[at + 8 * total :])
    found = []
    for (v, f), (*low, step) in zip(heads, scales, strict=True):
        folded, places = places[: 3 * v], places[3 * v :]
        change = np.where(folded % 2, -(folded + 1) // 2, folded // 2).reshape(v, 3)
        mine, codes = codes[: 3 * f], codes[3 * f :]
        following = np.cumsum(np.append(0, mine[:-1] == 0))
        found.append((np.cumsum(change, axis=0) * step + low, (following - mine).reshape(f, 3)))
    return found


def _planes(raw: bytes) -> NDArray[np.int64]:
    half = len(raw) // 2
    low, high = np.frombuffer(raw, np.uint8).reshape(2, half).astype(np.int64)
    return low + 256 * high


def volume(vertices: NDArray, faces: NDArray) -> float:
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    return float((a * np.cross(b, c)).sum() / 6)


def test_packed_meshes_are_those_that_were_packed() -> None:
    meshes = cell_meshes(made_run([LATER]))
    for (vertices, faces), mesh in zip(unpacked(packed(meshes, 400)), meshes, strict=True):
        assert len(faces) <= 400
        assert volume(vertices, faces) == pytest.approx(volume(mesh.vertices, mesh.faces), rel=2e-3)
        assert vertices.mean(axis=0) == pytest.approx(mesh.vertices.mean(axis=0), abs=0.3)


def test_few_bytes_for_each_cell() -> None:
    meshes = cell_meshes(made_run([PAIR]))
    assert len(packed(meshes, 700)) < 2 * 4000


def test_mesh_without_cells() -> None:
    assert unpacked(packed([], 100)) == []


def test_data_are_plain_and_complete(data: dict[str, Any]) -> None:
    assert json.loads(json.dumps(data))["frames"][1]["cells"] == ["low", "high", "new"]
    first = data["frames"][0]
    assert first["contacts"] == [(0, 1, 12.0)]
    assert first["surface"] == [None, None]  # the run has none
    assert first["types"] == ["R", "G"]
    assert data["cells"][2] == {"name": "new", "parent": "high"}
    assert data["bounds"][0] == pytest.approx([3.0, 6.0, 9.0], abs=0.1)
    assert [of["by"] for of in data["colourings"]] == ["cell", "type", "volume", "lineage"]


@pytest.mark.parametrize(
    ("times", "expected"),
    [
        (None, [0, 10, 20, 30]),
        (2, [0, 30]),
        (1, [30]),
        (9, [0, 10, 20, 30]),
        ([11, 29, 12], [10, 30]),
    ],
)
def test_times(times: Any, expected: list[float]) -> None:
    run = made_run([{"a": Ball((9.0, 9.0, 9.0), 2.0)}] * 4)
    assert [one["time"] for one in run_data(run, times, 50)["frames"]] == expected


@pytest.mark.parametrize("times", [[], 0, [np.nan]])
def test_times_that_are_none(times: Any) -> None:
    with pytest.raises(ValueError, match="times"):
        run_data(made_run([PAIR]), times)


def test_progress_is_told(tmp_path: Path) -> None:
    heard: list[tuple[str, int, int]] = []
    save_page(made_run([PAIR, PAIR]), tmp_path / "a.html", tell=lambda *told: heard.append(told))
    assert heard == [(1, 2), (2, 2)]


def test_page_is_written_whole_or_not_at_all(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="extension of"):
        save_page(made_run([PAIR]), tmp_path / "view.png")
    with pytest.raises(FileNotFoundError, match="there is no directory"):
        save_page(made_run([PAIR]), tmp_path / "none" / "view.html")
    assert list(tmp_path.iterdir()) == []


def test_triangles_are_shared_out() -> None:
    (few,) = run_data(made_run([PAIR]), total=600)["frames"]
    assert [len(faces) for _, faces in unpacked(few["mesh"])] == pytest.approx([300, 300], abs=5)


def test_many_types_have_colours_too() -> None:
    many = {f"c{k}": Ball((6.0 * k, 0, 0), 3.0, f"T{k}") for k in range(12)}
    (by_type,) = (
        of for of in run_data(made_run([many]), triangles=50)["colourings"] if of["by"] == "type"
    )
    assert len(set(by_type["types"].values())) == 12


def test_names_cannot_leave_the_data(data: dict[str, Any]) -> None:
    page = viewer_page({**data, "title": "</script><b>"})
    assert "</script><b>" not in page
    assert "&lt;/script&gt;&lt;b&gt; · MorphoSim" in page


def test_notebook_shows_a_frame() -> None:
    page = show(made_run([PAIR]), height=300)
    assert isinstance(page, Page)
    html = page._repr_html_()
    assert html.startswith('<iframe srcdoc="&lt;!doctype html&gt;')
    assert 'height="300"' in html


def test_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyvista", None)
    with pytest.raises(ImportError, match=r"needs the package pyvista; in a clone: .*pictures"):
        run_data(made_run([PAIR]))


@pytest.fixture(scope="module")
def tissue() -> dict[str, Any]:
    """More cells than the list has rows for, with numbers; the page begins cut, by generation."""
    balls = {
        f"c{k:03d}": Ball((6.0 * (k % 18), 6.0 * (k // 18), 5.0 * (k % 2)), 2.0) for k in range(324)
    }
    run = made_run([balls])
    run["generation"] = (("time", "cell"), np.arange(324.0)[None] % 5)
    run["pressure"] = (("time", "cell"), np.where(np.arange(324) == 1, np.nan, 0.25)[None])
    run["speed"] = (("time", "cell"), np.zeros((1, 324)))
    return run_data(run, triangles=20, by="generation", cut="-x=50")


def test_numbers_of_cells_are_in_the_data(tissue: dict[str, Any]) -> None:
    assert tissue["frames"][0]["values"] == {
        "generation": [float(k % 5) for k in range(324)],
        "pressure": [None if k == 1 else 0.25 for k in range(324)],
    }
    ways = {of["by"]: of for of in tissue["colourings"]}
    assert set(ways) == {"cell", "volume", "pressure", "generation", "lineage"}
    assert [text for _, text in ways["generation"]["scale"]["ticks"]] == ["0", "1", "2", "3", "4"]
    assert ways["generation"]["measured"] is True
    assert tissue["by"] == "generation"
    assert tissue["cut"] == {"axis": 0, "place": 50.0, "keepsLow": False}
    json.dumps(tissue)


def test_errors_of_what_the_page_begins_with() -> None:
    for options in ({"by": "age"}, {"cut": "w"}):
        with pytest.raises(ValueError, match=" is not known"):
            run_data(made_run([PAIR]), **options)


def test_many_cells_are_listed_in_part_and_found_by_name(
    browser: "Browser", tissue: dict[str, Any], tmp_path: Path
) -> None:
    (tmp_path / "view.html").write_text(viewer_page(tissue), encoding="utf-8")
    tab = browser.new_page(viewport={"width": WIDTH, "height": HEIGHT})
    faults: list[str] = []
    tab.on("pageerror", lambda error: faults.append(str(error)))
    tab.goto((tmp_path / "view.html").as_uri())
    tab.wait_for_selector("#notice", state="hidden")
    assert tab.locator("#cells li").count() == 301
    assert tab.locator("#cells li").last.inner_text() == "24 more: find them by name."
    assert tab.input_value("#by") == "generation"
    assert "Generation" in tab.inner_text("#legend")
    bar = tab.locator("#legend .bar").bounding_box()
    marks = [mark.bounding_box() for mark in tab.locator("#legend .ticks span").all()]
    assert bar is not None
    ends = [(box["x"], box["x"] + box["width"]) for box in filter(None, marks)]
    assert len(ends) == 5
    assert bar["x"] - 1 < ends[0][0]
    assert ends[-1][1] < bar["x"] + bar["width"] + 1
    assert all(a[1] < b[0] for a, b in pairwise(ends))
    script = "all => all.map(x => x.style.background)"
    colours = tab.locator("#cells .swatch").evaluate_all(script)
    assert colours[:5] == colours[5:10]
    assert len(set(colours)) == 5
    assert tab.inner_text("#cut-value") == "x = 50.0 µm"
    assert tab.locator("[name=axis]:checked").get_attribute("value") == "0"
    names = names_shown(tab)
    assert names
    assert all(6 * (int(name[1:]) % 18) + 2 > 50 for name in names)
    tab.fill("#search", "c32")
    assert tab.locator("#cells li:visible").count() == 4
    before = picture(tab)
    tab.click("#hide-all")
    assert changed(before, picture(tab)) > 0.0005
    tab.fill("#search", "nobody")
    assert tab.locator("#cells li:visible").all_inner_texts() == ["No such cell."]
    tab.close()
    assert not faults
