"""Reading files of other programs: clear errors for what is missing or damaged."""

import importlib
from collections.abc import Callable, Iterable, Sequence
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


def guarded(path: Path, read: Callable[[], T]) -> T:
    """Call `read`; what its parser raises on a damaged file becomes a ValueError."""
    try:
        return read()
    except (ImportError, MemoryError):
        raise
    except Exception as error:  # the parsers' errors have no common base
        message = f"{path} cannot be read as a {path.suffix.lower()} file; it may be damaged: "
        raise ValueError(f"{message}{type(error).__name__}: {error}") from error


def need(package: str, path: Path) -> Any:
    """Import a package that reads this file, or raise ImportError with what to install."""
    try:
        return importlib.import_module(package)
    except ImportError as error:
        message = f"{path} needs the package {package}; try: pip install 'morphosim[matlab]'"
        raise ImportError(message) from error


def listed(names: Sequence[str]) -> str:
    """Names as a text for an error."""
    return ", ".join(repr(name) for name in names) if names else "(none)"
