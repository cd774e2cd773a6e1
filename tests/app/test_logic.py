"""The application without a browser: who may ask, what it may touch, what the form says."""

import asyncio
import threading
from pathlib import Path
from queue import Queue
from types import SimpleNamespace

import pytest

from morphosim import Cell, RunWriter, Scene, Simulation, Sphere
from morphosim.app import charts, store, worker
from morphosim.app.access import Access, is_loopback
from morphosim.app.lower import STATE, Lower
from morphosim.app.processes import Child
from morphosim.app.routes import Streams
from morphosim.app.store import Store
from morphosim.app.upper import STATE as UPPER
from morphosim.app.upper import Upper
from tests.app.page_state import State

LOCAL = {"Host": "127.0.0.1:8080"}


@pytest.mark.parametrize(
    ("host", "expected"),
    [
        ("127.0.0.1", True), ("localhost", True), ("::1", True), ("0.0.0.0", False),
        ("192.168.1.4", False), ("evil.example", False),
    ],
)  # fmt: skip
def test_what_is_this_machine(host: str, expected: bool) -> None:
    assert is_loopback(host) is expected
    assert (Access.of_host(host).token == "") is expected


@pytest.mark.parametrize(
    ("headers", "reason"),
    [
        (LOCAL, ""),
        (LOCAL | {"Origin": "http://127.0.0.1:8080"}, ""),
        (LOCAL | {"Origin": "http://evil.example"}, "another site"),
        (LOCAL | {"Sec-Fetch-Site": "cross-site", "Sec-Fetch-Dest": "iframe"}, "another site"),
        (LOCAL | {"Sec-Fetch-Site": "cross-site", "Sec-Fetch-Dest": "document"}, ""),
        ({"Host": "evil.example:8080"}, "is not this machine"),
        ({}, "is not this machine"),
    ],
)
def test_other_sites_are_refused(headers: dict[str, str], reason: str) -> None:
    refusal = Access().refusal(headers, {}, None)
    assert reason in refusal
    assert (refusal == "") is (reason == "")


def test_a_token_is_asked_for_beyond_this_machine() -> None:
    access = Access.of_host("0.0.0.0")
    outside = {"Host": "10.0.0.7:8080"}
    assert len(access.token) > 20
    assert "token" in access.refusal(outside, {}, None)
    assert "token" in access.refusal(outside, {"token": "wrong"}, "wrong too")
    assert access.refusal(outside, {"token": access.token}, None) == ""
    assert access.refusal(outside, {}, access.token) == ""
    assert Access.of_host("0.0.0.0").token != access.token
    assert Access.of_host("127.0.0.1", always=True).token != ""


@pytest.mark.parametrize("name", ["../out", "/etc/passwd", "a/../../out", ".", "", "link/file"])
def test_nothing_outside_of_the_folder(tmp_path: Path, name: str) -> None:
    root = tmp_path / "root"
    root.mkdir()
    (tmp_path / "secret").mkdir()
    (root / "link").symlink_to(tmp_path / "secret")
    store = Store(root)
    with pytest.raises(ValueError, match=r"leads out of the folder|is not allowed"):
        store.path(name)


def test_a_run_with_a_link_outside_is_refused(tmp_path: Path) -> None:
    root, secret = tmp_path / "root", tmp_path / "secret.nc"
    (root / "run").mkdir(parents=True)
    secret.write_text("x")
    (root / "run" / "save-000000.nc").symlink_to(secret)
    with pytest.raises(ValueError, match="leads out"):
        Store(root).run("run")


def test_names_of_runs_and_files(tmp_path: Path) -> None:
    store = Store(tmp_path)
    with pytest.raises(FileNotFoundError, match="there is no run 'x'"):
        store.run("x")
    (tmp_path / "runs" / "a").mkdir(parents=True)
    (tmp_path / "runs" / "a" / "save-000000.nc").touch()
    (tmp_path / "masks.mat").touch()
    assert store.runs() == ["runs/a"]
    assert store.files({"masks": (".mat",), "no": (".x",)}) == {"masks": ["masks.mat"], "no": []}
    with pytest.raises(FileExistsError, match="not empty"):
        store.new_run("runs/a")
    assert store.name(store.free("runs/a")) == "runs/a-2"
    with store.receiving("../../up.mat") as (name, write):
        write(b"abc")
    assert (tmp_path / name).read_bytes() == b"abc"
    assert name == "imports/up.mat"
    with store.receiving("up.mat") as (one, _), store.receiving("up.mat") as (two, _):
        assert (one, two) == ("imports/up-2.mat", "imports/up-3.mat")
    with store.receiving("save-000000.nc") as (name, _):  # a label image, and no run
        assert name == "imports/sent-save-000000.nc"
    assert store.runs() == ["runs/a"]
    with pytest.raises(ValueError, match="ending that is not known"), store.receiving("x.exe"):
        pass


def test_uploads_have_a_largest_size(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(store, "LARGEST_UPLOAD", 2**20)
    text = r"file 'big\.npy' is larger than 0\.000976562 GiB, .*copy it into .* instead"
    with pytest.raises(ValueError, match=text), Store(tmp_path).receiving("big.npy") as (_, write):
        write(bytes(2**20 + 1))
    assert not any((tmp_path / "imports").iterdir())


def test_runs_that_would_not_be_listed_are_refused(tmp_path: Path) -> None:
    for name in ("a/b/c/d/e", "runs/.hidden/a"):
        with pytest.raises(ValueError, match="would not be listed"):
            Store(tmp_path).new_run(name)
    deep = Store(tmp_path).new_run("a/b/c/d")
    deep.mkdir(parents=True)
    (deep / "save-000000.nc").touch()
    assert Store(tmp_path).runs() == ["a/b/c/d"]


def test_many_files_hide_no_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(store, "MOST_FOLDERS", 4)
    for folder, count in (("export", 50), ("run", 3)):
        (tmp_path / folder).mkdir()
        for k in range(count):
            (tmp_path / folder / f"save-{k:06d}.nc").touch()
    assert set(Store(tmp_path).runs()) == {"export", "run"}


def test_what_is_chosen_last_is_shown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run = tmp_path / "run"
    balls = {"a": Sphere(center=(0, 0, 0), radius=3), "b": Sphere(center=(9, 0, 0), radius=3)}
    cells = [Cell(name=name, shape=ball) for name, ball in balls.items()]
    Simulation(Scene(cells=cells)).run(until=0, observers=[RunWriter(run, 1)])
    drawn: list[str] = []

    def history(run: object, cell: str) -> str:
        drawn.append(cell)
        return f"history of {cell}"

    monkeypatch.setattr(charts, "history", history)
    monkeypatch.setattr(charts, "contact_matrix", lambda run, save: f"save {save}")
    state = State(STATE)
    lower = Lower(state, Store(tmp_path), Streams())

    async def choose(*cells: str) -> None:
        """Choose one after the other, while the thread that reads is busy."""
        busy = threading.Event()
        lower._reader.submit(busy.wait)
        chosen = asyncio.gather(*(lower.viewer_said("picked", cell) for cell in cells))
        await asyncio.sleep(0.01)
        busy.set()
        await chosen

    lower._take(run)
    state.colour_by = "of another run"
    lower._show_facts("run")
    assert {"cell", "type", "surface_area"} <= set(state.colours)
    assert state.colour_by == "cell"
    asyncio.run(choose("a", "b"))
    assert (state.run_cell, state.history, state.matrix) == ("b", "history of b", "save 0")
    assert {row["name"] for row in state.figures} > {"volume"}
    assert drawn == ["b"]
    asyncio.run(choose("a"))
    assert state.history == "history of a"
    assert state.can_resume
    lower.close()


def test_jobs_of_a_process_of_their_own(tmp_path: Path) -> None:
    heard: Queue[tuple[str, object]] = Queue()
    child = Child(lambda *said: heard.put(said))
    try:
        child.do(worker.resume, name="x", store=Store(tmp_path))
        kind, text = heard.get(timeout=240)
        assert kind == "failed"
        assert str(text).startswith("there is no run 'x'")
        child.do(worker.warm_up)
        assert heard.get(timeout=240) == ("done", None)
    finally:
        child.close()
    assert not child.alive


def test_a_run_is_offered_by_its_name(tmp_path: Path) -> None:
    class Done:
        async def do(self, *_: object, **__: object) -> str:
            return ""

    async def note(name: str) -> None:
        ended.append(name)

    ended: list[str] = []
    state = State(UPPER | {"run_name": " runs/new "})
    upper = Upper(state, Store(tmp_path), Streams(), note)
    upper._desk = Done()  # type: ignore[assignment]
    asyncio.run(upper.run())
    assert ended == [state.run_name] == ["runs/new"]
    assert state.run_note == "runs/new is saved"


def test_a_run_is_ended_and_saved_before_what_may_take_long(tmp_path: Path) -> None:
    async def note(name: str) -> None:
        """Hear of no run."""

    closed: list[str] = []
    upper = Upper(State(UPPER), Store(tmp_path), Streams(), note)
    upper._desk = SimpleNamespace(close=lambda: closed.append("run"))  # type: ignore[assignment]
    upper.form._saver = SimpleNamespace(close=lambda: closed.append("saver"))  # type: ignore[assignment]
    upper.close()
    assert closed == ["run", "saver"]
