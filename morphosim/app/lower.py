"""Lower half of the page: looking at a run."""

import asyncio
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from morphosim.app import charts, tasks
from morphosim.app.processes import Desk, Job, JobError, Stopped, words_of
from morphosim.app.routes import Streams
from morphosim.app.store import Store
from morphosim.app.worker import warm_up
from morphosim.exports.formats import FORMATS
from morphosim.pictures.colours import BY, measures

if TYPE_CHECKING:
    import xarray as xr

MOST_SAVES = 60
"""Saves of a run that the view holds; of more, so many evenly spread ones."""

STATE = {
    "runs": [], "look_name": "", "opened": "", "opening": False, "look_error": "", "about": "",
    "can_resume": False, "run_stream": {"key": "", "count": 0}, "times": [], "run_index": -1,
    "run_cells": [], "run_cell": None, "figures": [], "history": "", "matrix": "",
    "colour_by": "cell", "colours": list(BY), "mirror": False, "format": "csv",
    "formats": [{"value": key, "title": form.title} for key, form in FORMATS.items()],
    "making": "", "made": [], "look_first_picture": 0.0,
}  # fmt: skip
"""What the lower half shows at first."""


class Lower:
    """What the lower half does.

    Parameters
    ----------
    state : the page's state, of trame
    store : Store
    streams : Streams
    """

    def __init__(self, state: Any, store: Store, streams: Streams) -> None:
        self._state, self._store, self._streams = state, store, streams
        self._reader = ThreadPoolExecutor(1)  # netCDF files are read in one thread at a time
        self._run: xr.Dataset | None = None
        self._saves: list[int] = []
        self._count, self._whole, self._viewed = 0, False, False
        self._wanted = object()  # what is to be drawn; another one for each choice
        self._traced: str | None = ""  # cell of the run whose history is drawn
        self._viewing: Desk | None = None
        self._making: Desk | None = None

    async def start(self) -> None:
        """Begin to serve: look for runs, start the processes that make views, pictures and data."""
        self._viewing, self._making = Desk(), Desk()
        with self._state:
            self.list_runs()
        await self._viewing.do(warm_up)

    def close(self) -> None:
        """End what is being done."""
        for desk in (self._viewing, self._making):
            if desk is not None:
                desk.close()
        self._reader.shutdown()

    @property
    def opened(self) -> str:
        """Name of the run that is open; "" for none."""
        return str(self._state.opened)

    def list_runs(self) -> None:
        """Look for runs."""
        self._state.runs = self._store.runs()
        if not self._state.look_name and self._state.runs:
            self._state.look_name = self._state.runs[0]

    async def run_ended(self, name: str) -> None:
        """Offer a run that has just ended; if it is open, what has been added is shown too."""
        with self._state as state:
            self.list_runs()
            if name in state.runs:
                state.look_name = name
        if name == self.opened == state.look_name:
            await self.open()

    async def open(self) -> None:
        """Open the chosen run: the last save at once, the others when they are ready."""
        name, began = self._state.look_name or "", time.perf_counter()
        self._wanted = object()
        with self._state as state:
            state.opening, state.look_error = True, ""
        try:
            path = self._store.run(name)
            await self._read(self._take, path)
            with self._state:
                self._show_facts(name)
            await asyncio.gather(self._show_cells(path, began), self._update(cell=None))
        except Stopped:
            return  # another run has been opened meanwhile
        except Exception as error:
            with self._state as state:
                state.look_error = words_of(error)
        with self._state as state:
            state.opening = False

    def _take(self, path: Path) -> None:
        from morphosim.accessor import open_run

        if self._run is not None:
            self._run.close()
        self._traced = ""
        self._run = open_run(path).load() if path.is_file() else open_run(path)

    def _show_facts(self, name: str) -> None:
        run, state = self._run, self._state
        assert run is not None
        times = run["time"].values.tolist()
        self._saves = chosen_saves(len(times))
        state.made = state.made if name == state.opened else []
        state.opened, state.times = name, [times[save] for save in self._saves]
        state.run_index = len(self._saves) - 1
        state.run_cell, state.run_cells = None, run["cell"].values.astype(str).tolist()
        state.colours = list(dict.fromkeys((*BY, *measures(run))))
        if state.colour_by not in state.colours:
            state.colour_by = BY[0]
        error, end = run.attrs["error"], run.attrs["duration"]
        saves = "1 save" if len(times) == 1 else f"{len(times)} saves"
        state.about = f"{saves}, t = {times[0]:g} to {times[-1]:g}"
        if len(self._saves) < len(times):
            state.about += f"; {len(self._saves)} of them are shown"
        if error:
            state.about += f". Ended by an error: {error}"
        finished = run.attrs.get("finished", times[-1] >= end - 1e-9)  # of old runs, by their time
        state.can_resume = not error and not finished
        if state.can_resume and (why := run.attrs.get("stopped", "")):
            state.about += f". Stopped: {why}"

    async def _show_cells(self, path: Path, began: float) -> None:
        assert self._viewing is not None
        if self._viewed:  # the run before, of which not all is ready yet
            self._viewing.break_off()
        self._viewed = True
        self._stream("", b"")

        def shown(kind: str, content: bytes) -> None:
            with self._state as state:
                self._stream(kind, content)
                if kind == "first" or len(state.times) == 1:
                    state.look_first_picture = round(time.perf_counter() - began, 2)

        times = list(self._state.times)
        try:
            shown("whole", await self._viewing.do(tasks.view, shown, run=path, times=times))
        except JobError:
            self._viewed = False
            raise
        self._viewed = False

    def _stream(self, kind: str, content: bytes) -> None:
        """Show something else in the viewer; nothing where there is no kind."""
        self._streams.drop(self._state.run_stream["key"])
        self._count, self._whole = self._count + 1, kind == "whole"
        key = f"run-{self._count}" if kind else ""
        if kind:
            self._streams.open(key, content)
        self._state.run_stream = {"key": key, "count": 1}

    async def viewer_said(self, kind: str, value: Any) -> None:
        """Follow what is chosen in the view."""
        if self._run is None:
            return
        state = self._state
        if kind == "picked" and value != state.run_cell:
            with state:
                state.run_cell = value
            await self._update(value)
        elif kind == "shown" and self._whole and value != state.run_index:
            with state:
                state.run_index = int(value)
            await self._update(state.run_cell)

    async def choose_cell(self) -> None:
        """Show the cell that is chosen in the list."""
        await self._update(self._state.run_cell)

    async def _update(self, cell: str | None) -> None:
        """Draw the figures of what is chosen, unless something else is chosen meanwhile."""
        run, index = self._run, self._state.run_index
        if run is None or not 0 <= index < len(self._saves):
            return
        save, wanted = self._saves[index], object()
        self._wanted = wanted

        def drawn() -> dict[str, Any]:
            found: dict[str, Any] = {"figures": charts.figures(run, save, cell) if cell else []}
            if self._wanted is wanted:
                found["matrix"] = charts.contact_matrix(run, save)
            if self._wanted is wanted and self._traced != cell:
                found["history"] = charts.history(run, cell) if cell else ""
            return found

        found = await self._read(lambda: drawn() if self._wanted is wanted else {})
        if self._wanted is wanted:
            self._traced = cell
            with self._state as state:
                state.update(found)

    async def _read(self, function: Callable[..., Any], *arguments: Any) -> Any:
        loop = asyncio.get_running_loop()
        return await loop.run_in_executor(self._reader, function, *arguments)

    async def make_picture(self) -> None:
        """Write a picture of what is shown."""
        state = self._state
        target = f"{state.opened}-t{state.times[state.run_index]:g}.png"
        await self._make(
            "picture", tasks.picture, target, time=state.times[state.run_index],
            by=state.colour_by, mirror=state.mirror,
        )  # fmt: skip

    async def make_film(self) -> None:
        """Write a film of the run."""
        state = self._state
        await self._make(
            "film", tasks.film, f"{state.opened}.mp4", by=state.colour_by, mirror=state.mirror
        )

    async def make_data(self) -> None:
        """Write the run for other programs."""
        to = self._state.format
        await self._make(FORMATS[to].title, tasks.table, f"{self._state.opened}-{to}", to=to)

    def break_off(self) -> None:
        """Break off what is being made."""
        if self._making is not None:
            self._making.break_off()

    async def _make(self, what: str, job: Job, name: str, **arguments: Any) -> None:
        """Write a file or folder beside the run, and list it."""
        state = self._state
        if self._making is None or state.making:
            return
        with state:
            state.making, state.look_error = what, ""
        try:
            run, target = self._store.run(state.opened), self._store.free(name)
            await self._making.do(job, self._told(what), run=run, target=target, **arguments)
            with state:
                state.made = [*state.made, self._entry(what, target)]
        except Stopped:
            pass
        except Exception as error:
            with state:
                state.look_error = words_of(error)
        with state:
            state.making = ""

    def _entry(self, what: str, target: Path) -> dict[str, Any]:
        name = self._store.name(target)
        return {"what": what, "name": name, "link": f"files/{quote(name)}"}

    def _told(self, what: str) -> Callable[[str, Any], None]:
        def told(kind: str, content: Any) -> None:
            if kind == "progress":
                done, of = content
                with self._state as state:
                    state.making = f"{what}, {done} of {of}"

        return told


def chosen_saves(count: int) -> list[int]:
    """Numbers of the saves that the view holds, of `count`; the first and last among them."""
    if count <= MOST_SAVES:
        return list(range(count))
    return [round(k * (count - 1) / (MOST_SAVES - 1)) for k in range(MOST_SAVES)]
