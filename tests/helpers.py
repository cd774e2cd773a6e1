"""What several test files need: engines from a few numbers, and fields on a common grid."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, cast

import netCDF4
import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage

from morphosim import Scene, built_in_scene, scene_names
from morphosim.engine.box_pool import BoxPool
from morphosim.engine.engine import Engine
from morphosim.kernels.noise import normal_vectors
from morphosim.kernels.rows import BLOCK, RIM
from morphosim.numerics.parameters import Numerics
from morphosim.period import Period
from morphosim.physics.parameters import Physics

H = 0.5
TAIL = 1e-9
"""Start fields are laid out to where their profile falls below this."""
EXPECTED_TO_FAIL = pytest.mark.filterwarnings(
    "ignore::morphosim.scene.stability.StabilityWarning",
    "ignore::morphosim.errors.ResolutionWarning",
)
"""For tests of scenes that are beyond what is stable, or what a lattice resolves."""
ONE_CELL = """
duration = 8
save_every = 4
[numerics]
threads = 1
[[cells]]
name = "a"
shape = { kind = "sphere", center = [0, 0, 0], radius = 3 }
"""
"""Scene file."""
StartField = tuple[NDArray[np.int64], NDArray[np.float64]]
SMALL: dict[str, dict[str, Any]] = {
    "blastoderm": {
        "cells.count": 60, "confinement.semi_axes": [60, 30, 30], "confinement.core": [45, 15, 15],
    },
    "sorting": {"cells.counts.A": 20, "cells.counts.B": 20},
}  # fmt: skip
"""What makes large built-in scenes small."""


def built_in_scenes() -> list[Scene]:
    """All built-in scenes, the large ones small."""
    return [built_in_scene(name, SMALL.get(name, {})) for name in scene_names()]


def lattice(low: ArrayLike, high: ArrayLike, h: float) -> tuple[NDArray[np.int64], list]:
    """First lattice index, and open coordinate axes, of the points between two corners (µm)."""
    first = np.floor(np.asarray(low) / h).astype(np.int64)
    last = np.ceil(np.asarray(high) / h).astype(np.int64)
    axes = [np.arange(a, b + 1) * h for a, b in zip(first, last, strict=True)]
    return first, np.meshgrid(*axes, indexing="ij", sparse=True)


def distance(points: Sequence[NDArray], center: ArrayLike) -> NDArray[np.float64]:
    """Distance of lattice points to a centre, µm."""
    return np.sqrt(sum((p - o) ** 2 for p, o in zip(points, np.asarray(center), strict=True)))


def sphere(
    center: ArrayLike, radius: float, h: float = H, scale: float = 1.0, tail: float = TAIL
) -> StartField:
    """Start field (1 + tanh(scale · depth)) / 2 of a ball, down to `tail`."""
    reach = radius - np.log(tail) / (2 * scale)
    origin, points = lattice(np.asarray(center) - reach, np.asarray(center) + reach, h)
    return origin, 0.5 * (1 + np.tanh(scale * (radius - distance(points, center))))


def make_engine(
    fields: Sequence[StartField],
    *,
    types: Sequence[str] | None = None,
    gamma: ArrayLike | None = None,
    frozen: Sequence[int] = (),
    shell: object = None,
    physics: dict | None = None,
    period: ArrayLike = (0, 0, 0),
    **numerics: object,
) -> Engine:
    """Engine of cells "0", "1", … in double precision on one thread, unless told otherwise.

    It looks at no error in space: that kernel is compiled anew for each combination of terms.
    """
    n = len(fields)
    chosen = {"precision": "double", "threads": 1, "spacing": H} | numerics
    repeats = Period.of(period, float(cast(float, chosen["spacing"])))
    engine = Engine(
        Physics(**(physics or {})), Numerics.preset("published", **chosen), shell, period=repeats
    )
    engine._accuracy._measure = lambda *_: None
    columns = {
        "name": [str(i) for i in range(n)],
        "own_tension": np.nan if gamma is None else gamma,
        "frozen": np.isin(np.arange(n), frozen),
    }
    engine.start(columns, list(types or [""] * n), list(fields))
    engine.settle()
    return engine


def advance(engine: Engine, steps: int, targets: ArrayLike | None = None) -> Engine:
    """Take steps; the target volumes are by default what the cells have now."""
    engine.cells["target"][:] = engine.volumes if targets is None else targets
    with engine.limited_threads():
        for _ in range(steps):
            engine.step()
    return engine


def on_grid(engine: Engine, low: ArrayLike, shape: Sequence[int]) -> NDArray[np.float64]:
    """Fields (N, nx, ny, nz) on a grid that holds every box; `low` is its first lattice point."""
    full = np.zeros((len(engine), *shape))
    for i in range(len(engine)):
        first = engine.pool.origin[i] - np.asarray(low)
        last = first + engine.pool.shape[i]
        assert np.all(first >= 0), "box outside the grid"
        assert np.all(last <= np.asarray(shape)), "box outside the grid"
        full[i][tuple(slice(a, b) for a, b in zip(first, last, strict=True))] = engine.pool.box(i)
    return full


def grid_around(engine: Engine, margin: int) -> tuple[NDArray[np.int64], tuple[int, ...]]:
    """First lattice point and shape of a grid `margin` points larger than all boxes."""
    low = engine.pool.origin.min(axis=0) - margin
    high = (engine.pool.origin + engine.pool.shape).max(axis=0) + margin
    shape = high - low
    return low, tuple(int(n) for n in shape + shape % 2)


def band_of(pool: BoxPool, i: int) -> NDArray[np.bool_]:
    """Which points of cell i's box are in its band, whose spans are as they should be."""
    nx, ny, nz = pool.shape[i].tolist()
    rows = pool.rows_of(i)
    low, high, place = (v[rows].astype(int) for v in (pool.low, pool.high, pool.place))
    length = high - low
    assert len(length) == nx * ny
    assert ((low >= 0) & (high <= nz)).all()
    assert ((length == 0) | (length >= BLOCK)).all()
    if pool.band_only:
        np.testing.assert_array_equal(place + low, np.cumsum(length) - length)
        assert length.sum() <= pool.room[i]
    else:
        np.testing.assert_array_equal(place, nz * np.arange(nx * ny))
    z = np.arange(nz)
    return ((low[:, None] <= z) & (z < high[:, None])).reshape(nx, ny, nz)


def assert_band_alone(pool: BoxPool, i: int) -> None:
    """What is up to `RIM` steps from the tolerance is in cell i's band, and no other row."""
    inside = band_of(pool, i)
    wanted = ndimage.binary_dilation(np.abs(pool.box(i)) > pool.limits.tolerance, iterations=RIM)
    assert not (wanted & ~inside).any()
    np.testing.assert_array_equal(wanted.any(axis=2), inside.any(axis=2))
    assert not inside.all()
    for values in (pool.phi, pool.history):
        if values is not None:
            assert not pool.box(i, values)[~inside].any()
            np.testing.assert_array_equal(pool.box(i, values)[inside], values[pool.stretch(i)])


def index_of(pool: BoxPool, i: int, point: tuple[int, int, int]) -> int:
    """Where a point of cell i's box is in the pools."""
    assert not pool.band_only or band_of(pool, i)[point]
    row = pool.row_start[i] + point[0] * pool.shape[i, 1] + point[1]
    return int(pool.start[i] + pool.place[row] + point[2])


def centroids(engine: Engine) -> NDArray[np.float64]:
    """Centroid of each cell, Σ φ x / Σ φ, µm."""
    h = engine.numerics.spacing
    result = np.zeros((len(engine), 3))
    for i in range(len(engine)):
        box, origin = engine.pool.box(i).astype(float), engine.pool.origin[i]
        axes = np.indices(box.shape, sparse=True)
        result[i] = [
            (box * (a + o)).sum() / box.sum() * h for a, o in zip(axes, origin, strict=True)
        ]
    return result


def normals(engine: Engine) -> Callable[[int], NDArray] | None:
    """The random vectors of the engine's steps."""

    def of_step(step: int) -> NDArray:
        u = np.zeros((len(engine), 3))
        normal_vectors(np.uint64(engine.numerics.seed), np.uint64(step), engine.cells["id"], u)
        return u

    return of_step if engine.physics.kappa > 0 else None


def full_centroids(phi: NDArray, low: NDArray) -> NDArray:
    """Σ φ x / Σ φ on the full grid, µm."""
    axes = np.indices(phi.shape[1:], sparse=True)
    moments = [(phi * (a + o)).sum(axis=(1, 2, 3)) for a, o in zip(axes, low, strict=True)]
    return np.stack(moments, axis=1) / phi.sum(axis=(1, 2, 3))[:, None] * H


def adopt_save(save: Path, target: Path, time: float, step: int) -> None:
    """Move a save of another run to `target`, as if that directory's run had made it then."""
    save.rename(target)
    with netCDF4.Dataset(target.with_name("save-000000.nc")) as first:
        run_id = first.getncattr("run_id")
    with netCDF4.Dataset(target, "a") as file:
        file.setncattr("run_id", run_id)
        file["time"][:], file["step"][:] = time, step
