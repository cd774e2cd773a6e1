"""Command line: `morphosim COMMAND --help` tells what each command takes."""

import signal
import sys
import warnings

from morphosim.cli import compute, data, imports, pictures, serve, sweep  # noqa: F401  (each adds its commands)
from morphosim.cli.app import INPUT_ERROR, INPUT_ERRORS, UNCHECKED, app
from morphosim.progress import printable, tell_line


def main() -> None:
    """Entry point; warnings and errors of input are one line, without a traceback."""
    # A batch system that ends a job stops it as Ctrl-C does: the state is saved.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    warnings.formatwarning = lambda message, *_, **__: f"warning: {printable(str(message))}\n"
    for stream in (sys.stdout, sys.stderr):  # a console that lacks a letter is no error
        if hasattr(stream, "reconfigure") and not stream.closed:
            stream.reconfigure(errors="replace")
    try:
        app(prog_name="morphosim")
    except INPUT_ERRORS as error:
        _end(str(error))
    except MemoryError as error:
        _end(f"there is not enough memory ({error or 'none can be had'}); take less at a time")
    except UNCHECKED as error:
        _end(
            f"{type(error).__name__}: {error}. This comes from a value that MorphoSim should have "
            "checked: please report it. With --verbose it is told where it arises"
        )


def _end(text: str) -> None:
    """End the command with an error of one line."""
    tell_line(f"error: {' '.join(text.split())}")
    sys.exit(INPUT_ERROR)
