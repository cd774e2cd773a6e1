"""Files: clear errors for what is missing or damaged, and files that appear whole or not at all."""

import csv
import io
import os
import tomllib
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

from morphosim import _validate

T = TypeVar("T")


def check_file(path: Path, suffixes: Iterable[str]) -> None:
    """Raise unless the file exists and has one of these extensions."""
    _validate.choice(f"extension of {path}", path.suffix.lower(), suffixes)
    if not path.is_file():
        message = f"{path} does not exist or is not a file"
        raise FileNotFoundError(message)


def writable(path: str | Path, suffixes: Sequence[str] = ()) -> Path:
    """Path of a file to write; raises, before any work, for no folder or another extension."""
    path = Path(path)
    if suffixes:
        _validate.choice(f"extension of {path}", path.suffix.lower(), suffixes)
    if not path.parent.is_dir():
        message = f"{path} cannot be written: there is no directory {path.parent}"
        raise FileNotFoundError(message)
    return path


def guarded(path: Path, read: Callable[[], T]) -> T:
    """Call `read`; what its parser raises on a damaged file becomes a ValueError."""
    try:
        return read()
    except (ImportError, MemoryError):
        raise
    except Exception as error:  # the parsers' errors have no common base
        message = f"{path} cannot be read as a {path.suffix.lower()} file; it may be damaged: "
        raise ValueError(f"{message}{type(error).__name__}: {error}") from error


def csv_rows(path: Path) -> list[list[str]]:
    """Rows of a CSV file; commas, semicolons or tabs, whichever the first line has most of."""
    text = path.read_text(encoding="utf-8-sig")
    first = text.partition("\n")[0]
    return list(csv.reader(io.StringIO(text), delimiter=max(",;\t", key=first.count)))


def listed(names: Sequence[str]) -> str:
    """Names as a text for an error."""
    return ", ".join(repr(name) for name in names) if names else "(none)"


def toml_table(path: Path, what: str) -> dict[str, Any]:
    """Content of a TOML file.

    Raises
    ------
    FileNotFoundError
        It does not exist; the text calls it `what`.
    ValueError
        It is not TOML.
    """
    if not path.is_file():
        message = f"{what} {path} does not exist"
        raise FileNotFoundError(message)
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except tomllib.TOMLDecodeError as error:
        message = f"{path} is not a TOML file: {error}"
        raise ValueError(message) from error


PARTIAL = ".partial"
"""Ending of a file that is being written."""


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Path of a file to write; when this ends, it stands at `path`, all at once and on disk.

    Killed within, the file at `path` is what it was before; so it is if writing fails.
    """
    partial = path.with_name(path.name + PARTIAL)
    try:
        yield partial
        _sync(partial, os.O_RDWR)
        partial.replace(path)
    except BaseException:
        partial.unlink(missing_ok=True)
        raise
    if hasattr(os, "O_DIRECTORY"):  # where the system can, the folder's list of names too
        _sync(path.parent, os.O_RDONLY | os.O_DIRECTORY)


def _sync(path: Path, flags: int) -> None:
    descriptor = os.open(path, flags)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
