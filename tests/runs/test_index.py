"""The index of a run's saves: what it holds is what they hold, and nothing but time hangs on it."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from morphosim import RunWriter, Simulation, measured, open_run
from morphosim.errors import DamageWarning
from morphosim.measure.variable import MEASURED
from morphosim.runs import save_file
from morphosim.runs.directory import RunDirectory
from morphosim.runs.merge import Save
from morphosim.runs.save_index import SECOND, indexed_saves

from .test_merge import simulation


def run_of(folder: Path, names: str = "abc", until: float = 6, **options: Any) -> RunDirectory:
    """Run with saves 2 apart."""
    simulation(names).run(until=until, observers=[RunWriter(folder, 2, **options)])
    return RunDirectory(folder)


@contextmanager
def counted(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[Path]]:
    """Paths of the saves that are read themselves."""
    seen: list[Path] = []
    read = Save.read
    with monkeypatch.context() as patch:
        patch.setattr(Save, "read", lambda path: (seen.append(path), read(path))[1])
        yield seen


def assert_same(a: Save, b: Save) -> None:
    for name in ("path", "of_root", "matrix", "lengths", "packed", "variables"):
        assert getattr(a, name) == getattr(b, name), name
    assert list(a.variables) == list(b.variables)
    assert list(a.attributes.items()) == list(b.attributes.items())
    assert [type(v) for v in a.attributes.values()] == [type(v) for v in b.attributes.values()]
    assert list(a.groups) == list(b.groups)
    for of_a, of_b in ((a.table, b.table), *((a.groups[g], b.groups[g]) for g in a.groups)):
        assert list(of_a) == list(of_b)
        for name in of_a:
            assert of_a[name].dtype == of_b[name].dtype, name
            np.testing.assert_array_equal(of_a[name], of_b[name], err_msg=name)


@pytest.mark.parametrize("most_dense", [500, 2], ids=["matrix", "list"])
@pytest.mark.parametrize("fields", ["packed", "exact", "none"])
def test_the_index_says_what_the_saves_say(
    fields: str, most_dense: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    @measured(dims=("time", "cell"), text="name in capitals, ß among them", kind=str)
    def capitals(state: Any) -> list[str]:
        return [name.upper() + "ß" for name in state.names]

    monkeypatch.setattr(save_file, "MOST_DENSE_CELLS", most_dense)
    try:
        files = run_of(tmp_path, fields=fields, labels=fields == "exact")
    finally:
        del MEASURED["capitals"]
    known = indexed_saves(files)
    assert list(known) == files.saves
    for path, save in known.items():
        assert_same(save, Save.read(path))


def test_a_run_opens_by_its_index_alone_to_the_same_dataset(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    files = run_of(tmp_path)
    with counted(monkeypatch) as seen, open_run(tmp_path) as run:
        assert not seen
        files.index.unlink()
        with open_run(tmp_path) as other:
            assert seen == files.saves
            assert run.identical(other)


def test_a_save_that_is_another_than_the_index_knows_is_read_itself(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    files = run_of(tmp_path)
    first, second, third, _ = files.saves
    os.utime(first, ns=(0, first.stat().st_mtime_ns + 1))
    second.write_bytes(second.read_bytes()[:-1])
    third.unlink()
    with counted(monkeypatch) as seen, pytest.warns(DamageWarning, match="save-000001"):
        run = open_run(tmp_path)
    assert seen == [first, second]
    assert run["time"].values.tolist() == [0, 6]


def test_times_that_a_copy_has_in_whole_seconds_are_known(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    files = run_of(tmp_path)
    for path in files.saves:
        whole = path.stat().st_mtime_ns // SECOND * SECOND
        os.utime(path, ns=(whole, whole))
    with counted(monkeypatch) as seen, open_run(tmp_path):
        assert not seen


def test_an_index_that_is_damaged_or_cut_off_says_nothing_wrong(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    files = run_of(tmp_path)
    whole, content = indexed_saves(files), files.index.read_bytes()
    damaged = [content[:n] for n in range(0, len(content), 1001)]
    damaged += [content[:n] + b"?" + content[n + 1 :] for n in range(9, len(content), 1001)]
    for text in (*damaged, b"no index", content + bytes(99)):
        files.index.write_bytes(text)
        found = indexed_saves(files)
        assert list(found) == list(whole)[: len(found)]
        for path, save in found.items():
            assert_same(save, whole[path])
    assert len(found) == 4
    files.index.write_bytes(content[: len(content) // 2])
    with counted(monkeypatch) as seen, open_run(tmp_path) as run:
        assert run["time"].values.tolist() == [0, 2, 4, 6]
        assert 0 < len(seen) < 4


def test_a_run_that_goes_on_mends_its_index(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    files = run_of(tmp_path)
    files.index.write_bytes(files.index.read_bytes()[:-1])
    again = Simulation.from_run(tmp_path)
    again.run(until=12, observers=[RunWriter(tmp_path, 2, resume=True)])
    with counted(monkeypatch) as seen, open_run(tmp_path) as run:
        assert seen == [files.save(3)]  # whose record was cut off
        assert run["time"].values.tolist() == [0, 2, 4, 6, 8, 10, 12]


def test_a_run_that_is_replaced_has_an_index_of_its_own(tmp_path: Path) -> None:
    size = run_of(tmp_path).index.stat().st_size
    files = run_of(tmp_path, until=2, overwrite=True)
    assert list(indexed_saves(files)) == files.saves
    assert files.index.stat().st_size < size


def test_an_index_that_cannot_be_written_ends_no_run(tmp_path: Path, caplog: Any) -> None:
    (tmp_path / "saves.index").mkdir()
    files = run_of(tmp_path)
    assert len(files.saves) == 4
    assert "saves.index" in caplog.text
    with open_run(tmp_path) as run:
        assert run.sizes["time"] == 4
