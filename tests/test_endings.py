"""How runs end: by errors, interruptions and faults around them; what is said, what is saved."""

import fcntl
import itertools
import os
import pty
import random
import shutil
import signal
import subprocess
import sys
import termios
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from morphosim import (
    Cell,
    DivergenceError,
    Numerics,
    Physics,
    RunWriter,
    SaveError,
    Scene,
    Simulation,
    Sphere,
    load_fields,
    load_scene,
    measured,
    open_run,
    save_scene,
)
from morphosim.app.processes import words_of
from morphosim.cell_field import CellField
from morphosim.cli import main
from morphosim.engine.engine import Engine
from morphosim.errors import told
from morphosim.measure.aggregates import Aggregates
from morphosim.measure.contacts import touching
from morphosim.measure.label_image import label_image
from morphosim.measure.measurement import measure_fields
from morphosim.measure.motion import Positions, root_mean_square
from morphosim.measure.surfaces import cell_surface
from morphosim.measure.variable import MEASURED
from morphosim.runs.measured_state import MeasuredState, variables
from morphosim.simulation.observers import finish_all

from .extremes import outcome, random_scene
from .helpers import EXPECTED_TO_FAIL

ROOT = Path(__file__).resolve().parents[1]
TWO_CELLS = ROOT / "examples" / "two_cells.toml"


def scene(**options: Any) -> Scene:
    cell = Cell(name="a", shape=Sphere(center=(0, 0, 0), radius=3))
    physics = Physics(**options.pop("physics", {}))
    given = {"cells": [cell], "duration": 20.0, "save_every": 4.0} | options
    return Scene(**given, numerics=Numerics(S=6.0, threads=1), physics=physics)


class Watcher:
    """Observer that raises what it is given, after a step or at the end."""

    def __init__(
        self, *, at: float = np.inf, raises: Callable[[], None] = lambda: None,
        finishes: BaseException | None = None,
    ) -> None:  # fmt: skip
        self.at, self.raises, self.finishes, self.finished = at, raises, finishes, 0

    def start(self, simulation: Simulation) -> None:
        pass

    def after_step(self, simulation: Simulation) -> None:
        if simulation.time >= self.at:
            self.raises()

    def finish(self, simulation: Simulation) -> None:
        self.finished += 1
        if self.finishes is not None:
            raise self.finishes


@pytest.fixture
def call(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> Any:
    """Call the command line in this process: exit code, error output."""

    def of_words(words: list[str]) -> tuple[int, str]:
        monkeypatch.setattr(sys, "argv", ["morphosim", *words])
        with pytest.raises(SystemExit) as end:
            main()
        return int(end.value.code or 0), capfd.readouterr().err

    return of_words


# --- observers ---------------------------------------------------------------------------------


@EXPECTED_TO_FAIL
@pytest.mark.parametrize("failure", [ValueError("mine"), KeyboardInterrupt(), SaveError("full")])
def test_no_observer_hides_what_has_ended_a_run(failure: BaseException, tmp_path: Path) -> None:
    watchers = [Watcher(finishes=failure), RunWriter(tmp_path, 100), Watcher(finishes=failure)]
    simulation = Simulation(scene(physics={"M": 1e6}, duration=300.0))
    with pytest.raises(DivergenceError, match="diverged at t = ") as caught:
        simulation.run(observers=watchers)
    note = f"at the end Watcher raised {type(failure).__name__}: {failure}"
    assert caught.value.__notes__ == [note] * 2
    for text in (told(caught.value), words_of(caught.value)):
        assert text == f"{caught.value}; {note}; {note}".replace("  ", " ").strip()
    assert [watcher.finished for watcher in watchers[::2]] == [1, 1]
    with open_run(tmp_path) as run:
        assert run.attrs["error"] == str(caught.value)
        assert np.isfinite(load_fields(run, -1)[0].phi).all()


def test_what_an_observer_raises_at_the_end_of_a_sound_run_is_raised() -> None:
    first, second = ValueError("first"), ValueError("second")
    with pytest.raises(ValueError, match="first") as caught:
        finish_all([Watcher(finishes=first), Watcher(finishes=second), Watcher()], None)
    assert caught.value.__notes__ == ["at the end Watcher raised ValueError: second"]


# --- measuring what is sick --------------------------------------------------------------------


def ball(x: int) -> np.ndarray:
    points = np.indices((14, 14, 14)) - 6.5
    return 0.5 * (1 - np.tanh(0.5 * (np.sqrt((points**2).sum(axis=0)) - 5))).astype(np.float32)


def mixed(phi: np.ndarray) -> np.ndarray:
    phi[::2], phi[1::2] = np.inf, -np.inf
    return phi


def one(phi: np.ndarray, value: float) -> np.ndarray:
    phi[7, 7, 7] = value
    return phi


SICK: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "sound": lambda phi: phi,
    "NaN": lambda phi: phi * np.float32(np.nan),
    "one NaN": lambda phi: one(phi, np.nan),
    "inf": lambda phi: np.full_like(phi, np.inf),
    "-inf": lambda phi: np.full_like(phi, -np.inf),
    "both inf": mixed,
    "empty": np.zeros_like,
    "negative": lambda phi: phi - np.float32(1.5),
    "huge": lambda phi: phi * np.float32(3e38),
    "one point": lambda phi: np.zeros((1, 1, 1), np.float32),
    "from 4 to -4": lambda phi: np.where(np.indices(phi.shape).sum(axis=0) % 2, 4, -4).astype("f4"),
}


@pytest.mark.parametrize("kinds", list(itertools.product(SICK, repeat=2)), ids="-".join)
def test_what_is_sick_is_measured_without_an_error(kinds: tuple[str, str]) -> None:
    fields = [
        CellField(f"c{k}", np.array([8 * k, 0, 0]), SICK[kind](ball(k)))
        for k, kind in enumerate(kinds)
    ]
    cells = measure_fields(fields, 0.5)
    aggregates = Aggregates(cells, ["x", "y"])
    for name in variables():
        owner = MEASURED[name].owner
        for part in (cells, aggregates):
            if owner is type(part):
                getattr(part, name)
    now, before = (Positions(t, ["c0", "c1"], cells.centroid) for t in (1.0, 0.0))
    root_mean_square(now.speed(before))
    touching(fields)
    label_image(fields)
    for field in fields:
        assert np.isfinite(cell_surface(field, 0.5).vertices).all()
    if kinds[0] == "sound":  # as it is alone
        alone = measure_fields(fields[:1], 0.5)
        np.testing.assert_array_equal(cells.centroid[0], alone.centroid[0])
        np.testing.assert_array_equal(cells.semi_axes[0], alone.semi_axes[0])


def test_a_volume_function_that_fails_is_named_and_the_last_state_is_saved(tmp_path: Path) -> None:
    ball = Sphere(center=(0, 0, 0), radius=5)
    cell = Cell(name="a", shape=ball, volume=lambda t: 1 / (t < 9) * 500)
    simulation = Simulation(scene(cells=[cell]))
    told_of = r"cell 'a': volume at t = .* cannot be computed: ZeroDivisionError: division by zero"
    with pytest.raises(ValueError, match=told_of):
        simulation.run(until=40, observers=[RunWriter(tmp_path / "run", 100)])
    with open_run(tmp_path / "run") as run:
        assert run["time"].values.tolist() == [0, simulation.time]


@EXPECTED_TO_FAIL
def test_a_variable_that_fails_at_the_end_does_not_lose_the_last_state(tmp_path: Path) -> None:
    @measured(dims=("time", "cell"), units="1", text="a number")
    def fragile(state: MeasuredState) -> Any:
        if state.simulation.error:
            message = "cannot be measured"
            raise ValueError(message)
        return [1.0]

    simulation = Simulation(scene(physics={"M": 1e6}, duration=300.0))
    try:
        with (
            pytest.raises(DivergenceError),
            pytest.warns(UserWarning, match="last save is without fragile: .* be measured") as told,
        ):
            simulation.run(observers=[RunWriter(tmp_path, 100)])
    finally:
        del MEASURED["fragile"]
    assert told[0].filename == __file__
    with open_run(tmp_path) as run:
        assert np.isfinite(run["fragile"].values[:, 0]).tolist() == [True, False]
        assert "diverged" in run.attrs["error"]


# --- the command line --------------------------------------------------------------------------


@pytest.mark.parametrize(
    "settings",
    [
        ["physics.M=200", "numerics.S=6"],
        ["numerics.preset=standard", "numerics.S=0", "numerics.dt=8"],
    ],
)
@EXPECTED_TO_FAIL
def test_a_run_that_diverges_says_so_and_keeps_its_last_finite_state(
    call: Any, tmp_path: Path, settings: list[str]
) -> None:
    words = [word for setting in settings for word in ("--set", setting)]
    code, err = call(["run", str(TWO_CELLS), "-o", str(tmp_path / "run"), *words])
    assert code == 1
    (line,) = [line for line in err.splitlines() if line.startswith("error: ")]
    assert "diverged at t = " in line
    assert line.endswith("The last state is saved")
    with open_run(tmp_path / "run") as run:
        assert run.attrs["error"] in line
        assert all(np.isfinite(field.phi).all() for field in load_fields(run, -1))


@EXPECTED_TO_FAIL
def test_random_extreme_scenes_end_well(call: Any, tmp_path: Path) -> None:
    found = [outcome(random_scene(random.Random(seed)), tmp_path / "e", call) for seed in EXTREMES]
    assert not [end for end in found if end.startswith("WRONG")]
    assert {"finished", "diverged"} <= set(found)


EXTREMES = (0, 1, 2, 3, 5, 9, 20, 22)
"""Seeds; each solver with steps of δt is among them, and each preset of `random_scene`."""


def test_a_run_does_not_end_before_what_it_has_reached(call: Any, tmp_path: Path) -> None:
    save_scene(scene(), tmp_path / "scene.toml")
    directory = str(tmp_path / "run")
    assert call(["run", str(tmp_path / "scene.toml"), "-o", directory])[0] == 0
    before = (tmp_path / "run" / "scene.toml").read_bytes()
    for until in ("12", "0"):
        code, err = call(["run", "--resume", directory, "--until", until])
        assert code == 2
        assert f"--until {until}: the run has reached t = 20 already; give a later end" in err
    code, err = call(["run", "--resume", directory, "--until", "1e30"])
    assert code == 2
    assert "scene.duration = 1e+30 takes 5e+29 steps of numerics.dt = 2; at most 1e+11" in err
    assert (tmp_path / "run" / "scene.toml").read_bytes() == before
    assert call(["run", "--resume", directory, "--until", "20"])[0] == 0


def test_too_little_memory_ends_a_run_in_one_line(
    call: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    save_scene(scene(), tmp_path / "scene.toml")
    step = Engine.step

    def greedy(self: Engine, most: int) -> None:
        if self.steps == 5:
            self.whole = False
            message = "Unable to allocate 3.00 TiB"
            raise MemoryError(message)
        step(self, most)

    monkeypatch.setattr(Engine, "step", greedy)
    code, err = call(["run", str(tmp_path / "scene.toml"), "-o", str(tmp_path / "run")])
    assert code == 1
    why = "error: there is not enough memory at t = 10 (Unable to allocate 3.00 TiB)"
    assert f"{why}. The saves before are kept" in err
    assert f"go on with: morphosim run --resume {tmp_path / 'run'}" in err
    assert "Traceback" not in err
    monkeypatch.setattr(Engine, "step", step)
    assert Simulation.from_run(tmp_path / "run").time == 8


# --- around a run ------------------------------------------------------------------------------


@pytest.mark.parametrize("fate", ["deleted", "renamed", "replaced"])
def test_a_directory_that_goes_away_is_told_as_that(tmp_path: Path, fate: str) -> None:
    directory = tmp_path / "run"

    def go_away() -> None:
        if fate == "deleted":
            shutil.rmtree(directory, ignore_errors=True)  # old states go at the same time
        else:
            directory.rename(tmp_path / "elsewhere")
        if fate == "replaced":
            directory.mkdir()

    gone = Watcher(at=10, raises=lambda: directory.exists() and not done and done.append(go_away()))
    done: list[Any] = []
    simulation = Simulation(scene())
    message = r"cannot save t = 12: the directory .*run is not there any more, as it was deleted or"
    with pytest.raises(SaveError, match=message) as caught:
        simulation.run(observers=[gone, RunWriter(directory, 4)])
    assert not hasattr(caught.value, "__notes__")
    assert "Make room" not in str(caught.value)
    assert fate == "replaced" or not directory.exists()
    if fate != "deleted":
        again = Simulation.from_run(tmp_path / "elsewhere")
        assert again.time == 8
        again.run(observers=[RunWriter(tmp_path / "elsewhere", 4, resume=True)])


def test_a_terminal_that_is_closed_ends_a_run_saved(tmp_path: Path) -> None:
    save_scene(replace(scene(), duration=1e7), tmp_path / "one.toml")
    command = [sys.executable, "-c", "from morphosim.cli import main; main()"]
    command += ["run", str(tmp_path / "one.toml"), "-o", str(tmp_path / "run")]
    terminal, inner = pty.openpty()

    def in_the_terminal() -> None:
        signal.signal(signal.SIGHUP, signal.SIG_DFL)  # these tests may run where it is ignored
        fcntl.ioctl(0, termios.TIOCSCTTY, 0)

    run = subprocess.Popen(
        command, stdin=inner, stdout=inner, stderr=inner, start_new_session=True,
        preexec_fn=in_the_terminal,
    )  # fmt: skip
    os.close(inner)
    try:
        end = time.monotonic() + 240
        while not (tmp_path / "run" / "save-000001.nc").exists() and time.monotonic() < end:
            time.sleep(0.05)
        os.close(terminal)
        assert run.wait(timeout=240) == 130
    finally:
        run.kill()
    again = Simulation.from_run(tmp_path / "run")
    assert again.time >= 4
    assert load_scene(tmp_path / "run" / "scene.toml").duration == 1e7
