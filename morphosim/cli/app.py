"""The application that commands belong to, what all of them share, and the codes it exits with."""

import errno
import inspect
import logging
import os
import sys
import traceback
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from functools import wraps
from importlib.metadata import version
from typing import Annotated, Any

import typer

from morphosim.errors import SimulationError
from morphosim.progress import TellWhat, printable, progress_line, silent, tell_line

app = typer.Typer(
    no_args_is_help=True, pretty_exceptions_enable=False, add_completion=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)  # fmt: skip
INPUT_ERROR, RUN_ERROR, INTERRUPTED = 2, 1, 130
INPUT_ERRORS = (ValueError, TypeError, OSError, ImportError, SimulationError)
"""Errors that are told in one line."""
UNCHECKED = (ArithmeticError, LookupError, RecursionError)
"""What Python raises for a value that nothing has checked."""
UNREAD = (errno.EPIPE, errno.EIO)
"""Errors of writing to what nobody reads."""


@dataclass(slots=True)
class Voice:
    """How much a command tells besides what it is asked for."""

    quiet: bool = False
    verbose: bool = False


voice = Voice()
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="tell errors and warnings only")]
Verbose = Annotated[
    bool, typer.Option("--verbose", "-v", help="tell events and saves too, and where errors arise")
]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="replace what exists there")]


def _tell_version(asked: bool) -> None:
    if asked:
        say(f"morphosim {version('morphosim')}")
        raise typer.Exit


@app.callback()
def _common(
    asked: Annotated[
        bool,
        typer.Option("--version", is_eager=True, callback=_tell_version, help="tell the version"),
    ] = False,
) -> None:
    """Phase-field simulation of multicellular shapes."""


def command(name: str | None = None) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Decorator of a function that is a command; it also takes --quiet and --verbose."""

    def add(function: Callable[..., None]) -> Callable[..., None]:
        @wraps(function)
        def called(*, quiet: bool, verbose: bool, **options: Any) -> None:
            with _speaking(quiet, verbose):
                function(**options)

        own, one = inspect.signature(function), inspect.Parameter.KEYWORD_ONLY
        both = {"quiet": Quiet, "verbose": Verbose}
        added = [inspect.Parameter(k, one, default=False, annotation=v) for k, v in both.items()]
        called.__signature__ = own.replace(parameters=[*own.parameters.values(), *added])  # type: ignore[attr-defined]
        called.__annotations__ = function.__annotations__ | both
        app.command(name)(called)
        return function

    return add


@contextmanager
def _speaking(quiet: bool, verbose: bool) -> Iterator[None]:
    """`voice`, and loggers of the package, while a command runs."""
    if quiet and verbose:
        message = "--quiet and --verbose exclude each other"
        raise ValueError(message)
    logger, handler = logging.getLogger("morphosim"), _Handler()
    before = logger.level
    logger.addHandler(handler)
    told = logging.WARNING if quiet else logging.DEBUG if verbose else logging.INFO
    logger.setLevel(told)
    voice.quiet, voice.verbose = quiet, verbose
    try:
        yield
    except (*INPUT_ERRORS, *UNCHECKED, MemoryError):
        if verbose:
            tell_line(traceback.format_exc().rstrip())
        raise
    finally:
        logger.removeHandler(handler)
        logger.setLevel(before)
        voice.quiet = voice.verbose = False


class _Handler(logging.Handler):
    """Writes to what standard error is now: a bar puts lines above itself."""

    def emit(self, record: logging.LogRecord) -> None:
        """Write a line."""
        mark = "warning: " if record.levelno >= logging.WARNING else ""
        tell_line(mark + self.format(record))


def say(text: str) -> None:
    """Print what was asked for, as far as somebody reads it (as in `| head`)."""
    _print(text, UNREAD)


def note(text: str) -> None:
    """Print what was done, unless --quiet; done it is, even if the disk of a log is full."""
    if not voice.quiet:
        _print(text, (*UNREAD, errno.ENOSPC, errno.EDQUOT))


def _print(text: str, ignored: tuple[int, ...]) -> None:
    """Print; after one of these errors nothing is printed any more."""
    if sys.stdout is None:  # closed
        return
    try:
        print(printable(text), flush=True)
    except OSError as error:
        if error.errno not in ignored:
            raise
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def remark(text: str) -> None:
    """Write what happens to standard error, unless --quiet."""
    if not voice.quiet:
        tell_line(text)


def progress() -> AbstractContextManager[TellWhat]:
    """What draws progress of a command; nothing with --quiet."""
    return nullcontext(silent) if voice.quiet else progress_line()
