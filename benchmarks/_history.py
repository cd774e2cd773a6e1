"""The history of the benchmarks: a file for each recorded run, and how figures went on.

An entry says what was run ("benchmark", "options"), at which commit ("commit", "committed",
"subject", and in "uncommitted" the files that were not as the commit has them), when ("measured"),
how many processors other programs used meanwhile ("others"), and holds in "result" all that the
benchmark writes with `--json`, the machine with it.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any, NamedTuple

Entry = Mapping[str, Any]
KEYS = (
    "benchmark", "options", "commit", "committed", "subject", "uncommitted", "measured", "others",
    "result",
)  # fmt: skip
BUSY = 0.2
"""Processors that others use, from which on the machine is said to be busy."""
RATIO, BEFORE, AFTER = "after / before", "before, MB per cell", "after, MB per cell"


class Figure(NamedTuple):
    """A number in the rows of a benchmark that is followed from commit to commit."""

    what: str
    column: str
    by: tuple[str, ...]
    """Columns that tell rows apart."""
    rows: str = "rows"
    """Where in the result the rows are."""
    least: int = 0
    """Rows of fewer cells are left out: what is measured of them is lost in other things."""


FIGURES = {
    "compare": (
        Figure("time of a step", RATIO, ("cells", "solver", "threads")),
        Figure("memory per cell", AFTER, ("cells", "solver", "threads"), least=100),
        Figure("start", RATIO, ("what",), "starts"),
    ),
    "step": (
        Figure("time of a step", "ms per step", ("scene", "threads")),
        Figure("memory per cell", "MB per cell", ("scene", "threads")),
    ),
    "scaling": (
        Figure("time of a step", "ms per step", ("cells", "solver", "threads")),
        Figure("memory per cell", "MB per cell", ("cells", "solver", "threads")),
    ),
    "table1": (Figure("time of a row", "min", ("cells", "numerics", "threads")),),
    "growth": (
        Figure("time of a step", "step, ms", ("cells",)),
        Figure("memory", "peak, GB", ("cells",)),
    ),
    "roofline": (Figure("time of a phase", "us", ("solver", "phase")),),
}  # fmt: skip
"""By benchmark. `compare` measures two commits in turn, the others one."""


class Point(NamedTuple):
    """A figure at a commit, relative to the first; the quartiles where ratios come in pairs."""

    commit: str
    ratio: float
    low: float
    high: float
    busy: bool


@dataclass
class Course:
    """How one figure went on, in the order in which it was measured."""

    benchmark: str
    what: str
    label: str
    """Which row."""
    points: list[Point] = field(default_factory=list)
    first: float | None = None
    """What figures of one commit are divided by."""

    def add(
        self, entry: Entry, revision: Mapping[str, Any], ratio: float, *quartiles: float
    ) -> None:
        """A figure at a commit."""
        low, high = quartiles or (ratio, ratio)
        self.points.append(Point(revision["commit"], ratio, low, high, is_busy(entry)))

    def last_of(self, revision: Mapping[str, Any]) -> float | None:
        """The figure at a commit, as measured last; None if it was not."""
        found = [point.ratio for point in self.points if point.commit == revision["commit"]]
        return found[-1] if found else None


Courses = dict[tuple, Course]


def append(folder: Path, entry: Entry) -> Path:
    """Write an entry to a file of its own.

    Raises
    ------
    FileExistsError
        There is one of this second, commit and benchmark; it is left as it is.
    ValueError
        It lacks a figure that is followed.
    """
    list(_rows(entry))
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{name(entry)}.json"
    with path.open("x", encoding="utf-8") as file:
        file.write(_text(entry) + "\n")
    return path


def name(entry: Entry) -> str:
    """What the file of an entry is called; names sort by time."""
    moment = entry["measured"].translate({ord(sign): None for sign in "-:"})
    return f"{moment}-{entry['commit'][:8]}-{entry['benchmark']}"


def entries(folder: Path) -> list[Entry]:
    """All entries of a folder, in the order in which they were measured.

    Raises
    ------
    ValueError
        A file is not an entry; the message names it.
    """
    return [_read(path) for path in sorted(folder.glob("*.json"))]


def courses(history: Sequence[Entry]) -> tuple[list[Course], list[str]]:
    """How all figures went on, and the names of entries that lead to no commit that is known.

    A ratio of `compare` holds on any machine, a busy one too: it is multiplied by what its earlier
    commit has come to in entries before. Figures of other benchmarks are divided by the first that
    has the same options and is of the same kind of processor; those of a busy machine tell of what
    kept it busy, and are left out. So is what is of no commit.

    Raises
    ------
    ValueError
        An entry lacks a figure that is followed; the message names both.
    """
    found: Courses = {}
    unknown = []
    for entry in history:
        paired = entry["benchmark"] == "compare"
        if entry["uncommitted"] or (is_busy(entry) and not paired):
            continue
        follow = _follow_pair if paired else _follow
        followed = [follow(found, entry, *row) for row in _rows(entry)]
        if not all(followed):
            unknown.append(name(entry))
    return list(found.values()), unknown


def is_busy(entry: Entry) -> bool:
    """Whether others used the machine meanwhile, as far as it is known."""
    return entry["others"] is not None and entry["others"] >= BUSY


def went_on(course: Course) -> bool:
    """Whether a figure was measured at more than one commit."""
    return len({point.commit for point in course.points}) > 1


def commits(history: Sequence[Entry]) -> dict[str, datetime]:
    """When each commit that has figures was made, the first at first."""
    known = [
        revision
        for entry in history
        for revision in entry["result"].get("revisions", [entry])
        if "commit" in revision
    ]
    made = {revision["commit"]: datetime.fromisoformat(revision["committed"]) for revision in known}
    return dict(sorted(made.items(), key=lambda pair: pair[1]))


def _rows(entry: Entry) -> Iterator[tuple[Figure, Mapping[str, Any]]]:
    """Figures of an entry, each with the row that has it."""
    for figure in FIGURES[entry["benchmark"]]:
        for row in entry["result"].get(figure.rows, ()):
            missing = [column for column in (figure.column, *figure.by) if column not in row]
            if missing:
                raise ValueError(f"{name(entry)}: a row of {figure.rows} lacks {missing[0]!r}")
            if row[figure.column] is not None and row.get("cells", figure.least) >= figure.least:
                yield figure, row


def _follow(found: Courses, entry: Entry, figure: Figure, row: Mapping[str, Any]) -> bool:
    """Add a figure of one commit."""
    machine = entry["result"]["machine"]
    like = *entry["options"], machine["cpu"], machine["known to LLVM as"]
    course = _course(found, entry, figure, row, like)
    course.first = course.first or row[figure.column]
    course.add(entry, entry, row[figure.column] / course.first)
    return True


def _follow_pair(found: Courses, entry: Entry, figure: Figure, row: Mapping[str, Any]) -> bool:
    """Add what `compare` says of the later of two commits, if the earlier one is known."""
    before, after = entry["result"]["revisions"]
    course = _course(found, entry, figure, row)
    if not course.points:
        course.add(entry, before, 1.0)
    base = course.last_of(before)
    if base is None:
        return False
    if figure.column == RATIO:
        middle, low, high = (row[key] for key in (RATIO, "lower quartile", "upper quartile"))
        course.add(entry, after, base * middle, base * low, base * high)
    elif min(row[AFTER], row[BEFORE]) > 0:  # not where a process has shrunk meanwhile
        course.add(entry, after, base * row[AFTER] / row[BEFORE])
    return True


def _course(
    found: Courses, entry: Entry, figure: Figure, row: Mapping[str, Any], like: tuple = ()
) -> Course:
    """The course that a row goes on, or a new one."""
    own = entry["benchmark"], figure.what, ", ".join(_worded(key, row[key]) for key in figure.by)
    return found.setdefault((*own, *like), Course(*own))


def _worded(column: str, value: Any) -> str:
    """What tells a row apart, as a reader says it."""
    if column not in ("cells", "threads"):
        return str(value)
    return f"{value} {column.removesuffix('s') if value == 1 else column}"


def _read(path: Path) -> Entry:
    try:
        entry = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise ValueError(f"{path} is no entry of the history: {error}") from error
    missing = set(KEYS) - set(entry) if isinstance(entry, dict) else set(KEYS)
    if missing:
        message = f"{path} is no entry of the history: it lacks {', '.join(sorted(missing))}"
        raise ValueError(message)
    if entry["benchmark"] not in FIGURES:
        allowed = ", ".join(FIGURES)
        raise ValueError(f"{path}: benchmark {entry['benchmark']!r} is not one of {allowed}")
    return entry


def _text(value: Any, depth: int = 0) -> str:
    """JSON with a line for each row of a table: what differs between entries is easily seen."""
    nested = isinstance(value, list | dict) and any(
        isinstance(v, list | dict) for v in _items(value)
    )
    if not nested:
        return json.dumps(value, ensure_ascii=False)
    margin = " " * (depth + 1)
    keys = (
        [f"{json.dumps(key)}: " for key in value] if isinstance(value, dict) else [""] * len(value)
    )
    lines = [
        f"{margin}{key}{_text(item, depth + 1)}"
        for key, item in zip(keys, _items(value), strict=True)
    ]
    start, end = "{}" if isinstance(value, dict) else "[]"
    return f"{start}\n" + ",\n".join(lines) + f"\n{' ' * depth}{end}"


def _items(value: list | dict) -> list:
    return list(value.values()) if isinstance(value, dict) else value
