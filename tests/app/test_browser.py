"""The application in a real browser: import, change, run, look, export."""

import socket
import urllib.error
import urllib.request
import zipfile
from pathlib import Path
from urllib.parse import urlsplit

import pytest

from tests.app.application import (
    cells_seen,
    choose,
    read_example,
    served,
    state,
    wait,
    write_example,
)  # fmt: skip
from tests.pictures.browser import chromium, reason_for_none

pytest.importorskip("trame_vuetify", reason="trame is not installed")


@pytest.mark.skipif(bool(reason_for_none()), reason=reason_for_none())
def test_import_run_look_and_export(tmp_path: Path) -> None:
    write_example(tmp_path)
    with served(tmp_path) as address, chromium() as browser:
        page = browser.new_page(viewport={"width": 1500, "height": 1000})
        faults: list[str] = []
        page.on("pageerror", lambda error: faults.append(str(error)))
        page.goto(address)
        wait(page, "state.cells.length === 8")

        read_example(page)
        assert state(page, "sigma") == [[0, 0.1, 0.2], [0.3, 0, 0.4], [0.5, 0.6, 0]]
        entry = page.get_by_label("Attraction from A to B", exact=True)
        entry.fill("0.9")
        entry.press("Tab")
        page.get_by_label("Time", exact=True).fill("much")
        page.get_by_role("button", name="Run", exact=True).click()
        wait(page, "state.run_error")
        assert state(page, "run_error") == "time = 'much' is not a number"

        page.get_by_label("Time", exact=True).fill("40")
        page.get_by_label("Saving interval").fill("10")
        page.get_by_role("button", name="Run", exact=True).click()
        wait(page, "!state.run_error")  # that of before; it goes when the run begins
        wait(page, "state.status === 'idle' && (state.run_note || state.run_error)")
        name = state(page, "run_title")
        assert state(page, "run_note") == f"{name} is saved"
        live = page.frame_locator("#live-viewer")
        live.get_by_text("C", exact=True).first.wait_for()
        page.wait_for_timeout(500)
        assert cells_seen(live) >= 3

        choose(page, "Run", name)
        page.get_by_role("button", name="Open", exact=True).click()
        wait(page, "state.opened && !state.opening && state.times.length === 5")
        viewer = page.frame_locator("#run-viewer")
        viewer.get_by_text("C", exact=True).first.wait_for()
        slider = viewer.locator("input[type=range]").last
        slider.focus()
        slider.press("ArrowLeft")
        wait(page, "state.run_index === 3")
        other = browser.new_page()  # sees the same time, and follows
        other.goto(address)
        shown = other.frame_locator("#run-viewer").locator("#when")
        shown.filter(has_text="t = 30 ·").wait_for()
        slider.press("ArrowLeft")
        shown.filter(has_text="t = 20 ·").wait_for()
        slider.press("ArrowRight")
        shown.filter(has_text="t = 30 ·").wait_for()
        wait(page, "state.run_index === 3")
        other.close()
        box = viewer.locator("canvas").first.bounding_box()
        viewer.locator("canvas").first.click(
            position={"x": box["width"] / 2, "y": box["height"] / 2}
        )
        wait(page, "state.run_cell && state.figures.length && state.history")
        assert state(page, "run_cell") == "B"  # the middle one

        page.locator(".half").last.get_by_role("button", name="Picture", exact=True).click()
        wait(page, "state.made.length === 1 && !state.making")
        page.get_by_role("button", name="Write", exact=True).click()
        wait(page, "state.made.length === 2 && !state.making")
        assert not state(page, "look_error")
        with page.expect_download() as download:
            page.get_by_role("link", name=f"{name}-csv").click()
        assert download.value.suggested_filename == f"{Path(name).name}-csv.zip"
        with zipfile.ZipFile(download.value.path()) as archive:
            assert f"{Path(name).name}-csv/cells.csv" in archive.namelist()
        assert not faults
    picture, table = (tmp_path / entry for entry in (f"{name}-t30.png", f"{name}-csv/cells.csv"))
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert len(table.read_text().splitlines()) == 1 + 5 * 3
    scene = (tmp_path / name / "scene.toml").read_text()
    assert "0.9" in scene


@pytest.mark.skipif(bool(reason_for_none()), reason=reason_for_none())
def test_pause_stop_and_resume(tmp_path: Path) -> None:
    write_example(tmp_path)
    with served(tmp_path) as address, chromium() as browser:
        page = browser.new_page(viewport={"width": 1500, "height": 1000})
        page.goto(address)
        wait(page, "state.cells.length === 8")
        read_example(page)
        page.get_by_label("Time", exact=True).fill("1000000")
        page.get_by_role("button", name="Run", exact=True).click()
        wait(page, "state.status === 'running' && state.progress_text.startsWith('t = ')")
        page.get_by_role("button", name="Pause").click()
        wait(page, "state.status === 'paused'")
        held = state(page, "progress_text")
        page.wait_for_timeout(1200)
        assert state(page, "progress_text") == held
        page.get_by_role("button", name="Go on").click()
        wait(page, "state.status === 'running'")
        page.get_by_role("button", name="Stop").click()
        wait(page, "state.status === 'idle' && state.run_note")
        assert "is stopped and saved" in state(page, "run_note")
        choose(page, "Run", state(page, "run_title"))
        page.get_by_role("button", name="Open", exact=True).click()
        wait(page, "state.opened && !state.opening")
        assert state(page, "can_resume"), (state(page, "about"), state(page, "look_error"))
        page.get_by_role("button", name="Resume").click()
        wait(page, "state.status === 'running'")
        page.get_by_role("button", name="Stop").click()
        wait(page, "state.status === 'idle' && state.run_note")


def test_beyond_this_machine_a_token_is_needed(tmp_path: Path) -> None:
    with served(tmp_path, "--host", "0.0.0.0") as address:
        assert "?token=" in address
        named = urlsplit(address)
        assert named.hostname == socket.gethostname().lower()
        local = f"http://127.0.0.1:{named.port}/?{named.query}"
        with urllib.request.urlopen(local, timeout=30) as answer:
            assert answer.status == 200
            assert answer.headers["Content-Security-Policy"] == "frame-ancestors 'self'"
        for path in ("", "viewer", "files/x", "ws"):
            with pytest.raises(urllib.error.HTTPError, match="403"):
                urllib.request.urlopen(local.split("?")[0] + path, timeout=30)
