"""Running a simulation for the page: a job of a process of its own.

The page hears "compiling", "began", "load" (what a viewer opens with), "frame" (one time of the
view), "progress", "warning" and "remark"; it may ask for "pause", "go on" and "stop". A run that is
stopped is saved, and `resume` goes on with it.
"""

import json
import time
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from morphosim.accessor import open_run
from morphosim.app.processes import STOP, Channel, Stopped
from morphosim.app.settings import Settings, preset_of, with_preset
from morphosim.app.store import ARRAYS, Store
from morphosim.cell_field import CellField
from morphosim.progress import Remaining
from morphosim.runs.writer import RunWriter
from morphosim.scene.file import save_scene
from morphosim.scene.scene import Scene
from morphosim.scene.stability import StabilityWarning, concerns
from morphosim.simulation.compilation import compilation_told
from morphosim.simulation.simulation import Simulation

PAUSE, GO_ON = "pause", "go on"
BY_CLICK = "by a click in the app"
CURE = "standard"
"""Preset that is offered where another may diverge."""
TRIANGLES, ALL_TRIANGLES, FEWEST_TRIANGLES = 800, 1_000_000, 100
"""Triangles of a cell in the live view: of many cells fewer, so that all have about so many, but no
fewer than these."""
PICTURE_SHARE = 0.2
"""Pictures take at most this share of the time."""
THINNING = 0.01
"""Between two pictures there is at least this share of the run's time so far, so that a run of
hours has some hundred of them."""


def warm_up(channel: Channel) -> None:
    """Make a small picture, so that all that pictures take is there when the first is wanted."""
    from morphosim.pictures.meshes import field_meshes
    from morphosim.pictures.viewerdata import frame

    points = np.indices((16, 16, 16)) - 7.5
    ball = CellField("ball", np.zeros(3, np.int64), 1 / (1 + np.exp((points**2).sum(axis=0) - 25)))
    frame(0.0, field_meshes([ball], 1.0), triangles=100)


def simulate(channel: Channel, settings: Settings, store: Store) -> str:
    """Simulate the scene of the form, and save it; returns why it was stopped, or ""."""
    directory = store.new_run(settings.name)
    with _told(channel):
        scene = settings.scene(store)
    with _told(channel, scene):
        return _run(channel, Simulation(scene), directory)


def resume(channel: Channel, name: str, store: Store) -> str:
    """Go on with a run from its last save; returns why it was stopped, or ""."""
    directory = store.run(name)
    with _told(channel):
        return _run(channel, Simulation.from_run(directory), directory, resume=True)


def _run(channel: Channel, simulation: Simulation, directory: Path, resume: bool = False) -> str:
    writer = RunWriter.of(simulation.scene, directory, resume)
    simulation.run(observers=[writer, Watcher(channel, directory)])
    return "" if simulation.finished else simulation.stopped


def save(channel: Channel, settings: Settings, name: str, store: Store) -> list[str]:
    """Write the scene of the form as a scene file; returns the names of what is written."""
    place = store.new_scene(name)
    with _told(channel):
        scene = replace(settings, name=place.stem).scene(store)
    place.parent.mkdir(parents=True, exist_ok=True)
    save_scene(scene, place)
    return [store.name(file) for file in (place, place.with_suffix(ARRAYS)) if file.exists()]


@contextmanager
def _told(channel: Channel, scene: Scene | None = None) -> Iterator[None]:
    """Warnings, and that kernels are compiled, go to the page.

    Parameters
    ----------
    channel : Channel
    scene : of the form, which is run now; None where nothing of it can be changed
    """

    def warned(message: Warning | str, category: type[Warning], *_: Any, **__: Any) -> None:
        if issubclass(category, StabilityWarning):
            channel.tell(*_on_stability(str(message), scene))
        else:
            channel.tell("warning", {"text": str(message), "cured": False})

    with warnings.catch_warnings(), compilation_told(lambda text: channel.tell("compiling", text)):
        warnings.simplefilter("always", UserWarning)
        warnings.showwarning = warned
        yield


def _on_stability(text: str, scene: Scene | None) -> tuple[str, dict[str, Any]]:
    """Message of what may diverge: a remark, where nothing that was chosen one by one is to blame.

    It tells whether the preset `CURE` has no such concern.
    """
    if scene is None:
        return "remark", {"text": text, "cured": False}
    preset = preset_of(scene.numerics)
    cured = not concerns(with_preset(scene, CURE))
    if not (preset and cured):
        return "warning", {"text": text, "cured": cured}
    return "remark", {"text": f"As the preset {preset!r} has it: {text}", "cured": True}


class Watcher:
    """Observer that tells the page how a run gets on, and does what the page asks for.

    Parameters
    ----------
    channel : Channel
    directory : path of the run, whose first save exists when this is started
    interval : float
        Seconds between two tellings of the progress, and between two pictures at least.
    """

    def __init__(self, channel: Channel, directory: Path, interval: float = 0.5) -> None:
        self._channel, self._directory, self._interval = channel, directory, interval
        self._shown = -1  # tick

    def start(self, simulation: Simulation) -> None:
        """Tell the page what begins, and show it as the save says that has just been made."""
        self._until = simulation.scene.end
        self._channel.tell("began", {"until": self._until})
        triangles = _triangles(len(simulation.names))
        self._channel.tell("load", opening(self._directory, triangles, [simulation.time]))
        self._shown = simulation.ticks
        self._clock = Clock()
        self._begun = self._told = self._pictured = time.perf_counter()
        self._cost = 0.0

    def after_step(self, simulation: Simulation) -> None:
        """Obey; tell the progress and show a picture if they are due."""
        now = self._clock.step(simulation.time)
        if now - self._told > self._interval:
            self._told = now
            self._channel.tell("progress", self._progress(simulation))
        if self._picture_due(now):
            self._show(simulation)
        command = self._channel.asked()
        if command == PAUSE:
            command = self._pause(simulation)
        if command == STOP:
            simulation.stop(BY_CLICK)

    def finish(self, simulation: Simulation) -> None:
        """Tell the end and show it, unless nobody is there any more."""
        try:
            self._channel.tell("progress", self._progress(simulation))
            self._show(simulation)
        except Stopped:
            return

    def _pause(self, simulation: Simulation) -> str:
        """Wait until the page says how to go on."""
        self._show(simulation)
        self._channel.tell("progress", self._progress(simulation))
        self._channel.tell("paused")
        while (command := self._channel.wait()) not in (GO_ON, STOP):
            pass
        self._clock = Clock()
        if command == GO_ON:
            self._channel.tell("went on")
        return command

    def _picture_due(self, now: float) -> bool:
        thinned = THINNING * (now - self._begun)
        return now - self._pictured > max(self._interval, self._cost / PICTURE_SHARE, thinned)

    def _show(self, simulation: Simulation) -> None:
        """Send the fields as they are now, unless they have been sent."""
        if simulation.ticks == self._shown:
            return
        begin = time.perf_counter()
        self._channel.tell("frame", live_frame(simulation))
        self._shown = simulation.ticks
        self._pictured = time.perf_counter()
        self._cost = self._pictured - begin

    def _progress(self, simulation: Simulation) -> dict[str, Any]:
        left, share = None, 1.0
        if self._until is None:
            share = simulation.stages_ended / len(simulation.scene.stages)
        elif self._until > 0:
            share = simulation.time / self._until
            left = self._clock.left(self._until)
        return {
            "time": simulation.time,
            "share": share,
            "cells": len(simulation.names),
            "stage": simulation.stage,
            "steps_per_second": self._clock.steps_per_second,
            "seconds_left": left,
        }


class Clock:
    """Wall time of steps; the first, which may hold compilation, does not count."""

    def __init__(self) -> None:
        self.steps, self._seconds = 0, 0.0
        self._first: float | None = None
        self._remaining: Remaining | None = None

    def step(self, at: float) -> float:
        """Count a step that has led to *in silico* time `at`; return the wall time (s)."""
        now = time.perf_counter()
        if self._first is None or self._remaining is None:
            self._first, self._remaining = now, Remaining(at)
        else:
            self.steps += 1
            self._seconds = now - self._first
            self._remaining.note(self._seconds, at)
        return now

    @property
    def steps_per_second(self) -> float | None:
        """Speed so far; None before the second step."""
        return self.steps / self._seconds if self._seconds else None

    def left(self, until: float) -> float | None:
        """Seconds until an *in silico* time is reached; None before the second step."""
        return None if self._remaining is None else self._remaining.seconds(until)


def opening(
    directory: Path, triangles: int | None = None, times: Sequence[float] | None = None
) -> bytes:
    """What a viewer opens a run with, as JSON: its saves, by default all."""
    from morphosim.pictures.viewerdata import run_data

    with open_run(directory) as run:
        return json.dumps(run_data(run, times=times, triangles=triangles)).encode()


def live_frame(simulation: Simulation) -> bytes:
    """One time of a running simulation for the viewer, as JSON."""
    from morphosim.pictures.meshes import field_meshes
    from morphosim.pictures.viewerdata import frame

    types = dict(zip(simulation.names, simulation.types, strict=True))
    meshes = field_meshes(simulation.fields, simulation.scene.numerics.spacing, types)
    data = frame(
        simulation.time, meshes, _figures(simulation), stage=simulation.stage,
        triangles=_triangles(len(meshes)),
    )  # fmt: skip
    return json.dumps(data).encode()


def _triangles(cells: int) -> int:
    """Triangles of each of so many cells in the live view."""
    return max(min(TRIANGLES, ALL_TRIANGLES // max(cells, 1)), FEWEST_TRIANGLES)


def _figures(simulation: Simulation) -> dict[str, dict[str, Any]]:
    """What the viewer says of each cell."""
    names, measured = simulation.names, simulation.measured()
    columns = zip(names, measured.volume, simulation.targets, measured.surface_area, strict=True)
    figures: dict[str, dict[str, Any]] = {
        name: {"volume": float(v), "target": float(t), "surface": float(s), "neighbours": {}}
        for name, v, t, s in columns
    }
    pairs = zip(measured.contacts.tolist(), measured.contact_area.tolist(), strict=True)
    for (i, j), area in pairs:
        figures[names[i]]["neighbours"][names[j]] = area
    return figures
