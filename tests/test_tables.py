"""Tables of others: what is understood, and what is refused with the reason."""

from collections.abc import Callable
from datetime import date
from pathlib import Path
from typing import Any

import openpyxl
import pytest

from morphosim import load_scene
from morphosim._files import toml_table
from morphosim._tables import read_rows
from morphosim.importers.labels.cell_table import read_cells
from morphosim.importers.lineage import read_lineage
from morphosim.importers.matlab.name_table import read_name_table

READERS = [read_cells, read_lineage, read_name_table]


def write(folder: Path, content: str | bytes) -> Path:
    path = folder / "table.csv"
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


@pytest.mark.parametrize(
    "content",
    [
        "label,name,volume\n70000,A,2.5\n",
        "\ufeffLabel;Name;Volume\r\n70000;A;2,5\r\n",
        "sep=;\nlabel;name;volume\n70000.0;A;2,5\n",
        'label,cell,volume\n70000.0,A,"2,5"\n',
        "name\tlabel\tvolume\t\nA\t7e4\t2.5\n\n\t\t\n",
        "label,name,volume,type\r70000,A,2.5,\r",
        "label,name,volume\n70000,A,250e\u22122\n",
    ],
    ids=["plain", "european", "sep", "quoted", "tabs", "old Mac", "minus"],
)
def test_numbers_and_separators_as_programs_write_them(tmp_path: Path, content: str) -> None:
    assert read_cells(write(tmp_path, content)) == {70000: {"name": "A", "volume": 2.5}}


def test_spreadsheets_hold_the_same_tables(tmp_path: Path) -> None:
    book = openpyxl.Workbook()
    for row in (["label", "name", "frozen"], [70000.0, "A", True], [None], [8, 9, False]):
        book.active.append(row)
    book.save(tmp_path / "cells.xlsx")
    assert read_cells(tmp_path / "cells.xlsx") == {
        70000: {"name": "A", "frozen": True}, 8: {"name": "9", "frozen": False},
    }  # fmt: skip


def test_an_entry_far_out_is_told(tmp_path: Path) -> None:
    book = openpyxl.Workbook()
    book.active["A1"], book.active["XFD1048576"] = "label", 1
    book.save(tmp_path / "cells.xlsx")
    with pytest.raises(ValueError, match="its sheet has 1048576 rows and 16384 columns"):
        read_cells(tmp_path / "cells.xlsx")


def merge(sheet: Any) -> None:
    sheet.merge_cells("B2:B3")


@pytest.mark.parametrize(
    ("entry", "spoil", "error"),
    [
        ("A", merge, "at B2:B3 merged entries: only the first"),
        ("=A1&1", None, "at B2 formulas without results"),
        (date(2026, 3, 1), None, "at B2 dates or times. If they are names"),
    ],
    ids=["merged", "formula", "date"],
)
def test_entries_of_a_spreadsheet_that_are_not_what_they_seem(
    tmp_path: Path, entry: Any, spoil: Callable[[Any], None] | None, error: str
) -> None:
    book = openpyxl.Workbook()
    for row in (["label", "name"], [1, entry], [2, "B"]):
        book.active.append(row)
    if spoil:
        spoil(book.active)
    book.save(tmp_path / "cells.xlsx")
    with pytest.raises(ValueError, match=f"cells.xlsx has {error}"):
        read_cells(tmp_path / "cells.xlsx")


def test_large_labels_and_flags_of_floats(tmp_path: Path) -> None:
    path = write(tmp_path, "label,frozen\n9007199254740993,1.0\n")
    assert read_cells(path) == {9007199254740993: {"frozen": True}}


BAD = {
    "decimal comma": ("label,name,volume\n1,A,2,5\n", "4 entries; expected 3.*2.5 for 2,5"),
    "cut short": ("label,name,volume\n1,A,2.5\n2,B\n", "row 3 has 2 entries; expected 3.*cut"),
    "no heading": ("label,name\n1,A,x\n", "row 2 has 3 entries; expected 2.*a heading is missing"),
    "twice": ("label,volume,Volume\n1,2,3\n", "column 'volume' occurs twice"),
    "twice by another name": ("label,name,cell\n1,A,B\n", "column 'name' occurs twice"),
    "thousands": ("label;volume\n1;1,125\n", "'1,125' may be 1.125 or 1125"),
    "both": ("label;volume\n1;1.234,5\n", "'1.234,5' is not a number; write it without sep"),
    "both, English": ('label,volume\n1,"1,234.5"\n', "'1,234.5' is not a .* without separators"),
    "Swiss": ("label,volume\n1,1'234\n", "\"1'234\" is not a number; write it without separators"),
    "spaces": ("label;volume\n1;1 234 567,5\n", "is not a number; write it without separators"),
    "per cent": ("label,volume\n1,50%\n", "'50%' is not a number"),
    "too large a label": ("label,name\n99999999999999999999,A\n", "label = 9{20} is not"),
    "underscore": ("label,volume\n1,1_0\n", "'1_0' is not a number"),
    "half a label": ("label,name\n1.5,A\n", "label = 1.5 is not a whole number"),
    "quotes": ('label,name\n1,"A\n', "cannot be read as a .csv file"),
}  # fmt: skip


@pytest.mark.parametrize(("content", "error"), BAD.values(), ids=BAD)
def test_what_is_not_sure_is_refused(tmp_path: Path, content: str, error: str) -> None:
    with pytest.raises((ValueError, TypeError), match=error):
        read_cells(write(tmp_path, content))


NO_TEXT = {
    "empty": (b"", "table.csv is empty"),
    "only separators": (b",,\n\n,\n", "table.csv is empty"),
    "zeros": (bytes(100), "NUL byte at 0"),
    "a zero": (b"label,name\n1,A\0\n", "NUL byte at 14"),
    "utf-16": ("label,name\n1,A\n".encode("utf-16"), "text in UTF-16; expected UTF-8"),
    "utf-16 without a mark": ("label,name\n1,A\n".encode("utf-16-le"), "text in UTF-16, or no"),
    "utf-32": ("label\n1\n".encode("utf-32"), "text in UTF-32"),
    "cp1252": ("label,name\n1,Zellü\n".encode("cp1252"), "line 2 .* which is 'ü' in .*cp1252"),
}  # fmt: skip


@pytest.mark.parametrize("read", READERS)
@pytest.mark.parametrize(("content", "error"), NO_TEXT.values(), ids=NO_TEXT)
def test_what_is_no_text_in_utf_8_is_said(
    tmp_path: Path, read: Callable[[Path], Any], content: bytes, error: str
) -> None:
    with pytest.raises(ValueError, match=error):
        read(write(tmp_path, content))


def test_all_tables_have_the_same_rows(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="row 2 has 4 entries; expected 3"):
        read_lineage(write(tmp_path, "name,parent,volume\nA,,2,5\n"))
    with pytest.raises(ValueError, match=r"row 3 has 2 entries; expected 3.*cut short"):
        read_name_table(write(tmp_path, ",A,B\nA,0,1\nB,0\n"))
    with pytest.raises(ValueError, match=r"has headings .* and no rows"):
        read_cells(write(tmp_path, "label,name\n"))
    assert [row.where[-5:] for row in read_rows(write(tmp_path, "a\n\n1\n"))] == ["row 1", "row 3"]


def test_scene_files_say_their_encoding(tmp_path: Path) -> None:
    path, text = tmp_path / "scene.toml", 'name = "Zellü"\n'
    for encoding, error in (("utf-16", "text in UTF-16"), ("cp1252", "line 1 .*cp1252")):
        path.write_bytes(text.encode(encoding))
        with pytest.raises(ValueError, match=error):
            load_scene(path)
    path.write_bytes(("\ufeff" + text).encode())
    assert toml_table(path, "scene file") == {"name": "Zellü"}
