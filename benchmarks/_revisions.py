"""What git says of this repository: its commits, and what stands in no commit."""

import os
import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ("morphosim", "kernels", "pyproject.toml")
"""What a revision is installed from."""
MEASURED = (*PACKAGE, "benchmarks", ":!benchmarks/history")
"""What figures depend on; entries of the history, which are figures, do not count."""


def git(*arguments: str, **variables: str) -> str:
    """What git says of this repository."""
    done = subprocess.run(
        ["git", *arguments], cwd=ROOT, env=os.environ | variables, check=False,
        stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    if done.returncode:
        raise SystemExit(f"git {arguments[0]} has failed in {ROOT}; its error stands above")
    return done.stdout.rstrip("\n")


def commit(revision: str = "HEAD") -> dict[str, str]:
    """A commit: its hash, when it was made, and the first line of its message."""
    parts = git("log", "-1", "--format=%H%n%cI%n%s", revision, "--").split("\n")
    return dict(zip(("commit", "committed", "subject"), parts, strict=True))


def uncommitted() -> list[str]:
    """Files that figures depend on and that are not as HEAD has them, new ones too."""
    status = git("status", "--porcelain", "--untracked-files=all", "--", *MEASURED)
    return [line[3:] for line in status.splitlines()]
