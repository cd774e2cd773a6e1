"""The application as tests use it: served from a folder, and driven in a real browser."""

import contextlib
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from openpyxl import Workbook
from scipy.io import savemat

if TYPE_CHECKING:
    from playwright.sync_api import FrameLocator, Page

NAMES = ["A", "B", "C"]
GRID = (120, 80, 60)
"""Voxels of 0.5 µm: the published eggshell's domain."""
PATIENCE = 60_000
"""Milliseconds; the first step may compile kernels."""


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
    """Three balls as the published program's files: masks with axes y, x, z, and a table."""
    grid = np.meshgrid(*map(np.arange, GRID), indexing="ij", sparse=True)
    masks = np.empty((3, 1), object)
    for k, x in enumerate((42, 60, 78)):
        distance = sum((p - o) ** 2 for p, o in zip(grid, (x, 40, 30), strict=True))
        masks[k, 0] = (distance < 9.0**2).astype(np.uint8).transpose(1, 0, 2)
    savemat(folder / "masks.mat", {"Mask": masks})
    book = Workbook()
    for row in (["", *NAMES], ["A", 0, 0.1, 0.2], ["B", 0.3, 0, 0.4], ["C", 0.5, 0.6, 0]):
        book.active.append(row)
    book.save(folder / "table.xlsx")


def wait(page: "Page", condition: str) -> None:
    """Wait until an expression of the page's `state` is true."""
    known = "const state = window.trame?.state?.state;"
    page.wait_for_function(
        f"() => {{ {known} return state?.cells && ({condition}); }}", timeout=PATIENCE
    )


def state(page: "Page", key: str) -> Any:
    """Value of the page's state."""
    return page.evaluate("(key) => window.trame.state.state[key]", key)


def choose(page: "Page", label: str, option: str) -> None:
    """Choose an entry of a list, as a user does."""
    page.get_by_role("combobox", name=label).first.click()
    page.get_by_role("option", name=option, exact=True).click()


def cells_seen(viewer: "FrameLocator") -> int:
    """Colours in the picture of a viewer that are no background: grey, or nearly white."""
    from io import BytesIO

    from PIL import Image

    shot = viewer.locator("canvas").first.screenshot()
    pixels = np.asarray(Image.open(BytesIO(shot)).convert("RGB")).astype(int)
    coloured = pixels[np.ptp(pixels, axis=2) > 60]
    return len(np.unique(coloured // 64, axis=0)) if len(coloured) > 500 else 0


def read_example(page: "Page") -> None:
    """Read the files of `write_example`."""
    page.get_by_role("button", name="Masks and table").click()
    choose(page, "Cells: masks", "masks.mat")
    choose(page, "Names and attraction", "table.xlsx")
    page.get_by_role("button", name="Read files").click()
    wait(page, "state.cells.length === 3 && !state.reading")
