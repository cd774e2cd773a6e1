"""What goes wrong with files and values, by chance."""

import copy
import json
from collections.abc import Callable
from typing import Any

import numpy as np

Random = np.random.Generator

ODD: tuple[Any, ...] = (
    0, -1, 1, 3, -0.0, 0.5, -2.5, 1e-9, 1e-320, 1e30, 1e300, -1e300, 1e308, 2**31, 2**63, 2**64,
    -(2**63), 10**40, 10**400, float("nan"), float("inf"), float("-inf"), True, False, "", " ", "a",
    "1", "0.5", "nan", "1e400", "a\0", "\x1b[31mred\x1b[0m", "a\nb", "é", "細胞", "\u202egnp",
    "x" * 5000,
    "../../etc/passwd", "module:name", "os:system", "none", "null", [], [[]], [0], [True], ["a"],
    [1, 2, 3], [1, "b", 3], [[[]], {}, 1], [0.0] * 200, {}, {"a": 1}, {"kind": "sphere"},
    {"use": 3}, [{}], {"": ""}, [[1, 2], [3]], {"dtype": "O", "shape": [1], "values": [1]},
    {"dtype": "f8", "shape": [10**12], "values": []},
)  # fmt: skip
"""Values for any place."""
PIECES = (
    b"", b"\0", b"\xff\xfe", b"\xef\xbb\xbf", b"\x1b[2J", b"nan", b"inf", b"-1", b"1e999", b"[",
    b"]", b"[" * 3000, b"{", b'"', b"'", b"\n", b"\r", b",", b";", b"\t", b"=", b"9" * 5000,
    b"a = 1\n", "é".encode(), "é".encode("latin-1"), "€".encode("cp1252"),
)  # fmt: skip
"""Bytes for any place of a text."""


def damaged_bytes(data: bytes, random: Random) -> bytes:
    """Bytes of which some are others, or missing, or too many."""
    damages: list[Callable[[bytearray, Random], bytearray]] = [
        _flipped, _flipped, _flipped, _cut_short, _without_piece, _with_piece, _zeroed, _doubled,
    ]  # fmt: skip
    result = bytearray(data)
    for _ in range(int(random.integers(1, 4))):
        result = damages[random.integers(len(damages))](result, random)
    return bytes(result)


def damaged_text(data: bytes, random: Random) -> bytes:
    """Text with a piece too many, a line twice or missing, or as `damaged_bytes`."""
    kind = random.integers(4)
    if kind == 0:
        return damaged_bytes(data, random)
    if kind == 1:
        place = random.integers(len(data) + 1)
        return data[:place] + PIECES[random.integers(len(PIECES))] + data[place:]
    lines = data.splitlines(keepends=True)
    place = random.integers(len(lines))
    return b"".join(
        lines[:place] + lines[place : place + 1] * (2 * (kind - 2)) + lines[place + 1 :]
    )


def damaged_table(data: bytes, random: Random, delimiter: bytes = b",") -> bytes:
    """Table with another entry at some places, or as `damaged_text`."""
    if random.random() < 0.4:
        return damaged_text(data, random)
    rows = [row.split(delimiter) for row in data.splitlines()]
    for _ in range(int(random.integers(1, 4))):
        row = rows[random.integers(len(rows))]
        entry = ODD[random.integers(len(ODD))]
        said = entry if isinstance(entry, str) else json.dumps(entry, default=str)
        row[random.integers(len(row))] = said.encode("utf-8", "replace")
    return b"\n".join(delimiter.join(row) for row in rows)


def damaged_tree(tree: Any, random: Random) -> Any:
    """Nested tables and lists with another value, key or entry at some places."""
    tree = copy.deepcopy(tree)
    for _ in range(int(random.integers(1, 3))):
        places = list(_places(tree))
        holder, key = places[random.integers(len(places))]
        _change(holder, key, random)
    return tree


def odd_value(random: Random) -> Any:
    """A value that hardly any place expects."""
    return copy.deepcopy(ODD[random.integers(len(ODD))])


def _places(tree: Any) -> Any:
    entries = tree.items() if isinstance(tree, dict) else enumerate(tree)
    for key, value in list(entries):
        yield tree, key
        if isinstance(value, dict | list):
            yield from _places(value)


def _change(holder: Any, key: Any, random: Random) -> None:
    kind, value = random.random(), holder[key]
    if kind < 0.5:
        holder[key] = odd_value(random)
    elif kind < 0.6:
        del holder[key]
    elif kind < 0.7:
        other = str(odd_value(random))[:20]
        holder[other if isinstance(holder, dict) else key] = value
    elif kind < 0.8 and isinstance(value, int | float):
        holder[key] = value * float(random.choice([-1.0, 0.0, 1e-12, 1e6, 1e25]))
    elif kind < 0.9:
        holder[key] = [value, value]
    else:
        holder[key] = str(value)


def _flipped(data: bytearray, random: Random) -> bytearray:
    for _ in range(int(random.integers(1, 5))):
        if data:
            data[random.integers(len(data))] = random.integers(256)
    return data


def _cut_short(data: bytearray, random: Random) -> bytearray:
    return data[: random.integers(len(data) + 1)]


def _without_piece(data: bytearray, random: Random) -> bytearray:
    first = random.integers(len(data) + 1)
    return data[:first] + data[first + int(random.integers(1, 64)) :]


def _with_piece(data: bytearray, random: Random) -> bytearray:
    place = random.integers(len(data) + 1)
    return data[:place] + bytearray(random.bytes(int(random.integers(1, 64)))) + data[place:]


def _zeroed(data: bytearray, random: Random) -> bytearray:
    first = int(random.integers(len(data) + 1))
    count = min(int(random.integers(1, 64)), len(data) - first)
    data[first : first + count] = bytes(count)
    return data


def _doubled(data: bytearray, random: Random) -> bytearray:
    first = random.integers(len(data) + 1)
    return data[: first + 32] + data[first:]
