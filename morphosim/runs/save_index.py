"""The tables of all saves, once more, in one file: so a run opens without opening each save.

The file is a sequence of records, one for each save, which is added when the save is in its place.
A record counts only for the very file that it was written of, by size and time; of all others, and
where the index is damaged or missing, the save itself is read. So nothing depends on the index but
how long opening takes.
"""

import json
import logging
import mmap
import struct
import zlib
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from morphosim.measure.variable import Variable
from morphosim.runs.directory import RunDirectory
from morphosim.runs.merge import Save, Table, is_held

MAGIC = b"saves  1"
HEAD = struct.Struct("<8s4IQ")
"""Before a record: MAGIC, the checksum of what follows, and the lengths of its parts, which are
facts, form and attributes in JSON, and arrays."""
ALIGNED = 8
"""Parts and arrays begin at multiples of so many bytes."""
MISREAD = (AttributeError, KeyError, TypeError, ValueError)
"""What reading a record raises that another program has written."""
SECOND = 1_000_000_000
"""Nanoseconds; some programs copy a file's time without what is less."""

_log = logging.getLogger(__name__)


def add_to_index(files: RunDirectory, save: Save) -> None:
    """Add a save whose file is in its place; if that fails, the run is without index."""
    try:
        with files.index.open("ab") as file:
            file.write(_record(save))
    except OSError as error:
        _log.warning("%s is left out, and the run opens more slowly: %s", files.index, error)
        with suppress(OSError):
            files.index.unlink()


def mend_index(files: RunDirectory) -> None:
    """Cut off a record that a process has left unfinished: none behind it would be found."""
    whole = max((record.end for record in _records(_mapped(files.index))), default=0)
    if files.index.is_file() and whole < files.index.stat().st_size:
        with files.index.open("r+b") as file:
            file.truncate(whole)


def indexed_saves(files: RunDirectory) -> dict[Path, Save]:
    """Saves that the index holds and that have stayed the same; arrays are read when used."""
    found: dict[Path, Save] = {}
    parsed: dict[bytes, Any] = {}
    for record in _records(_mapped(files.index)):
        try:
            path = files.path / record.facts["file"]
            if _is_of(path, record.facts):
                found[path] = record.save(path, parsed)
        except MISREAD as error:
            _log.debug("%s: a record is not understood: %s", files.index, error)
    return found


def _record(save: Save) -> bytes:
    """Record of a save."""
    stat = save.path.stat()
    tables = {"": save.table} | dict(save.groups)
    arrays = [(group, name, a) for group, table in tables.items() for name, a in table.items()]
    facts = {
        "file": save.path.name, "size": stat.st_size, "time": stat.st_mtime_ns,
        "lengths": save.lengths,
        "arrays": [(group, name, a.dtype.str, a.shape) for group, name, a in arrays],
    }  # fmt: skip
    form = {
        "of_root": list(save.of_root), "matrix": save.matrix, "packed": save.packed,
        "variables": {name: _said(variable) for name, variable in save.variables.items()},
    }  # fmt: skip
    attributes = {name: np.asarray(value).item() for name, value in save.attributes.items()}
    parts = [_padded(json.dumps(part).encode(), b" ") for part in (facts, form, attributes)]
    parts.append(b"".join(_padded(a.tobytes(), b"\0") for _, _, a in arrays))
    content = b"".join(parts)
    return HEAD.pack(MAGIC, zlib.crc32(content), *map(len, parts)) + content


def _said(variable: Variable) -> tuple[Any, ...]:
    """Description of a variable, for JSON."""
    kind = "text" if variable.kind is str else np.dtype(variable.kind).str
    return variable.dims, kind, variable.attributes


def _padded(part: bytes, by: bytes) -> bytes:
    return part + by * (-len(part) % ALIGNED)


@dataclass(frozen=True, slots=True)
class _Record:
    """A record that is whole.

    Attributes
    ----------
    facts : of this save
    form, attributes : texts in JSON, alike for most saves of a run
    arrays : content of the arrays, one after the other
    end : where the next record begins
    """

    facts: Mapping[str, Any]
    form: bytes
    attributes: bytes
    arrays: memoryview
    end: int

    def save(self, path: Path, parsed: dict[bytes, Any]) -> Save:
        """Save of the record; `parsed` holds what the texts of others have said."""
        for text, read in ((self.form, _form), (self.attributes, _attributes)):
            if text not in parsed:
                parsed[text] = read(text)
        form, groups = parsed[self.form], self._tables()
        return Save(
            path=path,
            table={name: values for name, values in groups.pop("").items() if is_held(values)},
            groups=groups,
            lengths=self.facts["lengths"],
            attributes=parsed[self.attributes],
            **form,
        )

    def _tables(self) -> dict[str, Table]:
        """Arrays by group and name, without a copy."""
        tables: dict[str, Table] = {"": {}}
        start = 0
        for group, name, kind, shape in self.facts["arrays"]:
            values: NDArray[Any] = np.ndarray(shape, kind, self.arrays, start)
            tables.setdefault(group, {})[name] = values
            start += values.nbytes + -values.nbytes % ALIGNED
        return tables


def _form(text: bytes) -> dict[str, Any]:
    """What saves of one kind have in common."""
    form: dict[str, Any] = json.loads(text)
    form["variables"] = {
        name: Variable.stored(dims, str if kind == "text" else np.dtype(kind), attributes)
        for name, (dims, kind, attributes) in form["variables"].items()
    }
    return form


def _attributes(text: bytes) -> dict[str, Any]:
    """Attributes of a file, numbers in the types that the netCDF library gives."""
    said = json.loads(text)
    return {name: v if isinstance(v, str) else np.asarray(v)[()] for name, v in said.items()}


def _records(content: mmap.mmap | bytes) -> Iterator[_Record]:
    """Records up to the first that is not whole."""
    view, start = memoryview(content), 0
    while start + HEAD.size <= len(view):
        magic, checksum, *lengths = HEAD.unpack_from(view, start)
        ends = start + HEAD.size + np.cumsum([0, *lengths])
        begin, end = int(ends[0]), int(ends[-1])
        if magic != MAGIC or end > len(view) or zlib.crc32(view[begin:end]) != checksum:
            return
        facts, form, attributes, arrays = (
            view[a:b] for a, b in zip(ends[:-1].tolist(), ends[1:].tolist(), strict=True)
        )
        yield _Record(json.loads(bytes(facts)), bytes(form), bytes(attributes), arrays, end)
        start = end


def _mapped(path: Path) -> mmap.mmap | bytes:
    """Content of a file, nothing if it is not there."""
    try:
        with path.open("rb") as file:
            return mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    except (OSError, ValueError):  # ValueError: it is empty
        return b""


def _is_of(path: Path, facts: Mapping[str, Any]) -> bool:
    """Whether a file is still that which facts were written of."""
    try:
        stat = path.stat()
    except OSError:
        return False
    times = (facts["time"], facts["time"] // SECOND * SECOND)
    return bool(stat.st_size == facts["size"] and stat.st_mtime_ns in times)
