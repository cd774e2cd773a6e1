"""Tables of what is known of labelled cells: .csv."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from morphosim import _validate
from morphosim._files import check_file, csv_rows, guarded

FLAGS = {"true": True, "yes": True, "1": True, "false": False, "no": False, "0": False}


def read_cells(path: Path) -> dict[int, dict[str, Any]]:
    """What a table says of each label, as keywords of `Cell`.

    Columns are "label", "name" (or "cell"), "type", "parent", "volume" (target volume, µm³),
    "gamma" and "frozen" (true, yes, 1 or false, no, 0), in any order; only "label" is needed. An
    empty entry says nothing.

    Raises
    ------
    FileNotFoundError
        The file does not exist.
    ValueError
        The file cannot be read, has a column that is not known, or an entry that is not allowed.
    """
    check_file(path, (".csv",))
    rows = guarded(path, lambda: _rows(path))
    cells: dict[int, dict[str, Any]] = {}
    for number, row in enumerate(rows, start=2):
        where = f"{path}, row {number}"
        said = {key: entry for key, entry in row.items() if entry}
        for key in said:
            _validate.choice(f"column of {path}", key, (*COLUMNS, "label", "cell"))
        if not said:
            continue
        label = _label(where, said.pop("label", ""))
        if label in cells:
            message = f"{where}: label {label} occurs twice; each must be unique"
            raise ValueError(message)
        if "cell" in said:
            said.setdefault("name", said.pop("cell"))
        cells[label] = {key: COLUMNS[key](f"{where}: {key}", said[key]) for key in said}
    return cells


def _rows(path: Path) -> list[dict[str, str]]:
    """Entries by heading; separated by commas, semicolons or tabs."""
    table = iter(csv_rows(path))
    head = [heading.strip().lower() for heading in next(table, [])]
    return [dict(zip(head, (entry.strip() for entry in row), strict=False)) for row in table]


def _label(where: str, entry: str) -> int:
    if not entry.isdecimal() or int(entry) == 0:
        message = f"{where}: label = {entry!r}; expected a whole number above 0"
        raise ValueError(message)
    return int(entry)


def _text(name: str, entry: str) -> str:
    return entry


def _positive(name: str, entry: str) -> float:
    return _validate.parsed_number(name, entry, above=0)


def _flag(name: str, entry: str) -> bool:
    _validate.choice(name, entry.lower(), FLAGS)
    return FLAGS[entry.lower()]


COLUMNS: Mapping[str, Callable[[str, str], Any]] = {
    "name": _text, "type": _text, "parent": _text, "volume": _positive, "gamma": _positive,
    "frozen": _flag,
}  # fmt: skip
"""What turns an entry into a value, by column."""
