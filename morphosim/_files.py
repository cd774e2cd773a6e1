"""Files: clear errors for what is missing or damaged, and files that appear whole or not at all."""

import codecs
import os
import shutil
import tomllib
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, TypeVar

from morphosim import _validate

T = TypeVar("T")
OTHER_ENCODINGS = {
    codecs.BOM_UTF32_LE: "UTF-32", codecs.BOM_UTF32_BE: "UTF-32", codecs.BOM_UTF16_LE: "UTF-16",
    codecs.BOM_UTF16_BE: "UTF-16",
}  # fmt: skip
"""Encodings by byte-order mark; that of UTF-16 begins as one of UTF-32 does."""


STUMBLES = (LookupError, TypeError, AttributeError, ArithmeticError, AssertionError, NameError)
"""Errors of a parser that has not noticed that a file is damaged."""
LONGEST_REASON, MOST_LISTED = 200, 30


def is_file(path: Path) -> bool:
    """Whether there is a file; none can have a name that is too long for the system."""
    return os.path.isfile(path)


def check_file(path: Path, suffixes: Iterable[str]) -> None:
    """Raise unless the file exists and has one of these extensions."""
    _validate.choice(f"extension of {path}", path.suffix.lower(), suffixes)
    if not is_file(path):
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


def check_free(path: Path, overwrite: bool = False) -> None:
    """Raise FileExistsError if there is something at a file's path, unless `overwrite`."""
    if path.is_dir():
        message = f"{path} is a directory; give the name of a file"
        raise FileExistsError(message)
    if not overwrite and (path.exists() or path.is_symlink()):
        message = f"{path} exists; give another name, or replace it by --overwrite (overwrite=True)"
        raise FileExistsError(message)


def guarded(path: Path, read: Callable[[], T]) -> T:
    """Call `read`; what its parser raises on a damaged file becomes a ValueError."""
    try:
        return read()
    except ImportError:
        raise
    except MemoryError as error:
        message = f"{path} asks for more memory than there is; it is too large, or damaged"
        raise ValueError(message) from error
    except Exception as error:  # the parsers' errors have no common base
        message = f"{path} cannot be read as a {path.suffix.lower()} file; it may be damaged"
        raise ValueError(message + _said_by_parser(error)) from error


def _said_by_parser(error: Exception) -> str:
    """What a parser says, in one line; nothing, where Python has stumbled within it."""
    if isinstance(error, STUMBLES) or not str(error).strip():
        return f" ({type(error).__name__})"
    line = str(error).strip().splitlines()[0]
    plain = "".join(c if _validate.is_printable(c) else "?" for c in line)
    return f": {type(error).__name__}: {plain[:LONGEST_REASON]}"


def read_text(path: Path) -> str:
    r"""Text of a file in UTF-8, with or without a byte-order mark; lines end in "\\n".

    Raises
    ------
    ValueError
        It is in another encoding, which the message names where it can be told, or no text.
    """
    data = path.read_bytes()
    for mark, encoding in OTHER_ENCODINGS.items():
        if data.startswith(mark):
            message = f"{path} is text in {encoding}; expected UTF-8. Save it as UTF-8"
            raise ValueError(f"{message} (in Excel: CSV UTF-8)")
    if b"\0" in data:
        message = f"{path} holds a NUL byte at {data.index(0)}: it is text in UTF-16, or no text; "
        raise ValueError(message + "expected text in UTF-8")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        byte = data[error.start : error.start + 1]
        raise ValueError(
            f"{path}, line {data.count(10, 0, error.start) + 1} is not text in UTF-8: byte "
            f"0x{byte.hex()}, which is {byte.decode('cp1252', 'replace')!r} in the Windows code "
            "page cp1252. Save the file as UTF-8 (in Excel: CSV UTF-8)"
        ) from error
    return text.replace("\r\n", "\n").replace("\r", "\n")


def listed(names: Sequence[str]) -> str:
    """Names as a text for an error."""
    shown = ", ".join(_validate.brief(name, 60) for name in names[:MOST_LISTED])
    more = f" and {len(names) - MOST_LISTED} more" if len(names) > MOST_LISTED else ""
    return shown + more or "(none)"


def toml_table(path: Path, what: str) -> dict[str, Any]:
    """Content of a TOML file.

    Raises
    ------
    FileNotFoundError
        It does not exist; the text calls it `what`.
    ValueError
        It is not TOML.
    """
    if not is_file(path):
        message = f"{what} {path} does not exist"
        raise FileNotFoundError(message)
    return toml_of(read_text(path), str(path))


def toml_of(text: str, where: str) -> dict[str, Any]:
    """Content of a text in TOML; ValueError if it is none, or nested too deeply."""
    try:
        return tomllib.loads(text)
    except RecursionError as error:
        message = f"{where} has more brackets within brackets than can be read"
        raise ValueError(message) from error
    except tomllib.TOMLDecodeError as error:
        message = f"{where} is not a TOML file: {error}"
        raise ValueError(message) from error
    except ValueError as error:  # an integer of thousands of digits
        message = f"{where} has a number of more digits than can be read"
        raise ValueError(message) from error


SYNCED_AT_ONCE = 32
"""Files that are waited for at once: the system puts what waits on disk together."""
PARTIAL = ".partial"
"""Ending of a file that is being written."""
NETCDF = "NetCDF: "
"""So begin errors of the netCDF library."""


class WriteError(OSError):
    """A file cannot be written; the text names it and says why."""


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Path of a file to write; when this ends, it stands at `path`, all at once and on disk.

    Killed within, the file at `path` is what it was before; so it is if writing fails. A link
    stays, and the file that it leads to is replaced; a device or a pipe is written to as it is.

    Raises
    ------
    WriteError
        The file cannot be written.
    """
    if path.exists() and not path.is_file():
        with _naming(path, path):
            yield path
        return
    target = path.resolve()
    partial = target.with_name(target.name + PARTIAL)
    try:
        with _naming(path, partial):
            yield partial
            _sync(partial)
            partial.replace(target)
            _sync(target.parent)
    except BaseException:
        with suppress(OSError):
            partial.unlink()
        raise


@contextmanager
def filling(directory: Path) -> Iterator[Path]:
    """Folder for files that appear in a directory when this ends, all of them and on disk.

    Files of the same names are replaced, others stay. If writing fails the directory is, or is not
    there, as it was before.

    Raises
    ------
    WriteError
        A file, or the directory, cannot be written.
    """
    made = not directory.exists()
    partial = directory / PARTIAL
    try:
        with _naming(directory, partial):
            shutil.rmtree(partial, ignore_errors=True)  # of a process that was killed
            partial.mkdir(parents=True)
            yield partial
            with ThreadPoolExecutor(SYNCED_AT_ONCE) as pool:
                list(pool.map(_sync, partial.rglob("*")))
            _move(partial, directory)
            _sync(directory)
    except BaseException:
        shutil.rmtree(partial, ignore_errors=True)
        if made:
            with suppress(OSError):
                directory.rmdir()
        raise


def _move(source: Path, target: Path) -> None:
    """Move a file or a folder; a folder that is there already takes what this one holds."""
    if source.is_dir() and target.is_dir():
        for path in source.iterdir():
            _move(path, target / path.name)
        source.rmdir()
    else:
        source.replace(target)


def write_text(path: Path, text: str) -> None:
    """Write a text file in UTF-8, as `replacing` does."""
    with replacing(path) as partial:
        partial.write_text(text, encoding="utf-8")


@contextmanager
def _naming(path: Path, partial: Path) -> Iterator[None]:
    """Name `path` in what is raised by writing to `partial`, or to files in it."""
    try:
        yield
    except (OSError, RuntimeError) as error:
        if not _by_writing(error, partial):
            raise
        message = f"{path} cannot be written: {_reason(error, path)}"
        raise WriteError(message) from error


def _by_writing(error: OSError | RuntimeError, partial: Path) -> bool:
    """Whether writing has raised this: errors of reading have the name of another file."""
    if isinstance(error, OSError):
        known = error.filename is None or str(error.filename).startswith(str(partial))
        return known and not isinstance(error, WriteError)
    return str(error).startswith(NETCDF)


def _reason(error: OSError | RuntimeError, path: Path) -> str:
    """Why a file cannot be written, in one line."""
    if isinstance(error, OSError) and error.strerror and (error.errno or 0) > 0:
        return error.strerror
    text = " ".join(str(getattr(error, "strerror", None) or error).split())
    if not path.parent.is_dir():
        return text
    # HDF5, netCDF and the coders of images do not say what the system has told them
    return f"{text} ({shutil.disk_usage(path.parent).free / 1e6:.1f} MB are free there)"


def _sync(path: Path) -> None:
    """Have a file, or a folder's list of names, on disk."""
    flags = os.O_RDWR
    if path.is_dir():
        if not hasattr(os, "O_DIRECTORY"):  # the system cannot
            return
        flags = os.O_RDONLY | os.O_DIRECTORY
    descriptor = os.open(path, flags)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
