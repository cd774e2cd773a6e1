"""Revisions of this repository, each installed in a virtual environment of its own and kept there.

A build is known by the package's files in the revision, by Python, and by the versions of the
libraries, which are those of the environment that asks: two builds differ in our code and in
nothing else. Each takes about 1 GB; the folder of builds can be deleted at any time.
"""

import hashlib
import os
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from importlib.metadata import distributions
from pathlib import Path

from _revisions import PACKAGE, ROOT, git
from filelock import FileLock

WORKING_TREE = "working tree"
TUNING = ("OPENBLAS_CORETYPE", "OPENBLAS_L2_SIZE")
"""Variables that make BLAS take another machine's kernels; what is timed runs without them."""
NOT_PINNED = {"morphosim", "pip", "setuptools", "wheel"}


@dataclass(frozen=True)
class Build:
    """One revision, installed.

    Attributes
    ----------
    name : the revision as it was asked for
    tree : git's name of its content
    folder : its virtual environment, and its cache of compiled kernels
    """

    name: str
    tree: str
    folder: Path

    @property
    def python(self) -> Path:
        """Its interpreter."""
        return self.folder / "env" / ("Scripts" if os.name == "nt" else "bin") / "python"

    def environment(self, kernels: Path | None = None) -> dict[str, str]:
        """Variables for its processes; compiled kernels are kept with it, or in `kernels`."""
        kept = {name: value for name, value in os.environ.items() if name not in TUNING}
        return kept | {"NUMBA_CACHE_DIR": str(kernels or self.folder / "kernels")}


def build(revision: str | None, cache: Path) -> Build:
    """A revision installed below `cache`; None is the working tree as it is, committed or not."""
    tree = _working_tree() if revision is None else _tree_of(revision)
    pins, content = _pins(), git("ls-tree", tree, *PACKAGE)
    key = hashlib.sha256("\n".join([content, sys.version, *pins]).encode()).hexdigest()[:16]
    made = Build(revision or WORKING_TREE, tree, cache / key)
    cache.mkdir(parents=True, exist_ok=True)
    with FileLock(cache / f"{key}.lock"):
        if not (made.folder / "complete").exists():
            shutil.rmtree(made.folder, ignore_errors=True)
            print(f"installing {made.name} in {made.folder}", file=sys.stderr)
            _install(made, pins)
            (made.folder / "complete").touch()
    return made


def _install(made: Build, pins: list[str]) -> None:
    """Make the virtual environment, and install the revision in it from a copy of its files."""
    subprocess.run([sys.executable, "-m", "venv", made.folder / "env"], check=True)
    constraints = made.folder / "constraints.txt"
    constraints.write_text("\n".join(pins))
    with tempfile.TemporaryDirectory() as source:
        files = subprocess.run(
            ["git", "archive", made.tree], cwd=ROOT, check=True, capture_output=True
        ).stdout
        subprocess.run(["tar", "-x"], cwd=source, input=files, check=True)
        pip = [made.python, "-m", "pip", "--disable-pip-version-check", "install", "--quiet"]
        subprocess.run([*pip, "--constraint", constraints, source], check=True)


def _pins() -> list[str]:
    """Versions of the libraries of this environment, as constraints of pip."""
    return sorted(
        {
            f"{found.name}=={found.version}"
            for found in distributions()
            if found.name.lower() not in NOT_PINNED and found.read_text("direct_url.json") is None
        }
    )


def _tree_of(revision: str) -> str:
    found = subprocess.run(
        ["git", "rev-parse", "--verify", "--quiet", f"{revision}^{{tree}}"],
        cwd=ROOT, capture_output=True, text=True,
    )  # fmt: skip
    if found.returncode:
        message = f"no revision {revision!r} in {ROOT}; `git log --oneline --all` lists them"
        raise SystemExit(message)
    return found.stdout.strip()


def _working_tree() -> str:
    """Git's name of the files as they are, with new ones; the index stays as it is."""
    with tempfile.TemporaryDirectory() as place:
        aside = {"GIT_INDEX_FILE": str(Path(place) / "index")}
        git("add", "--all", **aside)
        return git("write-tree", **aside)
