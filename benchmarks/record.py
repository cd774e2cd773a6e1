"""Runs a benchmark, and appends what it measures to the history, `benchmarks/history/`.

Run as `python benchmarks/record.py BENCHMARK [OPTION...]`, with the options of the benchmark: `step
--cells 100`, `compare main~5 --cells 8,100`. Each run is a file of its own there, with the commit,
the machine, the options, and how many processors other programs used meanwhile; none is ever
overwritten. What is measured must be as the commit has it, or `--dirty` says that it need not be:
such an entry is kept, and not drawn. `--draw` draws the history, after the run or alone.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from datetime import UTC, datetime
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from _history import FIGURES, append, commits, courses, entries, went_on
from _revisions import ROOT, commit, uncommitted

HISTORY = ROOT / "benchmarks" / "history"
PICTURE = ROOT / "docs" / "images" / "history.png"
PROCESSORS = Path("/proc/stat")
IDLE = (3, 4, 8, 9)
"""Of the times in its first line: idle, waiting for disks, and guests, which count as users."""


def record(benchmark: str, options: Sequence[str], dirty: bool) -> Path:
    """Run a benchmark, and append its result to the history."""
    state = commit(), uncommitted()
    check(state[1], dirty)
    measured = datetime.now(UTC)
    result, others = run(benchmark, options)
    if state != (commit(), uncommitted()):
        raise SystemExit("nothing is recorded: the tree has changed while it was measured")
    moment = measured.isoformat(timespec="seconds").replace("+00:00", "Z")
    entry = {
        "benchmark": benchmark, "options": list(options), **state[0], "uncommitted": state[1],
        "measured": moment, "others": others, "result": result,
    }  # fmt: skip
    return append(HISTORY, entry)


def check(changed: Sequence[str], dirty: bool) -> None:
    """End if what would be measured is not what the commit says."""
    package = find_spec("morphosim")
    place = Path(package.origin).resolve() if package and package.origin else None
    if place is None or not place.is_relative_to(ROOT):
        message = f"the package that is installed is not this tree: {place}; pip install -e {ROOT}"
        raise SystemExit(message)
    if changed and not dirty:
        message = f"not committed: {', '.join(changed)}. Commit first, or record with --dirty"
        raise SystemExit(message)


def run(benchmark: str, options: Sequence[str]) -> tuple[dict[str, Any], float | None]:
    """What a benchmark writes as JSON, and how many processors others used meanwhile."""
    script = ROOT / "benchmarks" / f"{benchmark}.py"
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "result.json"
        before = busy(), own(), time.monotonic()
        done = subprocess.run([sys.executable, script, *options, "--json", path], check=False)
        if done.returncode:
            raise SystemExit(done.returncode)
        after = busy(), own(), time.monotonic()
        result = json.loads(path.read_text(encoding="utf-8"))
    if before[0] is None or after[0] is None:
        return result, None
    others = after[0] - before[0] - (after[1] - before[1])
    return result, round(max(0.0, others / (after[2] - before[2])), 2)


def busy() -> float | None:
    """Seconds that all processors have worked; None where the system does not tell."""
    if not PROCESSORS.exists():
        return None
    ticks = [int(word) for word in PROCESSORS.read_text().partition("\n")[0].split()[1:]]
    worked = sum(tick for k, tick in enumerate(ticks) if k not in IDLE)
    return worked / os.sysconf("SC_CLK_TCK")


def own() -> float:
    """Seconds of a processor that this process and those that it has waited for have used."""
    return sum(os.times()[:4])


def draw() -> None:
    """Draw the history for the page on speed."""
    from _pictures import history_picture

    history = entries(HISTORY)
    found, unknown = courses(history)
    drawn = [course for course in found if went_on(course)]
    if not drawn:
        raise SystemExit("nothing to draw: no figure was measured at two commits")
    history_picture(drawn, commits(history), PICTURE)
    print(PICTURE)
    for name in unknown:
        print(f"not drawn: {name} compares with a commit that no earlier entry leads to")


def parsed() -> tuple[argparse.Namespace, list[str]]:
    """The command line, and the options of the benchmark."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )  # fmt: skip
    parser.add_argument("benchmark", nargs="?", choices=tuple(FIGURES))
    parser.add_argument("--dirty", action="store_true", help="record what is not committed, too")
    parser.add_argument("--draw", action="store_true", help="draw the history")
    known, options = parser.parse_known_args()
    if known.benchmark is None and (options or known.dirty or not known.draw):
        parser.error(f"name a benchmark, one of {', '.join(FIGURES)}, or say --draw alone")
    if any(option.startswith("--js") for option in options):
        parser.error("--json: the result is written to the history")
    return known, options


def main() -> None:
    """Record, draw, or both."""
    known, options = parsed()
    try:
        if known.benchmark:
            print(record(known.benchmark, options, known.dirty))
        if known.draw:
            draw()
    except (FileExistsError, ValueError) as error:
        raise SystemExit(str(error)) from error


if __name__ == "__main__":
    main()
