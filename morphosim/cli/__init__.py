"""Command line: `morphosim COMMAND --help` tells what each command takes."""

import sys
import warnings

from morphosim.cli import compute, data, fit, imports, pictures, serve, sweep  # noqa: F401  (each adds its commands)
from morphosim.cli.app import INPUT_ERROR, INPUT_ERRORS, UNCHECKED, app
from morphosim.errors import told
from morphosim.progress import printable, tell_line
from morphosim.simulation.interrupts import interrupt_by_signals


def main() -> None:
    """Entry point; warnings and errors of input are one line, without a traceback."""
    interrupt_by_signals()  # of a batch system, or a closed terminal: the state is saved
    warnings.formatwarning = lambda message, *_, **__: f"warning: {printable(str(message))}\n"
    for stream in (sys.stdout, sys.stderr):  # a console that lacks a letter is no error
        if hasattr(stream, "reconfigure") and not stream.closed:
            stream.reconfigure(errors="replace")
    try:
        app(prog_name="morphosim")
    except INPUT_ERRORS as error:
        _end(told(error))
    except MemoryError as error:
        _end(
            f"there is not enough memory ({told(error) or 'none can be had'}); take less at a time"
        )
    except UNCHECKED as error:
        _end(
            f"{type(error).__name__}: {told(error)}. This comes from a value that MorphoSim should "
            "have checked: please report it. With --verbose it is told where it arises"
        )


def _end(text: str) -> None:
    """End the command with an error of one line."""
    tell_line(f"error: {' '.join(text.split())}")
    sys.exit(INPUT_ERROR)
