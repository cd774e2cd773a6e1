"""Palettes: few colours, many colours that set neighbours apart, and scales."""

from collections.abc import Sequence
from functools import cache

import numpy as np
from numpy.typing import NDArray

from morphosim import _validate

RGB = tuple[float, float, float]
"""Red, green and blue from 0 to 1."""
HEX_DIGITS = 6
GREY: RGB = (0.6, 0.6, 0.6)
OKABE_ITO = (
    "#e69f00", "#56b4e9", "#009e73", "#f0e442", "#0072b2", "#d55e00", "#cc79a7", "#999999",
)  # fmt: skip
LIGHT, DARK = 0.5, 0.35
"""How much white and black the variants of a colour hold."""
MOST = 48
"""Colours that are all different."""
LEVELS = (0.25, 0.45, 0.65, 0.85, 0.95)
"""Red, green and blue of further colours: pure ones look alike, and more so where they are dark."""
APART = 25.0
"""Colours that differ by so much (CIE 1976, also to deuteranopes) are as good as any."""
DEUTERANOPIA = np.array(
    [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413],
     [-0.011820, 0.042940, 0.968881]]
)  # fmt: skip
"""What linear RGB looks like to deuteranopes (Machado et al. 2009, doi:10.1109/TVCG.2009.113)."""
TO_XYZ = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
"""Linear sRGB to CIE XYZ."""


def rgb(colour: object) -> RGB:
    """Colour as red, green and blue from 0 to 1.

    Parameters
    ----------
    colour : "#rrggbb", or three numbers from 0 to 1

    Raises
    ------
    ValueError
        It is neither.
    """
    if isinstance(colour, str):
        digits = colour.removeprefix("#")
        if len(digits) == HEX_DIGITS and set(digits.lower()) <= set("0123456789abcdef"):
            red, green, blue = (int(digits[k : k + 2], 16) / 255 for k in (0, 2, 4))
            return red, green, blue
        message = f"colour = {colour!r} is not of the form '#d55e00'"
        raise ValueError(message)
    red, green, blue = _validate.vector("colour", colour).tolist()  # type: ignore[arg-type]
    for value in (red, green, blue):
        _validate.number("colour", value, least=0, most=1)
    return red, green, blue


def hexed(colour: RGB) -> str:
    """Colour as "#rrggbb"."""
    return "#" + "".join(f"{round(255 * value):02x}" for value in colour)


DIVERGING = tuple(map(rgb, ("#2166ac", "#67a9cf", "#f7f7f7", "#ef8a62", "#b2182b")))
"""From blue by white to red (ColorBrewer RdBu)."""
SEQUENTIAL = tuple(
    map(rgb, ("#440154", "#414487", "#2a788e", "#22a884", "#7ad151", "#fde725"))
)  # fmt: skip
"""From violet to yellow (viridis)."""


def interpolated(stops: Sequence[RGB], place: float) -> RGB:
    """Colour between stops at even distances; `place` from 0 to 1."""
    return blended(stops, np.array([place]))[0]


def blended(stops: Sequence[RGB], places: NDArray[np.float64]) -> list[RGB]:
    """Colours between stops at even distances, from 0 to 1; grey at what is no number."""
    at, known = np.linspace(0, 1, len(stops)), np.isfinite(places)
    bands = (np.interp(places, at, band) for band in np.transpose(stops))
    shades = zip(*(band.tolist() for band in bands), strict=True)
    return [shade if there else GREY for shade, there in zip(shades, known.tolist(), strict=True)]


def evenly(stops: Sequence[RGB], count: int) -> list[RGB]:
    """So many colours, from the first stop to the last."""
    return [interpolated(stops, place) for place in np.linspace(0, 1, max(count, 2))[:count]]


def some_colours(count: int) -> list[RGB]:
    """So many colours that differ: of the palette, then variants of it, and then further ones.

    Of more than `MOST` some are the same.
    """
    palette = many_colours() if count <= len(many_colours()) else further_colours()
    return [palette[k % len(palette)] for k in range(count)]


def many_colours() -> list[RGB]:
    """The palette, then its light and then its dark variants."""
    base = [rgb(colour) for colour in OKABE_ITO]
    hues = base[:-1]
    light = [_mixed(colour, 1.0, LIGHT) for colour in hues]
    return base + light + [_mixed(colour, 0.0, DARK) for colour in hues]


@cache
def further_colours() -> list[RGB]:
    """`MOST` colours: `many_colours`, and in turn what differs best from all before it."""
    candidates = [(r, g, b) for r in LEVELS for g in LEVELS for b in LEVELS]
    chosen = many_colours()
    apart = _distances([*chosen, *candidates])
    nearest = apart[: len(chosen), len(chosen) :].min(axis=0)
    while len(chosen) < MOST:
        best = int(nearest.argmax())
        chosen.append(candidates[best])
        nearest = np.minimum(nearest, apart[len(many_colours()) + best, len(many_colours()) :])
    return chosen


def set_apart(count: int, pairs: NDArray[np.int64]) -> list[RGB]:
    """Colours of things so that those of each pair differ well.

    Few things get the palette in order. Of many, in turn, each gets the colour that differs from
    those its neighbours have by now; of several that do, the one that is used least.

    Parameters
    ----------
    count : int
    pairs : (P, 2), numbers below `count`
    """
    if count <= len(OKABE_ITO):
        return some_colours(count)
    palette = many_colours()
    apart = np.minimum(_distances(palette), APART)
    touching: list[set[int]] = [set() for _ in range(count)]
    for a, b in np.asarray(pairs).tolist():
        touching[a].add(b)
        touching[b].add(a)
    used = np.zeros(len(palette))
    chosen: list[int] = []
    for k in range(count):
        taken = [chosen[other] for other in touching[k] if other < k]
        worst = apart[taken].min(axis=0) if taken else np.full(len(palette), APART)
        chosen.append(int(np.lexsort((used, -worst))[0]))
        used[chosen[k]] += 1
    return [palette[choice] for choice in chosen]


def _mixed(colour: RGB, other: float, share: float) -> RGB:
    red, green, blue = ((1 - share) * value + share * other for value in colour)
    return red, green, blue


def _distances(colours: Sequence[RGB]) -> NDArray[np.float64]:
    """Smaller of the differences to most people and to deuteranopes: (C, C)."""
    values = np.array(colours)
    linear = np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)
    seen = [_lab(linear), _lab(np.clip(linear @ DEUTERANOPIA.T, 0, 1))]
    return np.asarray(
        np.min([np.linalg.norm(lab[:, None] - lab[None], axis=2) for lab in seen], axis=0)
    )


def _lab(linear: NDArray[np.float64]) -> NDArray[np.float64]:
    """CIE L*a*b* of linear RGB, by the white of sRGB."""
    x, y, z = np.cbrt(linear @ TO_XYZ.T / TO_XYZ.sum(axis=1)).T
    return np.stack([116 * y - 16, 500 * (x - y), 200 * (y - z)], axis=1)
