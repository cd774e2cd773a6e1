"""Every control of the page in a real browser, by what it does.

`uses` says which controls a test is of, and the last test here that there are no others.
"""

import re
import tomllib
import zipfile
from importlib import import_module
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from PIL import Image

from morphosim import open_run as run_of
from tests.app.application import (
    NAME_OF,
    NARROW,
    USED,
    WIDE,
    choose,
    chosen,
    clear,
    click_option,
    open_run,
    read_example,
    read_files,
    show_scene,
    state,
    type_in,
    uses,
    wait,
    wait_for_cells,
)

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Locator, Page


def button(page: "Page", name: str) -> "Locator":
    return page.get_by_role("button", name=name, exact=True)


def press(page: "Page", name: str) -> None:
    button(page, name).click()


def cell_names(page: "Page") -> list[str]:
    """Names in the table of cells; none where there is no table."""
    return [entry.input_value() for entry in page.locator("[aria-label^='Name of cell']").all()]


# ---------------------------------------------------------------------------------------------
# What to simulate
# ---------------------------------------------------------------------------------------------


@uses("Scene")
def test_the_scene_that_is_chosen_is_read(page: "Page") -> None:
    press(page, "Built-in scene")
    for name, count in (("single-cell", 1), ("celegans-8-strong", 8), ("single-cell", 1)):
        choose(page, "Scene", name)
        wait(page, f"state.loaded === '{name}' && !state.reading")
        page.get_by_role("heading", name=f"Cells of {name}").wait_for()
        assert chosen(page, "Scene") == name
        assert len(cell_names(page)) == count
        assert page.get_by_label("Name of the run").input_value() == f"runs/{name}"


@uses("Built-in scene", "Masks and table", "Label image")
def test_cells_are_those_of_the_tab(page: "Page") -> None:
    show_scene(page)
    scene = chosen(page, "Scene")
    press(page, "Label image")
    page.locator(".cells").wait_for(state="detached")
    assert not button(page, "Run").is_visible()
    read_example(page)
    assert cell_names(page) == ["A", "B", "C"]
    assert page.get_by_label("Name of the run").input_value() == "runs/masks"
    press(page, "Label image")
    page.locator(".cells").wait_for(state="detached")
    press(page, "Masks and table")  # what was read here is here
    page.locator(".cells").wait_for()
    assert cell_names(page) == ["A", "B", "C"]
    show_scene(page)
    assert page.get_by_role("heading", name=f"Cells of {scene}").is_visible()
    assert page.get_by_label("Name of the run").input_value() == f"runs/{scene}"
    press(page, "Masks and table")
    page.locator(".cells").wait_for(state="detached")


MASKS, TABLE, SHELL = "Cells: masks or saved fields", "Names and attraction", "Eggshell"


@uses(MASKS, f"{TABLE}.*", f"{SHELL}.*", f"Clear {MASKS}", f"Clear {TABLE}.*", f"Clear {SHELL}.*")
@uses("Voxel, µm", "Read files")
def test_files_of_the_published_program(page: "Page") -> None:
    press(page, "Masks and table")
    for masks, table, names in (
        ("masks.mat", "table.xlsx", ["A", "B", "C"]),
        ("pair.mat", "pair.csv", ["A", "B"]),
        ("masks.mat", "table.xlsx", ["A", "B", "C"]),
    ):
        choose(page, MASKS, masks)
        choose(page, TABLE, table)
        read_files(page)
        assert cell_names(page) == names
    assert page.get_by_label("Attraction from C to B").input_value() == "0.6"
    before = target_volumes(page)
    type_in(page, "Voxel, µm", "0.25")
    read_files(page)
    np.testing.assert_allclose(target_volumes(page), np.array(before) / 8, rtol=0.01)
    assert len(cell_names(page)) == 3
    type_in(page, "Voxel, µm", "")

    error = page.locator("#form_error")
    choose(page, SHELL, "pair.mat")
    press(page, "Read files")
    error.filter(has_text="PhiShell").wait_for()
    choose(page, SHELL, "shell.mat")
    read_files(page)
    assert not error.is_visible()
    clear(page, SHELL)
    read_files(page)
    for label, words in ((TABLE, "no table of names"), (MASKS, "no file of masks")):
        clear(page, label)
        press(page, "Read files")
        error.filter(has_text=words).wait_for()
        assert cell_names(page) == []


def target_volumes(page: "Page") -> list[float]:
    """Target volumes of the cells, as the table shows them."""
    entries = page.locator(".cells input.volume").all()
    return [float(entry.get_attribute("placeholder") or "") for entry in entries]


@uses("Label image", "Clear Label image")
def test_label_images(page: "Page") -> None:
    press(page, "Label image")
    type_in(page, "Voxel, µm", "0.5")
    for name, count in (("labels.npy", 3), ("many.npy", 27), ("labels.npy", 3)):
        choose(page, "Label image", name)
        read_files(page)
        assert len(cell_names(page)) == count
    clear(page, "Label image")
    press(page, "Read files")
    page.locator("#form_error", has_text="no label image").wait_for()


@uses(r"Array \(key\)", "Background label", "Least voxels of a label", "Known of labels.*")
@uses("Clear Known of labels.*")
def test_what_of_a_label_image_is_meant(page: "Page") -> None:
    press(page, "Label image")
    error = page.locator("#form_error")
    choose(page, "Label image", "both.npz")
    type_in(page, "Voxel, µm", "0.5")
    press(page, "Read files")
    error.filter(has_text="key").wait_for()
    type_in(page, "Array (key)", "many")
    read_files(page)
    assert len(cell_names(page)) == 27
    type_in(page, "Background label", "27")
    read_files(page)
    assert len(cell_names(page)) == 26
    type_in(page, "Least voxels of a label", "65")  # they have 64
    press(page, "Read files")
    error.filter(has_text="65").wait_for()
    type_in(page, "Least voxels of a label", "64")
    choose(page, "Known of labels", "about.csv")
    read_files(page)
    assert cell_names(page)[:2] == ["One", "Two"]
    assert page.get_by_label("Type of Two").input_value() == "Y"
    clear(page, "Known of labels")
    read_files(page)
    assert cell_names(page)[0] != "One"


UPLOADS = {
    "Masks and table": {"masks": ".mat", "table": ".csv", "shell_file": ".mat"},
    "Label image": {"image": ".npy", "table": ".csv", "about": ".csv"},
    "Scene file": {"scene_file": ".toml"},
}


@uses("Scene file", "Upload masks", "Upload table", "Upload shell_file", "Upload image")
@uses("Upload about", "Upload scene_file")
def test_an_upload_is_chosen(page: "Page", folder: Path, tmp_path: Path) -> None:
    for tab, fields in UPLOADS.items():
        press(page, tab)
        for field, suffix in fields.items():
            file = tmp_path / f"sent-{field}{suffix}"
            for content in (b"# 1", b"# 2"):  # changed meanwhile, it can be sent again
                file.write_bytes(content)
                before = state(page, field) or ""
                page.locator(f"[data-uploads={field}]").set_input_files(file)
                wait(page, f"state.{field} && state.{field} !== '{before}'")
                assert (folder / state(page, field)).read_bytes() == content
            name = state(page, field)
            page.locator(".v-autocomplete", has_text=name).wait_for()
    page.locator("[data-uploads=scene_file]").set_input_files(
        {"name": "a.exe", "mimeType": "text/plain", "buffer": b"x"}
    )
    page.locator("#form_error", has_text="'a.exe' has an ending that is not known").wait_for()


# ---------------------------------------------------------------------------------------------
# The form, and the run that it says
# ---------------------------------------------------------------------------------------------


@uses("Name of cell .+", "Attraction from .+ to .+", "Time", "Time step δt", "Saving interval")
@uses("Tolerance, nm")
@uses("Shell", "Name of the run.*", "Run")
def test_a_run_is_as_the_form_says(page: "Page", folder: Path) -> None:
    read_example(page)
    assert state(page, "sigma") == [[0, 0.1, 0.2], [0.3, 0, 0.4], [0.5, 0.6, 0]]
    type_in(page, "Name of cell 1", "first")
    type_in(page, "Attraction from first to B", "0.9")
    type_in(page, "Time", "much")
    press(page, "Run")
    page.locator("#run_error", has_text="time = 'much' is not a number").wait_for()
    assert page.locator("#status").inner_text() == "failed"

    type_in(page, "Time", "20")
    type_in(page, "Tolerance, nm", "fine")
    press(page, "Run")
    page.locator("#run_error", has_text="tolerance = 'fine' is not a number").wait_for()

    said = {"Saving interval": "10", "Time step δt": "1.25", "Tolerance, nm": "20"}
    for label, value in said.items():
        page.get_by_label(label, exact=True).fill(value)
    page.get_by_label("Shell", exact=True).uncheck()
    page.get_by_label("Name of the run").fill("runs/mine")
    press(page, "Run")  # at once: what has just been typed holds
    page.locator("#run_note", has_text="runs/mine is saved").wait_for()
    assert not page.locator("#run_error").is_visible()
    with (folder / "runs/mine/scene.toml").open("rb") as file:
        scene = tomllib.load(file)
    assert (scene["duration"], scene["save_every"]) == (20, 10)
    assert (scene["numerics"]["dt"], scene["numerics"]["tolerance"]) == (1.25, 20)
    assert "confinement" not in scene
    assert ["first", "B", 0.9] in [[*row] for row in pairs_of(scene)]
    with run_of(folder / "runs/mine") as run:
        assert run["cell"].values.tolist() == ["first", "B", "C"]
        assert run["time"].values.tolist() == [0, 10, 20]
    live = page.frame_locator("#live-viewer")
    live.get_by_text("first", exact=True).first.wait_for()
    wait_for_cells(page, live, 3)

    assert page.locator("#status").inner_text() == "finished"
    assert page.locator("#progress").inner_text().startswith("t = 20 of 20 · 3 cells")
    assert "left" not in page.locator("#progress").inner_text()
    assert page.get_by_label("Name of the run").input_value() == "runs/mine-2"
    press(page, "Run")
    page.locator("#run_note", has_text="runs/mine-2 is saved").wait_for()
    assert page.get_by_label("Name of the run").input_value() == "runs/mine-3"


def pairs_of(scene: dict[str, Any]) -> list[Any]:
    return scene["physics"]["sigma"]["pairs"]


@uses("Preset")
def test_presets_bring_their_tolerance(page: "Page") -> None:
    show_scene(page)
    for preset, tolerance in (("fast", "20"), ("published", ""), ("draft", "50")):
        choose(page, "Preset", preset)
        wait(page, f"state.preset === '{preset}' && state.tolerance === '{tolerance}'")
        assert page.get_by_label("Tolerance, nm", exact=True).input_value() == tolerance
    choose(page, "Preset", "as the scene says")
    wait(page, "state.tolerance === ''")


def read_many(page: "Page") -> None:
    """Read a label image of so many cells that one pair at a time is shown."""
    show_scene(page)
    press(page, "Label image")
    choose(page, "Label image", "many.npy")
    type_in(page, "Voxel, µm", "0.5")
    read_files(page)


@uses("σ: pull of", "on", "to", "both ways", "Set")
def test_attraction_of_a_pair_among_many(page: "Page") -> None:
    read_many(page)
    names = cell_names(page)
    assert len(names) == 27
    for j, i, value, both in ((3, 5, "0.25", True), (4, 2, "0.75", False)):
        page.get_by_role("combobox", name="σ: pull of").first.fill(names[j])
        click_option(page, names[j])
        page.get_by_role("combobox", name="on", exact=True).first.fill(names[i])
        click_option(page, names[i])
        page.get_by_label("both ways").set_checked(both)
        page.get_by_label("to", exact=True).fill(value)
        press(page, "Set")
        wait(page, f"state.sigma[{j}][{i}] === '{value}'")
        assert (state(page, "sigma")[i][j] == value) is both


@uses("Pause", "Go on", "Stop", "Resume")
def test_pause_stop_and_resume_from_two_pages(
    page: "Page", browser: "Browser", address: str
) -> None:
    read_example(page)
    type_in(page, "Time", "1000000")
    type_in(page, "Name of the run: a folder to make", "runs/long")
    press(page, "Run")
    wait(page, "state.status === 'running' && state.progress_text.startsWith('t = ')")
    press(page, "Pause")
    wait(page, "state.status === 'paused'")
    held = page.locator("#progress").inner_text()
    page.wait_for_timeout(1200)
    assert page.locator("#progress").inner_text() == held
    other = browser.new_page()
    other.goto(address)
    press(page, "Go on")
    wait(other, "state.status === 'running'")
    page.reload()
    wait(page, "state.status === 'running' && state.progress_text.includes('left')")
    assert not button(page, "Run").is_enabled()
    press(other, "Stop")
    page.locator("#run_note", has_text="runs/long is stopped and saved").wait_for()
    for each in (page, other):
        wait(each, "state.status === 'idle'")
        assert each.locator("#status").inner_text() == "stopped"
        assert each.locator("#progress").inner_text().startswith("t = ")
        assert "left" not in each.locator("#progress").inner_text()
    stopped = time_of(page)
    other.close()

    open_run(page, "runs/long")
    press(page, "Resume")
    wait(page, "state.status === 'running' && state.progress_text.startsWith('t = ')")
    wait(page, f"parseFloat(state.progress_text.slice(4)) > {stopped}")
    press(page, "Stop")
    page.locator("#run_note", has_text="stopped").wait_for()
    wait(page, "!state.opening && state.status === 'idle'")
    about = page.get_by_text(re.compile(r"saves?, t = ")).inner_text()  # it is shown anew
    assert float(re.search(r" to ([0-9.]+\d)", about)[1]) > stopped
    assert button(page, "Resume").is_visible()


def time_of(page: "Page") -> float:
    return float(page.locator("#progress").inner_text().split()[2])


def test_a_run_that_fails_says_so(page: "Page") -> None:
    show_scene(page)
    type_in(page, "Name of the run: a folder to make", "runs/two")
    press(page, "Run")
    page.locator("#run_error", has_text="'runs/two' exists and is not empty").wait_for()
    assert page.locator("#status").inner_text() == "failed"
    assert page.locator("#progress").inner_text() == ""


# ---------------------------------------------------------------------------------------------
# Looking at runs
# ---------------------------------------------------------------------------------------------


@uses("Run", "Open", "Cell; or click one in the view", "Clear Cell; or click one in the view")
def test_the_figures_are_of_the_cell_that_is_chosen(page: "Page", folder: Path) -> None:
    label = "Cell; or click one in the view"
    for name, cells in (("runs/two", "BA"), ("runs/three", "BC")):
        open_run(page, name)
        with run_of(folder / name) as run:
            for cell in cells:
                choose(page, label, cell)
                page.get_by_role("heading", name=f"{cell} over time").wait_for()
                volume = f"{float(run['volume'].sel(cell=cell)[-1]):.1f} µm³"
                page.locator(".figures tr", has_text=volume).first.wait_for()
                neighbours = page.locator(".figures tr", has_text="touches").inner_text()
                assert cell not in neighbours.removeprefix("touches")
    clear(page, label)
    page.locator(".figures").wait_for(state="detached")
    assert page.get_by_role("heading", name="over time").count() == 0


def test_view_and_page_agree(page: "Page", browser: "Browser", address: str) -> None:
    open_run(page, "runs/three")
    viewer = page.frame_locator("#run-viewer")
    viewer.get_by_text("C", exact=True).first.wait_for()
    slider = viewer.locator("#time")
    slider.focus()
    slider.press("ArrowLeft")
    page.get_by_role("heading", name="Contacts at t = 4").wait_for()
    other = browser.new_page()  # sees the same time, and follows
    other.goto(address)
    shown = other.frame_locator("#run-viewer").locator("#when")
    shown.filter(has_text="t = 4 ·").wait_for()
    slider.press("ArrowLeft")
    shown.filter(has_text="t = 0 ·").wait_for()
    slider.press("ArrowRight")
    shown.filter(has_text="t = 4 ·").wait_for()
    page.get_by_role("heading", name="Contacts at t = 4").wait_for()
    other.close()
    box = viewer.locator("canvas").first.bounding_box()
    assert box is not None
    middle = {"x": box["width"] / 2, "y": box["height"] / 2}
    viewer.locator("canvas").first.click(position=middle)
    page.get_by_role("heading", name="B over time").wait_for()  # the middle one
    assert chosen(page, "Cell; or click one in the view") == "B"


@uses("Colours by", "mirror z", "Picture", "Film", "Data as", "Write", "Break off", "Download")
def test_exports_are_downloaded_and_the_page_stays(page: "Page", folder: Path) -> None:
    open_run(page, "runs/three")
    half = page.locator(".half").last
    pictures = []
    for by, mirror in (("cell", False), ("volume", False), ("volume", True)):
        choose(page, "Colours by", by)
        half.get_by_label("mirror z").set_checked(mirror)
        half.get_by_role("button", name="Picture", exact=True).click()
        pictures.append(np.asarray(Image.open(BytesIO(download(page, len(pictures), ".png")))))
    cell, volume, mirrored = pictures
    for one, two in ((cell, volume), (volume, mirrored)):
        assert one.shape != two.shape or (one != two).any()

    half.get_by_role("button", name="Film", exact=True).click()
    page.get_by_text("Break off").click()
    wait(page, "!state.making")
    assert half.locator("a[download]").count() == 3
    half.get_by_role("button", name="Film", exact=True).click()
    assert b"ftyp" in download(page, 3, ".mp4")[:12]
    for count, (what, entry) in enumerate(
        (
            ("tables (CSV)", "cells.csv"),
            ("label images (OME-TIFF)", ".tif"),
            ("tables (CSV)", "cells.csv"),
        )
    ):
        choose(page, "Data as", what)
        press(page, "Write")
        with zipfile.ZipFile(BytesIO(download(page, 4 + count, ".zip"))) as archive:
            assert any(name.endswith(entry) for name in archive.namelist())
    assert not page.locator("#look_error").is_visible()


def download(page: "Page", number: int, suffix: str) -> bytes:
    """File of a link, once it is there; the page and its connection stay as they are."""
    wait(page, f"state.made.length === {number + 1} && !state.making")
    link = page.locator("a[download]").nth(number)
    for act in (link.click, lambda: link.press("Enter")):
        with page.expect_download() as found:
            act()
        assert found.value.suggested_filename.endswith(suffix)
    content = found.value.path().read_bytes()
    assert page.get_by_role("heading", name="MorphoSim", exact=True).is_visible()
    assert page.evaluate("trame.client.isConnected()")
    return content


# ---------------------------------------------------------------------------------------------
# The page as a whole
# ---------------------------------------------------------------------------------------------


def test_two_pages_show_the_same(page: "Page", browser: "Browser", address: str) -> None:
    press(page, "Built-in scene")
    open_run(page, "runs/three")
    other = browser.new_page(viewport=NARROW)
    other.goto(address)
    wait(other, "state.opened === 'runs/three' && !state.reading")
    for first, second in (("single-cell", "celegans-8"), ("celegans-8", "single-cell")):
        choose(page, "Scene", first)
        choose(other, "Scene", second)
        for each in (page, other):
            wait(each, f"state.loaded === '{second}' && !state.reading && state.fits")
            each.get_by_role("heading", name=f"Cells of {second}").wait_for()
            assert chosen(each, "Scene") == second
    label = "Cell; or click one in the view"
    for first, second in (("A", "B"), ("B", "C"), ("C", "A")):
        choose(page, label, first)
        choose(other, label, second)
        for each in (page, other):
            each.get_by_role("heading", name=f"{second} over time").wait_for()
            assert chosen(each, label) == second
    other.close()


def test_back_and_reload_show_what_was_there(page: "Page") -> None:
    read_example(page)
    open_run(page, "runs/two")
    for leave in (page.reload, lambda: (page.goto("about:blank"), page.go_back())):
        leave()
        wait(page, "state.fits && state.opened === 'runs/two'")
        assert cell_names(page) == ["A", "B", "C"]
        page.frame_locator("#run-viewer").get_by_text("B", exact=True).first.wait_for()
        press(page, "Built-in scene")  # and the page is alive
        wait(page, "state.fits && !state.reading")
        read_example(page)


FAULTS = (Path(__file__).parent / "faults.js").read_text()


@pytest.mark.parametrize("page", [WIDE, NARROW], ids=["wide", "narrow"], indirect=True)
def test_nothing_is_cut_off_or_overlaps(page: "Page") -> None:
    for tab in ("Masks and table", "Label image", "Scene file", "Built-in scene"):
        press(page, tab)
        wait(page, "!state.reading")
        assert page.evaluate(FAULTS) == [], tab
    read_example(page)
    open_run(page, "runs/three")
    choose(page, "Cell; or click one in the view", "A")
    page.get_by_role("heading", name="A over time").wait_for()
    press(page, "Write")
    wait(page, "state.made.length && !state.making")
    type_in(page, "Name of the run: a folder to make", "../" + "out-of-here" * 20)
    press(page, "Run")
    page.locator("#run_error", has_text="leads out").wait_for()
    assert page.evaluate(FAULTS) == []


CONTROLS = f"""() => {{
  const shown = (each) => each.checkVisibility() || each.type === "file";
  const kinds = "button, a[href], input, textarea, select, [role=button]";
  return [...document.querySelectorAll(kinds)].filter(shown).map({NAME_OF});
}}"""


def test_every_control_is_used_by_a_test(page: "Page") -> None:
    for file in Path(__file__).parent.glob("test_*.py"):
        import_module(f"tests.app.{file.stem}")
    found: set[str] = set()

    def look() -> None:
        found.update(page.evaluate(CONTROLS))

    press(page, "Scene file")
    look()
    read_many(page)
    look()
    read_example(page)
    look()
    show_scene(page)
    choose(page, "Scene", "celegans-1-to-8")  # of whose walls `published` tells a remark
    wait(page, "state.loaded === 'celegans-1-to-8' && !state.reading")
    choose(page, "Preset", "published")
    type_in(page, "Time", "1000000")
    press(page, "Run")
    wait(page, "state.status === 'running' && state.remarks.length")
    look()
    press(page, "Pause")
    wait(page, "state.status === 'paused'")
    look()
    press(page, "Stop")
    wait(page, "state.status === 'idle'")
    open_run(page, "runs/three")
    choose(page, "Cell; or click one in the view", "A")
    press(page, "Film")
    wait(page, "state.making")
    look()
    press(page, "Break off")
    wait(page, "!state.making")
    press(page, "Write")
    wait(page, "state.made.length && !state.making")
    press(page, "Save scene")
    wait(page, "state.saved.length && !state.saving")
    look()
    unused = {name for name in found if not any(re.fullmatch(c, name) for c in USED)}
    assert unused == set(), "say by `uses` which test uses them"
    gone = {c for c in USED if not any(re.fullmatch(c, name) for name in found)}
    assert gone == set(), "there is no such control any more"
