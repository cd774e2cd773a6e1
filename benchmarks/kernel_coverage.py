"""Which lines and branches of the kernels their tests run, file by file.

Run as `python benchmarks/kernel_coverage.py`; half a minute. Compiled code hides its lines from
coverage, so the tests in `tests/kernels` run with kernels as plain Python functions
(NUMBA_DISABLE_JIT=1). What needs compilation skips and says why (`tests/kernels/conftest.py`).
`messages` is tested with the ranks, in `tests/mpi`.
"""

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from _common import arguments, report

ROOT = Path(__file__).resolve().parents[1]
TESTS = "tests/kernels"
PACKAGE = "morphosim.kernels"


def measured(place: Path) -> dict[str, Any]:
    """What coverage has counted while the tests ran, as it says it in JSON."""
    data, result = f"--data-file={place / 'data'}", place / "coverage.json"
    coverage = [sys.executable, "-m", "coverage"]
    tests = ["-m", "pytest", TESTS, "-q", "-rs", "-p", "no:cacheprovider"]
    environment = os.environ | {"NUMBA_DISABLE_JIT": "1"}
    run = [*coverage, "run", "--branch", f"--source={PACKAGE}", data, *tests]
    if subprocess.run(run, cwd=ROOT, env=environment).returncode:
        raise SystemExit("a test failed; its error stands above")
    subprocess.run(
        [*coverage, "json", "-q", data, "-o", result], cwd=ROOT, check=True, env=environment
    )
    return dict(json.loads(result.read_text()))


def row(name: str, summary: Mapping[str, Any]) -> dict[str, Any]:
    """One line of the table."""
    return {
        "file": name,
        "lines": summary["num_statements"],
        "not run": summary["missing_lines"],
        "branches": summary["num_branches"],
        "not taken": summary["missing_branches"],
        "run, %": round(summary["percent_covered"], 1),
    }


def main() -> None:
    """Run the tests and report."""
    options = arguments(__doc__)
    with tempfile.TemporaryDirectory() as place:
        counted = measured(Path(place))
    rows = [
        row(Path(path).stem, found["summary"])
        for path, found in sorted(counted["files"].items())
        if found["summary"]["num_statements"]
    ]
    report([*rows, row("all", counted["totals"])], options.json)


if __name__ == "__main__":
    main()
