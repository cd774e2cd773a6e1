"""Runs of balls at known places, made without simulation."""

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np
import xarray as xr

H = 0.5
BOX = ((0.0, 0.0, 0.0), (30.0, 30.0, 30.0))
RED, GREEN = (0.8, 0.0, 0.0), (0.0, 0.7, 0.0)


class Ball(NamedTuple):
    center: tuple[float, float, float]
    radius: float = 4.0
    type: str = ""
    error: float = 0.0  # of the volume, %


Balls = Mapping[str, Ball]
LOW, HIGH = (7.0, 9.0, 11.0), (21.0, 23.0, 19.0)
PAIR: Balls = {"low": Ball(LOW, type="R"), "high": Ball(HIGH, type="G")}
"""Two balls that no view along an axis shows in one place."""


def made_run(
    saves: Sequence[Balls],
    touching: Mapping[tuple[str, str], float] | None = None,
    stages: Sequence[str] | None = None,
    parents: Mapping[str, str] | None = None,
) -> xr.Dataset:
    """Run of these saves at t = 0, 10, 20 and so on.

    Contact areas in µm² are given, between balls that need not touch.
    """
    names = list(dict.fromkeys(name for save in saves for name in save))
    fields = [(t, name, *_field(ball)) for t, s in enumerate(saves) for name, ball in s.items()]
    ragged = {
        "row_size": ("box", [phi.size for *_, phi in fields]),
        "box_time": ("box", [t for t, *_ in fields]),
        "box_cell": ("box", [names.index(name) for _, name, *_ in fields]),
        "box_origin": (("box", "axis"), [origin for *_, origin, _ in fields]),
        "box_shape": (("box", "axis"), [phi.shape for *_, phi in fields]),
        "phi": ("sample", np.concatenate([phi.ravel() for *_, phi in fields])),
    }
    area = np.zeros((len(saves), len(names), len(names)), np.float32)
    for (a, b), value in (touching or {}).items():
        i, j = names.index(a), names.index(b)
        area[:, [i, j], [j, i]] = value
    return xr.Dataset(
        ragged
        | _table(saves, names)
        | {
            "contact_area": (("time", "cell", "neighbour"), area),
            "stage": ("time", np.array(stages or [""] * len(saves), object)),
            "parent": ("cell", np.array([(parents or {}).get(n, "") for n in names], object)),
        },
        {"time": np.arange(len(saves)) * 10.0, "cell": names, "neighbour": names},
        {"spacing_um": H, "scene": "made"},
    )


def _field(ball: Ball) -> tuple[np.ndarray, np.ndarray]:
    """First lattice point, and φ."""
    origin = np.floor((np.array(ball.center) - ball.radius - 3) / H).astype(np.int64)
    count = int(np.ceil(2 * (ball.radius + 3) / H)) + 1
    axes = [(low + np.arange(count)) * H - o for low, o in zip(origin, ball.center, strict=True)]
    x, y, z = np.meshgrid(*axes, indexing="ij", sparse=True)
    phi = 0.5 * (1 + np.tanh(ball.radius - np.sqrt(x**2 + y**2 + z**2)))
    return origin, phi.astype(np.float32)


def _table(saves: Sequence[Balls], names: Sequence[str]) -> dict:
    """Variables per time and cell."""
    shape = (len(saves), len(names))
    volume, target = np.full(shape, np.nan), np.full(shape, np.nan)
    low, high = np.full((*shape, 3), np.nan), np.full((*shape, 3), np.nan)
    kind = np.full(shape, "", object)
    for t, save in enumerate(saves):
        for name, ball in save.items():
            k = names.index(name)
            target[t, k] = 4 / 3 * np.pi * ball.radius**3
            volume[t, k] = target[t, k] * (1 + ball.error / 100)
            origin, phi = _field(ball)
            low[t, k], high[t, k] = origin * H, (origin + np.array(phi.shape) - 1) * H
            kind[t, k] = ball.type
    per_cell, per_axis = ("time", "cell"), ("time", "cell", "axis")
    return {
        "volume": (per_cell, volume), "target_volume": (per_cell, target), "type": (per_cell, kind),
        "box_low": (per_axis, low), "box_high": (per_axis, high),
    }  # fmt: skip


def crowd(count: int, per_row: int = 5) -> dict[str, Ball]:
    """So many small balls side by side."""
    return {
        f"cell{k}": Ball((3.0 + 5 * (k % per_row), 3.0 + 5 * (k // per_row), 10.0), 2.0)
        for k in range(count)
    }


def all_touch(names: Sequence[str], area: float = 1.0) -> dict[tuple[str, str], float]:
    """Contacts between all of these."""
    return dict.fromkeys(combinations(names, 2), area)
