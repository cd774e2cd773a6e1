"""Where compiled kernels are kept: a folder in which nobody else can put anything."""

import os
import stat
import subprocess
import sys
import threading
from pathlib import Path

import numba
import numpy as np
import pytest
from filelock import FileLock
from numba.core.caching import FunctionCache

from morphosim.kernels import _jit
from morphosim.kernels._shared_cache import SharedCache

pytestmark = pytest.mark.skipif(not hasattr(os, "geteuid"), reason="no owners and modes of files")


def found(environment: dict[str, str], code: str = "", **options: object) -> list[str]:
    """Folder that a new process keeps kernels in, whether it stays, and what it prints."""
    code = code + "\nimport morphosim.kernels._jit as j; print(j.CACHE.folder, j.CACHE.kept)"
    done = subprocess.run(
        [sys.executable, "-c", code], env={"PATH": os.defpath} | environment, cwd="/",
        capture_output=True, text=True, **options,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return [*done.stdout.split(), done.stderr]


def test_a_folder_is_made_for_this_user_alone(tmp_path: Path) -> None:
    folder = _jit._private(tmp_path / "a" / "b")
    assert folder == str((tmp_path / "a" / "b").resolve())
    assert {stat.S_IMODE(part.stat().st_mode) for part in (Path(folder), Path(folder).parent)} == {
        0o700
    }
    assert _jit._private(Path(folder)) == folder


@pytest.mark.parametrize("mode", [0o701, 0o710, 0o740, 0o770, 0o777, 0o1777])
def test_a_folder_that_is_open_to_others_is_not_taken(mode: int, tmp_path: Path) -> None:
    (tmp_path / "cache").mkdir()
    (tmp_path / "cache").chmod(mode)
    assert _jit._private(tmp_path / "cache") is None


@pytest.mark.parametrize(
    ("mode", "well"), [(0o777, False), (0o775, False), (0o1777, True), (0o755, True)]
)
def test_nobody_else_may_rename_what_lies_above(mode: int, well: bool, tmp_path: Path) -> None:
    (tmp_path / "above").mkdir()
    (tmp_path / "above").chmod(mode)
    assert (_jit._private(tmp_path / "above" / "mine" / "cache") is not None) == well
    assert (tmp_path / "above" / "mine").exists() == well, "made where it is not taken"


def test_a_folder_of_another_user_is_not_taken(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "cache").mkdir(mode=0o700)
    monkeypatch.setattr(os, "geteuid", lambda: os.getuid() + 1)
    assert _jit._private(tmp_path / "cache") is None


def test_a_link_counts_as_what_it_leads_to(tmp_path: Path) -> None:
    for name, mode in (("closed", 0o700), ("open", 0o777)):
        (tmp_path / name).mkdir()
        (tmp_path / name).chmod(mode)
        (tmp_path / f"to-{name}").symlink_to(tmp_path / name)
    (tmp_path / "circle").symlink_to(tmp_path / "circle")
    assert _jit._private(tmp_path / "to-closed" / "cache") == str(
        tmp_path.resolve() / "closed/cache"
    )
    assert _jit._private(tmp_path / "to-open" / "cache") is None
    assert _jit._private(tmp_path / "circle" / "cache") is None


def test_the_folder_that_the_user_names_is_taken_if_it_is_safe(tmp_path: Path) -> None:
    folder, kept, said = found({"NUMBA_CACHE_DIR": str(tmp_path / "named")})
    assert folder.startswith(str(tmp_path / "named" / "morphosim"))
    assert (kept, said) == ("True", "")
    (tmp_path / "named").chmod(0o777)
    folder, _, said = found({"NUMBA_CACHE_DIR": str(tmp_path / "named"), "HOME": str(tmp_path)})
    assert str(tmp_path / "named") not in folder
    assert f"NUMBA_CACHE_DIR = {tmp_path / 'named'} is not used" in said


def test_else_a_new_folder_is_made_and_removed(tmp_path: Path) -> None:
    environment = {"TMPDIR": str(tmp_path), "HOME": str(tmp_path / "none")}
    (tmp_path / "morphosim").mkdir()  # a name that anyone can foresee
    refuse = "import os; real = os.access; os.access = lambda p, m: 'morphosim-' in p.name"
    folder, kept, _ = found(environment, refuse)
    assert Path(folder).parent == tmp_path.resolve()
    assert Path(folder).name.startswith("morphosim-")
    assert kept == "False"
    assert not Path(folder).exists()


def test_without_any_folder_kernels_are_compiled_all_the_same() -> None:
    code = (
        "import os; os.access = lambda *_: False\n"
        "from morphosim.kernels._jit import kernel\n"
        "@kernel()\ndef double(x):\n    return 2 * x\n"
        "assert double(2) == 4 and double.stats.cache_path is None"
    )
    assert found({}, code)[:2] == ["None", "False"]


def test_a_user_without_home_and_name_can_start() -> None:
    code = "import os, pwd\ndef nobody(uid): raise KeyError(uid)\npwd.getpwuid = nobody"
    folder, _, said = found({}, code)
    assert Path(folder).is_absolute()
    assert said == ""
    assert not Path("/~").exists()


def test_user_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Installed kernels are kept in XDG_CACHE_HOME, or else in ~/.cache."""
    monkeypatch.setattr(numba.config, "CACHE_DIR", "")
    monkeypatch.setattr(_jit, "__file__", str(tmp_path / "site-packages" / "kernels" / "_jit.py"))
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    for named, expected in (("", "home/.cache"), (str(tmp_path / "other"), "other")):
        monkeypatch.setenv("XDG_CACHE_HOME", named)
        found = _jit._find_cache()
        assert found.kept
        assert Path(str(found.folder)).parent == tmp_path.resolve() / expected / "morphosim"


def test_where_files_have_no_owners_any_folder_will_do(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "cache").mkdir()
    (tmp_path / "cache").chmod(0o777)
    monkeypatch.delattr(os, "geteuid")  # as on Windows
    assert _jit._private(tmp_path / "cache") == str((tmp_path / "cache").resolve())


TWICE = """
import time
from numba.core import event
from morphosim.kernels._jit import kernel

class Listener(event.Listener):
    def on_start(self, event):
        time.sleep(1)  # so that the other one comes to it
        print("compiled", flush=True)
    def on_end(self, event): ...

@kernel()
def double(x):
    return 2 * x

event.register("numba:compile", Listener())
assert double(2) == 4
"""


def test_of_processes_that_need_the_same_kernel_one_compiles(tmp_path: Path) -> None:
    (tmp_path / "twice.py").write_text(TWICE)
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    command = [sys.executable, str(tmp_path / "twice.py")]
    started = [
        subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True)
        for _ in range(2)
    ]
    said = [process.communicate()[0] for process in started]
    assert [process.returncode for process in started] == [0, 0]
    assert sorted(said) == ["", "compiled\n"]
    assert [path.name for path in (tmp_path / "cache").rglob("*.lock")] in ([], ["index.lock"])


def test_entries_of_a_cache_are_made_one_at_a_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else of two processes that read the index, and write it again, one would lose its entry."""
    entries: list[object] = []
    monkeypatch.setattr(FunctionCache, "save_overload", lambda *entry: entries.append(entry))
    with _jit._cached_in(str(tmp_path)):
        cache = SharedCache(found)
    with FileLock(Path(cache.cache_path, "index.lock")):
        saving = threading.Thread(target=cache.save_overload, args=((), None))
        saving.start()
        saving.join(0.3)
        assert saving.is_alive()
        assert entries == []
    saving.join(10)
    assert len(entries) == 1


def test_a_kernel_runs_its_own_copies_of_what_it_calls() -> None:
    """As a process does that loads it: no other kernel can give it others."""

    @_jit.kernel(kept=False)
    def helper(x):  # type: ignore[no-untyped-def]
        return x if x < 2 else helper(x - 1) + helper(x - 2)

    @_jit.kernel(kept=False)
    def outer(values):  # type: ignore[no-untyped-def]
        for k in range(len(values)):
            values[k] = helper(values[k])

    outer(np.ones(3))
    ((_, compiled),) = outer.overloads.items()
    (copy,) = (f for f in compiled.library.get_defined_functions() if "helper" in f.name)
    assert copy.linkage.name == "internal"
