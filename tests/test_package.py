"""The package as it is found: at the root of a clone, installed either way."""

import ast
import os
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from morphosim.exports.formats import FORMATS

ROOT = Path(__file__).resolve().parents[1]
IGNORED = shutil.ignore_patterns("__pycache__")


@pytest.fixture
def clone(tmp_path: Path) -> Path:
    """Root of a clone: the package, and its kernels beside it."""
    root = tmp_path / "clone"
    for name in ("morphosim", "kernels"):
        shutil.copytree(ROOT / name, root / name, ignore=IGNORED)
    return root


@pytest.fixture
def plain(clone: Path, tmp_path: Path) -> dict[str, str]:
    """Environment of a plain installation, which has the kernels within the package.

    The folders of this Python's packages are given by name, and Python started with -S, so that an
    editable installation of the package does not help.
    """
    site = tmp_path / "site"
    shutil.copytree(clone / "morphosim", site / "morphosim")
    shutil.copytree(clone / "kernels", site / "morphosim" / "kernels")
    about = site / "morphosim-0.1.0.dist-info" / "METADATA"
    about.parent.mkdir()
    about.write_text("Metadata-Version: 2.1\nName: morphosim\nVersion: 0.1.0\n")
    packages = [path for path in sys.path if path.endswith("-packages")]
    return {"PYTHONPATH": os.pathsep.join([str(site), *packages])}


def python(code: str, folder: Path, *flags: str, **environment: str) -> str:
    """Output of a new Python process in a folder."""
    command = [sys.executable, *flags, "-c", code]
    done = subprocess.run(
        command, cwd=folder, env=os.environ | environment, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


WHERE = """
import morphosim.kernels.pairs as module
from morphosim import RunWriter
import morphosim, morphosim.kernels
assert morphosim.kernels.pairs is module
print(morphosim.__file__, module.__file__)
"""


def test_python_at_the_root_of_a_clone_takes_the_clones_kernels(clone: Path, plain: dict) -> None:
    found = python(WHERE, clone, "-S", **plain).split()
    assert [Path(path).parent for path in found] == [clone / "morphosim", clone / "kernels"]


def test_python_elsewhere_takes_the_installation(tmp_path: Path, plain: dict) -> None:
    found = python(WHERE, tmp_path, "-S", **plain).split()
    package = tmp_path / "site" / "morphosim"
    assert [Path(path).parent for path in found] == [package, package / "kernels"]


def test_this_installation_works_at_the_root_of_its_clone() -> None:
    assert Path(python(WHERE, ROOT).split()[1]).parent.name == "kernels"


def test_another_process_unpickles_what_is_of_a_clones_kernels(clone: Path, plain: dict) -> None:
    said = python(
        "import pickle; from morphosim.kernels.layout import Boxes; print(pickle.dumps(Boxes))",
        clone, "-S", **plain,
    )  # fmt: skip
    found = python(f"import pickle; print(pickle.loads({said}).__name__)", clone, "-S", **plain)
    assert found == "Boxes"


def test_all_folders_with_code_are_installed() -> None:
    with (ROOT / "pyproject.toml").open("rb") as file:
        stated = tomllib.load(file)["tool"]["setuptools"]["packages"]
    folders = [path.parent.relative_to(ROOT) for path in ROOT.glob("morphosim/**/__init__.py")]
    assert sorted(stated) == sorted([".".join(f.parts) for f in folders] + ["morphosim.kernels"])


BESIDES_THE_APPLICATION = {"mpi", "sweep"}
"""Extras of what the application does not offer."""


def test_the_extra_of_the_application_brings_all_that_it_offers() -> None:
    with (ROOT / "pyproject.toml").open("rb") as file:
        extras = tomllib.load(file)["project"]["optional-dependencies"]
    brought, named = {"app"}, ["app"]
    while named:
        for requirement in extras[named.pop()]:
            if requirement.startswith("morphosim["):
                inner = requirement.partition("[")[2].rstrip("]").split(",")
                named += [extra for extra in inner if extra not in brought]
                brought.update(inner)
    needed = _extras_asked_for() | {form.extra for form in FORMATS.values() if form.extra}
    assert needed >= {"app", "images", "matlab", "pictures", "vtk"}
    assert needed - BESIDES_THE_APPLICATION <= brought


def _extras_asked_for() -> set[str]:
    """Extras that errors of the package name."""
    return {
        argument.value
        for path in ROOT.glob("morphosim/**/*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Call)
        and isinstance(node.func, ast.Name)
        and node.func.id in ("need", "how_to_install")
        for argument in node.args[-1:]
        if isinstance(argument, ast.Constant)
    }


def test_no_module_imports_a_private_name_of_another() -> None:
    found = [
        f"{path.name}: {node.module}.{alias.name}"
        for path in ROOT.glob("morphosim/**/*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.ImportFrom) and node.module != "morphosim"
        for alias in node.names
        if alias.name.startswith("_")
    ]
    assert found == []


def test_all_warnings_point_to_the_line_of_the_user() -> None:
    """One function makes them; it finds that line."""
    for path in (ROOT / "morphosim").rglob("*.py"):
        calls = {
            ast.unparse(node.func)
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
            if isinstance(node, ast.Call)
        }
        raises = calls & {"warnings.warn", "warnings.warn_explicit"}
        assert not raises or path.name == "errors.py", path


USER = """\
import sys
from types import ModuleType
from morphosim.errors import warn

module = sys.modules["morphosim.scene.deep"] = ModuleType("morphosim.scene.deep")
exec({library!r}, module.__dict__)
{call}
"""
LIBRARY = """
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from morphosim.errors import DamageWarning, warn

@dataclass
class Deep:
    value: int

    def __post_init__(self):
        self.lazy

    @cached_property
    def lazy(self):
        with context():
            return 1

@contextmanager
def context():
    list(map(inner, [1]))
    yield

def inner(value):
    warn("something is damaged", DamageWarning)

def calls(function):
    function()
"""


@pytest.mark.parametrize(
    "call", ["module.Deep(1)", "module.calls(lambda: module.inner(1))", "warn('by hand')"]
)
def test_a_warning_points_to_the_nearest_line_outside(tmp_path: Path, call: str) -> None:
    script = tmp_path / "script.py"
    script.write_text(USER.format(library=LIBRARY, call=call))
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, check=True)
    assert f"{script}:7: " in done.stderr.splitlines()[0]
