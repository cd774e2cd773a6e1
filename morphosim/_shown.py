"""How objects show themselves: a few lines on a terminal, a small table in a notebook.

However many cells, values or voxels there are, what is shown stays short, and is found quickly.
"""

import html
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import fields
from itertools import islice
from types import FunctionType
from typing import Any

import numpy as np

MOST_LISTED = 4
"""Entries that are shown of a list or a table of values."""
MOST_ROWS = 8
"""Rows that are shown of a table in a notebook."""
LONGEST, LONGEST_VALUE, LONGEST_NAME, LINE = 450, 160, 16, 61
"""Characters of what is said of an object, a value of it, a name in a list, and in a line."""


def short_repr(self: Any) -> str:
    """`__repr__` of a dataclass that may hold much; `__repr__ = short_repr` stands in its body."""
    values = (f"{f.name}={short(getattr(self, f.name))}" for f in fields(self) if f.repr)
    return cut(f"{type(self).__qualname__}({', '.join(values)})", LONGEST)


def short(value: Any) -> str:
    """What a value is, in one line: its `repr`, of arrays and long lists in few words."""
    if isinstance(value, np.generic):
        return short(value.item())
    if isinstance(value, np.ndarray):
        few = value.ndim == 1 and value.size <= MOST_LISTED
        return short(value.tolist()) if few else f"<{value.dtype} array of shape {value.shape}>"
    if isinstance(value, FunctionType):
        return f"<function {value.__qualname__}>"
    if isinstance(value, str | bytes):
        return cut(repr(value[:LONGEST_VALUE]), LONGEST_VALUE)
    if isinstance(value, Mapping):
        entries = (f"{short(key)}: {short(item)}" for key, item in value.items())
        return f"{{{_first(entries, len(value))}}}"
    if isinstance(value, list | tuple):
        listed = _first(map(short, value), len(value))
        if isinstance(value, list):
            return f"[{listed}]"
        return f"({listed},)" if len(value) == 1 else f"({listed})"
    return cut(" ".join(repr(value).split()), LONGEST_VALUE)


def listed(names: Collection[str]) -> str:
    """The first of some names, and how many more there are."""
    return _first((cut(name, LONGEST_NAME) for name in names), len(names))


def _first(entries: Iterable[str], count: int) -> str:
    shown = list(islice(entries, MOST_LISTED))
    more = [f"… and {count - MOST_LISTED} more"] if count > MOST_LISTED else []
    return ", ".join([*shown, *more])


def cut(text: str, most: int) -> str:
    """A text, or its beginning if it is longer than `most`."""
    return text if len(text) <= most else f"{text[: most - 1]}…"


def text_of(title: str, facts: Mapping[str, str]) -> str:
    """A title, and a line for each fact; those that are "" are left out."""
    said = {name: fact for name, fact in facts.items() if fact}
    width = max(map(len, said), default=0)
    lines = [title, *(f"  {name:{width}}  {fact}" for name, fact in said.items())]
    return "\n".join(cut(line, LINE) for line in lines)


def html_of(
    title: str,
    facts: Mapping[str, str],
    head: Sequence[str] = (),
    rows: Iterable[Sequence[str]] = (),
    count: int = 0,
) -> str:
    """The same for a notebook, and a table with the first of `count` rows; all is escaped."""
    said = [(name, cut(fact, LONGEST_VALUE)) for name, fact in facts.items() if fact]
    parts = [f"<b>{html.escape(cut(title, LONGEST_VALUE))}</b>", _table([], said)]
    return f"<div>{''.join(parts)}{table_of(head, rows, count)}</div>"


def table_of(head: Sequence[str], rows: Iterable[Sequence[str]], count: int) -> str:
    """The first of `count` rows in HTML, and how many more there are; "" where there are none.

    Columns in which they have nothing are left out.
    """
    first = list(islice(rows, MOST_ROWS))
    said = [k for k in range(len(head)) if any(row[k] for row in first)]
    shown = [[row[k] for k in said] for row in (head, *first)]
    more = [("…", f"and {count - MOST_ROWS} more")] if count > MOST_ROWS else []
    return _table(shown[0], [*shown[1:], *more]) if count else ""


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [_row("th", head)] if head else []
    return f"<table>{''.join([*lines, *(_row('td', row) for row in rows)])}</table>"


def _row(tag: str, entries: Iterable[str]) -> str:
    style = ' style="text-align: left"'
    cells = (f"<{tag}{style}>{html.escape(cut(e, LONGEST_VALUE))}</{tag}>" for e in entries)
    return f"<tr>{''.join(cells)}</tr>"
