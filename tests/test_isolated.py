"""Reading in a process beside, which may die of it."""

import os
import signal
import sys
from pathlib import Path

import numpy as np
import pytest

from morphosim import _isolated
from morphosim._files import guarded
from morphosim._isolated import ReaderDiedError, isolated, process_beside


def test_values_and_errors_come_back() -> None:
    np.testing.assert_array_equal(isolated(np.arange, 5), np.arange(5))
    with pytest.raises(FileNotFoundError, match="nowhere"):
        isolated(Path.read_bytes, Path("nowhere"))
    first = isolated(os.getpid)
    assert isolated(os.getpid) == first != os.getpid()


@pytest.mark.skipif(sys.platform == "win32", reason="signals are of other systems")
def test_a_reader_that_dies_is_told_and_replaced() -> None:
    with pytest.raises(ReaderDiedError, match="signal 11"):
        isolated(signal.raise_signal, signal.SIGSEGV)
    assert isolated(len, "abc") == 3
    with pytest.raises(ReaderDiedError, match="code 3"):
        isolated(os._exit, 3)


@pytest.mark.skipif(sys.platform != "linux", reason="needs a limit of memory")
def test_a_reader_takes_no_more_memory_than_there_is(tmp_path: Path) -> None:
    size = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    with pytest.raises(ValueError, match=r"a\.mat asks for more memory than there is"):
        guarded(tmp_path / "a.mat", lambda: isolated(bytearray, size))


def test_a_reader_ends_when_nothing_is_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    read, write = os.pipe()
    monkeypatch.setattr(_isolated, "IDLE", 0.01)
    with os.fdopen(read, "rb") as file, os.fdopen(write, "wb") as other:
        assert not _isolated._is_asked(file)
        other.write(b"x")
        other.flush()
        assert _isolated._is_asked(file)


def test_a_process_beside_imports_from_where_this_one_does(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    other = tmp_path / "morphosim"
    other.mkdir()
    (other / "__init__.py").write_text("")
    monkeypatch.chdir(tmp_path)
    with process_beside("import morphosim; print(morphosim.__file__)") as process:
        answer, _ = process.communicate()
    assert answer.decode().strip() == _isolated.__file__.replace("_isolated.py", "__init__.py")
