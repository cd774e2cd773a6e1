"""Cameras: from where cells are seen, in parallel projection so that a scale bar holds."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from morphosim import _validate

Floats = NDArray[np.float64]
View = str | Sequence[float]
"""Name of `VIEWS`, or direction (3,) from the cells to the camera."""
VIEWS: dict[str, tuple[float, float, float]] = {
    "x": (1, 0, 0), "y": (0, 1, 0), "z": (0, 0, 1),
    "-x": (-1, 0, 0), "-y": (0, -1, 0), "-z": (0, 0, -1), "corner": (0.55, 0.45, 1.0),
}  # fmt: skip
THREE = ("z", "x", "y")
"""The views "three": from the front, from the right and from above, as in technical drawings."""
RING = 64
"""Points of a circle."""
MOST_PIXELS, MOST_AREA = 8192, 1 << 25
"""Along a side, and in all: a picture is made of four times as many, which take memory."""
MARGIN = 0.04
"""Free rim, as a share of the picture's shorter side."""


@dataclass(frozen=True, slots=True)
class Camera:
    """Parallel projection onto a picture.

    Attributes
    ----------
    right, up : (3,) unit vectors
        Along the picture's rows and columns.
    center : (3,) µm
        What is in the middle of the picture.
    scale : float
        µm per pixel.
    size : (int, int)
        Width and height in pixels.
    """

    right: Floats
    up: Floats
    center: Floats
    scale: float
    size: tuple[int, int]

    @property
    def toward(self) -> Floats:
        """Unit vector (3,) from the cells to the camera."""
        return np.cross(self.right, self.up)

    def pixels(self, points: ArrayLike) -> Floats:
        """Where points (N, 3) in µm are: (N, 2) columns and rows, from the upper left corner."""
        offsets = (np.asarray(points, np.float64) - self.center) / self.scale
        column = self.size[0] / 2 + offsets @ self.right
        return np.stack([column, self.size[1] / 2 - offsets @ self.up], axis=-1)


def checked_pixels(size: Iterable[Any], least: int) -> tuple[int, int]:
    """Width and height of a picture; ValueError beyond what can be drawn."""
    sides = [_validate.integer("size", side, least=least, most=MOST_PIXELS) for side in size]
    if len(sides) != 2 or sides[0] * sides[1] > MOST_AREA:
        message = (
            f"size = {'x'.join(map(str, sides))} pixels is not allowed: give a width and a height, "
            f"and of both at most {MOST_AREA // 10**6} million pixels"
        )
        raise ValueError(message)
    return sides[0], sides[1]


def directions(view: View) -> tuple[Floats, Floats]:
    """Unit vectors (3,) to the right and up in a view.

    y is up, or in views along y -z, so that the three views along axes fit together.

    Raises
    ------
    ValueError
        The view is not known, or is the zero vector.
    """
    if isinstance(view, str):
        _validate.choice("view", view, VIEWS)
        toward = np.array(VIEWS[view], np.float64)
    else:
        toward = _validate.vector("view", view)
    if not toward.any():
        message = f"view = {view!r} is no direction; give one, or one of {', '.join(VIEWS)}"
        raise ValueError(message)
    toward = toward / np.abs(toward).max()  # whose square is a number
    toward = toward / np.linalg.norm(toward)
    along_y = np.abs(toward[1]) > 1 - 1e-9
    up = np.array([0.0, 0.0, -toward[1]]) if along_y else np.array([0.0, 1.0, 0.0])
    right = np.cross(up, toward)
    right /= np.linalg.norm(right)
    return right, np.cross(toward, right)


def turned(view: View, angle: float) -> tuple[float, float, float]:
    """Direction of a view, turned about the y axis by an angle in degrees.

    Raises
    ------
    ValueError
        The view is along y.
    """
    right, up = directions(view)
    x, y, z = np.cross(right, up).tolist()
    if up[1] == 0:
        message = f"view = {view!r} cannot turn: the camera goes around y; give one not along it"
        raise ValueError(message)
    cosine, sine = np.cos(np.deg2rad(angle)), np.sin(np.deg2rad(angle))
    return float(cosine * x + sine * z), y, float(cosine * z - sine * x)


def corners(bounds: ArrayLike) -> Floats:
    """Corners (8, 3) of the box with this lower and upper corner (2, 3)."""
    low, high = np.asarray(bounds, np.float64)
    return np.array([np.where(upper, high, low) for upper in np.ndindex(2, 2, 2)])


def swept(points: ArrayLike) -> Floats:
    """Points (N, 3) of a cylinder that holds these (M, 3) while a camera goes around y."""
    given = np.asarray(points, np.float64)
    low, high = given.min(axis=0), given.max(axis=0)
    middle = (low + high) / 2
    radius = np.linalg.norm((given - middle)[:, [0, 2]], axis=1).max()
    phase = np.linspace(0, 2 * np.pi, RING, endpoint=False)
    ring = np.stack([np.cos(phase), np.zeros(RING), np.sin(phase)], axis=1) * radius
    ends = np.array([(middle[0], y, middle[2]) for y in (low[1], high[1])])
    return np.asarray((ring + ends[:, None]).reshape(-1, 3))


def extent(points: ArrayLike, view: View) -> tuple[float, float]:
    """Width and height, in µm, of points (N, 3) in a view."""
    right, up = directions(view)
    given = np.asarray(points, np.float64)
    return float(np.ptp(given @ right)), float(np.ptp(given @ up))


def camera(
    view: View,
    points: ArrayLike,
    size: tuple[int, int],
    *,
    scale: float | None = None,
    foot: int = 0,
) -> Camera:
    """Camera that has points in view.

    Parameters
    ----------
    view : name or direction
    points : (N, 3) µm
    size : (int, int)
        Width and height in pixels.
    scale : float, optional
        µm per pixel; by default as small as it can be.
    foot : int
        Pixels to leave free at the bottom.
    """
    right, up = directions(view)
    width, height = size
    given = np.asarray(points, np.float64)
    if scale is None:
        rim = 2 * MARGIN * min(size)
        wide, high = extent(given, view)
        room = max(width - rim, 1), max(height - rim - foot, 1)
        scale = max(wide / room[0], high / room[1], 1e-9)
    basis = np.stack([right, up, np.cross(right, up)])
    seen = given @ basis.T
    middle = (seen.min(axis=0) + seen.max(axis=0)) / 2 - (0, foot / 2 * scale, 0)
    return Camera(right, up, middle @ basis, scale, (width, height))
