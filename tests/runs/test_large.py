"""What is as large as all fields of a run is not held twice."""

import tracemalloc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from zipfile import ZIP_DEFLATED, ZipFile

import numpy as np
import pytest

from morphosim import Cell, Field, Numerics, RunWriter, Scene, Simulation, _parts
from morphosim.runs.checkpoint import FIELDS, Checkpoint
from morphosim.runs.npz import stored_array

ROWS = 6
"""Cells along each axis."""


@pytest.fixture(scope="module")
def many() -> Simulation:
    """Some hundred small cells."""
    depth = 3 - np.linalg.norm(np.indices((13, 13, 13)) - 6.0, axis=0) * 0.75
    phi = 0.5 * (1 + np.tanh(depth))
    cells = [
        Cell(name="-".join(map(str, place)), shape=Field(phi=phi, origin=place * 4.5, spacing=0.75))
        for place in np.argwhere(np.ones((ROWS,) * 3))
    ]
    return Simulation(Scene(cells=cells, numerics=Numerics(threads=1, spacing=0.75)))


@contextmanager
def peak() -> Iterator[Callable[[], int]]:
    """Bytes that arrays took at most in here, beyond those of before."""
    tracemalloc.start()
    try:
        before = tracemalloc.get_traced_memory()[0]
        tracemalloc.reset_peak()
        yield lambda: tracemalloc.get_traced_memory()[1] - before
    finally:
        tracemalloc.stop()


@pytest.fixture(autouse=True)
def small_pieces(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_parts, "PIECE", 1 << 16)


def fields_of(simulation: Simulation) -> int:
    """Bytes of all fields and their histories."""
    return simulation.engine.pool.nbytes


def test_a_save_and_its_checkpoint_hold_no_second_copy_of_the_fields(
    many: Simulation, tmp_path: Path
) -> None:
    writer = RunWriter(tmp_path, 1)
    writer.start(many)
    many.step()
    with peak() as most:
        writer.after_step(many)
        assert most() < 0.2 * fields_of(many)
    writer.finish(many)
    assert writer.files.last == 1
    state, now = Checkpoint.read(writer.files.restart(1)), many.checkpoint()
    for name, values in now.arrays.items():
        np.testing.assert_array_equal(np.asarray(state.arrays[name]), values)


def test_a_run_goes_on_without_a_second_copy_of_the_fields(
    many: Simulation, tmp_path: Path
) -> None:
    path = tmp_path / "state.npz"
    many.checkpoint(lasting=False).write(path)
    with peak() as most:
        many.go_back(Checkpoint.read(path))
        assert most() < 1.3 * fields_of(many)  # the new pools before the old ones go


def test_a_checkpoint_that_lasts_is_a_copy(many: Simulation) -> None:
    kept, before = many.checkpoint(), many.volumes.copy()
    many.step()
    many.go_back(kept)
    np.testing.assert_array_equal(many.volumes, before)


def test_numpy_reads_a_checkpoint(many: Simulation, tmp_path: Path) -> None:
    path, state = tmp_path / "state.npz", many.checkpoint()
    many.checkpoint(lasting=False).write(path)
    with np.load(path, allow_pickle=False) as file:
        for name in FIELDS:
            np.testing.assert_array_equal(file[name], state.arrays[name])


def test_fields_that_another_program_has_compressed_are_read(tmp_path: Path) -> None:
    values = np.arange(12.0).reshape(6, 2)
    for save in (np.savez, np.savez_compressed):
        save(tmp_path / "x.npz", band=values)
        with ZipFile(tmp_path / "x.npz") as archive:
            assert (archive.getinfo("band.npy").compress_type == ZIP_DEFLATED) == (
                save is np.savez_compressed
            )
            found = stored_array(archive, "band")
        np.testing.assert_array_equal(found[1:3], values[1:3])
        np.testing.assert_array_equal(np.asarray(found), values)


def test_joined_arrays_are_as_one() -> None:
    parts = [np.arange(3), np.zeros(0, int), np.arange(3, 8)]
    joined, whole = _parts.Joined(parts), np.arange(8)
    assert joined.shape == whole.shape
    for low in range(9):
        for high in range(9):
            np.testing.assert_array_equal(joined[low:high], whole[low:high])
    np.testing.assert_array_equal(np.asarray(joined), whole)
