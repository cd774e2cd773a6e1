"""What README.md and docs/*.md show: their blocks and commands, in the order of the page.

`test_pages.py` does what a page says. What stands here is how a page is read, and the tables that
say what is done instead where the letter would take too long, or another machine.
"""

import os.path
import re
import shlex
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]

PROGRAMS = (
    "morphosim",
    "mpirun",
    "python",
    "pip",
    "pytest",
    "git",
    "apt",
    "dnf",
    "ssh",
    "pre-commit",
)
"""A text in backticks that begins with one of these and goes on is a command."""

SHORT_RUN = "--until 4 --save-every 2"
"""What `morphosim run SCENE -o DIR` gets besides, if nothing else is said below."""

SMALL_EGG = (
    "--set cells.count=60 --set confinement.semi_axes=[24,20,20] --set confinement.core=[14,10,10] "
    "--until 4"
)
INSTEAD = {
    "morphosim run SCENE --from runs/embryo --time 500 -o NEW": "morphosim run celegans-8 --from "
    "runs/embryo --time 2 --until 4 -o NEW",
    "morphosim sweep FILE.toml -o DIR": "morphosim sweep --help",
    "morphosim run SCENE --from DIR --time T -o NEW": "morphosim run celegans-8 --from DIR "
    "--time 2 --until 2 -o NEW",
    "morphosim import-labels IMAGE -o DIR": "morphosim import-labels IMAGE --axes xyz "
    "--spacing 0.5 0.5 0.5 -o DIR",
    "morphosim import-labels IMAGE --spacing 0.2 0.2 0.6 --table cells.csv -o DIR": "morphosim "
    "import-labels IMAGE --axes xyz --spacing 0.5 0.5 0.5 --table cells.csv -o DIR",
    "mpirun -n 4 morphosim run SCENE -o DIR --mpi": "mpirun -n 2 morphosim run SCENE -o DIR --mpi "
    + SHORT_RUN,
    "mpirun -n 8 morphosim run --resume DIR --mpi": "mpirun -n 1 morphosim run --resume DIR --mpi",
    **{
        command: f"{command} {SMALL_EGG}"
        for command in (
            "morphosim run blastoderm -o runs/blastoderm",
            "morphosim run blastoderm --save-every 100 -o RUN",
        )
    },
    "morphosim warm": "morphosim warm --help",
    "morphosim warm SCENE": "morphosim warm SCENE --help",
    "morphosim fit IMAGE -o DIR": "morphosim fit --help",
    "morphosim fit embryo.tif -o found --scene celegans-8 --table names.csv": (
        "morphosim fit --help"
    ),
    "morphosim run sorting -o runs/sorting": "morphosim run sorting --dry-run "
    "--set cells.counts.A=20 --set cells.counts.B=20",
    "mpirun -n 4 python large.py": "mpirun -n 2 python large.py",
    **{
        f"morphosim run synnotch-{name} -o DIR": f"morphosim run synnotch-{name} --dry-run"
        for name in ("asymmetric-3", "asymmetric-2", "symmetric", "repair", "dissociation")
    },
}
"""Commands that take minutes, or a file whose kind the page leaves open, and what is done."""

SHORTER = {
    "docs/mpi.md": [("simulation.run(observers", "simulation.run(until=4, observers")],
    "docs/sweeps.md": [
        ('{"numerics.preset": "fast"}', '{"numerics.preset": "draft", "duration": 4}'),
        ('numerics.preset = "fast"', 'numerics.preset = "draft"\nduration = 4'),
    ],
}
"""Texts of Python and TOML blocks that would run for minutes, and what stands there instead."""

WORDS = {
    "SCENE": "celegans-8", "IMAGE": "image.npy", "MASKS.mat": "masks.mat", "TABLE.xls": "table.csv",
    "FORMAT": "csv", "T": "4", "COMMAND": "run",
}  # fmt: skip
"""What stands on a page for something of a user's own; folders keep the names of the page."""

NOT_HERE = {
    "apt": "installs a package of the system",
    "dnf": "installs a package of the system",
    "git clone": "needs the network",
    "cd": "goes into the clone",
    ". .venv": "is of the shell",
    "ssh": "needs another machine",
    "pre-commit": "runs the linters, which .ci/run does",
    "python -m venv": "makes an environment; `.ci/run` begins with it",
    "pip install pre-commit": "is another project's package",
    "python docs/draw_architecture.py": "writes into the clone; tests/test_architecture.py runs it",
}
"""Commands that are not run, by how they begin, and why."""

NEEDS = {
    r"morphosim (plot|film|show)\b": "pictures", r"morphosim app\b": "app",
    r"morphosim export .* --to vtk": "vtk", r"morphosim sweep\b": "sweep", r".* --mpi\b": "mpi",
    r"morphosim import-\w+ .*\.xlsx?\b": "matlab",
}  # fmt: skip
"""Commands that take more than `pip install .`, and the extra that brings it."""

OTHERS_OPTIONS = {
    "--dist": "pytest-xdist", "--hypothesis-profile": "hypothesis", "--all-files": "pre-commit",
    "--nthreads": "dask worker", "--nworkers": "dask worker",
}  # fmt: skip
"""Options that pages name and that are not of MorphoSim, and whose they are."""


@dataclass(frozen=True, slots=True)
class Shown:
    """Something that a page shows.

    Attributes
    ----------
    page : path from the root of the repository
    line : where it begins
    kind : "python", "toml", "csv", or "command"
    text : the block, or the command in one line
    """

    page: str
    line: int
    kind: str
    text: str

    @property
    def where(self) -> str:
        """Page and line, for messages."""
        return f"{self.page}:{self.line}"

    @property
    def file(self) -> str:
        """Name of the file that a block is to be saved as, by its first line; "" for none."""
        named = re.match(r"# (\w+\.(?:py|toml))\n", self.text)
        return named[1] if named else ""


def shown(path: Path) -> list[Shown]:
    """All that a page shows, in its order."""
    page, text = os.path.relpath(path, ROOT), path.read_text(encoding="utf-8")
    found = []
    for match in re.finditer(r"```(\w*)\n(.*?)```|`([^`]+)`", text, flags=re.DOTALL):
        line = text.count("\n", 0, match.start()) + 1
        language, block, span = match.groups()
        if span is not None:
            command = " ".join(span.split())
            if command.startswith(tuple(f"{program} " for program in PROGRAMS)):
                found.append(Shown(page, line, "command", command))
        elif language:
            found.append(Shown(page, line, language, block))
        else:
            found += [Shown(page, line, "command", command) for command in _commands(block)]
    return found


def _commands(block: str) -> Iterator[str]:
    """Commands of a block of a shell, without comments."""
    for line in block.splitlines():
        for command in re.sub(r"\s#.*", "", line).split("&&"):
            if command.strip():
                yield command.strip()


def options_shown(path: Path) -> set[str]:
    """Options of commands, such as --until, that a page names in a block or in backticks."""
    text = path.read_text(encoding="utf-8")
    code = re.findall(r"```\n.*?```|`[^`]+`", text, flags=re.DOTALL)
    return set(re.findall(r"(?<![\w-])--[a-z][a-z-]*", " ".join(code)))


def names_shown(path: Path) -> set[tuple[str, str]]:
    """Attributes that a page names: ("Simulation", "divide") of `Simulation.divide(...)`."""
    spans = re.findall(r"`([^`]+)`", path.read_text(encoding="utf-8"))
    dotted = (re.match(r"(?:morphosim\.)?([A-Z]\w+|run\.morpho)\.(\w+)", span) for span in spans)
    return {(found[1], found[2]) for found in dotted if found}


def instead(command: str) -> str:
    """What is run in place of a command."""
    command = re.sub(r"[\[\]]", "", command) if command.startswith("morphosim") else command
    if command in INSTEAD:
        return INSTEAD[command]
    words = shlex.split(command)
    if words[:2] == ["morphosim", "run"] and "-o" in words and "--dry-run" not in words:
        return f"{command} {SHORT_RUN}"
    return command
