"""Films: as many frames as saves, of even size, that show what is there at the time."""

import resource
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from numpy.typing import NDArray

from morphosim.pictures.film import film

from .made import BOX, GREEN, RED, Ball, made_run

PACKAGES = ("pyvista", "matplotlib", "imageio_ffmpeg")
pytestmark = pytest.mark.skipif(
    not all(map(find_spec, PACKAGES)), reason="the extra pictures is not installed"
)

SMALL: dict[str, Any] = {
    "size": (321, 301), "by": "type", "colours": {"R": RED, "G": GREEN}, "bounds": BOX,
}  # fmt: skip


@pytest.fixture(scope="module")
def run() -> xr.Dataset:
    """A red ball that goes to the right and then becomes green."""
    return made_run(
        [{"a": Ball((x, 15, 15), type=kind)} for x, kind in ((6, "R"), (15, "R"), (24, "G"))]
    )


def frames_of(path: Path) -> tuple[str, NDArray]:
    """What ffmpeg says of a film of 320 x 300 pixels, and its frames (frame, row, column, band)."""
    import imageio_ffmpeg

    ffmpeg = imageio_ffmpeg.get_ffmpeg_exe()
    raw = ("-f", "rawvideo", "-pix_fmt", "rgb24", "-")
    done = subprocess.run([ffmpeg, "-i", str(path), *raw], capture_output=True, check=True)
    frames = np.frombuffer(done.stdout, np.uint8).reshape(-1, 300, 320, 3)
    return next(line for line in done.stderr.decode().splitlines() if "Video:" in line), frames


def middle(frame: NDArray, band: int) -> float:
    """Middle column of what is of a primary colour; NaN if nothing is."""
    others = np.delete(frame.astype(int), band, axis=2).max(axis=2)
    columns = np.nonzero((frame[..., band].astype(int) > others + 60)[80:])[1]
    return float(columns.mean()) if len(columns) > 50 else np.nan


def test_a_film_has_a_frame_per_save_and_shows_it(run: xr.Dataset, tmp_path: Path) -> None:
    told: list[tuple[int, int]] = []
    film(run, tmp_path / "film.mp4", tell=lambda done, of: told.append((done, of)), **SMALL)
    about, frames = frames_of(tmp_path / "film.mp4")
    for fact in ("h264", "yuv420p", " 320x300", " 12 fps"):
        assert fact in about
    assert len(frames) == 3
    left, center = (middle(frame, 0) for frame in frames[:2])
    assert left + 20 < center == pytest.approx(160, abs=4)
    assert middle(frames[2], 1) > center + 20
    assert np.isnan(middle(frames[2], 0))
    assert told == [(1, 3), (2, 3), (3, 3)]
    assert [file.name for file in tmp_path.iterdir()] == ["film.mp4"]


def test_a_film_may_be_a_gif_of_chosen_times(run: xr.Dataset, tmp_path: Path) -> None:
    from PIL import Image

    film(run, tmp_path / "film.gif", times=[0, 20], fps=5, **SMALL)
    with Image.open(tmp_path / "film.gif") as image:
        assert image.n_frames == 2  # type: ignore[attr-defined]
        assert image.size == (320, 300)
        assert image.info["duration"] == 200
        assert image.info["loop"] == 0
        assert middle(np.asarray(image.convert("RGB")), 0) < 140


def gif_frames(path: Path) -> list[NDArray]:
    from PIL import Image, ImageSequence

    with Image.open(path) as image:
        return [np.asarray(frame.convert("RGB")) for frame in ImageSequence.Iterator(image)]


def test_a_gif_has_one_palette_with_an_even_colour_bar(tmp_path: Path) -> None:
    ball = Ball((15, 15, 15), 9, error=-4)
    run = made_run([{"a": ball}, {"b": ball._replace(error=5)}, {"b": ball._replace(error=0)}])
    film(run, tmp_path / "film.gif", by="volume", bounds=BOX)
    frames = gif_frames(tmp_path / "film.gif")
    bars = [frame[50, 285:675].astype(int) for frame in frames]
    assert all((bar == bars[0]).all() for bar in bars)
    assert len(np.unique(bars[0], axis=0)) > 60
    assert np.abs(np.diff(bars[0], axis=0)).max() <= 16  # no step is seen
    assert all((frame[-40:, 400:700] == 255).all() for frame in frames)  # paper stays white
    assert (tmp_path / "film.gif").stat().st_size < 300_000


@pytest.mark.parametrize("by", ["type", "stage", "lineage", "cell"])
def test_what_stands_still_does_not_move_in_a_film(by: str, tmp_path: Path) -> None:
    still = {"a": Ball((8, 15, 15), type="R")}
    far = {f"c{k:02d}": Ball((24, 3 + 2 * k, 8), 2, type=f"type {k:02d}") for k in range(12)}
    run = made_run([still, still | far], stages=["1", "a stage of a long name"])
    film(run, tmp_path / "film.gif", by=by, bounds=BOX, names=True, size=(320, 300))
    first, last = (frame.astype(int) for frame in gif_frames(tmp_path / "film.gif"))
    left = first[100:260, 40:140]
    assert (left.min(axis=2) < 200).mean() > 0.1  # the ball
    np.testing.assert_array_equal(left, last[100:260, 40:140])
    starts = [
        np.flatnonzero((frame[:25].min(axis=2) < 128).any(axis=0))[0] for frame in (first, last)
    ]
    assert starts[0] == starts[1]  # of the title


def test_a_camera_may_go_around_one_save(run: xr.Dataset, tmp_path: Path) -> None:
    film(run, tmp_path / "film.mp4", times=[0] * 3, turn=180, **SMALL)
    places = [middle(frame, 0) for frame in frames_of(tmp_path / "film.mp4")[1]]
    assert places[0] + 20 < places[1] < places[2] - 20
    assert places[1] == pytest.approx(160, abs=4)
    assert places[0] + places[2] == pytest.approx(320, abs=6)


def test_frames_of_a_gif_last_whole_hundredths(run: xr.Dataset, tmp_path: Path) -> None:
    from PIL import Image

    for fps, lasts in ((30, 30), (100, 20)):
        film(run, tmp_path / "film.gif", fps=fps, **SMALL)
        with Image.open(tmp_path / "film.gif") as image:
            assert image.info["duration"] == lasts


def test_a_film_that_ffmpeg_cannot_finish_leaves_the_one_before(
    run: xr.Dataset, tmp_path: Path
) -> None:
    (tmp_path / "film.mp4").write_text("before")
    _, most = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (2000, most))  # of ffmpeg too
    try:
        with pytest.raises(OSError, match=r"ffmpeg|pipe"):
            film(run, tmp_path / "film.mp4", **SMALL)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (most, most))
    assert [file.read_text() for file in tmp_path.iterdir()] == ["before"]


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("film.avi", {}, "extension of .*film.avi = '.avi' is not known"),
        ("film.mp4", {"fps": 0}, "fps = 0 is not allowed"),
        ("film.mp4", {"fps": 1e9}, "fps = 1000000000.0 is not allowed: .* >= 0.01 and <= 1000"),
        ("film.gif", {"fps": 1e-9}, "fps = 1e-09 is not allowed"),
        ("film.mp4", {"size": (10**9, 64)}, "size = 1000000000 is not allowed: .* >= 64 and <= 8"),
        ("film.gif", {"size": (8192, 8192)}, "size = 8192x8192 pixels is not allowed"),
        ("film.gif", {"size": (64,)}, "give a width and a height"),
        ("film.mp4", {"times": []}, "times is empty"),
        ("film.mp4", {"size": (10, 100)}, "size = 10 is not allowed"),
        ("film.mp4", {"view": "above"}, "view = 'above' is not known"),
        ("film.mp4", {"view": "-y", "turn": 90}, "view = '-y' cannot turn"),
        ("film.mp4", {"by": "age"}, "by = 'age' is not known"),
    ],
)
def test_errors_leave_no_file(
    run: xr.Dataset, name: str, options: dict, message: str, tmp_path: Path
) -> None:
    with pytest.raises(ValueError, match=message):
        film(run, tmp_path / name, **options)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("fps", [0.01, 1000])
@pytest.mark.parametrize("name", ["film.mp4", "film.gif"])
def test_the_slowest_and_the_fastest_film_end(
    run: xr.Dataset, name: str, fps: float, tmp_path: Path
) -> None:
    film(run, tmp_path / name, times=[0, 20], fps=fps, size=(64, 64))
    assert (tmp_path / name).stat().st_size > 0


def test_a_missing_folder_is_named(run: xr.Dataset, tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"there is no directory .*nowhere"):
        film(run, tmp_path / "nowhere" / "film.mp4")


@pytest.mark.parametrize("package", PACKAGES)
def test_a_missing_package_is_named(
    run: xr.Dataset, package: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(ImportError, match=rf"{package}; in a clone: pip install '.\[pictures\]'"):
        film(run, tmp_path / "film.mp4")
    assert list(tmp_path.iterdir()) == []
