"""GIF films: 256 colours for the whole film, the same in every frame."""

import zlib
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from morphosim.pictures.palettes import RGB

if TYPE_CHECKING:
    from PIL.Image import Image

Pixels = NDArray[np.uint8]
LEAST = 2
"""1/100 s, least time of a frame that browsers keep to."""
COLOURS = 255
"""Of the palette; one more is for what stays as in the frame before."""
BITS = 6
"""Of red, green and blue, by which colours are told apart."""
SAMPLES = 1 << 18
"""Pixels from which the palette is made."""
PAPER_AND_INK: Sequence[RGB] = ((1, 1, 1), (0, 0, 0))
EVENNESS = 1 / 2
"""Power of an area by which its colour counts: large ones shall not take the shades of small."""


def write_gif(
    path: Path, frames: Iterable[Pixels], size: tuple[int, int], fps: float, sure: Sequence[RGB]
) -> None:
    """Write frames (height, width, 3). Those are kept, compressed, until all colours are known.

    `sure` colours, fewer than 200, have a place in the palette.
    """
    kept, colours = [], _Colours()
    for frame in frames:
        colours.add(frame)
        kept.append(zlib.compress(frame.tobytes(), 1))
    palette = _palette(colours, [*PAPER_AND_INK, *sure])
    images = _images(kept, size, palette, _nearest(colours, palette))
    duration = 10 * max(round(100 / fps), LEAST)  # ms, which the file holds in 1/100 s
    next(images).save(
        path, "GIF", save_all=True, append_images=images, duration=duration, loop=0, disposal=1,
        optimize=True,
    )  # fmt: skip


class _Colours:
    """How often the colours of some frames are there, those alike taken together."""

    def __init__(self) -> None:
        self.count = np.zeros(1 << 3 * BITS, np.int64)
        self.sums = np.zeros((3, 1 << 3 * BITS), np.int64)

    def add(self, frame: Pixels) -> None:
        numbers = _numbers(frame).ravel()
        found, inverse, count = np.unique(numbers, return_inverse=True, return_counts=True)
        self.count[found] += count
        for band, sums in enumerate(self.sums):
            values = frame[..., band].ravel().astype(np.float64)
            sums[found] += np.rint(np.bincount(inverse, values)).astype(np.int64)

    @property
    def found(self) -> NDArray[np.int64]:
        """Numbers of the colours that are there."""
        return np.flatnonzero(self.count)

    @property
    def means(self) -> NDArray[np.float64]:
        """Red, green and blue of each: (C, 3)."""
        return np.asarray((self.sums[:, self.found] / self.count[self.found]).T)


def _numbers(frame: Pixels) -> NDArray[np.int64]:
    """Number of the colour of each pixel."""
    red, green, blue = (frame[..., band].astype(np.int64) >> 8 - BITS for band in range(3))
    return red << 2 * BITS | green << BITS | blue


def _palette(colours: _Colours, sure: Sequence[RGB]) -> Pixels:
    """Colours (255, 3) for the whole film."""
    from PIL import Image

    weights = colours.count[colours.found] ** EVENNESS
    repeats = np.maximum(np.rint(weights * SAMPLES / weights.sum()), 1).astype(np.int64)
    samples = np.rint(np.repeat(colours.means, repeats, axis=0)).astype(np.uint8)
    most = COLOURS - len(sure)
    made = Image.fromarray(samples[None]).quantize(most, Image.Quantize.MEDIANCUT, kmeans=1)
    chosen = np.array(made.getpalette(), np.uint8).reshape(-1, 3)[:most]
    return np.concatenate([np.rint(255 * np.array(sure)).astype(np.uint8), chosen])


def _nearest(colours: _Colours, palette: Pixels) -> Pixels:
    """Place in the palette for each number of a colour."""
    from scipy.spatial import KDTree

    places = np.zeros(len(colours.count), np.uint8)
    places[colours.found] = KDTree(palette.astype(np.float64)).query(colours.means)[1]
    return places


def _images(
    kept: list[bytes], size: tuple[int, int], palette: Pixels, nearest: Pixels
) -> "Iterator[Image]":
    from PIL import Image

    width, height = size
    for data in kept:
        frame = np.frombuffer(zlib.decompress(data), np.uint8).reshape(height, width, 3)
        image = Image.fromarray(nearest[_numbers(frame)], "P")
        image.putpalette(palette.tobytes())
        yield image
