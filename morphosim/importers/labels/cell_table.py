"""Tables of what is known of labelled cells: .csv, .xls and .xlsx."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from morphosim import _validate
from morphosim._tables import Converter, positive, read_table, text, whole

FLAGS = {
    "true": True, "yes": True, "1": True, "1.0": True,
    "false": False, "no": False, "0": False, "0.0": False,
}  # fmt: skip


def read_cells(path: Path) -> dict[int, dict[str, Any]]:
    """What a table says of each label, as keywords of `Cell`.

    Columns are "label", "name" (or "cell"), "type", "parent", "volume" (target volume, µm³),
    "gamma" and "frozen" (true, yes, 1 or false, no, 0), in any order; only "label" is needed. An
    empty entry says nothing.

    Raises
    ------
    FileNotFoundError
        The file does not exist.
    TypeError, ValueError
        The file cannot be read, has a column that is not known, or an entry that is not allowed.
    """
    cells: dict[int, dict[str, Any]] = {}
    for where, said in read_table(path, COLUMNS, ("label",), {"cell": "name"}).rows:
        if "label" not in said:
            message = f"{where}: label is missing; expected a whole number above 0"
            raise ValueError(message)
        label = said.pop("label")
        if label in cells:
            message = f"{where}: label {label} occurs twice; each must be unique"
            raise ValueError(message)
        cells[label] = said
    return cells


def _flag(name: str, entry: str) -> bool:
    _validate.choice(name, entry.lower(), FLAGS)
    return FLAGS[entry.lower()]


COLUMNS: Mapping[str, Converter] = {
    "label": whole(1), "name": text, "type": text, "parent": text, "volume": positive,
    "gamma": positive, "frozen": _flag,
}  # fmt: skip
"""What turns an entry into a value, by column."""
