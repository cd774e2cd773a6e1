"""The application as tests use it: served from a folder, and driven in a real browser."""

import contextlib
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from openpyxl import Workbook
from scipy.io import savemat

from morphosim import Cell, Physics, RunWriter, Scene, Simulation, Sphere
from morphosim.app.form import SOURCES, STATE

if TYPE_CHECKING:
    from playwright.sync_api import FrameLocator, Locator, Page

NAMES = ["A", "B", "C"]
GRID = (120, 80, 60)
"""Voxels of 0.5 µm: the published eggshell's domain."""
WIDE = {"width": 1500, "height": 1000}
NARROW = {"width": 420, "height": 900}
"""Sizes of the window: a screen and a telephone."""
PATIENCE = 120_000
"""Milliseconds; the first step may compile kernels."""

Test = TypeVar("Test", bound=Callable[..., object])
USED: dict[str, list[str]] = {}
"""Controls of the page, as patterns of their names, and the tests that use them; see `uses`."""
NAME_OF = (Path(__file__).parent / "controls.js").read_text()


def uses(*controls: str) -> Callable[[Test], Test]:
    """Decorator of a test that uses controls of the page and looks at what they do.

    The names are regular expressions; `controls.js` says what a control is called. That the test
    does use them is seen by the fixture `page`; that each control of the page is used by a test, by
    `test_every_control_is_used_by_a_test`.
    """

    def mark(test: Test) -> Test:
        for control in controls:
            USED.setdefault(control, []).append(test.__name__)
        return test

    return mark


@contextmanager
def served(folder: Path, *options: str) -> Iterator[str]:
    """Address of an application that serves a folder."""
    command = "from morphosim.cli import main; main()"
    process = subprocess.Popen(
        [sys.executable, "-c", command, "app", "--folder", str(folder), "--no-open", *options],
        stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    try:
        assert process.stdout is not None
        yield process.stdout.readline().split()[-1]
    finally:
        process.terminate()
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(30)
        process.kill()
        process.wait()
        process.stdout.close()


def write_example(folder: Path) -> None:
    """Files that the tabs read, and two runs of balls in a row, of which one was stopped.

    masks.mat, table.xlsx and the walls shell.mat are as the published program's, with axes y, x,
    z; pair.mat and pair.csv have the first two cells; labels.npy has the three cells of masks.mat
    as a label image, many.npy has 27 cubes, and both.npz both of them; about.csv says what is known
    of two labels.
    """
    grid = np.meshgrid(*map(np.arange, GRID), indexing="ij", sparse=True)
    masks, labels = np.empty((3, 1), object), np.zeros(GRID, np.uint16)
    for k, x in enumerate((42, 60, 78)):
        ball = sum((p - o) ** 2 for p, o in zip(grid, (x, 40, 30), strict=True)) < 9.0**2
        masks[k, 0] = ball.astype(np.uint8).transpose(1, 0, 2)
        labels[ball] = k + 1
    savemat(folder / "masks.mat", {"Mask": masks})
    savemat(folder / "pair.mat", {"Mask": masks[:2]})
    outside = sum((2 * p / n - 1) ** 2 for p, n in zip(grid, GRID, strict=True)) > 1
    savemat(folder / "shell.mat", {"PhiShell": outside.astype(float).transpose(1, 0, 2)})
    np.save(folder / "labels.npy", labels)
    cube = np.pad(np.ones((4, 4, 4), np.uint16), 1)
    many = np.kron(np.arange(1, 28, dtype=np.uint16).reshape(3, 3, 3), cube)
    np.save(folder / "many.npy", many)
    np.savez(folder / "both.npz", few=labels, many=many)
    (folder / "about.csv").write_text("label,name,type\n1,One,X\n2,Two,Y\n")
    book = Workbook()
    for row in (["", *NAMES], ["A", 0, 0.1, 0.2], ["B", 0.3, 0, 0.4], ["C", 0.5, 0.6, 0]):
        book.active.append(row)
    book.save(folder / "table.xlsx")
    (folder / "pair.csv").write_text(",A,B\nA,0,0.7\nB,0.8,0\n")
    for run, names, until in (("three", NAMES, 8), ("two", NAMES[:2], 16)):
        balls = [Sphere(center=(8 * k, 0, 0), radius=5 - k) for k in range(len(names))]
        cells = [Cell(name=name, shape=ball) for name, ball in zip(names, balls, strict=True)]
        scene = Scene(cells=cells, physics=Physics(sigma=0.5), duration=16)
        Simulation(scene).run(until, observers=[RunWriter(folder / "runs" / run, 4)])


def wait(page: "Page", condition: str) -> None:
    """Wait until an expression of the page's `state` is true."""
    known = "const state = window.trame?.state?.state;"
    page.wait_for_function(
        f"() => {{ {known} return state?.cells && ({condition}); }}", timeout=PATIENCE
    )


def open_run(page: "Page", name: str) -> None:
    """Open a run of the list, and wait until all of it is there."""
    before = state(page, "run_stream")["key"]
    choose(page, "Run", name)
    page.get_by_role("button", name="Open", exact=True).click()
    wait(page, f"state.run_stream.key !== '{before}' && state.opened === '{name}'")
    wait(page, "state.run_stream.key && !state.opening")


def type_in(page: "Page", label: str, text: str) -> None:
    """Write into a field, and leave it."""
    entry = page.get_by_label(label, exact=True)
    entry.fill(text)
    entry.press("Tab")


def state(page: "Page", key: str) -> Any:
    """Value of the page's state."""
    return page.evaluate("(key) => window.trame.state.state[key]", key)


def choose(page: "Page", label: str, option: str) -> None:
    """Choose an entry of a list, as a user does."""
    page.get_by_role("combobox", name=label).first.click()
    click_option(page, option)


def click_option(page: "Page", name: str) -> None:
    """Click an entry of the list that is open; once more if it has moved under the mouse."""
    entry = page.get_by_role("option", name=name, exact=True)
    entry.click()
    while not is_gone(entry):
        entry.click()


def is_gone(entry: "Locator") -> bool:
    """Whether an entry is not seen any more, at once or after a moment."""
    from playwright.sync_api import TimeoutError as TooLateError

    try:
        entry.wait_for(state="hidden", timeout=2000)
    except TooLateError:
        return False
    return True


def clear(page: "Page", label: str) -> None:
    """Empty a list by its cross, which is there under the mouse."""
    page.get_by_role("combobox", name=label).first.hover()
    page.get_by_label(re.compile(f"^Clear {label}")).click()


def wait_for_cells(page: "Page", viewer: "FrameLocator", count: int) -> None:
    """Wait until a viewer shows so many cells."""
    end = monotonic() + PATIENCE / 1000
    while cells_seen(viewer) < count:
        assert monotonic() < end, f"{cells_seen(viewer)} cells are seen, not {count}"
        page.wait_for_timeout(500)


def cells_seen(viewer: "FrameLocator") -> int:
    """Colours in the picture of a viewer that are no background: grey, or nearly white."""
    from io import BytesIO

    from PIL import Image

    shot = viewer.locator("canvas").first.screenshot()
    pixels = np.asarray(Image.open(BytesIO(shot)).convert("RGB")).astype(int)
    coloured = pixels[np.ptp(pixels, axis=2) > 60]
    return len(np.unique(coloured // 64, axis=0)) if len(coloured) > 500 else 0


def read_example(page: "Page") -> None:
    """Read the files of `write_example`, also if they have been read and changed before."""
    show_scene(page)
    page.get_by_role("button", name="Masks and table").click()
    choose(page, "Cells: masks", "masks.mat")
    choose(page, "Names and attraction", "table.xlsx")
    read_files(page)


def choose_no_files(page: "Page") -> None:
    """Empty all that the tabs of files say, as it was at first."""
    keys = {key for keys in SOURCES.values() for key in keys.values()} - {"scene_name"}
    emptied = {key: STATE[key] for key in keys}
    page.evaluate("(emptied) => trame.state.update(emptied)", emptied)


def show_scene(page: "Page") -> None:
    """Go to the tab of the built-in scenes."""
    page.get_by_role("button", name="Built-in scene").click()
    wait(page, "state.source_kind === 'built-in' && state.fits === 'built-in' && !state.reading")
    page.locator(".cells").wait_for()


def read_files(page: "Page") -> None:
    """Read files that have been chosen, or chosen anew, without a fault."""
    wait(page, "!state.fits && !state.reading")
    page.get_by_role("button", name="Read files").click()
    wait(page, "state.fits === state.source_kind && !state.reading")
    page.locator(".cells").wait_for()


def chosen(page: "Page", label: str) -> str:
    """What a list shows as chosen."""
    box = page.locator(".v-input", has=page.get_by_text(label)).first
    return box.locator(".v-autocomplete__selection").inner_text()
