"""One application and one browser for all tests of a module, and pages that know what is used."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from tests.app.application import (
    NAME_OF,
    PATIENCE,
    USED,
    WIDE,
    choose_no_files,
    served,
    wait,
    write_example,
)
from tests.pictures.browser import PLAIN, chromium, reason_for_none

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page


LISTEN = f"""
const nameOf = {NAME_OF};
if (window === window.top)
  for (const kind of ["click", "input", "change"])
    window.addEventListener(kind, (event) => window.used(nameOf(event.target)), true);
"""
STILL = """
const still = new CSSStyleSheet(), none = "animation: none !important; transition: none !important";
still.replaceSync(`*, *::before, *::after { ${none} }`);
document.adoptedStyleSheets = [...document.adoptedStyleSheets, still];
"""
"""Without what moves for its own sake, which Chromium paints at every tick and tests wait for."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of the application, which a module may write itself."""
    found = tmp_path_factory.mktemp("folder")
    write_example(found)
    return found


@pytest.fixture(scope="module")
def address(folder: Path) -> Iterator[str]:
    """Address of the application."""
    pytest.importorskip("trame_vuetify", reason="trame is not installed")
    if reason := reason_for_none():
        pytest.skip(reason)
    with served(folder) as found:
        yield found


@pytest.fixture(scope="module")
def browser() -> "Iterator[Browser]":
    """Browser for the pages."""
    with chromium(*PLAIN) as found:
        yield found


@pytest.fixture
def page(request: pytest.FixtureRequest, browser: "Browser", address: str) -> "Iterator[Page]":
    """The application's page; in the end the test must have used the controls that it says.

    A parameter is the size of the window.
    """
    size = getattr(request, "param", WIDE)
    failed = request.session.testsfailed
    used: set[str] = set()
    faults: list[str] = []
    found = browser.new_page(viewport=size)
    found.set_default_timeout(PATIENCE)
    found.on("pageerror", lambda error: faults.append(str(error)))
    found.expose_function("used", lambda name: used.add(name))
    found.add_init_script(LISTEN + STILL)
    found.goto(address)
    wait(found, "!state.reading && state.status === 'idle'")
    choose_no_files(found)
    yield found
    wide = found.evaluate("document.scrollingElement.scrollWidth")
    found.close()
    assert not faults
    assert wide <= size["width"], "the page scrolls sideways"
    if request.session.testsfailed > failed:
        return
    test = request.function.__name__
    said = [control for control, tests in USED.items() if test in tests]
    assert [c for c in said if not any(re.fullmatch(c, name) for name in used)] == []
