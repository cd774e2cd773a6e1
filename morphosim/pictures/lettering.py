"""How wide texts are, and what is left of those that are too long."""

from functools import cache

POINTS_PER_INCH = 72
DOTS = "…"
FEWEST = 3
"""Letters that are left of a text, besides the dots."""


@cache
def _width(text: str) -> float:
    """Inches in letters of one point."""
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import text_to_path

    font = FontProperties(size=100)
    width, _, _ = text_to_path.get_text_width_height_descent(text, font, ismath=False)
    return float(width) / 100 / POINTS_PER_INCH


def inches_wide(text: str, size: float) -> float:
    """Width in inches of a text in letters of a size in points."""
    return _width(text) * size


def letters(text: str, most: int) -> str:
    """At most so many letters: names often differ in the last ones, so that the middle is left out.

    A shorter text is returned as it is.
    """
    if len(text) <= most:
        return text
    ahead = (most - 1) // 2
    return text[:ahead] + DOTS + text[len(text) - (most - 1 - ahead) :]


def shortened(text: str, size: float, most: float) -> str:
    """Text that is at most so many inches wide, or of the fewest letters."""
    count = len(text)
    while count > FEWEST + 1 and inches_wide(letters(text, count), size) > most:
        count -= 1
    return letters(text, count)


def plain(text: str) -> str:
    """Text whose dollar signs matplotlib does not take as mathematics."""
    return text.replace("$", r"\$")
