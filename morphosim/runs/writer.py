"""Saving a simulation as it goes on."""

import logging
from collections import deque
from concurrent.futures import ThreadPoolExecutor, wait
from itertools import chain
from pathlib import Path

import numpy as np

from morphosim import _shown, _validate
from morphosim._files import replacing
from morphosim.errors import SaveError
from morphosim.measure.motion import Positions
from morphosim.measure.variable import VariableError
from morphosim.numerics.parameters import PARTS, Numerics
from morphosim.runs.directory import RunDirectory
from morphosim.runs.measured_state import MeasuredState, variables
from morphosim.runs.netcdf_variables import stored_variables
from morphosim.runs.observed import Observed
from morphosim.runs.save_facts import facts_of, whole_saves
from morphosim.runs.save_file import Contents, write_save
from morphosim.runs.save_index import add_to_index, mend_index
from morphosim.runs.shell import write_shell
from morphosim.scene.file import save_scene
from morphosim.scene.scene import SAVE_FIELDS, Scene
from morphosim.scene.stages import check_interval
from morphosim.scene.term_tables import term_table

LEAST_INTERVAL = 1e-3
"""Of time between saves, in the shortest steps."""
_log = logging.getLogger(__name__)


class RunWriter:
    """Observer that saves a simulation every so often, and at its end.

    A save is whole or absent: killed at any moment, the directory holds all saves before and goes
    on from the last of them.

    Parameters
    ----------
    directory : path
        Made if it does not exist; must not hold a run or a scene file yet, unless `resume` or
        `overwrite`.
    every : float
        *In silico* time between saves.
    fields : {"packed", "exact", "none"}
        See `Scene.save_fields`.
    labels : bool
        Whether each save also has a label image.
    resume : bool
        Whether to add to the run that the directory holds; the simulation must be that of
        `Simulation.from_run`.
    overwrite : bool
        Whether to replace a run that the directory holds: at the start its saves, states and scene
        file are deleted, and nothing else.

    Raises
    ------
    FileExistsError
        The directory holds a run or a scene file, or another process is writing there.
    SaveError
        While running: a save could not be written. All saves before are whole.

    Examples
    --------
    >>> from morphosim import Simulation, built_in_scene
    >>> simulation = Simulation(built_in_scene("single-cell"))
    >>> simulation.run(until=40, observers=[RunWriter("runs/one", every=20)])  # doctest: +SKIP
    """

    def __init__(
        self,
        directory: str | Path,
        every: float,
        *,
        fields: str = "packed",
        labels: bool = False,
        resume: bool = False,
        overwrite: bool = False,
    ) -> None:
        self.files = RunDirectory(Path(directory))
        self.every = _validate.number("every", every, above=0)
        _validate.choice("fields", fields, SAVE_FIELDS)
        _validate.flag("labels", labels)
        _validate.flag("overwrite", overwrite)
        self.fields, self.labels, self.resume = fields, labels, resume
        self.overwrite = overwrite
        self._number, self._saved = -1, -1.0
        if not (resume or overwrite):
            self.files.check_free()
        self._make_folder()

    def __repr__(self) -> str:
        where = _shown.short(str(self.directory))
        return f"RunWriter({where}, every={self.every:g}, fields={self.fields!r})"

    @classmethod
    def of(
        cls, scene: Scene, directory: str | Path, resume: bool = False, overwrite: bool = False
    ) -> "RunWriter":
        """Writer that saves when, and what, a scene says; see `start` for what it refuses."""
        _check_interval(scene.save_every, scene.numerics)  # before there is a directory
        return cls(
            directory, scene.save_every, fields=scene.save_fields, labels=scene.save_labels,
            resume=resume, overwrite=overwrite,
        )  # fmt: skip

    @property
    def directory(self) -> Path:
        """Directory of the run."""
        return self.files.path

    def start(self, simulation: Observed) -> None:
        """Lock the directory, write the scene, and save the start.

        Raises
        ------
        ValueError
            The physics, now or in a later stage, have a term that no file can say: the run could
            not go on from a save. Or saves are to be far closer together than steps.
        """
        _check_interval(self.every, simulation.scene.numerics)
        _check_terms(simulation)
        self._failed = False
        self._lock = self.files.locked()
        self._other = ThreadPoolExecutor(1)
        try:
            self._begin(simulation)
        except BaseException:
            self._close()
            raise

    def after_step(self, simulation: Observed) -> None:
        """Save if a save is due."""
        ticks = simulation.ticks
        if ticks == self._measured_from:
            self._marks.append(_positions(simulation))
        if ticks >= self._due:
            self._save(simulation)
            self._plan(simulation)

    def next_time(self, simulation: Observed) -> float:
        """*In silico* time of the next save, or from which its speed is measured."""
        wanted = self._measured_from if simulation.ticks < self._measured_from else self._due
        return wanted * simulation.scene.numerics.tick

    def stage_ended(self, simulation: Observed) -> None:
        """Save the end of a stage; saves of then and later, if it ends in the past, are dropped."""
        self._save_again(simulation)
        self._plan(simulation)

    def finish(self, simulation: Observed) -> None:
        """Save the last state, unless a step or a save has failed, and unlock the directory."""
        try:
            if simulation.whole and not self._failed:
                says_why = not simulation.stopped or self._told[-1][0] < simulation.time
                (self._save if says_why else self._save_again)(simulation)
                self.files.drop_after(self._number)  # where a run has gone on from before these
        finally:
            self._close()

    def holds(self, simulation: Observed) -> bool:
        """Whether the last save is of the present state."""
        return self._saved == simulation.time

    def _begin(self, simulation: Observed) -> None:
        self._marks: deque[Positions] = deque(maxlen=4)
        if self.resume:
            self._find_place(simulation)
        elif self.overwrite:
            self.files.clear()
        else:
            self.files.check_free()
        self.files.tidy()
        mend_index(self.files)
        self._place = self.files.place
        self._told = [(-1.0, 0)]  # time of each save, and how many events it and those before tell
        self._marks.append(_positions(simulation))
        if not self.resume:
            self._write_scene(simulation)
        self._plan(simulation)
        self._save(simulation)

    def _close(self) -> None:
        self._other.shutdown()
        self._lock.release()

    def _make_folder(self) -> None:
        try:
            self.files.path.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            message = (
                f"cannot make the directory {self.directory}: {error.strerror or error}; take "
                "another one"
            )
            raise SaveError(message) from error

    def _find_place(self, simulation: Observed) -> None:
        """Go on after the last save that is not of a later time than the simulation.

        Raises
        ------
        ValueError
            The saves are of another run, or hold other variables.
        """
        for number, facts in whole_saves(self.files):
            if facts.run_id != simulation.identity.id:
                message = (
                    f"{self.directory} holds the run of another simulation; take "
                    f"Simulation.from_run({str(self.directory)!r})"
                )
                raise ValueError(message)
            if facts.time <= simulation.time:
                self._number, self._saved = number, facts.time
                self._marks.append(Positions(facts.time, facts.cells, facts.centroid))
                _check_variables(self.files.save(number))
                return

    def _write_scene(self, simulation: Observed) -> None:
        """Scene file, where a file can say the scene, and the shell to be drawn."""
        try:
            write_shell(self.directory, simulation.scene.confinement)
            save_scene(simulation.scene, self.files.scene)
        except ValueError as error:
            _log.warning("%s is not written: %s", self.files.scene, error)
        except OSError as error:
            raise self._error(simulation, error) from error

    def _plan(self, simulation: Observed) -> None:
        """Find the tick at which the next save is due, and from which its speed is measured."""
        tick, ticks = simulation.scene.numerics.tick, simulation.ticks
        passed = np.floor(ticks * tick / self.every + 1e-9)
        self._due = max(int(np.ceil((passed + 1) * self.every / tick - 1e-6)), ticks + 1)
        self._measured_from = self._due - check_interval(tick)

    def _save(self, simulation: Observed, anew: bool = False) -> None:
        """Save, unless the last save is of this time; `anew`, also then."""
        if simulation.time == self._saved and not anew:
            return
        if self.files.place != self._place:
            self._failed = True
            raise self._gone(simulation)
        number = self._number + 1
        events = "; ".join(text for _, text in simulation.events[self._told[-1][1] :])
        state = MeasuredState(simulation, self._mark_before(simulation.time), events)
        try:
            self._write(number, state)
        except (OSError, VariableError) as error:
            self._failed = True
            raise self._error(simulation, error) from error
        _log.debug("saved t = %g in %s", simulation.time, self.files.save(number))
        self._other.submit(self.files.keep_states, number)
        self._number, self._saved = number, simulation.time
        self._told.append((simulation.time, len(simulation.events)))
        self._marks.append(state.positions)

    def _save_again(self, simulation: Observed) -> None:
        """Save, in place of saves of this time or later."""
        if simulation.time > self._saved:
            self._save(simulation)
            return
        while self._told[-1][0] >= simulation.time:
            self._told.pop()
        self._save(simulation, anew=True)
        self._drop_between(simulation.time)

    def _write(self, number: int, state: MeasuredState) -> None:
        """Write a save and, at the same time, the checkpoint to go on from."""
        with replacing(self.files.save(number)) as partial:
            checkpoint = state.simulation.checkpoint(lasting=False)
            kept = self._other.submit(checkpoint.write, self.files.restart(number))
            try:
                contents = Contents.of(state, self.fields, self.labels)
                write_save(partial, contents)
            finally:
                wait([kept])  # it reads the fields, which must stay
            kept.result()  # a save appears after the checkpoint
        add_to_index(self.files, contents.as_read(self.files.save(number)))

    def _mark_before(self, time: float) -> Positions | None:
        """Where cells were at the last mark that lies in the past."""
        marks = [mark for mark in self._marks if mark.time < time]
        return max(marks, key=lambda mark: mark.time, default=None)

    def _drop_between(self, time: float) -> None:
        """Delete the saves before the last one that are not of an earlier time."""
        for number in reversed(self.files.saved[:-1]):
            facts = facts_of(self.files.save(number))
            if facts is not None and facts.time < time:
                return
            if facts is not None:
                self.files.save(number).unlink()

    def _gone(self, simulation: Observed) -> SaveError:
        message = (
            f"cannot save t = {simulation.time:g}: the directory {self.directory} is not there any "
            "more, as it was deleted or renamed while the run wrote to it. If it was renamed, go "
            "on with: morphosim run --resume ITS-NEW-NAME"
        )
        return SaveError(message)

    def _error(self, simulation: Observed, error: OSError | VariableError) -> SaveError:
        if self.files.place != self._place:
            return self._gone(simulation)
        cause = getattr(error, "strerror", None) or error
        hint = (
            f"Make room or allow writing, then go on with: morphosim run --resume {self.directory}"
        )
        if isinstance(error, VariableError):
            hint = (
                "Correct its function, then go on with "
                f"Simulation.from_run({str(self.directory)!r})"
            )
        message = (
            f"cannot save t = {simulation.time:g} in {self.directory}: {cause}. "
            f"All {len(self.files.saves)} saves before are whole. {hint}"
        )
        return SaveError(message)


def _check_interval(every: float, numerics: Numerics) -> None:
    """Raise ValueError if saves are far closer together than steps, after which they are made.

    A little closer is one save for each step: presets change δt.
    """
    if every < LEAST_INTERVAL * numerics.tick:
        of = "" if numerics.tolerance is None else f" / {PARTS}, the shortest"
        message = (
            f"save_every = {every:g} is far shorter than a step of numerics.dt = {numerics.dt:g}"
            f"{of}, and saves are made after steps. Take at least {numerics.tick:g}"
        )
        raise ValueError(message)


def _check_terms(simulation: Observed) -> None:
    """Raise ValueError if a file cannot say a term that acts now or in a stage."""
    later = [stage.physics.get("terms", ()) for stage in simulation.scene.stages]
    for term in chain(simulation.physics.terms, *later):
        term_table(term)


def _check_variables(save: Path) -> None:
    """Raise ValueError if a variable has another form now than in a save: no table holds both."""
    stored = stored_variables(save)
    for name, variable in variables().items():
        if name in stored and stored[name].form != variable.form:
            message = (
                f"variable {name!r} is declared as {variable.form} and is {stored[name].form} in "
                f"{save}; give the function another name"
            )
            raise ValueError(message)


def _positions(simulation: Observed) -> Positions:
    return Positions(simulation.time, simulation.names, simulation.centroids)
