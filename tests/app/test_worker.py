"""What runs for the page, and what it shows of runs, without a browser."""

import base64
import gzip
import json
import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numba.core import event

from morphosim import Cell, Physics, RunWriter, Scene, Simulation, Sphere, open_run
from morphosim.app import charts, tasks, worker
from morphosim.app.lower import MOST_SAVES, chosen_saves
from morphosim.app.settings import OWN, Settings, facts
from morphosim.app.source import Source
from morphosim.app.store import Store
from morphosim.app.upper import progress_text
from morphosim.kernels.step import step_band
from morphosim.pictures.matrix import contact_matrix
from morphosim.scene.stability import chosen_S, concerns

pytest.importorskip("pyvista", reason="PyVista is not installed")


class Commands:
    """A channel that keeps what it is told, and gives a command at each step.

    Not that kernels are compiled, which some caches make needless.
    """

    def __init__(self, *commands: str) -> None:
        self.told: list[tuple[str, Any]] = []
        self._commands = list(commands)

    def tell(self, kind: str, content: Any = None) -> None:
        if kind != "compiling":
            self.told.append((kind, content))

    def asked(self) -> str:
        return self._commands.pop(0) if self._commands else ""

    wait = asked

    def kinds(self) -> list[str]:
        return [kind for kind, _ in self.told]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a label image, and a run of its two cells that was stopped."""
    root = tmp_path_factory.mktemp("folder")
    grid = np.meshgrid(*map(np.arange, (48, 28, 28)), indexing="ij", sparse=True)
    labels = np.zeros((48, 28, 28), np.uint16)
    for label, x in ((3, 16), (7, 31)):
        distance = sum((p - o) ** 2 for p, o in zip(grid, (x, 14, 14), strict=True))
        labels[distance < 7.5**2] = label
    np.save(root / "labels.npy", labels)
    (root / "table.csv").write_text(",left,right\nleft,0,0.3\nright,0.1,0\n")
    return root


@pytest.fixture(scope="module")
def form(folder: Path) -> Settings:
    source = Source(kind="labels", image="labels.npy", table="table.csv", spacing="0.5")
    found = facts(source.read(Store(folder)))
    return Settings(
        source=source, names=[cell["name"] for cell in found["cells"]], sigma=found["sigma"],
        duration="40", save_every="10", dt="2", shell=False, name="runs/pair",
    )  # fmt: skip


def test_a_label_image_with_a_table(folder: Path, form: Settings) -> None:
    scene = form.scene(Store(folder))
    assert scene.names == ["left", "right"]
    np.testing.assert_array_equal(
        scene.physics.attraction.matrix(scene.names), [[0, 0.3], [0.1, 0]]
    )
    (folder / "short.csv").write_text("left\n")
    short = Source(kind="labels", image="labels.npy", table="short.csv", spacing="0.5")
    with pytest.raises(ValueError, match=r"short.csv has 1 names, but the image has 2 labels"):
        short.read(Store(folder))


def test_the_stabilisation_is_what_an_image_needs(folder: Path, form: Settings) -> None:
    store = Store(folder)
    assert chosen_S(replace(form, shell=True).scene(store)) > 12 > 6 > chosen_S(form.scene(store))
    for preset in (OWN, "fast", "standard"):
        assert concerns(replace(form, shell=True, preset=preset).scene(store)) == []


def test_a_run_that_is_stopped_goes_on_to_the_same_end(folder: Path, form: Settings) -> None:
    store = Store(folder)
    channel = Commands("", worker.PAUSE, worker.GO_ON, "", "stop")
    assert worker.simulate(channel, form, store) == worker.BY_CLICK  # type: ignore[arg-type]
    kinds = channel.kinds()
    assert kinds[:2] == ["began", "load"]
    assert kinds.index("paused") < kinds.index("went on")
    with open_run(store.run("runs/pair")) as run:
        assert run["time"].values[-1] == 8  # four steps
        assert run.attrs["stopped"] == worker.BY_CLICK

    again = Commands()
    assert worker.resume(again, "runs/pair", store) == ""  # type: ignore[arg-type]
    assert again.told[0] == ("began", {"until": 40})
    whole = Simulation(form.scene(store))
    whole.run(observers=[RunWriter(folder / "whole", 10)])
    with open_run(store.run("runs/pair")) as run:
        np.testing.assert_array_equal(run["volume"][-1], whole.volumes)


def test_steps_too_long_for_the_run_are_told_before_it(folder: Path, form: Settings) -> None:
    store = Store(folder)
    for changes, told in (
        ({"dt": "1000", "duration": "4000"}, "numerics.dt = 1000 is too long for a run of 4000"),
        ({"duration": "1e30"}, "scene.duration = 1e+30 takes 5e+29 steps of numerics.dt = 2"),
        ({"save_every": "1e-30"}, "save_every = 1e-30 is far shorter than a step"),
    ):
        channel = Commands()
        with pytest.raises(ValueError, match=re.escape(told)):
            worker.simulate(channel, replace(form, name="long", **changes), store)  # type: ignore[arg-type]
        assert channel.told == []
        assert not store.path("long").exists()


def test_live_frames_say_what_the_saves_say(folder: Path) -> None:
    cells = [
        Cell(name=n, shape=Sphere(center=(x, 0, 0), radius=5)) for n, x in (("a", 0), ("b", 9))
    ]
    simulation = Simulation(Scene(cells=cells, physics=Physics(sigma=0.5)))
    simulation.run(until=4, observers=[RunWriter(folder / "live", 4)])
    live = json.loads(worker.live_frame(simulation))
    saved = json.loads(worker.opening(folder / "live", worker.TRIANGLES, [4.0]))["frames"][0]
    for key in ("time", "cells", "types", "volume", "target", "surface"):
        assert live[key] == saved[key]
    np.testing.assert_allclose(live["contacts"], saved["contacts"], rtol=1e-4)


def test_the_live_view_of_many_cells_has_fewer_triangles_of_each(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(worker, "ALL_TRIANGLES", 300)  # as if two cells were many
    cells = [
        Cell(name=n, shape=Sphere(center=(x, 0, 0), radius=5)) for n, x in (("a", 0), ("b", 20))
    ]
    live = json.loads(worker.live_frame(Simulation(Scene(cells=cells))))
    sizes = np.frombuffer(gzip.decompress(base64.b64decode(live["mesh"])), "<u4", 14)
    assert sizes[0] == 2  # meshes, of each of which vertices, faces, and four numbers follow
    np.testing.assert_allclose(sizes[[2, 8]], 150, atol=3)


def test_the_view_shows_the_last_save_first(folder: Path) -> None:
    channel = Commands()
    path = folder / "live"
    whole = json.loads(tasks.view(channel, path, [0.0, 4.0]))  # type: ignore[arg-type]
    assert channel.kinds() == ["first"]
    assert [frame["time"] for frame in json.loads(channel.told[0][1])["frames"]] == [4]
    assert [frame["time"] for frame in whole["frames"]] == [0, 4]


def test_figures_of_a_cell(folder: Path) -> None:
    with open_run(folder / "live") as run:
        names, areas, _ = contact_matrix(run, 1)
        rows = {row["name"]: row["text"] for row in charts.figures(run, 1, "a")}
        for image in (charts.history(run, "a"), charts.contact_matrix(run, 1)):
            assert image.startswith("data:image/svg+xml;base64,")
    assert names == ["a", "b"]
    assert areas[0, 1] == areas[1, 0] > 0
    assert rows["touches"] == f"b {areas[0, 1]:.0f} µm²"
    assert rows["target volume"] == "523.6 µm³"


@pytest.mark.parametrize("count", [1, 2, MOST_SAVES, MOST_SAVES + 1, 500])
def test_the_first_and_last_saves_are_shown(count: int) -> None:
    chosen = chosen_saves(count)
    assert (chosen[0], chosen[-1]) == (0, count - 1)
    assert len(set(chosen)) == min(count, MOST_SAVES) == len(chosen)


def test_progress_in_one_line() -> None:
    found = {
        "time": 20.0, "cells": 8, "stage": "", "steps_per_second": 41.234, "seconds_left": 200.0,
    }  # fmt: skip
    text = progress_text(found, 100.0)
    assert text == "t = 20 of 100 · 8 cells · 41.2 steps per second · about 3 min left"
    staged = found | {"stage": "2 cells", "seconds_left": None}
    assert progress_text(staged, None) == "t = 20 · stage 2 cells · 8 cells · 41.2 steps per second"


def test_the_page_hears_that_kernels_are_compiled() -> None:
    heard: list[tuple[str, Any]] = []
    channel = SimpleNamespace(tell=lambda *said: heard.append(said))
    with worker._told(channel):  # type: ignore[arg-type]
        for kernel in (step_band, step_band):
            event.start_event("numba:compile", {"dispatcher": kernel})
    ((kind, text),) = heard
    assert kind == "compiling"
    assert "20 to 60 s" in text
