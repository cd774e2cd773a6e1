"""Tables of cell names, attraction and volumes: .xls, .xlsx and .csv."""

import io
import re
import unicodedata
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from morphosim import _validate
from morphosim._extras import need
from morphosim._files import check_file, csv_rows, guarded, listed

Entry = str | float


@dataclass(frozen=True, slots=True, kw_only=True)
class NameTable:
    """Names, attraction sigma[j, i] of j on i, and volumes (µm³; none where not stated)."""

    names: Sequence[str]
    sigma: NDArray[np.float64]
    volumes: Mapping[str, float]


def read_table(path: Path) -> NameTable:
    """Names, attraction and volumes from an .xls, .xlsx or .csv file."""
    readers = {".xls": _rows_of_xls, ".xlsx": _rows_of_xlsx, ".csv": _rows_of_csv}
    check_file(path, readers)
    rows = _without_empty(guarded(path, lambda: readers[path.suffix.lower()](path)))
    if not rows:
        message = f"{path} is empty; expected a table of cell names and attraction"
        raise ValueError(message)
    if len(rows[0]) > 1:
        return _parse(path, rows)
    names = _checked_names(path, "row", [row[0] for row in rows])
    return NameTable(names=names, sigma=np.zeros((len(names), len(names))), volumes={})


def _rows_of_xls(path: Path) -> list[list[Entry]]:
    xlrd = need("xlrd", str(path), "matlab")
    book = xlrd.open_workbook(str(path), logfile=io.StringIO())

    def plain(cell: Any) -> Entry:
        if cell.ctype == xlrd.XL_CELL_ERROR:
            return str(xlrd.error_text_from_code.get(cell.value, "error"))
        return _plain(bool(cell.value) if cell.ctype == xlrd.XL_CELL_BOOLEAN else cell.value)

    return [[plain(cell) for cell in row] for row in book.sheet_by_index(0).get_rows()]


def _rows_of_xlsx(path: Path) -> list[list[Entry]]:
    openpyxl = need("openpyxl", str(path), "matlab")
    sheet = openpyxl.load_workbook(path, data_only=True).worksheets[0]
    return [[_plain(value) for value in row] for row in sheet.iter_rows(values_only=True)]


def _rows_of_csv(path: Path) -> list[list[Entry]]:
    return [[_plain(v) for v in row] for row in csv_rows(path)]


def _plain(value: Any) -> Entry:
    """Return a number as float, anything else as text, nothing as the empty text."""
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        return float(value)
    return "" if value is None else str(value).strip()


def _without_empty(rows: Iterable[list[Entry]]) -> list[list[Entry]]:
    """Drop empty rows and columns, and bring all rows to the same length."""
    filled = [row for row in rows if any(value != "" for value in row)]
    width = max(map(len, filled), default=0)
    full = [row + [""] * (width - len(row)) for row in filled]
    used = [k for k in range(width) if any(row[k] != "" for row in full)]
    return [[row[k] for k in used] for row in full]


def _parse(path: Path, rows: list[list[Entry]]) -> NameTable:
    """Table whose first row is a header."""
    header, body = _checked_names(path, "column", rows[0][1:]), rows[1:]
    names = _checked_names(path, "row", [row[0] for row in body])
    columns = {name: k for k, name in enumerate(header, start=1)}
    volume = [columns.pop(name) for name in header if _is_volume(name)]
    if len(volume) > 1:
        message = f"{path} has {len(volume)} columns headed volume; expected at most one"
        raise ValueError(message)
    sigma = np.zeros((len(names), len(names)))
    if columns or not volume:
        _check_columns(path, names, columns)
        for j, row in enumerate(body):
            sigma[j] = [_sigma(path, names[j], i, row[columns[i]]) for i in names]
    volumes = {
        name: _validate.parsed_number(f"{path}: volume of cell {name!r}", row[k], above=0)
        for k in volume
        for name, row in zip(names, body, strict=True)
    }
    return NameTable(names=names, sigma=sigma, volumes=volumes)


def _checked_names(path: Path, kind: str, entries: Sequence[Entry]) -> list[str]:
    """Names of the rows or the columns as texts, neither missing nor twice."""
    names = [entry if isinstance(entry, str) else f"{entry:.15g}" for entry in entries]
    if not names or "" in names:
        at = f" (number {names.index('') + 1})" if names else ""
        message = f"{path}: a {kind}{at} has no name; expected a cell's name at each {kind}"
        raise ValueError(message)
    _validate.unique(f"{path}: {kind}", names)
    return names


def _is_volume(heading: str) -> bool:
    """Whether a heading is "volume" in any case, alone or with µm³ in any spelling."""
    letters = re.sub(r"[\W_]", "", unicodedata.normalize("NFKC", heading).casefold())
    return letters in ("volume", "volumeum3", "volumeμm3")


def _check_columns(path: Path, names: Sequence[str], columns: Iterable[str]) -> None:
    extra = [name for name in columns if name not in names]
    missing = [name for name in names if name not in columns]
    if extra or missing:
        message = (
            f"{path}: the names of rows and columns differ: columns without a row "
            f"{listed(extra)}, rows without a column {listed(missing)}; expected the same names, "
            "and besides at most a column 'volume (um^3)'"
        )
        raise ValueError(message)


def _sigma(path: Path, j: str, i: str, entry: Entry) -> float:
    """Attraction from j to i; an empty diagonal is allowed, as it means nothing."""
    if j == i and entry == "":
        return 0.0
    return _validate.parsed_number(
        f"{path}: attraction from {j!r} (row) to {i!r} (column)", entry, least=0
    )
