"""Functions and classes of a user's own files."""

import sys
from pathlib import Path

import pytest

from morphosim import _import_path


def test_a_file_that_fails_is_not_kept(tmp_path: Path) -> None:
    path = tmp_path / "broken.py"
    path.write_text("class Swim:\n    pass\n1 / 0\n", encoding="utf-8")
    for _ in range(2):
        with pytest.raises(ValueError, match=r"division by zero.*Correct the file"):
            _import_path.loaded(f"{path}:Swim", "use")
    assert str(path) not in sys.modules
    path.write_text("class Swim:\n    pass\n", encoding="utf-8")
    assert _import_path.loaded(f"{path}:Swim", "use").__name__ == "Swim"


def test_a_script_that_runs_when_it_is_loaded_is_told_what_to_do(tmp_path: Path) -> None:
    path = tmp_path / "script.py"
    path.write_text("import sys\nsys.exit(2)\n", encoding="utf-8")
    with pytest.raises(ValueError, match=r'put what runs under if __name__ == "__main__":'):
        _import_path.loaded(f"{path}:Swim", "use")


def test_a_module_that_fails_is_told_apart_from_one_that_is_not_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "module_that_ends.py").write_text("raise SystemExit(7)\n", encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(ValueError, match=r"\(SystemExit: 7\)\. Correct the module, and put what"):
        _import_path.loaded("module_that_ends:Swim", "use")
    with pytest.raises(ValueError, match=r"\(ModuleNotFoundError: .*\)\. Is the module installed"):
        _import_path.loaded("module_that_is_not_there:Swim", "use")


def test_a_file_is_looked_up_in_a_folder_and_finds_its_neighbours(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, elsewhere = tmp_path / "place", tmp_path / "elsewhere"
    folder.mkdir()
    elsewhere.mkdir()
    (folder / "beside_it.py").write_text("SPEED = 3\n", encoding="utf-8")
    (folder / "own.py").write_text("from beside_it import SPEED\n", encoding="utf-8")
    monkeypatch.chdir(elsewhere)
    before = list(sys.path)
    assert _import_path.loaded("own.py:SPEED", "use", folder) == 3
    assert sys.path == before
    with pytest.raises(ValueError, match=r"there is no file .*elsewhere.*own\.py"):
        _import_path.loaded("own.py:SPEED", "use")
    monkeypatch.chdir(folder)
    assert _import_path.loaded("own.py:SPEED", "use") == 3
    del sys.modules["beside_it"]
