"""Films of a run: the cells over time, from a fixed or a slowly turning camera."""

from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from morphosim import _validate
from morphosim._extras import need
from morphosim._files import replacing, writable
from morphosim.pictures.camera import View, checked_pixels, directions, swept, turned
from morphosim.pictures.plot import draw_sight
from morphosim.pictures.sight import (
    Sight,
    Surroundings,
    checked_bounds,
    run_corners,
    sight,
    surroundings,
)
from morphosim.progress import Tell
from morphosim.runs.saved_fields import save_count, time_index

if TYPE_CHECKING:
    import xarray as xr

    from morphosim.pictures.painter import Painter

Pixels = NDArray[np.uint8]
FORMATS = (".mp4", ".gif")
DPI = 100
TITLE = 0.42
"""Inches for the time and stage."""
SLOWEST, FASTEST = 0.01, 1000.0
"""Frames per second: a GIF's last at most 655 s, and coders never end where there are too many."""
QUALITY = 8
"""Of the video, of 10."""
GIF_LEAST = 2
"""1/100 s, least time of a frame that browsers keep to."""


@dataclass(frozen=True, slots=True)
class _Shooting:
    """How the frames of a film are made."""

    size: tuple[int, int]
    view: View
    turn: float
    points: NDArray[np.float64]
    names: bool
    mirror: bool


def film(
    run: "xr.Dataset",
    path: str | Path,
    *,
    by: str = "cell",
    view: View = "z",
    turn: float = 0.0,
    times: Iterable[float] | None = None,
    fps: float = 12.0,
    colours: Mapping[str, object] | None = None,
    names: bool = False,
    shell: bool = True,
    mirror: bool = False,
    bounds: ArrayLike | None = None,
    size: tuple[int, int] = (960, 720),
    tell: Tell | None = None,
) -> None:
    """Write a film of a run, one frame per save.

    Parameters
    ----------
    run : Dataset of `open_run`
    path : path
        "*.mp4" (H.264) or "*.gif". The file appears when it is whole, and replaces another.
    by, colours, names, shell, mirror : see `plot`
    view : name or direction
        See `plot`; where the film begins if it turns.
    turn : float
        Degrees by which the camera goes around the y axis from the first to the last frame.
    times : numbers, optional
        One frame for each: the save nearest to it; by default all saves. To go around one save,
        give its time as often as there are to be frames.
    fps : float
        Frames per second, from 0.01 to 1000; those of a GIF last a whole number of 1/100 s, at
        least two.
    bounds : (2, 3) µm, optional
        Corners of the box to have in view; by default the shell or box, or else all cells.
    size : (int, int)
        Width and height in pixels, from 64 to 8192, and together at most 33 million; odd numbers
        are lowered by one.
    tell : callable, optional
        Told after each frame how many are done, and of how many.

    Raises
    ------
    ValueError
        A word or number is not allowed, or the run lacks what it takes.
    ImportError
        PyVista, matplotlib or imageio-ffmpeg is not installed.
    OSError
        The film cannot be written, or the system has no library to draw with.
    """
    target = writable(path, FORMATS)
    need("matplotlib", "a film", "pictures")
    if target.suffix.lower() == ".mp4":
        need("imageio_ffmpeg", "a film", "pictures")
    fps = _validate.number("fps", fps, least=SLOWEST, most=FASTEST)
    turn = _validate.number("turn", turn)
    if turn:
        turned(view, turn)
    directions(view)
    for name, flag in (("names", names), ("shell", shell)):
        _validate.flag(name, flag)
    saves = _saves(run, times)
    around = surroundings(run, mirror) if shell else Surroundings()
    points = _points(run, bounds, around, mirror)
    width, height = (pixels // 2 * 2 for pixels in checked_pixels(size, least=64))
    shooting = _Shooting(
        (width, height), view, turn, swept(points) if turn else points, names, mirror
    )

    def look(save: int) -> Sight:
        return sight(run, float(run["time"].values[save]), by, colours, mirror, around)

    write = _write_mp4 if target.suffix.lower() == ".mp4" else _write_gif
    with replacing(target) as partial, closing(_frames(saves, look, shooting)) as frames:
        write(partial, _told(frames, len(saves), tell), shooting.size, fps)


def _saves(run: "xr.Dataset", times: Iterable[float] | None) -> list[int]:
    """Number of the save of each frame."""
    if times is None:
        return list(range(save_count(run)))
    saves = [time_index(run, _validate.number("times", time)) for time in times]
    if not saves:
        message = "times is empty; give at least one, or None for all saves"
        raise ValueError(message)
    return saves


def _points(
    run: "xr.Dataset", bounds: ArrayLike | None, around: Surroundings, mirror: bool
) -> NDArray[np.float64]:
    """Points (N, 3) that are in view throughout."""
    if bounds is not None:
        return checked_bounds(bounds, mirror)
    return run_corners(run, mirror) if around.points is None else around.points


def _frames(
    saves: list[int], look: Callable[[int], Sight], shooting: _Shooting
) -> Generator[Pixels, None, None]:
    """Frames of a film; saves that follow each other are read once."""
    from morphosim.pictures.painter import Painter

    shown, seen = -1, None
    step = shooting.turn / max(len(saves) - 1, 1)
    with Painter() as painter:
        for k, save in enumerate(saves):
            if seen is None or save != shown:
                shown, seen = save, look(save)
            view = turned(shooting.view, k * step) if shooting.turn else shooting.view
            yield _frame(seen, painter, view, shooting)


def _frame(seen: Sight, painter: "Painter", view: View, shooting: _Shooting) -> Pixels:
    """One frame: (height, width, 3)."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    from morphosim.pictures import annotate

    wide, high = (pixels / DPI for pixels in shooting.size)
    figure = Figure(figsize=(wide, high), dpi=DPI)
    canvas = FigureCanvasAgg(figure)
    figure.suptitle(seen.title, fontsize=11, y=1 - 0.12 / high, va="top")
    annotate.draw_key(figure, seen.colouring, TITLE)
    top = TITLE + annotate.key_height(seen.colouring, wide)
    ax = figure.add_axes((0, 0, 1, max(1 - top / high, 0.1)))
    draw_sight(
        ax, seen, painter, view, shooting.points, names=shooting.names, mirror=shooting.mirror
    )
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()


def _told(frames: Iterable[Pixels], count: int, tell: Tell | None) -> Iterator[Pixels]:
    """Frames, of which each is told of when it has been taken."""
    for done, frame in enumerate(frames, 1):
        yield frame
        if tell is not None:
            tell(done, count)


def _write_mp4(path: Path, frames: Iterable[Pixels], size: tuple[int, int], fps: float) -> None:
    ffmpeg = need("imageio_ffmpeg", "a film", "pictures")
    sent = 0
    writer = ffmpeg.write_frames(
        str(path), size, fps=fps, codec="libx264", pix_fmt_out="yuv420p", quality=QUALITY,
        macro_block_size=2, ffmpeg_log_level="quiet",
        output_params=["-f", "mp4", "-movflags", "+faststart"],
    )  # fmt: skip
    with closing(writer):
        writer.send(None)
        for frame in frames:
            writer.send(np.ascontiguousarray(frame))
            sent += 1
    try:
        written = ffmpeg.count_frames_and_secs(str(path))[0]
    except RuntimeError as error:
        message = "ffmpeg did not finish it"
        raise OSError(message) from error
    if written != sent:  # of which the writer says nothing
        message = f"ffmpeg wrote {written} of {sent} frames"
        raise OSError(message)


def _write_gif(path: Path, frames: Iterable[Pixels], size: tuple[int, int], fps: float) -> None:
    from PIL import Image

    images = (Image.fromarray(frame).quantize(256, dither=Image.Dither.NONE) for frame in frames)
    first = next(images)
    duration = 10 * max(round(100 / fps), GIF_LEAST)  # ms, which the file holds in 1/100 s
    first.save(
        path, "GIF", save_all=True, append_images=images, duration=duration, loop=0, disposal=1
    )
