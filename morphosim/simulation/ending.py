"""What to say of a run that has ended before its end, in one line."""

from pathlib import Path

from morphosim.errors import SaveError, told
from morphosim.runs.writer import RunWriter
from morphosim.simulation.simulation import Simulation


def words_of_ending(error: BaseException, simulation: Simulation, writer: RunWriter) -> str:
    """What has ended a run, what is saved of it, and how it goes on; in one line."""
    go_on = _go_on(writer.directory)
    saved = writer.holds(simulation)
    kept = "The last state is saved" if saved else "The saves before are kept"
    if isinstance(error, KeyboardInterrupt):
        notes = "".join(f". {note}" for note in getattr(error, "__notes__", ()))
        what = "saved" if saved else "the saves before are kept"
        return f"interrupted at t = {simulation.time:g}; {what}{notes}. Go on with: {go_on}"
    if isinstance(error, MemoryError):
        why = f" ({told(error)})" if told(error) else ""
        return (
            f"error: there is not enough memory at t = {simulation.time:g}{why}. {kept}; where "
            f"there is more, go on with: {go_on}"
        )
    return f"error: {told(error)}" + ("" if isinstance(error, SaveError) else f". {kept}")


def words_of_stop(simulation: Simulation, directory: Path) -> str:
    """Why a run was stopped, and how it goes on; in one line."""
    more = "" if simulation.finished else f". Go on with: {_go_on(directory)}"
    return f"stopped at t = {simulation.time:g}: {simulation.stopped}{more}"


def _go_on(directory: Path) -> str:
    return f"morphosim run --resume {directory}"
