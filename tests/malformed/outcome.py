"""What came of an input: right, an error of one line, or a fault."""

import contextlib
import io
import re
import traceback
import unicodedata
import warnings
from collections.abc import Callable
from typing import NamedTuple

import click

from morphosim.errors import SimulationError
from morphosim.scene.stability import StabilityWarning

ERRORS = (ValueError, TypeError, OSError, ImportError, SimulationError, click.ClickException)
"""What bad input may raise."""
INNER = re.compile(
    r"object is not|object has no|unsupported operand|not subscriptable|unhashable|unexpected "
    r"keyword|positional argument|index out of|could not broadcast|invalid literal|could not "
    r"convert|to unpack|Exceeds the limit|ambiguous|inhomogeneous|not supported between|has no len"
    r"|must be real number|zero-size|missing \d+ required|cannot be interpreted|Traceback|argument "
    r"must be|divide by zero|overflow encountered|invalid value encountered|out of bounds for"
)
"""What Python and NumPy say of themselves: it names nothing that a user knows."""
LONGEST = 1500


class Outcome(NamedTuple):
    """`kind` is "right", "error" or "fault"."""

    kind: str
    text: str


def outcome(call: Callable[[], object]) -> Outcome:
    """Call, and judge how it ends: warnings and what it prints count too."""
    out, err = io.StringIO(), io.StringIO()
    with (
        warnings.catch_warnings(record=True) as warned,
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
    ):
        warnings.simplefilter("always")
        kind, text = _ended(call)
    strange = [w for w in warned if not _ours(w.category)]
    if kind != "fault" and strange:
        first = strange[0]
        return Outcome("fault", f"{first.category.__name__}: {first.message} ({first.filename})")
    if kind != "fault" and not _printable(out.getvalue() + err.getvalue()):
        return Outcome("fault", f"prints control characters: {out.getvalue() + err.getvalue()!r}")
    return Outcome(kind, text)


def _ended(call: Callable[[], object]) -> tuple[str, str]:
    try:
        ended = call()
    except ERRORS as error:
        text = f"{type(error).__name__}: {error}"
        if isinstance(error, click.ClickException):
            text = error.format_message()
        return ("error" if _sound(str(error)) else "fault"), text + _place(error)
    except SystemExit as end:
        return ("error" if end.code in (1, 2) else "right"), str(end.code)
    except BaseException as error:
        return "fault", f"{type(error).__name__}: {error}" + _place(error)
    return ("error" if ended in (1, 2) else "right"), str(ended)


def _place(error: BaseException) -> str:
    """Where an error was raised."""
    frames = traceback.extract_tb(error.__traceback__)
    ours = [f for f in frames if "/morphosim/" in f.filename] or frames
    return "".join(
        f" <- {f.filename.rpartition('/morphosim/')[2]}:{f.lineno}" for f in ours[:-4:-1]
    )


def _ours(category: type[Warning]) -> bool:
    return issubclass(category, StabilityWarning) or category.__module__.startswith("morphosim")


def _sound(text: str) -> bool:
    """Whether an error is a sentence of one line that names a thing."""
    inner = INNER.search(text.partition("may be damaged: ")[0])  # a parser's own words may follow
    return bool(text.strip()) and not inner and len(text) <= LONGEST and "\n" not in text


def _printable(text: str) -> bool:
    return not any(unicodedata.category(c) == "Cc" and c not in "\n\r\t" for c in text)
