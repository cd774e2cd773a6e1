"""README.md and docs/*.md, done by the letter: each page in a folder of its own, top to bottom.

A block or a command that is added to a page is run here without further work. What would take
minutes, or another machine, is in the tables of `documented.py`.
"""

import contextlib
import io
import os
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
import typer.main
from scipy.io import savemat

import morphosim
from morphosim import Simulation, load_scene
from morphosim.accessor import MorphoAccessor
from morphosim.cli import main
from morphosim.cli.app import app

from .documented import (
    INSTEAD,
    NEEDS,
    NOT_HERE,
    OTHERS_OPTIONS,
    PAGES,
    ROOT,
    SHORTER,
    WORDS,
    Shown,
    instead,
    names_shown,
    options_shown,
    shown,
)

HISTORY = "docs/changelog.md"
"""Names what was once; it is not a page to follow."""
GUIDES = [path for path in PAGES if not HISTORY.endswith(path.name)]
EXTRAS = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"][
    "optional-dependencies"
]
CELLS = """
[[cells]]
name = "P0"
type = "skin"
shape = { kind = "sphere", center = [0.0, 0.0, 0.0], radius = 5.0 }
"""
"""A cell for blocks of a scene file that have none."""
MPI = ["mpirun", "--oversubscribe", "--allow-run-as-root"]


def files_of_a_user(folder: Path) -> None:
    """What pages take to be there."""
    (folder / "examples").symlink_to(ROOT / "examples")
    x, y, z = np.indices((120, 80, 60))  # voxels of 0.5 um: the eggshell of import-matlab
    balls = [(x - c) ** 2 + (y - 40) ** 2 + (z - 30) ** 2 < 100 for c in (50, 69)]
    np.save(folder / "image.npy", balls[0] + 2 * balls[1].astype(np.uint8))
    (folder / "cells.csv").write_text("label,name\n1,E\n2,MS\n")
    masks = np.empty((2, 1), object)
    masks[:, 0] = [ball.transpose(1, 0, 2).astype(np.uint8) for ball in balls]
    savemat(folder / "masks.mat", {"Mask": masks})
    (table,) = [each for each in shown(ROOT / "docs" / "protocols.md") if each.kind == "csv"]
    (folder / "TABLE.csv").write_text(table.text, encoding="utf-8")
    (folder / "table.csv").write_text(",E,MS\nE,0,0.5\nMS,0.5,0\n")


class User:
    """Somebody who does what a page says, one thing after the other.

    Parameters
    ----------
    page : list of Shown
    monkeypatch : pytest.MonkeyPatch
    """

    def __init__(self, page: list[Shown], monkeypatch: pytest.MonkeyPatch) -> None:
        self.page, self.patch = page, monkeypatch
        self.folders: dict[str, str] = {}
        self.script = ModuleType("__main__")  # all Python of the page, which processes may import
        self.script.__file__ = str(Path("script.py").absolute())
        monkeypatch.setitem(sys.modules, "__main__", self.script)
        monkeypatch.syspath_prepend(Path.cwd())
        self.scripts = {
            word for each in page if each.kind == "command" for word in each.text.split()
        }
        self.started: list[str] = []

    def do(self, each: Shown) -> None:
        """Run a block or a command; it must succeed."""
        getattr(self, each.kind)(each)

    def python(self, each: Shown) -> None:
        """Save a block, and run it unless a command does; it prints what its comments say."""
        text = _replaced(self._shorter(each), self.folders)
        if each.file:
            Path(each.file).write_text(text, encoding="utf-8")
        if each.file in self.scripts:
            return
        with Path("script.py").open("a", encoding="utf-8") as file:
            file.write(text)
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed):
            exec(compile(text, self.script.__file__ or "", "exec"), vars(self.script))
        expected = re.findall(r"^ *print\(.*\)  # (.*)$", text, flags=re.MULTILINE)
        assert [line for line in printed.getvalue().splitlines() if line in expected] == expected

    def toml(self, each: Shown) -> None:
        """Save a file that has a name; load all else as a part of a scene, and take a step."""
        text = self._shorter(each)
        path = Path(each.file or f"block{each.line}.toml")
        whole = bool(each.file) or "[cells]" in text
        path.write_text(text if whole else text + CELLS, encoding="utf-8")
        if not each.file:
            Simulation(load_scene(path)).run(until=2)

    def csv(self, each: Shown) -> None:
        """Nothing to do: `files_of_a_user` has saved it, for other pages too."""

    def command(self, each: Shown) -> None:
        """Run a command, or check it as far as can be done here."""
        if each.text.startswith(tuple(NOT_HERE)):
            return
        words = shlex.split(self._with_outputs(instead(each.text)))
        if each.page == HISTORY:
            words = [*words[:2], "--help"] if words[0] == "morphosim" else ["pip", "install", "."]
        if words[0] == "mpirun":
            self._over_ranks(words[1:])
        elif words[0] in ("pip", "pytest", "python"):
            getattr(self, f"_check_{words[0]}")(words[1:])
        else:
            assert words[0] == "morphosim", "no program that is known here"
            self._morphosim(words[1:])

    def _morphosim(self, words: list[str]) -> None:
        """Call the command line here; a command that is only mentioned, or serves, for its help."""
        if words[0] == "app" or (len(words) == 1 and words != ["scenes"]):
            words = [*words, "--help"]
        self.patch.setattr(sys, "argv", ["morphosim", *words])
        told = io.StringIO()
        with pytest.raises(SystemExit) as end, contextlib.redirect_stderr(told):
            main()
        assert not end.value.code, told.getvalue()

    def _over_ranks(self, words: list[str]) -> None:
        if shutil.which("mpirun") is None or find_spec("mpi4py") is None:
            pytest.skip("mpirun or mpi4py is not installed")
        own = {"python": [sys.executable], "morphosim": [sys.executable, "-m", "morphosim"]}
        command = [part for word in words for part in own.get(word, [word])]
        done = subprocess.run(
            [*MPI, *command], capture_output=True, text=True, timeout=240, check=False,
            env=os.environ | {"OMPI_MCA_mpi_yield_when_idle": "1", "NUMBA_NUM_THREADS": "1"},
        )  # fmt: skip
        assert done.returncode == 0, done.stderr

    @staticmethod
    def _check_pip(words: list[str]) -> None:
        """The project, and extras that it has."""
        assert words[0] == "install"
        project = re.fullmatch(r"(?:\.|FILE\.whl)(?:\[(.*)\])?", words[-1])
        assert project is not None, words
        assert set((project[1] or "test").split(",")) <= EXTRAS.keys()

    @staticmethod
    def _check_pytest(words: list[str]) -> None:
        """Folders of tests that exist; options are looked at with all others."""
        assert all((ROOT / word).is_dir() for word in words if word.startswith("tests"))

    @staticmethod
    def _check_python(words: list[str]) -> None:
        """A script that exists and knows its options, or the benchmark that it runs does.

        It takes minutes. Or the command line.
        """
        if words[0] == "-m":
            assert words[1:] == ["morphosim"]
            return
        runs = [ROOT / "benchmarks" / f"{word}.py" for word in words[1:]]
        scripts = [ROOT / words[0], *(path for path in runs if path.exists())]
        source = " ".join(path.read_text(encoding="utf-8") for path in scripts)
        for word in words:
            name = word.removeprefix("--").replace("-", "_")
            assert not word.startswith("--") or re.search(rf'"{word}"|\b{name}=', source), word

    def _shorter(self, each: Shown) -> str:
        text = each.text
        for old, new in SHORTER.get(each.page, ()):
            text = text.replace(old, new)
        return text

    def _with_outputs(self, command: str) -> str:
        """Command with things of ours for words such as SCENE, and a new folder for each output."""
        made = re.findall(r"-o ([A-Z]+)\b", command)
        new = {word: f"{word.lower()}{len(self.started)}" for word in made}
        for word, folder in new.items():
            command = command.replace(f"-o {word}", f"-o {folder}")
        self.started.append(command)
        command = _replaced(command, WORDS | self.folders)
        self.folders |= new
        return command


def _replaced(text: str, words: Mapping[str, str]) -> str:
    for word, thing in words.items():
        text = re.sub(rf"(?<![\w./-]){re.escape(word)}(?![\w.-])", thing, text)
    return text


def follow(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Do what a page says, in the present folder."""
    files_of_a_user(Path.cwd())
    page = shown(path)
    user = User(page, monkeypatch)
    for each in page:
        try:
            user.do(each)
        except BaseException as error:
            error.add_note(f"at {each.where}: {each.text}")
            raise


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.name)
@pytest.mark.usefixtures("own_variables")
def test_a_page_by_the_letter(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    follow(path, monkeypatch)


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("a\n\n```python\nprint(1 + 1)  # 3\n```\n", 3),
        ("```python\nfrom morphosim import Nothing\n```\n", 1),
        ("then `morphosim run no-such-scene -o DIR`", 1),
        ("then `morphosim info DIR`", 1),
        ("\n```\nmorphosim scenes --no-such-option\n```\n", 2),
        ("```toml\n[physics]\ngama = 0.3\n```\n", 1),
        ("`pip install '.[no-such-extra]'`", 1),
        ("`python benchmarks/step.py --no-such-option`", 1),
    ],
)
def test_what_a_page_says_wrong_is_found(
    text: str, line: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    page = tmp_path / "page.md"
    page.write_text(text, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    with pytest.raises((AssertionError, ImportError, ValueError)) as caught:
        follow(page, monkeypatch)
    assert f"page.md:{line}: " in caught.value.__notes__[-1]


def test_what_is_done_instead_stands_on_a_page() -> None:
    found = [each for path in PAGES for each in shown(path)]
    commands = [each.text.replace("[", "").replace("]", "") for each in found]
    assert set(INSTEAD) <= set(commands)
    assert all(any(text.startswith(begin) for text in commands) for begin in NOT_HERE)
    for page, pairs in SHORTER.items():
        for old, _ in pairs:
            assert any(each.page == page and old in each.text for each in found), old


def brought_by(extra: str) -> set[str]:
    """An extra, and those that it includes."""
    inner = [re.fullmatch(r"morphosim\[(.*)\]", need) for need in EXTRAS[extra]]
    names = [name for found in inner if found for name in found[1].split(",")]
    return {extra}.union(*map(brought_by, names))


@pytest.mark.parametrize("path", GUIDES, ids=lambda path: path.name)
def test_a_page_says_what_to_install_for_its_commands(path: Path) -> None:
    text = path.read_text(encoding="utf-8") + "\n"
    parts = re.split(r"^(?=## )", text, flags=re.MULTILINE)
    ends = np.cumsum([part.count("\n") for part in parts]) + 1  # first lines of what follows
    named = [
        (text.count("\n", 0, found.start()), extra)
        for found in re.finditer(r"pip install '\.\[(.*?)\]'", text)
        for extra in brought_by(found[1])
    ]
    for each in shown(path):
        section = ends[np.searchsorted(ends, each.line, side="right")]
        before = {extra for line, extra in named if line < section}
        lacking = [extra for what, extra in NEEDS.items() if re.match(what, each.text)]
        assert before.issuperset(lacking), f"{each.where}: {each.text} needs {lacking}"


def test_the_readme_names_every_extra() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    extras = text[text.index("**Extras**") : text.index("**A bare machine**")]
    assert set(re.findall(r"`(\w+)`", extras)) == set(EXTRAS)


def options_of_commands() -> set[str]:
    group = typer.main.get_command(app)
    commands = [group, *group.commands.values()]
    parameters = [parameter for command in commands for parameter in command.params]
    return {name for each in parameters for name in (*each.opts, *each.secondary_opts)}


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.name)
def test_options_that_a_page_names_exist(path: Path) -> None:
    sources = [*(ROOT / "benchmarks").glob("*.py"), *(ROOT / "examples").glob("*.py")]
    scripts = " ".join(source.read_text(encoding="utf-8") for source in sources)
    for option in options_shown(path) - options_of_commands() - OTHERS_OPTIONS.keys():
        name = option.removeprefix("--").replace("-", "_")
        assert re.search(rf'"{option}"|\b{name}=', scripts), option


@pytest.mark.parametrize("path", GUIDES, ids=lambda path: path.name)
def test_names_that_a_page_uses_exist(path: Path) -> None:
    for owner, name in names_shown(path):
        known = MorphoAccessor if owner == "run.morpho" else getattr(morphosim, owner, None)
        if known is None:
            continue  # of another library
        stated = getattr(known, "__dataclass_fields__", {}) | getattr(known, "__annotations__", {})
        assert hasattr(known, name) or name in stated, f"{owner}.{name}"
