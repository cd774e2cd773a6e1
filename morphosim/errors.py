"""Errors that a running simulation raises, and how an error is told in one line."""


def told(error: BaseException) -> str:
    """Text of an error with its notes, in one line."""
    parts = [str(error), *getattr(error, "__notes__", ())]
    return " ".join("; ".join(parts).split())


class SimulationError(RuntimeError):
    """A simulation cannot go on; `time` and `cell` say when and where, "" for no cell alone."""

    def __init__(self, message: str, *, time: float, cell: str) -> None:
        super().__init__(message)
        self.time = time
        self.cell = cell


class DivergenceError(SimulationError):
    """A field is no longer finite, or runs away. The fields kept are the last finite ones."""


class CellVanishedError(SimulationError):
    """A cell's field is below 1/2 everywhere (paper §2.3, "cell disappearance")."""


class TermError(SimulationError):
    """A force term has raised an error; the message names it, and the time."""


class SaveError(OSError):
    """A save cannot be written; all saves before are whole and the run can go on from the last."""


class DamageWarning(UserWarning):
    """A file of a run is damaged, or of another run, and is left out."""
