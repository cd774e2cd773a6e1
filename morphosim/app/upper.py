"""Upper half of the page: what to simulate, and the run that is going on."""

import time
from collections.abc import Awaitable, Callable
from typing import Any

from morphosim.app import worker
from morphosim.app.form import STATE as FORM_STATE
from morphosim.app.form import Form
from morphosim.app.processes import STOP, Desk, Job, JobError, Stopped
from morphosim.app.routes import Streams
from morphosim.app.store import Store
from morphosim.progress import duration_text

STARTING = "starting"

STATE = {
    **FORM_STATE,
    "status": "idle", "run_title": "", "progress": 0, "progress_text": "", "run_error": "",
    "run_note": "", "run_end": "", "warnings": [], "remarks": [],
    "live_stream": {"key": "", "count": 0}, "first_picture": 0.0, "cure": worker.CURE,
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
        self.form = Form(state, store)
        self._runs, self._began = 0, 0.0
        self._until: float | None = None
        self._told: dict[str, Any] | None = None
        self._desk: Desk | None = None

    async def start(self) -> None:
        """Begin to serve: start the process of the simulation, show the first scene."""
        self._desk = Desk()
        await self.form.list_files()
        await self.form.read_source()
        await self._desk.do(worker.warm_up)

    def close(self) -> None:
        """End the simulation, which saves its state first, and then all else."""
        if self._desk is not None:
            self._desk.close()
        self.form.close()

    async def run(self) -> None:
        """Simulate what the form says."""
        settings = self.form.settings()
        await self._do(settings.name, worker.simulate, settings=settings, store=self._store)
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
            if why := await self._desk.do(job, self._heard, **arguments):
                end, note = (
                    "stopped",
                    f"{name} is stopped and saved ({why}); Resume goes on with it",
                )
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
            state.run_error, state.run_note = "", ""
            state.warnings, state.remarks = [], []
            state.live_stream = {"key": "", "count": 0}

    def _heard(self, kind: str, content: Any) -> None:
        """Show what the worker tells."""
        with self._state as state:
            getattr(self, f"_hear_{kind.replace(' ', '_')}")(state, content)

    def _hear_warning(self, state: Any, content: dict[str, Any]) -> None:
        state.warnings = [*state.warnings, content]

    def _hear_remark(self, state: Any, content: dict[str, Any]) -> None:
        state.remarks = [*state.remarks, content]

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
