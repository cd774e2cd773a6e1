"""Screenshots of the application for its guide, one for each step of its use.

Run as `python examples/app_screenshots.py EXAMPLE OUT`: EXAMPLE holds the files of the published
program's example (`Example_8Cell.mat` and its tables). Takes Playwright and Chromium. Prints how
long the first picture takes after clicks on Run and Open.
"""

import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from playwright.sync_api import sync_playwright

MASKS, TABLE = "Example_8Cell.mat", "Example_CellName&AttractionMatrix_1.xls"
CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")
ARGUMENTS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
PATIENCE = 300_000
"""Milliseconds; the first step of a first run compiles the kernels."""


@contextmanager
def application(folder: str) -> Iterator[str]:
    """Address of an application that serves a folder."""
    command = [shutil.which("morphosim") or "morphosim", "app", "--folder", folder, "--no-open"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        yield process.stdout.readline().split()[-1]
    finally:
        process.terminate()
        process.wait()


def wait(page: Any, condition: str) -> None:
    """Wait until an expression of the page's `state` holds."""
    known = "const state = window.trame?.state?.state;"
    page.wait_for_function(
        f"() => {{ {known} return state?.cells && ({condition}); }}", timeout=PATIENCE
    )


def choose(page: Any, label: str, option: str) -> None:
    """Choose an entry of a list, as a user does."""
    page.get_by_role("combobox", name=label).first.click()
    page.get_by_role("option", name=option, exact=True).click()


def first_picture(page: Any, viewer: str, button: str) -> float:
    """Seconds from a click until a viewer shows cells."""
    begin = time.perf_counter()
    page.get_by_role("button", name=button, exact=True).click()
    cells = page.frame_locator(viewer).locator("input[type=checkbox]")
    cells.first.wait_for(timeout=PATIENCE)
    return time.perf_counter() - begin


def simulate(page: Any, shot: Callable[[str], None]) -> None:
    """Upper half: import, change one attraction, run."""
    wait(page, "state.cells.length === 8")
    page.wait_for_timeout(12_000)  # until the processes are warm
    shot("start")
    page.get_by_role("button", name="Masks and table").click()
    choose(page, "Cells: masks", MASKS)
    choose(page, "Names and attraction", TABLE)
    page.get_by_role("button", name="Read files").click()
    wait(page, "state.loaded === 'Example_8Cell' && !state.reading")
    for pair in ("ABpl to E", "E to ABpl"):
        entry = page.get_by_label(f"Attraction from {pair}", exact=True)
        entry.fill("0.2")
        entry.press("Tab")
    page.get_by_label("Time", exact=True).fill("1000")
    page.get_by_label("Saving interval").fill("100")
    page.mouse.move(5, 5)
    shot("import")
    print(f"first picture after Run: {first_picture(page, '#live-viewer', 'Run'):.1f} s")
    wait(page, "state.live_stream.count > 2 && state.progress > 20")
    shot("run")
    wait(page, "state.status === 'idle' && state.run_note")


def look(page: Any, shot: Callable[[str], None]) -> None:
    """Lower half: open, slide, pick, export."""
    print(f"first picture after Open: {first_picture(page, '#run-viewer', 'Open'):.1f} s")
    wait(page, "!state.opening && state.times.length === 11")
    canvas = page.frame_locator("#run-viewer").locator("canvas").first
    box = canvas.bounding_box()
    canvas.click(position={"x": box["width"] * 0.55, "y": box["height"] * 0.45})
    wait(page, "state.run_cell && state.history")
    page.locator(".half").last.get_by_role("button", name="Picture", exact=True).click()
    wait(page, "state.made.length === 1 && !state.making")
    page.get_by_role("button", name="Write", exact=True).click()
    wait(page, "state.made.length === 2 && !state.making")
    page.wait_for_timeout(1000)
    shot("look")


def main(example: Path, out: Path) -> None:
    """Make all pictures."""
    out.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory() as parent, sync_playwright() as playwright:
        folder = Path(parent) / "embryos"
        folder.mkdir()
        for name in (MASKS, TABLE):
            shutil.copy(example / name, folder)
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=ARGUMENTS)
        page = browser.new_page(viewport={"width": 1500, "height": 800})

        def shot(name: str) -> None:
            half = page.locator(".half").last if name == "look" else page.locator(".half").first
            half.screenshot(path=out / f"app_{name}.png")
            print(out / f"app_{name}.png")

        with application(str(folder)) as address:
            page.goto(address)
            simulate(page, shot)
            look(page, shot)
        browser.close()


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
