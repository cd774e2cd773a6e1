"""Two revisions of the package against each other: time of a step, memory, start, and the bits.

Run as `python benchmarks/compare.py REV [REV2]`; REV2 is by default the working tree as it is,
committed or not. Each revision is installed in an environment of its own, with the same libraries,
and kept in a cache. Close-packed cells are then advanced in turn in two living processes, so that
both see the same noise; the table has medians and the quartiles of the ratio after / before, pair
by pair. A revision against itself (`compare.py HEAD HEAD`) tells how much of a ratio is noise.

`same bits` and `largest dphi` compare all fields after `--steps` steps. `MB per cell` is what the
process grows by. `--compile` adds the first step on an empty cache of kernels, some minutes.
"""

import argparse
import json
import os
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from _builds import WORKING_TREE, Build, build
from _common import machine, packed_points, print_table
from _pairs import Box, largest_difference, paired_ratios
from _revisions import commit, uncommitted

RADIUS, DT = 4.0, 1.5
WORKER = Path(__file__).with_name("_compare_worker.py")
CACHE = Path(
    os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"), "morphosim/compare"
)
PAIR = 2
"""Fewest cells that need all kernels; one alone has others for what it does not feel."""
SETTLED = 20
"""Steps after which all kernels have run, those too that lay boxes anew."""
TURN = 0.1
"""Most seconds that one revision advances before the other has its turn."""
STARTS = 7
"""Times that an import is measured."""
IMPORTS = {
    "import morphosim": "import morphosim",
    "import Simulation": "from morphosim import Simulation",
}


class Process:
    """A living worker of one revision."""

    def __init__(self, made: Build, kernels: Path | None = None) -> None:
        self.made = made
        self._process = subprocess.Popen(
            [made.python, "-I", WORKER], env=made.environment(kernels), text=True,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE,
        )  # fmt: skip

    def ask(self, do: str, **arguments: Any) -> Any:
        """What a method of the worker gives."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        try:
            print(json.dumps({"do": do, **arguments}), file=self._process.stdin, flush=True)
            line = self._process.stdout.readline()
        except BrokenPipeError:
            line = ""
        if not line:
            message = f"the worker of {self.made.name} has ended; its error stands above"
            raise SystemExit(message)
        return json.loads(line)

    def start(self, cells: int, solver: str, threads: int, steps: int) -> float:
        """Make a simulation of close-packed cells and take its first steps; the seconds."""
        points = packed_points(cells, RADIUS).tolist()
        numerics = {"dt": DT, "solver": solver, "threads": threads}
        made_in = self.ask("start", points=points, radius=RADIUS, numerics=numerics)
        return float(made_in + self.ask("step", steps=steps))

    def fields(self, place: Path) -> dict[str, Box]:
        """All fields, by cell."""
        path = place / f"{id(self)}.npz"
        self.ask("save", path=str(path))
        with np.load(path) as file:
            names = [name.removeprefix("phi ") for name in file.files if name.startswith("phi ")]
            return {name: (file[f"origin {name}"], file[f"phi {name}"]) for name in names}

    def end(self) -> None:
        """Close the worker's input, at which it ends."""
        self._process.communicate()


@contextmanager
def living(made: Build, kernels: Path | None = None) -> Iterator[Process]:
    """A worker, for as long as this lasts."""
    process = Process(made, kernels)
    try:
        yield process
    finally:
        process.end()


def warm(made: Build, solver: str, threads: int) -> None:
    """Compile the kernels in a process of its own: a process that compiles stays larger."""
    with living(made) as process:
        for few in (1, PAIR):
            process.start(few, solver, threads, SETTLED)


def step_row(
    builds: tuple[Build, Build], cells: int, solver: str, options: argparse.Namespace
) -> dict[str, Any]:
    """One line of the table of steps."""
    with ExitStack() as stack:
        both = [stack.enter_context(living(made)) for made in builds]
        for process in both:
            few = min(cells, PAIR)  # loads the kernels, which are not counted as cells' memory
            process.start(few, solver, options.threads, SETTLED)
            process.start(cells, solver, options.threads, options.steps)
        bits = same_fields(both)
        memory = [process.ask("memory") for process in both]
        ratios = paired_ratios(*take_turns(both, options.rounds))
    return {
        "cells": cells, "solver": solver, "threads": options.threads,
        "before, ms": 1e3 * ratios["before"], "after, ms": 1e3 * ratios["after"],
        "after / before": ratios["ratio"],
        "lower quartile": ratios["low"], "upper quartile": ratios["high"],
        "before, MB per cell": per_cell(memory[0], cells),
        "after, MB per cell": per_cell(memory[1], cells),
    } | bits  # fmt: skip


def same_fields(both: list[Process]) -> dict[str, Any]:
    """Whether the fields of both are the same to the bit, and their largest difference."""
    if len({process.ask("digest") for process in both}) == 1:
        return {"same bits": True, "largest dphi": 0.0}
    with tempfile.TemporaryDirectory() as place:
        fields = [process.fields(Path(place)) for process in both]
    return {"same bits": False, "largest dphi": largest_difference(*fields)}


def take_turns(both: list[Process], rounds: int) -> list[list[float]]:
    """Seconds of a step of both, one pair after the other; who begins changes every time."""
    slower = max(process.ask("step", steps=1) for process in both)
    steps = max(1, round(TURN / slower))
    seconds: list[list[float]] = [[], []]
    for turn in range(rounds):
        for k in (0, 1) if turn % 2 else (1, 0):
            seconds[k].append(both[k].ask("step", steps=steps) / steps)
    return seconds


def per_cell(size: int | None, cells: int) -> float | None:
    """Bytes as MB per cell."""
    return None if size is None else size / cells / 1e6


def import_row(what: str, statement: str, builds: tuple[Build, Build]) -> dict[str, Any]:
    """How long a new process takes for an import, in turn for both."""
    program = f"import time; begin = time.perf_counter(); {statement}\n"
    program += "print(time.perf_counter() - begin)"
    seconds: list[list[float]] = [[], []]
    for turn in range(STARTS + 1):
        for k, made in enumerate(builds):
            done = subprocess.run(
                [made.python, "-I", "-c", program], env=made.environment(),
                check=True, capture_output=True, text=True,
            )  # fmt: skip
            if turn:
                seconds[k].append(float(done.stdout))
    return start_row(what, paired_ratios(*seconds))


def compile_row(solver: str, builds: tuple[Build, Build], threads: int) -> dict[str, Any]:
    """From making a simulation to the end of its first step, with an empty cache of kernels."""
    seconds = []
    for made in builds:
        with tempfile.TemporaryDirectory() as empty, living(made, Path(empty)) as process:
            seconds.append(process.start(PAIR, solver, threads, steps=1))
    return start_row(f"first step, {solver}, empty cache", paired_ratios(*[[s] for s in seconds]))


def start_row(what: str, ratios: dict[str, float]) -> dict[str, Any]:
    """One line of the table of starts."""
    return {
        "what": what, "before, s": ratios["before"], "after, s": ratios["after"],
        "after / before": ratios["ratio"],
        "lower quartile": ratios["low"], "upper quartile": ratios["high"],
    }  # fmt: skip


def described(made: Build) -> dict[str, Any]:
    """A revision and its commit; a working tree with changes has none."""
    known = {"name": made.name, "tree": made.tree}
    if made.name != WORKING_TREE:
        return known | commit(made.name)
    return known if uncommitted() else known | commit()


def counts(text: str) -> list[int]:
    """Numbers with commas between them."""
    return [int(part) for part in text.split(",")]


def parsed() -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("before", metavar="REV", help="a revision, as git names it")
    parser.add_argument("after", metavar="REV2", nargs="?", help="by default the working tree")
    parser.add_argument("--cells", type=counts, default="1,8,100,1000", help="1,8,100,1000")
    parser.add_argument("--solvers", default="dct,band", help="dct,band")
    parser.add_argument("--threads", type=int, default=1, help="1")
    parser.add_argument("--rounds", type=int, default=21, help="pairs that are timed; 21")
    parser.add_argument("--steps", type=int, default=20, help="steps before, to compare; 20")
    parser.add_argument("--compile", action="store_true", help="with the first step, empty cache")
    parser.add_argument("--cache", type=Path, default=CACHE, help=f"folder of builds; {CACHE}")
    parser.add_argument("--json", type=Path, help="write the result to this file")
    return parser.parse_args()


def main() -> None:
    """Install both, measure and report."""
    options = parsed()
    builds = build(options.before, options.cache), build(options.after, options.cache)
    print("\n".join(f"{k}: {b.name}" for k, b in zip(("before", "after"), builds, strict=True)))
    for made in builds:
        for solver in options.solvers.split(","):
            warm(made, solver, options.threads)
    rows = [
        step_row(builds, cells, solver, options)
        for cells in options.cells
        for solver in options.solvers.split(",")
    ]
    print_table(rows)
    starts = [import_row(what, statement, builds) for what, statement in IMPORTS.items()]
    if options.compile:
        starts += [compile_row(s, builds, options.threads) for s in options.solvers.split(",")]
    print_table(starts)
    if options.json is not None:
        revisions = [described(made) for made in builds]
        result = {"machine": machine(), "revisions": revisions, "rows": rows, "starts": starts}
        options.json.write_text(json.dumps(result, indent=1))


if __name__ == "__main__":
    main()
