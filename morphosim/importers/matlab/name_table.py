"""Tables of cell names, attraction and volumes: .xls, .xlsx and .csv."""

import re
import unicodedata
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from morphosim import _validate
from morphosim._files import listed
from morphosim._tables import number, read_rows


@dataclass(frozen=True, slots=True, kw_only=True)
class NameTable:
    """Names, attraction sigma[j, i] of j on i, and volumes (µm³; none where not stated)."""

    names: Sequence[str]
    sigma: NDArray[np.float64]
    volumes: Mapping[str, float]


def read_name_table(path: Path) -> NameTable:
    """Names, attraction and volumes from an .xls, .xlsx or .csv file."""
    rows = [row.entries for row in read_rows(path)]
    if len(rows[0]) > 1:
        return _parse(path, rows)
    names = _checked_names(path, "row", [row[0] for row in rows])
    return NameTable(names=names, sigma=np.zeros((len(names), len(names))), volumes={})


def _parse(path: Path, rows: Sequence[Sequence[str]]) -> NameTable:
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
        name: number(f"{path}: volume of cell {name!r}", row[k], above=0)
        for k in volume
        for name, row in zip(names, body, strict=True)
    }
    return NameTable(names=names, sigma=sigma, volumes=volumes)


def _checked_names(path: Path, kind: str, entries: Sequence[str]) -> list[str]:
    """Names of the rows or the columns as texts, neither missing nor twice."""
    names = list(entries)
    if not names or "" in names:
        at = f" (number {names.index('') + 1})" if names else ""
        message = f"{path}: a {kind}{at} has no name; expected a cell's name at each {kind}"
        raise ValueError(message)
    for name in names:
        _validate.label(f"{path}: name of a {kind}", name)
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


def _sigma(path: Path, j: str, i: str, entry: str) -> float:
    """Attraction from j to i; an empty diagonal is allowed, as it means nothing."""
    if j == i and entry == "":
        return 0.0
    return number(f"{path}: attraction from {j!r} (row) to {i!r} (column)", entry, least=0)
