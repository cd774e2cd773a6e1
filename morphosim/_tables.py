"""Tables of others: .csv, .xls and .xlsx, read alike and checked alike."""

import csv
import io
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import date, time, timedelta
from pathlib import Path
from typing import Any

from morphosim import _validate
from morphosim._extras import need
from morphosim._files import check_file, guarded, listed, read_text

Converter = Callable[[str, str], Any]
"""Turns an entry into a value; the first text says whose entry it is, for errors."""
SEPARATORS = ",;\t"
MOST_ENTRIES = 2**24
"""Entries of a sheet, at most: as many as an .xls file may have."""
MOST_PLACES = 5
DIGITS, LARGEST_WHOLE = re.compile(r"\d{1,20}"), 2**64 - 1
SEPARATOR_LINE = re.compile(r"sep=(.)\s*", re.IGNORECASE)
"""First line by which Excel is told the separator."""
DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+(e[+-]?\d+)?", re.IGNORECASE)
GROUPED = re.compile(r"[+-]?[1-9]\d{0,2}(,\d{3})+")
"""A number with a decimal comma and three digits, or thousands with separators."""
DECIMAL_POINT = re.compile(r"[+-]?\d*\.?\d*")
THOUSANDS = re.compile(r"[+-]?\d{1,3}(?:([.,' \u00a0\u2009\u202f\u2019])\d{3}(\1\d{3})*)[.,]?\d*")
"""A number whose digits stand in groups of three."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """A row that is not empty: its place, for errors, and its entries as texts."""

    where: str
    entries: Sequence[str]


@dataclass(frozen=True, slots=True, kw_only=True)
class Table:
    """A table with headings: its columns, and for each row its place and what it says.

    An empty entry says nothing.
    """

    columns: tuple[str, ...]
    rows: Sequence[tuple[str, dict[str, Any]]]


def read_table(
    path: Path,
    columns: Mapping[str, Converter],
    needed: Sequence[str],
    aliases: Mapping[str, str],
) -> Table:
    """Table whose first row has headings, in any case and order.

    Parameters
    ----------
    path : .csv, .xls or .xlsx
    columns : what turns an entry into a value, by heading
    needed : headings that must be there
    aliases : other names of headings

    Raises
    ------
    FileNotFoundError
        The file does not exist.
    ValueError
        It cannot be read, has no rows, a column that is not known, missing or there twice, or an
        entry that is not allowed; the message names file, row and column.
    """
    head, *rows = read_rows(path)
    said = [heading.lower() for heading in head.entries]
    for heading in said:
        _validate.choice(f"column of {path}", heading, (*columns, *aliases))
    found = tuple(aliases.get(heading, heading) for heading in said)
    _validate.unique(f"{path}: column", found)
    missing = [column for column in needed if column not in found]
    if missing:
        message = f"{path} has no column {listed(missing)}; has {listed(found)}"
        raise ValueError(message)
    if not rows:
        message = f"{path} has headings ({', '.join(found)}) and no rows; expected a row per cell"
        raise ValueError(message)
    return Table(columns=found, rows=[(row.where, _said(row, found, columns)) for row in rows])


def _said(row: Row, found: Sequence[str], columns: Mapping[str, Converter]) -> dict[str, Any]:
    return {
        column: columns[column](f"{row.where}: {column}", entry)
        for column, entry in zip(found, row.entries, strict=True)
        if entry
    }


def read_rows(path: Path) -> list[Row]:
    """Rows of a table, without those and without columns that are empty; all are equally long.

    Numbers of a spreadsheet become texts too.

    Raises
    ------
    FileNotFoundError
        The file does not exist.
    ValueError
        It cannot be read, is empty, or a row has more or fewer entries than the first.
    """
    check_file(path, READERS)
    rows = [
        Row(where=f"{path}, row {number}", entries=[entry.strip() for entry in entries])
        for number, entries in READERS[path.suffix.lower()](path)
    ]
    filled = [row for row in rows if any(row.entries)]
    if not filled:
        message = f"{path} is empty; expected a table whose first row has headings"
        raise ValueError(message)
    width = max(k for k, entry in enumerate(filled[0].entries, start=1) if entry)
    cut = [replace(row, entries=_of_length(row, width)) for row in filled]
    used = [any(entries) for entries in zip(*(row.entries for row in cut), strict=True)]
    return [
        replace(row, entries=[e for e, kept in zip(row.entries, used, strict=True) if kept])
        for row in cut
    ]


def _of_length(row: Row, expected: int) -> Sequence[str]:
    """Entries of a row as far as the first row goes.

    A row that is shorter, or says more, is a ValueError with the likely reason.
    """
    count = max([len(row.entries[:expected])] + [k for k, e in enumerate(row.entries, 1) if e])
    if count == expected:
        return row.entries[:expected]
    message = f"{row.where} has {count} entries; expected {expected}, as the first row has: "
    if count < expected:
        raise ValueError(message + "the table is cut short, or separators are missing")
    raise ValueError(
        message + "a heading is missing, or a comma within an entry separates too, also a decimal "
        "one. Write 2.5 for 2,5, put entries in quotes, or separate them by semicolons"
    )


def _rows_of_csv(path: Path) -> Iterable[tuple[int, list[str]]]:
    """Rows by number; commas, semicolons or tabs between, whichever the first has most of."""
    lines = read_text(path).split("\n", 1)
    told = SEPARATOR_LINE.fullmatch(lines[0])
    text = "".join(lines[1:]) if told else "\n".join(lines)
    first = text.lstrip("\n").partition("\n")[0]
    separator = told[1] if told else max(SEPARATORS, key=first.count)
    reader = csv.reader(io.StringIO(text), delimiter=separator, strict=True)
    return guarded(path, lambda: list(enumerate(reader, start=2 if told else 1)))


@dataclass(frozen=True, slots=True, kw_only=True)
class _Sheet:
    """A spreadsheet: its rows, and the places of what is not what it seems to be."""

    rows: Sequence[list[str]]
    merged: Sequence[str]
    dates: Sequence[str]
    unsolved: Sequence[str] = ()


def _rows_of_xls(path: Path) -> Iterable[tuple[int, list[str]]]:
    """Rows of the first sheet, by number."""
    xlrd = need("xlrd", str(path), "matlab")

    def text(cell: Any) -> str:
        if cell.ctype == xlrd.XL_CELL_ERROR:
            return str(xlrd.error_text_from_code.get(cell.value, "error"))
        return _text(bool(cell.value) if cell.ctype == xlrd.XL_CELL_BOOLEAN else cell.value)

    def read() -> _Sheet:
        book = xlrd.open_workbook(str(path), logfile=io.StringIO(), formatting_info=True)
        sheet = book.sheet_by_index(0)
        cells = list(sheet.get_rows())
        return _Sheet(
            rows=[[text(cell) for cell in row] for row in cells],
            merged=[f"{xlrd.cellname(low, left)}:{xlrd.cellname(high - 1, right - 1)}"
                    for low, high, left, right in sheet.merged_cells],
            dates=[xlrd.cellname(k, m) for k, row in enumerate(cells)
                   for m, cell in enumerate(row) if cell.ctype == xlrd.XL_CELL_DATE],
        )  # fmt: skip

    return _plain_rows(path, guarded(path, read))


def _rows_of_xlsx(path: Path) -> Iterable[tuple[int, list[str]]]:
    """Rows of the first sheet, by number."""
    openpyxl = need("openpyxl", str(path), "matlab")

    def read() -> _Sheet:
        sheet = openpyxl.load_workbook(path, data_only=True).worksheets[0]
        if sheet.max_row * sheet.max_column > MOST_ENTRIES:  # an entry far out makes them all
            message = f"its sheet has {sheet.max_row} rows and {sheet.max_column} columns"
            raise ValueError(message)
        said = openpyxl.load_workbook(path).worksheets[0]  # formulas, where that has their results
        cells = [cell for row in sheet.iter_rows() for cell in row]
        return _Sheet(
            rows=[[_text(value) for value in row] for row in sheet.iter_rows(values_only=True)],
            merged=[str(place) for place in sheet.merged_cells.ranges],
            dates=[c.coordinate for c in cells if isinstance(c.value, date | time | timedelta)],
            unsolved=[c.coordinate for c in cells
                      if c.value is None and c.data_type == "n"
                      and said[c.coordinate].value is not None],
        )  # fmt: skip

    return _plain_rows(path, guarded(path, read))


def _plain_rows(path: Path, sheet: _Sheet) -> Iterable[tuple[int, list[str]]]:
    """Rows of a sheet by number, or ValueError if some entries are not what they seem to be."""
    reasons = (
        (sheet.merged, "merged entries: only the first has what they show. Split them"),
        (sheet.dates, "dates or times. If they are names, format them as text and write them anew"),
        (sheet.unsolved, "formulas without results. Save it in Excel or LibreOffice, or as .csv"),
    )
    for places, reason in reasons:
        if places:
            message = f"{path} has at {', '.join(places[:MOST_PLACES])} {reason}"
            raise ValueError(message)
    return enumerate(sheet.rows, start=1)


def _text(value: Any) -> str:
    """A spreadsheet's value as the text of an entry; whole numbers without a point."""
    if isinstance(value, float) and value.is_integer() and abs(value) < 2**53:
        value = int(value)
    return "" if value is None else str(value)


READERS: Mapping[str, Callable[[Path], Iterable[tuple[int, list[str]]]]] = {
    ".xls": _rows_of_xls, ".xlsx": _rows_of_xlsx, ".csv": _rows_of_csv,
}  # fmt: skip
"""What gives the rows of a file with their numbers, by extension."""


# --- entries -----------------------------------------------------------------------------------


def text(name: str, entry: str) -> str:
    """Return an entry that may be a name."""
    _validate.label(name, entry)
    return entry


def number(name: str, entry: str, **bounds: float) -> float:
    """Return an entry as `_validate.number` does; a decimal comma is as good as a point."""
    entry = entry.replace("\u2212", "-")
    if GROUPED.fullmatch(entry):
        message = (
            f"{name} = {entry!r} may be {entry.replace(',', '.', 1)} or "
            f"{entry.replace(',', '')}; write it with a point, or without separators"
        )
        raise ValueError(message)
    pointed = entry.replace(",", ".") if DECIMAL_COMMA.fullmatch(entry) else entry
    if "_" in pointed:  # which Python would read over
        message = f"{name} = {entry!r} is not a number"
        raise ValueError(message)
    if THOUSANDS.fullmatch(entry) and not DECIMAL_POINT.fullmatch(entry):
        message = f"{name} = {entry!r} is not a number; write it without separators of thousands"
        raise ValueError(message)
    return _validate.parsed_number(name, pointed, **bounds)


def positive(name: str, entry: str) -> float:
    """Return an entry as a number above 0."""
    return number(name, entry, above=0)


def whole(least: int) -> Callable[[str, str], int]:
    """Make a converter to whole numbers, of which 70000.0 is one, not below `least`."""

    def convert(name: str, entry: str) -> int:
        value: float = int(entry) if DIGITS.fullmatch(entry) else number(name, entry)
        whole = int(value) if value == int(value) else value
        return _validate.integer(name, whole, least=least, most=LARGEST_WHOLE)

    return convert
