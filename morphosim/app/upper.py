"""Upper half of the page: what to simulate, and the run that is going on."""

import asyncio
import time
from collections.abc import Awaitable, Callable
from typing import Any

from morphosim.app import worker
from morphosim.app.processes import STOP, Desk, Job, JobError, Stopped, words_of
from morphosim.app.routes import Streams
from morphosim.app.settings import OWN, PRESET_NAMES, Settings, Source, facts
from morphosim.app.store import IMAGES, MASKS, TABLES, Store
from morphosim.library.built_in import scene_names
from morphosim.progress import duration_text

FILES = {"mask_files": MASKS, "table_files": TABLES, "image_files": IMAGES}
"""Lists of files to import, and their endings."""
MOST_IN_TABLE = 24
"""Cells up to which the whole attraction matrix can be edited; beyond, one pair at a time."""
SOURCES = {
    "built-in": {"scene": "scene_name"},
    "matlab": {"masks": "masks", "table": "table", "shell": "shell_file", "spacing": "voxel"},
    "labels": {"image": "image", "table": "table", "spacing": "voxel"},
}  # fmt: skip
"""Of each tab, what of a `Source` its controls say, and the states where they say it."""
SOURCE_KEYS = sorted({"source_kind"}.union(*(keys.values() for keys in SOURCES.values())))
FIRST = "celegans-8"
STARTING = "starting"

STATE = {
    "source_kind": "built-in", "scene_name": FIRST, "scene_names": scene_names(),
    "masks": "", "table": "", "shell_file": "", "image": "", "voxel": "",
    "mask_files": [], "table_files": [], "image_files": [],
    "loaded": "", "description": "", "stages": [], "has_shell": False,
    "cells": [], "sigma": [], "pair_from": "", "pair_to": "", "pair_value": "0", "pair_both": True,
    "duration": "", "save_every": "", "dt": "", "dts": {}, "preset": OWN,
    "presets": list(PRESET_NAMES), "shell": True, "run_name": "runs/test", "form_error": "",
    "status": "idle", "run_title": "", "progress": 0, "progress_text": "", "run_error": "",
    "run_note": "", "warnings": [], "live_stream": {"key": "", "count": 0}, "reading": False,
    "fits": False, "run_end": "",
    "most_in_table": MOST_IN_TABLE, "first_picture": 0.0,
}  # fmt: skip
"""What the upper half shows at first."""


class Upper:
    """What the upper half does.

    Parameters
    ----------
    state : the page's state, of trame
    store : Store
    streams : Streams
    ended : coroutine function, called with the name of a run that has ended
    """

    def __init__(
        self, state: Any, store: Store, streams: Streams, ended: Callable[[str], Awaitable[None]]
    ) -> None:
        self._state, self._store, self._streams, self._ended = state, store, streams, ended
        self._runs, self._began = 0, 0.0
        self._source: Source | None = None  # what the form holds
        self._reading: Source | None = None
        self._until: float | None = None
        self._told: dict[str, Any] | None = None
        self._desk: Desk | None = None

    async def start(self) -> None:
        """Begin to serve: start the process of the simulation, show the first scene."""
        self._desk = Desk()
        await self.list_files()
        await self.read_source()
        await self._desk.do(worker.warm_up)

    def close(self) -> None:
        """End the simulation, which saves its state first."""
        if self._desk is not None:
            self._desk.close()

    async def list_files(self) -> None:
        """Look for files to import."""
        found = await asyncio.to_thread(self._store.files, FILES)
        with self._state as state:
            state.update(found)

    def chosen(self) -> Source:
        """What the controls of the chosen tab say."""
        state, kind = self._state, self._state.source_kind
        said = {field: state[key] or "" for field, key in SOURCES[kind].items()}
        return Source(kind=kind, **said)

    def compare(self) -> None:
        """Find out whether the form holds what the chosen tab says; it is shown only then."""
        self._state.fits = self.chosen() == self._source

    async def choose_kind(self) -> None:
        """Show what the chosen tab says: a scene of the list is read at once, files when told."""
        with self._state as state:
            self._reading, state.reading, state.form_error = None, False, ""
            self.compare()
        if state.source_kind == "built-in" and not state.fits:
            await self.read_source()

    async def read_source(self) -> None:
        """Read the chosen scene or files, and fill the form with what is there."""
        state = self._state
        source = self._reading = self.chosen()
        with state:
            state.reading, state.form_error = True, ""
        found, words = None, ""
        try:
            found = facts(await asyncio.to_thread(source.read, self._store, "ball"))
        except Exception as error:
            words = words_of(error)
        if self._reading is not source:
            return  # another has been chosen meanwhile
        with state:
            state.reading, state.form_error = False, words
            if found is not None:
                self._source = source
                self._fill(found)
            self.compare()

    def _fill(self, found: dict[str, Any]) -> None:
        state = self._state
        for key in ("cells", "sigma", "description", "stages", "has_shell", "dts"):
            state[key] = found[key]
        for key in ("duration", "save_every", "dt"):
            state[key] = f"{found[key]:g}"
        state.preset, state.shell = OWN, found["has_shell"]
        state.loaded = found["name"]
        names = [cell["name"] for cell in found["cells"]]
        state.pair_from, state.pair_to = names[0], names[-1]
        state.run_name = self._store.name(self._store.free(f"runs/{_plain(found['name'])}"))

    def set_pair(self) -> None:
        """Put the value of the pair below the matrix into it."""
        state = self._state
        names = [cell["name"] for cell in state.cells]
        if state.pair_from not in names or state.pair_to not in names:
            state.form_error = "choose two cells of the list for a pair"
            return
        j, i = names.index(state.pair_from), names.index(state.pair_to)
        sigma = [list(row) for row in state.sigma]
        sigma[j][i] = state.pair_value
        if state.pair_both:
            sigma[i][j] = state.pair_value
        state.sigma, state.form_error = sigma, ""

    def settings(self) -> Settings:
        """What the form says now."""
        state = self._state
        return Settings(
            source=self._source or self.chosen(),
            names=[cell["name"] for cell in state.cells],
            sigma=state.sigma,
            duration=state.duration,
            save_every=state.save_every,
            dt=state.dt,
            preset=state.preset,
            shell=state.shell or not state.has_shell,
            name=(state.run_name or "").strip(),
        )

    async def run(self) -> None:
        """Simulate what the form says."""
        await self._do(
            self._state.run_name, worker.simulate, settings=self.settings(), store=self._store
        )
        with self._state as state:
            state.run_name = self._store.free_name(state.run_name)

    async def resume(self, name: str) -> None:
        """Go on with a saved run."""
        await self._do(name, worker.resume, name=name, store=self._store)

    def pause(self) -> None:
        """Hold the run until it is told to go on."""
        self._ask(worker.PAUSE)

    def go_on(self) -> None:
        """Go on after a pause."""
        self._ask(worker.GO_ON)

    def stop(self) -> None:
        """End the run, unless it has just ended; it is saved."""
        if self._state.status in ("running", "paused"):
            self._state.status = "stopping"
            self._ask(STOP)

    def _ask(self, command: str) -> None:
        if self._desk is not None:
            self._desk.ask(command)

    async def _do(self, name: str, job: Job, /, **arguments: Any) -> None:
        """Do a job of the worker, and show how it ends."""
        if self._desk is None or self._state.status != "idle":
            return
        self._begin(name)
        end, error, note = "finished", "", f"{name} is saved"
        try:
            await self._desk.do(job, self._heard, **arguments)
        except JobError as failure:
            end, error, note = "failed", str(failure), ""
        except Stopped:
            end, note = "stopped", f"{name} is stopped and saved; Resume goes on with it"
        with self._state as state:
            state.status, state.run_end, state.run_error, state.run_note = "idle", end, error, note
            state.progress = 100 if end == "finished" else state.progress
            state.progress_text = progress_text(self._told, self._until) if self._told else ""
        await self._ended(name)

    def _begin(self, name: str) -> None:
        self._began = time.perf_counter()
        self._told, self._until = None, None
        self._streams.drop(self._state.live_stream["key"])
        with self._state as state:
            state.status, state.run_title, state.progress = "starting", name, 0
            state.progress_text = STARTING
            state.run_error, state.run_note, state.warnings = "", "", []
            state.live_stream = {"key": "", "count": 0}

    def _heard(self, kind: str, content: Any) -> None:
        """Show what the worker tells."""
        with self._state as state:
            getattr(self, f"_hear_{kind.replace(' ', '_')}")(state, content)

    def _hear_warning(self, state: Any, text: str) -> None:
        state.warnings = [*state.warnings, text]

    def _hear_compiling(self, state: Any, text: str) -> None:
        state.progress_text = text

    def _hear_began(self, state: Any, found: dict[str, Any]) -> None:
        self._until = found["until"]
        state.status = "running"
        if state.progress_text == STARTING:  # and not compiling
            state.progress_text = "first step"

    def _hear_load(self, state: Any, content: bytes) -> None:
        self._runs += 1
        key = f"live-{self._runs}"
        self._streams.open(key, content)
        state.live_stream = {"key": key, "count": 1}
        state.first_picture = round(time.perf_counter() - self._began, 2)

    def _hear_frame(self, state: Any, content: bytes) -> None:
        key = state.live_stream["key"]
        state.live_stream = {"key": key, "count": self._streams.add(key, content)}

    def _hear_progress(self, state: Any, found: dict[str, Any]) -> None:
        state.progress = round(100 * found["share"], 1)
        state.progress_text = progress_text(found, self._until)
        self._told = found | {"seconds_left": None}  # in the end nothing is left

    def _hear_paused(self, state: Any, content: None) -> None:
        state.status = "paused"

    def _hear_went_on(self, state: Any, content: None) -> None:
        state.status = "running"


def progress_text(found: dict[str, Any], until: float | None) -> str:
    """Time, stage, speed and what is left, in one line."""
    parts = [f"t = {found['time']:g}" + ("" if until is None else f" of {until:g}")]
    if found["stage"]:
        parts.append(f"stage {found['stage']}")
    parts.append(f"{found['cells']} cells" if found["cells"] > 1 else "1 cell")
    if found["steps_per_second"]:
        parts.append(f"{found['steps_per_second']:.3g} steps per second")
    if found["seconds_left"]:
        parts.append(f"about {duration_text(found['seconds_left'])} left")
    return " · ".join(parts)


def _plain(name: str) -> str:
    """Name of a scene as that of a folder."""
    return "".join(c if c.isalnum() or c in "-_." else "_" for c in name).strip(".") or "run"
