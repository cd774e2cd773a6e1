"""Every control of the form in a real browser, by its effect: what is read, run and saved."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from morphosim import Attraction, Cell, Mask, Physics, Scene, Sphere, load_scene, save_scene
from tests.app.application import NARROW, WIDE, choose, clear, state, uses, wait

if TYPE_CHECKING:
    from playwright.sync_api import Page

CODE = '[[physics.terms]]\nuse = "own.py:Own"\n'


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A label image of three times, and scene files: one with an array, one with code."""
    root = tmp_path_factory.mktemp("folder")
    grid = np.meshgrid(*map(np.arange, (48, 28, 28)), indexing="ij", sparse=True)
    labels = np.zeros((3, 48, 28, 28), np.uint16)
    for time in range(3):
        for label, x in ((3, 16 - time), (7, 31 + time)):
            distance = sum((p - o) ** 2 for p, o in zip(grid, (x, 14, 14), strict=True))
            labels[time][distance < 7.5**2] = label
    np.save(root / "series.npy", labels)
    ball = Mask(mask=labels[0] == 3, origin=(0, 0, 0), spacing=0.5)
    cells = [
        Cell(name="left", shape=ball, type="X"),
        Cell(name="right", shape=Sphere(center=(16, 7, 7), radius=3.7), type="Y"),
    ]
    sigma = Attraction(default=0.1, types={("X", "X"): 0.3})
    pair = Scene(cells=cells, physics=Physics(sigma=sigma), duration=8, save_every=4, name="pair")
    save_scene(pair, root / "pair.toml")
    save_scene(Scene(cells=cells[1:], name="one"), root / "one.toml")
    (root / "own.toml").write_text((root / "one.toml").read_text() + CODE)
    (root / "own.py").write_text("open('was-run', 'w')")
    return root


def fill(page: "Page", **entries: str) -> None:
    """Type into fields, by their labels."""
    for label, entry in entries.items():
        found = page.get_by_label(label, exact=True)
        found.fill(entry)
        found.press("Tab")


def saved(page: "Page", folder: Path, name: str) -> Scene:
    """What the form says, by the file that it writes."""
    fill(page, **{"Scene file to write": name})
    page.get_by_role("button", name="Save scene").click()
    wait(page, f"!state.saving && state.saved[0]?.name === '{name}.toml'")
    assert state(page, "save_error") == ""
    with page.expect_download() as download:
        page.get_by_role("link", name=f"{name}.toml").click()
    assert download.value.suggested_filename == f"{name}.toml"
    assert Path(download.value.path()).read_bytes() == (folder / f"{name}.toml").read_bytes()
    assert state(page, "cells")  # and the page is still there
    return load_scene(folder / f"{name}.toml")


@pytest.mark.parametrize("page", [WIDE, NARROW], ids=["wide", "narrow"], indirect=True)
@uses(
    "Scene file", "Type of .+", "Target volume of .+", "Surface tension of .+", "Surface tension γ"
)
@uses("S", "Preset", "Walls", "Scene file to write", "Save scene", "Download")
def test_values_that_are_typed_are_those_of_the_scene(page: "Page", folder: Path) -> None:
    width = page.viewport_size["width"]
    page.get_by_role("button", name="Scene file", exact=True).click()
    choose(page, "Scene file (", "one.toml")
    wait(page, "state.fits && state.loaded === 'one'")
    choose(page, "Scene file (", "pair.toml")
    wait(page, "state.fits && state.loaded === 'pair'")
    assert page.get_by_label("Attraction from left to right", exact=True).input_value() == "0.1"
    fill(page, **{
        "Type of right": "X", "Target volume of left": "200", "Surface tension of right": "0.4",
        "Surface tension γ": "0.3", "S": "9",
    })  # fmt: skip
    attraction = page.get_by_label("Attraction from left to right", exact=True)
    page.wait_for_function("(entry) => entry.value === '0.3'", arg=attraction.element_handle())
    scene = saved(page, folder, f"changed-{width}")
    left, right = scene.cells
    assert (left.volume, left.gamma, right.gamma, right.type) == (200, None, 0.4, "X")
    assert (scene.physics.gamma, scene.numerics.S, scene.duration) == (0.3, 9, 8)
    assert not scene.physics.attraction.pairs

    means = page.locator("#preset_means")
    for preset, text in (
        ("draft", "tolerance 50 nm, δt from 0.03125 to 32 · S = "),
        ("published", "S = 12 · stepped walls"),
    ):
        choose(page, "Preset", preset)
        means.filter(has_text=text).wait_for()
        wait(page, f"state.preset === '{preset}' && state.S === '' && state.walls === ''")
        assert page.get_by_label("S", exact=True).input_value() == ""
    for walls in ("resolved", "preset: stepped", "resolved"):
        choose(page, "Walls", walls)
    scene = saved(page, folder, f"numerics-{width}")
    assert (scene.numerics.S, scene.numerics.walls, scene.numerics.dt) == (12, "resolved", 2)
    fill(page, **{"Target volume of left": "much"})
    page.get_by_role("button", name="Save scene").click()
    wait(page, "state.save_error")
    assert state(page, "save_error") == "cell 'left': volume = 'much' is not a number"


@uses("Upload scene_file", "Clear Scene file")
def test_a_scene_is_sent_with_its_arrays_but_without_code(page: "Page", folder: Path) -> None:
    page.get_by_role("button", name="Scene file", exact=True).click()
    upload = page.locator("input[type=file][data-uploads=scene_file]")
    upload.set_input_files([folder / "pair.npz", folder / "pair.toml"])  # in whichever order
    wait(page, "state.scene_file.startsWith('imports/pair') && state.fits && !state.reading")
    assert state(page, "form_error") == ""
    assert [cell["name"] for cell in state(page, "cells")] == ["left", "right"]
    upload.set_input_files([folder / "pair.toml"])
    wait(page, "state.form_error")
    assert "there is no such file in" in state(page, "form_error")
    upload.set_input_files([folder / "own.toml"])
    error = page.locator("#form_error").filter(has_text="names code, which is not imported here")
    error.filter(has_text="morphosim app --allow-code").wait_for()
    assert not list(folder.glob("**/was-run"))
    assert not Path("was-run").exists()
    choose(page, "Scene file (", "pair.toml")
    page.locator(".cells").wait_for()
    clear(page, "Scene file")
    page.locator(".cells").wait_for(state="detached")


@uses("Time index, from 0", "Target volumes", "Axes, as tzyx", "Frozen: names or labels")
def test_a_time_of_a_label_image_is_chosen(page: "Page") -> None:
    page.get_by_role("button", name="Label image", exact=True).click()
    choose(page, "Label image", "series.npy")
    fill(page, **{"Time index, from 0": "", "Voxel, µm": "0.5"})
    press = page.get_by_role("button", name="Read files")
    for entry, words in (("", "choose one by time_index, 0 to 2"), ("3", "time_index = 3, but")):
        fill(page, **{"Time index, from 0": entry})
        press.click()
        page.locator("#form_error").filter(has_text=words).wait_for()
    fill(page, **{"Time index, from 0": "2"})
    volumes = set()
    for kind in ("ball", "voxels"):
        choose(page, "Target volumes", kind)
        wait(page, "!state.fits")
        press.click()
        wait(page, "state.fits && !state.reading && !state.form_error")
        volumes.add(state(page, "cells")[0]["own_volume"])
    assert len(volumes) == 2
    fill(page, **{"Axes, as tzyx": "tzy"})
    press.click()
    page.locator("#form_error").filter(has_text="axes = 'tzy': expected").wait_for()
    fill(page, **{"Axes, as tzyx": "", "Frozen: names or labels": "3,7"})
    press.click()
    page.locator("#form_error").filter(has_text="all 2 cells are frozen").wait_for()
    for label in ("Frozen: names or labels", "Time index, from 0"):
        fill(page, **{label: ""})


def test_what_is_being_typed_stays_when_the_page_is_drawn_anew(page: "Page") -> None:
    page.get_by_role("button", name="Scene file", exact=True).click()
    choose(page, "Scene file (", "pair.toml")
    wait(page, "state.fits && state.loaded === 'pair'")
    for label in ("Target volume of left", "Attraction from left to right", "Name of cell 1"):
        entry = page.get_by_label(label, exact=True)
        entry.fill("12")
        page.evaluate("() => window.trame.state.set('loaded', 'another')")  # as a server might
        page.get_by_text("Cells of another").wait_for()
        assert entry.input_value() == "12", label
        page.evaluate("() => window.trame.state.set('loaded', 'pair')")


@uses("Take standard")
def test_what_a_preset_may_do_wrong_is_said_in_the_report(page: "Page") -> None:
    page.get_by_role("button", name="Built-in scene").click()
    choose(page, "Scene", "celegans-8-strong")
    wait(page, "state.fits && state.loaded === 'celegans-8-strong' && !state.reading")
    choose(page, "Scene", "celegans-1-to-8")  # daughters will press the walls
    wait(page, "state.fits && state.loaded === 'celegans-1-to-8' && !state.reading")
    choose(page, "Preset", "published")
    fill(page, **{"Time": "4", "Saving interval": "4"})
    page.get_by_role("button", name="Run", exact=True).click()
    wait(page, "state.status === 'idle' && (state.run_note || state.run_error)")
    first = state(page, "run_title")
    remark = page.locator(".remarks").filter(has_text="As the preset 'published' has it")
    remark.wait_for()
    assert page.locator(".warnings").count() == 0
    remark.get_by_role("button", name="Take standard").click()
    wait(page, f"state.preset === 'standard' && state.run_name !== '{first}'")
    fill(page, **{"S": "0.5"})
    page.get_by_role("button", name="Run", exact=True).click()
    page.locator(".warnings").filter(has_text="numerics.S = 0.5 may diverge").wait_for()
    wait(page, "state.status === 'idle' && (state.run_note || state.run_error)")
    assert page.locator(".remarks").count() == 0
