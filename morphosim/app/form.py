"""The form: what to simulate, as it is chosen and changed in the page."""

import asyncio
import warnings
from typing import Any
from urllib.parse import quote

import numpy as np

from morphosim.app import worker
from morphosim.app.changes import attraction_matrix
from morphosim.app.processes import Desk, words_of
from morphosim.app.settings import OWN, PRESET_NAMES, Settings, facts
from morphosim.app.source import Source
from morphosim.app.store import ARRAYS, IMAGES, MASKS, SCENES, TABLES, Store
from morphosim.importers.labels.scene import VOLUMES
from morphosim.library.built_in import scene_names
from morphosim.numerics.parameters import WALLS
from morphosim.scene.scene import Scene

FILES = {
    "mask_files": MASKS, "table_files": TABLES, "image_files": IMAGES, "scene_files": SCENES,
}  # fmt: skip
"""Lists of files to read, and their endings."""
FIRST = Source()
"""What is chosen at first."""
MOST_IN_TABLE = 24
"""Cells up to which the whole attraction matrix can be edited; beyond, one pair at a time."""
SOURCES = {
    "built-in": {"scene": "scene_name"},
    "matlab": {"masks": "masks", "table": "table", "shell": "shell_file", "spacing": "voxel"},
    "labels": {
        "image": "image", "table": "table", "spacing": "voxel", "time": "time_index",
        "axes": "axes", "key": "array", "about": "about", "frozen": "frozen",
        "volumes": "image_volumes", "least_voxels": "least_voxels", "background": "background",
    },
    "file": {"file": "scene_file"},
}  # fmt: skip
"""Of each tab, what of a `Source` its controls say, and the states where they say it."""
SOURCE_KEYS = sorted({"source_kind"}.union(*(keys.values() for keys in SOURCES.values())))
FILLED = (
    "cells", "sigma", "description", "stages", "has_shell", "duration", "save_every", "numerics",
)  # fmt: skip
"""Facts of a scene that the state has by the same names."""
LISTS = {"built-in": "scene_name", "file": "scene_file"}
"""Tabs of one list, and its state: what is chosen there is read at once."""

STATE = {
    "source_kind": "built-in", "scene_name": FIRST.scene, "scene_names": scene_names(),
    "scene_file": "", "masks": "", "table": "", "shell_file": "", "image": "", "voxel": "",
    "time_index": "", "axes": "", "array": "", "about": "", "frozen": "",
    "image_volumes": FIRST.volumes, "volume_kinds": list(VOLUMES), "least_voxels": "",
    "background": "",
    "mask_files": [], "table_files": [], "image_files": [], "scene_files": [],
    "loaded": "", "description": "", "stages": [], "has_shell": False,
    "cells": [], "sigma": [], "pair_from": "", "pair_to": "", "pair_value": "0", "pair_both": True,
    "duration": "", "save_every": "", "dt": "", "tolerance": "", "S": "", "walls": "",
    "wall_kinds": list(WALLS), "gamma": "", "own_gamma": "",
    "numerics": {OWN: dict.fromkeys(("dt", "tolerance", "S", "walls", "text"), "")},
    "preset": OWN, "presets": list(PRESET_NAMES), "shell": True,
    "run_name": "runs/test", "form_error": "", "form_warnings": [], "reading": False,
    "fits": "",
    "most_in_table": MOST_IN_TABLE,
    "save_name": "", "saving": False, "save_error": "", "saved": [],
}  # fmt: skip
"""What the form shows at first."""


class Form:
    """What the form does.

    Parameters
    ----------
    state : the page's state, of trame
    store : Store
    """

    def __init__(self, state: Any, store: Store) -> None:
        self._state, self._store = state, store
        self._source: Source | None = None  # what the form holds
        self._reading: Source | None = None
        self._turn = asyncio.Lock()  # of readers: warnings are caught for all threads alike
        self._scene: Scene | None = None  # as it was read, before anything is changed
        self._types: list[str] = []  # whose attraction is shown
        self._saver: Desk | None = None

    def close(self) -> None:
        """End the process that writes scenes, if there is one."""
        if self._saver is not None:
            self._saver.close()

    async def list_files(self) -> None:
        """Look for files to read."""
        found = await asyncio.to_thread(self._store.files, FILES)
        with self._state as state:
            state.update(found)

    async def uploaded(self, name: str) -> None:
        """Show a file that has come from the browser for a value of the state; read a scene."""
        await self.list_files()
        if name == "scene_file" and self._state.source_kind == "file":
            await self.read_source()

    def chosen(self) -> Source:
        """What the controls of the chosen tab say."""
        state, kind = self._state, self._state.source_kind
        said = {field: state[key] or "" for field, key in SOURCES[kind].items()}
        return Source(kind=kind, **said)

    def compare(self) -> None:
        """Find out of which tab the form is: it holds what its controls say, and is shown there."""
        chosen = self.chosen()
        self._state.fits = chosen.kind if chosen == self._source else ""

    async def choose_kind(self) -> None:
        """Show what the chosen tab says: a scene of a list is read at once, files when told."""
        with self._state as state:
            self._reading, state.reading, state.form_error = None, False, ""
            state.form_warnings = []
            self.compare()
        kind = state.source_kind
        if kind in LISTS and state[LISTS[kind]] and not state.fits:
            await self.read_source()

    async def read_source(self) -> None:
        """Read the chosen scene or files, and fill the form with what is there."""
        state = self._state
        source = self._reading = self.chosen()
        with state:
            state.reading, state.form_error, state.form_warnings = True, "", []
        scene, words = None, ""
        told: list[str] = []
        async with self._turn:
            if self._reading is not source:
                return  # another has been chosen while one before it was read
            try:
                scene, told = await asyncio.to_thread(_looked_at, source, self._store)
            except Exception as error:
                words = words_of(error)
        if self._reading is not source:
            return  # another has been chosen meanwhile
        with state:
            state.reading, state.form_error, state.form_warnings = False, words, told
            if scene is not None:
                self._source, self._scene = source, scene
                self._fill(facts(scene, rough=source.settles))
            self.compare()

    def _fill(self, found: dict[str, Any]) -> None:
        state = self._state
        names = [cell["name"] for cell in found["cells"]]
        self._types = [cell["type"] for cell in found["cells"]]
        for key in FILLED:
            state[key] = found[key]
        state.loaded, state.shell = found["name"], found["has_shell"]
        state.own_gamma, state.gamma = found["gamma"], ""
        state.pair_from, state.pair_to = names[0], names[-1]
        state.save_error, state.saved = "", []
        self._take_preset(OWN)
        self.propose_names()

    def propose_names(self) -> None:
        """Names of a run, and of a scene file, that are free."""
        state, plain = self._state, _plain(self._state.loaded)
        state.run_name = self._store.name(self._store.free(f"runs/{plain}"))
        state.save_name = self._free_scene(f"{plain}.toml")

    def _free_scene(self, name: str) -> str:
        return self._store.name(self._store.free(name, ARRAYS))

    def show_preset(self) -> None:
        """Show what the chosen preset means: nothing else is said of it then."""
        self._take_preset(self._state.preset or OWN)

    def _take_preset(self, name: str) -> None:
        state = self._state
        meant = state.numerics[name]
        state.preset, state.dt, state.tolerance = name, meant["dt"], meant["tolerance"]
        state.S = state.walls = ""

    def take_cure(self) -> None:
        """Choose the preset that is offered where another may diverge, for a run of its own."""
        with self._state:
            self._take_preset(worker.CURE)
            self.propose_names()

    def show_attraction(self) -> None:
        """Show the attraction of the types that the cells have now, but for entries typed."""
        state = self._state
        types = [str(cell["type"]).strip() for cell in state.cells]
        if self._scene is None or types == self._types:
            return
        self._types = types
        sigma = np.round(attraction_matrix(self._scene, types), 9).tolist()
        state.sigma = [
            [old if isinstance(old, str) else new for old, new in zip(*rows, strict=True)]
            for rows in zip(state.sigma, sigma, strict=True)
        ]

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
            types=[cell["type"] for cell in state.cells],
            volumes=[cell["volume"] for cell in state.cells],
            tensions=[cell["gamma"] for cell in state.cells],
            sigma=state.sigma,
            gamma=state.gamma,
            duration=state.duration,
            save_every=state.save_every,
            dt=state.dt,
            tolerance=state.tolerance,
            S=state.S,
            walls=state.walls or "",
            preset=state.preset,
            shell=state.shell or not state.has_shell,
            name=(state.run_name or "").strip(),
        )

    async def save(self) -> None:
        """Write the scene that the form says as a file, and offer it."""
        state = self._state
        if state.saving or not state.cells:
            return
        self._saver = self._saver or Desk()
        with state:
            state.saving, state.save_error, state.saved = True, "", []
        files, words = [], ""
        try:
            files = await self._saver.do(
                worker.save, self._heard, settings=self.settings(), name=state.save_name or "",
                store=self._store,
            )  # fmt: skip
        except Exception as error:
            words = words_of(error)
        with state:
            state.saving, state.save_error = False, words
            state.saved = [{"name": name, "link": f"files/{quote(name)}"} for name in files]
            if files:
                state.save_name = self._free_scene(files[0])
        await self.list_files()

    def _heard(self, kind: str, content: Any) -> None:
        """Show what is warned of while a scene is saved, once."""
        if kind == "warning" and content["text"] not in self._state.form_warnings:
            with self._state as state:
                state.form_warnings = [*state.form_warnings, content["text"]]


def _looked_at(source: Source, store: Store) -> tuple[Scene, list[str]]:
    """Scene of a source, and what its readers warn of."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", UserWarning)
        scene = source.read(store, quick=True)
    return scene, [str(warning.message) for warning in caught]


def _plain(name: str) -> str:
    """Name of a scene as that of a file or folder."""
    return "".join(c if c.isalnum() or c in "-_." else "_" for c in name).strip(".") or "run"
