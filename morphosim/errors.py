"""Errors that a running simulation raises, how an error is told in one line, and how to warn."""

import sys
import warnings
from types import FrameType


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


class ToleranceError(SimulationError):
    """The shortest steps do not meet the tolerance."""


class CellVanishedError(SimulationError):
    """A cell's field is below 1/2 everywhere (paper §2.3, "cell disappearance")."""


class TermError(SimulationError):
    """A force term has raised an error; the message names it, and the time."""


class SaveError(OSError):
    """A save cannot be written; all saves before are whole and the run can go on from the last."""


class DamageWarning(UserWarning):
    """A file of a run is damaged, or of another run, and is left out."""


class ResolutionWarning(UserWarning):
    """The lattice is too coarse for what has happened; the message says what to take."""


def warn(message: str, category: type[Warning] = UserWarning) -> None:
    """Warn of what the user's line has called for, however deep in the package it shows.

    The line is the nearest on the stack that is neither the package's nor the standard library's.
    """
    frame, level = sys._getframe(1), 2
    while _is_internal(frame) and frame.f_back is not None:
        frame, level = frame.f_back, level + 1
    warnings.warn(message, category, stacklevel=level)


def _is_internal(frame: FrameType) -> bool:
    """Whether a frame is of this package or the standard library; told by its module.

    File names would not do: the constructor of a dataclass has none.
    """
    package = frame.f_globals.get("__name__", "").partition(".")[0]
    return package == __package__ or (package != "__main__" and package in sys.stdlib_module_names)
