"""The application's server: who reaches it, and what its page does when it is gone."""

import socket
import urllib.error
import urllib.request
from pathlib import Path
from urllib.parse import urlsplit

import pytest

from tests.app.application import PATIENCE, served, wait
from tests.pictures.browser import PLAIN, chromium

pytest.importorskip("trame_vuetify", reason="trame is not installed")


def test_beyond_this_machine_a_token_is_needed(tmp_path: Path) -> None:
    with served(tmp_path, "--host", "0.0.0.0") as address:
        assert "?token=" in address
        named = urlsplit(address)
        assert named.hostname == socket.gethostname().lower()
        local = f"http://127.0.0.1:{named.port}/?{named.query}"
        with urllib.request.urlopen(local, timeout=120) as answer:
            assert answer.status == 200
            assert answer.headers["Content-Security-Policy"] == "frame-ancestors 'self'"
        for path in ("", "viewer", "files/x", "ws"):
            with pytest.raises(urllib.error.HTTPError, match="403"):
                urllib.request.urlopen(local.split("?")[0] + path, timeout=120)


def test_a_page_that_has_lost_its_server_says_so_and_comes_back(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = str(free.getsockname()[1])
    with chromium(*PLAIN) as browser:
        page = browser.new_page()
        with served(tmp_path, "--port", port) as address:
            page.goto(address)
            wait(page, "state.cells.length === 8")
        page.get_by_role("heading", name="MorphoSim does not answer").wait_for()
        with served(tmp_path, "--port", port):
            page.get_by_role("heading", name="Simulate").wait_for(timeout=PATIENCE)
            wait(page, "state.cells.length === 8")
