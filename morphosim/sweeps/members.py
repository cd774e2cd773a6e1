"""One member of a scan: simulated, measured, its result stored."""

import shutil
import threading
import time
import warnings
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from morphosim.accessor import open_run
from morphosim.errors import SimulationError
from morphosim.library.built_in import built_in_scene
from morphosim.runs.directory import RunDirectory
from morphosim.runs.resume import saved_state
from morphosim.runs.writer import RunWriter
from morphosim.scene.file import load_scene
from morphosim.scene.scene import Scene
from morphosim.scene.stability import StabilityWarning
from morphosim.simulation.simulation import Simulation
from morphosim.simulation.warming import not_ahead
from morphosim.sweeps.axes import Member, Settings
from morphosim.sweeps.figures import Figure
from morphosim.sweeps.store import Store

if TYPE_CHECKING:
    import xarray as xr

OF_THE_MACHINE = (OSError, MemoryError, ImportError)
"""Errors that say nothing about the member: it is run again when the scan goes on."""
_ONE_AT_A_TIME = threading.Lock()
"""Numba's and BLAS's threads belong to the process, so a process runs one member at a time."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Task:
    """What all members share.

    Attributes
    ----------
    directory : path of the scan
    scene : str
        Name of a built-in scene that is made anew for each seed, or "" for the scan's scene file.
    figures : sequence of Figure
    threads : int
        Threads of one member.
    keep_runs : bool
        Whether the directories of the runs stay.
    """

    directory: Path
    scene: str
    figures: Sequence[Figure]
    threads: int
    keep_runs: bool

    def scene_of(self, settings: Settings) -> Scene:
        """Scene with these settings."""
        if self.scene:
            return built_in_scene(self.scene, settings)
        return load_scene(Store(self.directory).scene, settings)

    def __call__(self, member: Member) -> str:
        """Run a member, store what is measured or its error; "" or the error."""
        import dask

        # Without this xarray connects every process to the scheduler, to write a file.
        with _ONE_AT_A_TIME, dask.config.set(scheduler="synchronous"):
            return self._stored(member)

    def _stored(self, member: Member) -> str:
        with not_ahead(), warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", StabilityWarning)
            begun = time.perf_counter()
            table, error = self._tried(member)
            seconds = time.perf_counter() - begun
        if error is None or not isinstance(error, OF_THE_MACHINE):
            told = [str(w.message) for w in caught if w.category is StabilityWarning]
            error = self._written(member, table, error, "; ".join(told), seconds)
            if not self.keep_runs:
                shutil.rmtree(Store(self.directory).run(member.number), ignore_errors=True)
        return _text(error)

    def _written(
        self, member: Member, table: "xr.Dataset | None", error: Exception | None, warning: str,
        seconds: float,
    ) -> Exception | None:  # fmt: skip
        """Store the result; figures that no file can hold are an error of the member."""
        store, facts = Store(self.directory), {"warning": warning, "seconds": seconds}
        try:
            store.write(member.number, table, error=_text(error), **facts)
        except OSError:
            raise
        except Exception as fault:
            store.write(member.number, None, error=_text(fault), **facts)
            return fault
        return error

    def _tried(self, member: Member) -> "tuple[xr.Dataset | None, Exception | None]":
        folder = Store(self.directory).run(member.number)
        try:
            for figure in self.figures:
                figure.check()
            self._simulate(member, folder)
            return measured(folder, self.figures), None
        except Exception as error:  # whatever a member fails by is its result
            return None, error

    def _simulate(self, member: Member, folder: Path) -> None:
        """Run to the end, from the last save of an earlier attempt if there is one."""
        simulation = self._begun(folder)
        going_on = simulation is not None
        if simulation is None:
            shutil.rmtree(folder, ignore_errors=True)
            scene = self.scene_of(member.settings).with_numerics(threads=self.threads)
            if not (self.keep_runs or any(figure.computed for figure in self.figures)):
                scene = replace(scene, save_fields="none", save_labels=False)
            simulation = Simulation(scene)
        simulation.run(observers=[RunWriter.of(simulation.scene, folder, going_on)])

    def _begun(self, folder: Path) -> Simulation | None:
        """Simulation at the last save of an earlier attempt, or None where it cannot go on."""
        if not RunDirectory(folder).saves:
            return None
        with suppress(ValueError, FileNotFoundError):
            scene, state = saved_state(folder)
            return Simulation(scene.with_numerics(threads=self.threads), state)
        return None


def measured(folder: Path, figures: Sequence[Figure]) -> "xr.Dataset":
    """Figures of a run, and the *in silico* time of its end."""
    import xarray as xr

    with open_run(folder) as run:
        # types now and over time, as coordinates, are not in one table
        found = {figure.name: figure.of(run).reset_coords(drop=True) for figure in figures}
        end = run["time"].isel(time=-1, drop=True).load()
        end.attrs = {"units": "1", "long_name": "in silico time of the member's end"}
        return xr.Dataset(found | {"end_time": end.drop_vars("time", errors="ignore")})


def _text(error: Exception | None) -> str:
    """An error as one line; the project's own texts say all there is to say."""
    if error is None:
        return ""
    text = " ".join(str(error).split())
    return text if isinstance(error, SimulationError) else f"{type(error).__name__}: {text}"
