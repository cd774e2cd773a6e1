"""Faults put into the code one at a time, and which test catches each.

`mutants.toml` beside this lists them: in which file what stands instead of what, and the tests that
are there to see it. A copy of the tree gets one fault after the other. Faults in kernels are tried
without compilation (NUMBA_DISABLE_JIT=1), as in `kernel_coverage`, the others with it: the copy
compiles the kernels once, and not again if `--keep` names its folder.

Run as `python benchmarks/mutants.py [--only kernels/boxes.py] [--keep FOLDER]`; the exit code is 1
if a fault is not caught that the table does not explain, or if one is that it does.
"""

import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

from _common import arguments, machine

ROOT = Path(__file__).resolve().parents[1]
TABLE = Path(__file__).with_suffix(".toml")
PARTS = ("kernels", "morphosim", "tests", "docs", "examples", "benchmarks")
PATIENCE = 300.0
"""Seconds after which tests hang."""
NOT_CAUGHT, CAUGHT = 0, 1
"""Exit codes of pytest; any other says that no test ran."""


@dataclass(frozen=True, kw_only=True)
class Mutant:
    """A fault: `after` stands in `file` instead of `before`, which is there once.

    `tests` are the arguments of pytest that should catch it, `compiled` whether with compiled
    kernels; `why` says why none can.
    """

    file: str
    fault: str
    before: str
    after: str
    tests: Sequence[str]
    compiled: bool = True
    why: str = ""

    def applied(self, root: Path) -> str:
        """Text of the file with the fault; ValueError if the table does not fit the file."""
        text = (root / self.file).read_text(encoding="utf-8")
        if (found := text.count(self.before)) != 1:
            message = f"{self.file}: {self.before!r} stands there {found} times; expected once"
            raise ValueError(message)
        return text.replace(self.before, self.after)


def read_table() -> list[Mutant]:
    """All faults of the table."""
    table = tomllib.loads(TABLE.read_text(encoding="utf-8"))
    return [
        Mutant(**({"file": file} | {k: v for k, v in part.items() if k != "faults"} | row))
        for file, part in table.items() for row in part["faults"]
    ]  # fmt: skip


@contextmanager
def copied(keep: str) -> Iterator[Path]:
    """A copy of the tree in which kernels lie where they are installed."""
    with tempfile.TemporaryDirectory() as place:
        root = Path(keep or place).resolve()
        for name in PARTS:
            shutil.copytree(
                ROOT / name, root / name, dirs_exist_ok=True, symlinks=True,
                ignore=shutil.ignore_patterns("__pycache__"),
            )  # fmt: skip
        for name in ("pyproject.toml", "README.md"):
            shutil.copy2(ROOT / name, root / name)
        kernels = root / "morphosim" / "kernels"
        if not kernels.exists():
            kernels.symlink_to(root / "kernels")
        yield root


def outcome(
    root: Path, tests: Sequence[str], compiled: bool, patience: float | None = None
) -> tuple[int, str]:
    """Exit code of pytest, and the first test that failed or, with another code, what it says."""
    environment = os.environ | {"PYTHONPATH": str(root), "PYTHONDONTWRITEBYTECODE": "1"}
    if not compiled:
        environment["NUMBA_DISABLE_JIT"] = "1"
    command = [sys.executable, "-m", "pytest", "-x", "-p", "no:cacheprovider", *tests]
    try:
        done = subprocess.run(
            command, cwd=root, env=environment, capture_output=True, text=True, timeout=patience
        )
    except subprocess.TimeoutExpired:
        return CAUGHT, f"no end after {patience:g} s"
    said = re.search(r"^(?:FAILED|ERROR) (.+?)(?: - |$)", done.stdout, re.MULTILINE)
    return done.returncode, said[1] if said else (done.stdout + done.stderr)[-2000:]


def check_whole(root: Path, mutants: Sequence[Mutant]) -> None:
    """Raise unless the tests pass without a fault."""
    for compiled in (False, True):
        tests = dict.fromkeys(t for m in mutants if m.compiled is compiled for t in m.tests)
        if tests:
            code, said = outcome(root, list(tests), compiled)
            if code != NOT_CAUGHT:
                message = f"the tests do not pass without any fault: {said}"
                raise SystemExit(message)


def tried(root: Path, mutant: Mutant) -> str:
    """What became of a fault; the file is then as old as it was, else Numba compiles it anew."""
    path = root / mutant.file
    text, age = path.read_text(encoding="utf-8"), path.stat().st_mtime_ns
    path.write_text(mutant.applied(root), encoding="utf-8")
    try:
        code, said = outcome(root, mutant.tests, mutant.compiled, PATIENCE)
    finally:
        path.write_text(text, encoding="utf-8")
        os.utime(path, ns=(age, age))
    if code == CAUGHT:
        return f"caught: {said}"
    return "not caught" if code == NOT_CAUGHT else f"no test ran: {said}"


def main() -> None:
    """Try all faults; report."""
    options = arguments(__doc__, only="", keep="")
    mutants = [m for m in read_table() if m.file.startswith(options.only)]
    for mutant in mutants:
        mutant.applied(ROOT)
    rows, wrong = [], 0
    with copied(options.keep) as root:
        check_whole(root, mutants)
        for mutant in mutants:
            begun = perf_counter()
            found = tried(root, mutant)
            as_said = found.startswith("not caught" if mutant.why else "caught")
            wrong += not as_said
            rows.append({
                "file": mutant.file, "fault": mutant.fault,
                "result": f"{found}; {mutant.why}" if mutant.why else found,
                "s": round(perf_counter() - begun, 1),
            })  # fmt: skip
            print("as said" if as_said else "WRONG  ", *rows[-1].values(), sep=" | ", flush=True)
    if options.json is not None:
        options.json.write_text(json.dumps({"machine": machine(), "rows": rows}, indent=1))
    print(f"{len(rows)} faults, {wrong} not as the table says")
    raise SystemExit(1 if wrong else 0)


if __name__ == "__main__":
    main()
