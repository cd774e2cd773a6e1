"""Command line: `morphosim COMMAND --help` tells what each command takes."""

import signal
import sys
import warnings

import typer

from morphosim.cli import compute, data, imports, pictures, serve, sweep  # noqa: F401  (each adds its commands)
from morphosim.cli.app import INPUT_ERROR, app
from morphosim.errors import SimulationError


def main() -> None:
    """Entry point; warnings and errors of input are one line, without a traceback."""
    # A batch system that ends a job stops it as Ctrl-C does: the state is saved.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    warnings.formatwarning = lambda message, *_, **__: f"warning: {message}\n"
    try:
        app()
    except (ValueError, TypeError, OSError, ImportError, SimulationError) as error:
        typer.echo(f"error: {error}", err=True)
        sys.exit(INPUT_ERROR)
