"""Headless Chromium for tests, or a skip that says why there is none."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from playwright.sync_api import Browser

NAMES = ("chromium", "chromium-browser", "google-chrome")
ARGUMENTS = (
    "--no-sandbox", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync", "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
)  # fmt: skip
"""WebGL 2 without a GPU, and no traffic of the browser's own."""
PLAIN = ("--disable-gpu-compositing", "--disable-gpu-rasterization")
"""Draws what is around a view without WebGL, for a tenth of the processor's time."""


def reason_for_none() -> str:
    """Why no browser can be started; "" if one can."""
    if find_spec("playwright") is None:
        return "playwright is not installed"
    if not any(map(shutil.which, NAMES)):
        return f"no browser: none of {', '.join(NAMES)} is on the path"
    return ""


@contextmanager
def chromium(*further: str) -> "Iterator[Browser]":
    """Browser of Playwright with further arguments; skips the test if there is none."""
    reason = reason_for_none()
    if reason:
        pytest.skip(reason)
    from playwright.sync_api import sync_playwright

    path = next(filter(None, map(shutil.which, NAMES)))
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=path, headless=True, args=[*ARGUMENTS, *further]
        )
        try:
            yield browser
        finally:
            browser.close()
