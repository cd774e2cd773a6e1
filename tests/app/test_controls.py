"""Every control of the page in a real browser, by its effect."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import pytest

from tests.app.application import choose, served, state, wait, write_example
from tests.pictures.browser import chromium, reason_for_none

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

pytest.importorskip("trame_vuetify", reason="trame is not installed")
pytestmark = pytest.mark.skipif(bool(reason_for_none()), reason=reason_for_none())
WIDE = {"width": 1500, "height": 1000}


@pytest.fixture(scope="module")
def browser() -> "Iterator[Browser]":
    with chromium() as found:
        yield found


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Address of one application for all tests of this module."""
    folder = tmp_path_factory.mktemp("folder")
    write_example(folder)
    with served(folder) as found:
        yield found


@pytest.fixture
def page(browser: "Browser", address: str) -> "Iterator[Page]":
    found = browser.new_page(viewport=WIDE)
    faults: list[str] = []
    found.on("pageerror", lambda error: faults.append(str(error)))
    found.goto(address)
    wait(found, "!state.reading")
    yield found
    found.close()
    assert not faults


def test_the_scene_that_is_chosen_is_read(page: "Page") -> None:
    for name, count in (("single-cell", 1), ("celegans-8-strong", 8), ("single-cell", 1)):
        choose(page, "Scene", name)
        wait(page, f"state.loaded === '{name}' && !state.reading")
        assert len(state(page, "cells")) == count
        assert state(page, "run_name") == f"runs/{name}"
        assert page.get_by_label("Name of cell", exact=False).count() == count
