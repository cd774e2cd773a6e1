"""Films of a run: the cells over time, from a fixed or a slowly turning camera."""

from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
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
from morphosim.pictures.colours import colouring_by_save, key_colours
from morphosim.pictures.cut import read_cut
from morphosim.pictures.gif import write_gif
from morphosim.pictures.lettering import inches_wide
from morphosim.pictures.plot import draw_sight
from morphosim.pictures.sight import (
    Sight,
    Surroundings,
    checked_bounds,
    placed_cut,
    run_corners,
    sight,
    surroundings,
    title,
)
from morphosim.progress import Tell
from morphosim.runs.saved_fields import save_count, time_index

if TYPE_CHECKING:
    import xarray as xr

    from morphosim.pictures.name_tags import NameTag
    from morphosim.pictures.painter import Painter

Pixels = NDArray[np.uint8]
FORMATS = (".mp4", ".gif")
DPI, USUAL = 100.0, (960, 720)
"""Pixels per inch of films of this size."""
LEAST_DPI = 60.0
"""Below it letters are not read."""
TITLE, LETTERS = 0.42, 11.0
"""Inches for the time and stage, and their letters in points."""
SLOWEST, FASTEST = 0.01, 1000.0
"""Frames per second: a GIF's last at most 655 s, and coders never end where there are too many."""
QUALITY = 8
"""Of the video, of 10."""


@dataclass(frozen=True, slots=True)
class _Shooting:
    """How the frames of a film are made."""

    size: tuple[int, int]
    view: View
    turn: float
    points: NDArray[np.float64]
    names: bool
    mirror: bool
    titles: Sequence[str]

    @property
    def dpi(self) -> float:
        """Pixels per inch, so that letters keep their share of the picture."""
        wide, high = self.size
        return max(DPI * min(wide / USUAL[0], high / USUAL[1]), LEAST_DPI)


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
    cut: str | None = None,
    bounds: ArrayLike | None = None,
    size: tuple[int, int] = USUAL,
    tell: Tell | None = None,
) -> None:
    """Write a film of a run, one frame per save.

    Parameters
    ----------
    run : Dataset of `open_run`
    path : path
        "*.mp4" (H.264) or "*.gif". The file appears when it is whole, and replaces another.
    by, colours, names, shell, mirror, cut : see `plot`
        The cut is in the same place throughout.
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
    half, saves = read_cut(cut), _saves(run, times)
    around = surroundings(run, mirror) if shell else Surroundings()
    placed = placed_cut(run, saves, half, around, mirror)
    points = _points(run, bounds, around, mirror)
    width, height = (pixels // 2 * 2 for pixels in checked_pixels(size, least=64))
    shooting = _Shooting(
        (width, height), view, turn, swept(points) if turn else points, names, mirror,
        [title(run, float(run["time"].values[save])) for save in saves],
    )  # fmt: skip

    colouring = colouring_by_save(run, sorted(set(saves)), by, colours)

    def look(save: int) -> Sight:
        time = float(run["time"].values[save])
        return sight(run, time, colouring(save), mirror, around, placed)

    with replacing(target) as partial, closing(_frames(saves, look, shooting)) as frames:
        told = _told(frames, len(saves), tell)
        if target.suffix.lower() == ".mp4":
            _write_mp4(partial, told, shooting.size, fps)
        else:
            write_gif(partial, told, shooting.size, fps, key_colours(colouring(saves[0])))


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
    tags: dict[str, NameTag] = {}
    step = shooting.turn / max(len(saves) - 1, 1)
    with Painter() as painter:
        for k, save in enumerate(saves):
            if seen is None or save != shown:
                shown, seen = save, look(save)
            view = turned(shooting.view, k * step) if shooting.turn else shooting.view
            yield _frame(seen, painter, view, shooting, tags)


def _frame(
    seen: Sight, painter: "Painter", view: View, shooting: _Shooting, tags: "dict[str, NameTag]"
) -> Pixels:
    """One frame: (height, width, 3). Of `tags`, names of the frame before, it makes its own."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    from morphosim.pictures import annotate
    from morphosim.pictures.key import draw_key, key_height

    wide, high = (pixels / shooting.dpi for pixels in shooting.size)
    figure = Figure(figsize=(wide, high), dpi=shooting.dpi)
    canvas = FigureCanvasAgg(figure)
    widest = max(inches_wide(title, LETTERS) for title in shooting.titles)
    annotate.draw_title(figure, seen.title, LETTERS, max((wide - widest) / 2, 0.1))
    draw_key(figure, seen.colouring, TITLE)
    top = TITLE + key_height(seen.colouring, wide, high)
    ax = figure.add_axes((0, 0, 1, max(1 - top / high, 0.1)))
    draw_sight(
        ax, seen, painter, view, shooting.points, names=shooting.names, mirror=shooting.mirror,
        before=tags,
    )  # fmt: skip
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
