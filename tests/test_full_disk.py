"""On a full disk one line names the file and the reason, and nothing half written is left."""

import errno
import json
import os
import re
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from morphosim import (
    Cell,
    Field,
    Numerics,
    RunWriter,
    Scene,
    Simulation,
    Sphere,
    export,
    save_scene,
)
from morphosim._files import WriteError, filling, replacing, write_text
from morphosim.exports.formats import FORMATS
from morphosim.pictures.film import film
from morphosim.pictures.plot import plot
from morphosim.pictures.show import save_page
from morphosim.runs.pack import pack
from morphosim.sweeps.store import Store

from .pictures.made import PAIR, made_run

resource = pytest.importorskip("resource", reason="the system has no limits of files")
MOST_BYTES = 4096
TRUTH = "what was there before"


@contextmanager
def full_disk() -> Iterator[None]:
    """No file may grow beyond a few kB in here."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (MOST_BYTES, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.fixture(scope="module")
def run() -> xr.Dataset:
    run = made_run([PAIR] * 60, {("low", "high"): 1.0})
    return run.assign(centroid=run["box_low"], radial_position=run["volume"])


@pytest.fixture(scope="module")
def directory(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("run")
    cell = Cell(name="a", shape=Sphere(center=(0, 0, 0), radius=3))
    simulation = Simulation(Scene(cells=[cell], numerics=Numerics(threads=1)))
    simulation.run(until=2, observers=[RunWriter(place, 2)])
    return place


def scene_of_noise() -> Scene:
    phi = np.random.default_rng(1).random((20, 20, 20))
    return Scene(cells=[Cell(name="a", shape=Field(phi=phi, spacing=0.5))])


Write = Callable[[xr.Dataset, Path, Path], object]
WRITERS: dict[str, Write] = {
    **{
        f"picture.{ending}": lambda run, _, path: plot(run, path=path)
        for ending in ("png", "jpg", "pdf", "svg", "tif", "webp")
    },
    "film.mp4": lambda run, _, path: film(run, path, times=[0, 10], size=(400, 300)),
    "film.gif": lambda run, _, path: film(run, path, times=[0, 10], size=(400, 300)),
    "view.html": lambda run, _, path: save_page(run, path, [0]),
    "packed.nc": lambda _, directory, path: pack(directory, path),
    "scene.npz": lambda *of: save_scene(scene_of_noise(), of[2].with_suffix(".toml")),
    "scan.json": lambda *of: write_text(of[2], json.dumps(list(range(MOST_BYTES)))),
    "000001.nc": lambda run, _, path: Store(path.parents[1]).write(1, run),
}


@pytest.mark.parametrize("name", WRITERS)
def test_a_file_is_whole_or_what_it_was(
    name: str, run: xr.Dataset, directory: Path, tmp_path: Path
) -> None:
    path = tmp_path / "members" / name
    path.parent.mkdir()
    if name != "packed.nc":  # which is not replaced
        path.write_text(TRUTH)
    with full_disk(), pytest.raises(WriteError) as caught:
        WRITERS[name](run, directory, path)
    message = str(caught.value)
    assert message.startswith(f"{path} cannot be written: ")
    assert "File too large" in message or "MB are free there" in message
    assert "\n" not in message
    assert [p.name for p in path.parent.iterdir()] == ([] if name == "packed.nc" else [name])
    assert name == "packed.nc" or path.read_text() == TRUTH


@pytest.mark.parametrize("there", [True, False])
@pytest.mark.parametrize("to", FORMATS)
def test_an_export_is_whole_or_nothing(
    to: str, there: bool, run: xr.Dataset, tmp_path: Path
) -> None:
    place = tmp_path / "out"
    if there:
        place.mkdir()
    with full_disk(), pytest.raises(WriteError) as caught:
        export(run, place, to)
    assert str(caught.value) == f"{place} cannot be written: {os.strerror(errno.EFBIG)}"
    assert list(tmp_path.rglob("*")) == ([place] if there else [])
    assert export(run, place, to, times=[0])


def fails() -> None:
    """Raise a RuntimeError that has nothing to do with files."""
    table = {1: 1}
    for key in table:
        table[key + 1] = key


def test_errors_of_reading_are_not_those_of_writing(tmp_path: Path) -> None:
    for kind, path in ((replacing, tmp_path / "a"), (filling, tmp_path / "b")):
        with pytest.raises(FileNotFoundError, match="source"), kind(path):
            (tmp_path / "source").read_text()
        with pytest.raises(RuntimeError, match="dictionary changed"), kind(path):
            fails()
    assert not list(tmp_path.iterdir())


def test_a_link_stays_and_its_file_is_replaced(tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "there" / "file")
    write_text(tmp_path / "link", TRUTH)
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "there" / "file").read_text() == TRUTH


@pytest.mark.skipif(sys.platform != "linux", reason="the device is Linux's")
def test_a_device_is_written_to_and_stays() -> None:
    write_text(Path("/dev/null"), TRUTH)
    assert Path("/dev/null").is_char_device()
    with pytest.raises(WriteError, match="/dev/full cannot be written: No space left"):
        write_text(Path("/dev/full"), TRUTH)


@pytest.mark.parametrize("place", ["missing/file", "folder"])
def test_a_place_that_no_file_can_have(place: str, tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    path = tmp_path / place
    with pytest.raises(WriteError, match=f"^{re.escape(str(path))} cannot be written: "):
        write_text(path, TRUTH)
