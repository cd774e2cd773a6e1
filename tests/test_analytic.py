"""The engine against what is known without it: exact results, orders, symmetries and bounds."""

import tracemalloc
from collections.abc import Sequence
from typing import Any

import numba
import numpy as np
import pytest
from numpy.typing import NDArray

import morphosim.engine.coupling
import morphosim.physics.motility
from morphosim.engine.column_sums import ColumnCover
from morphosim.engine.engine import Engine
from morphosim.geometry.confinement import EllipsoidShell
from morphosim.kernels.noise import normal_vectors
from morphosim.physics.attraction import Attraction

from .helpers import (
    H,
    advance,
    centroids,
    distance,
    grid_around,
    lattice,
    make_engine,
    on_grid,
    sphere,
)
from .reference import full_grid as fg

TAU, GAMMA = 2.62, 0.25
CENTER = (0.1, 0.2, -0.3)


# --- equilibria ----------------------------------------------------------------------------------


def radial_profile(engine: Engine) -> tuple[NDArray, NDArray]:
    """Distance from the centroid, and φ, at the points of the first cell's box."""
    box, origin = engine.pool.box(0), engine.pool.origin[0]
    h = engine.numerics.spacing
    axes = [(np.arange(n) + o) * h for n, o in zip(box.shape, origin, strict=True)]
    points = np.meshgrid(*axes, indexing="ij", sparse=True)
    return distance(points, centroids(engine)[0]).ravel(), box.ravel()


def radius(engine: Engine) -> float:
    """Where φ = 1/2: artanh(2φ - 1) is linear in the distance near there."""
    r, phi = radial_profile(engine)
    near = np.abs(phi - 0.5) < 0.3
    slope, offset = np.polyfit(r[near], np.arctanh(2 * phi[near] - 1), 1)
    return -offset / slope


def relaxed(start_radius: float, **physics: Any) -> Engine:
    """A free cell at rest, from a start with an interface twice too wide."""
    width = 0.5 * np.sqrt(physics.get("c", 2.0) / 2)
    engine = make_engine(
        [sphere(CENTER, start_radius, scale=width, tail=1e-5)],
        dt=1.0, S=3.0, box_tolerance=1e-4, physics=physics,
    )  # fmt: skip
    return advance(engine, 100, [4 / 3 * np.pi * start_radius**3])


def profile_error(engine: Engine) -> float:
    """Largest difference from (1 + tanh(√(c/2) d)) / 2, d being the depth."""
    r, phi = radial_profile(engine)
    scale = np.sqrt(engine.physics.c / 2)
    return np.abs(phi - 0.5 * (1 + np.tanh(scale * (radius(engine) - r)))).max()


@pytest.mark.parametrize("c", [1.0, 2.0])
def test_a_large_cell_has_the_tanh_profile(c: float) -> None:
    # Measured: 0.31 / (c R²) at R = 7 and 10; what is left is the curvature of the surface.
    for start_radius in (7.0, 10.0):
        engine = relaxed(start_radius, c=c)
        assert profile_error(engine) * c * radius(engine) ** 2 == pytest.approx(0.32, abs=0.02)


@pytest.mark.parametrize(
    ("start_radius", "physics", "relative", "absolute"),
    [
        (4.0, {"M": 2.0}, 2.0, 0.0),
        (4.0, {}, 8.0, 0.0),
        (7.0, {}, 8.0, 0.0),
        (7.0, {"volume_constraint": "absolute"}, 0.0, 0.0016),
    ],
)
def test_the_volume_deficit_balances_surface_tension(
    start_radius: float, physics: dict, relative: float, absolute: float
) -> None:
    """M' (1 - v/V) or M (V - v), with the paper's values by default, holds against 2 γ / R."""
    # Measured: 1 + 0.36 / R² times that.
    engine = relaxed(start_radius, **physics)
    R, target = radius(engine), 4 / 3 * np.pi * start_radius**3
    deficit = target - engine.volumes[0]
    pressure = relative * deficit / target + absolute * deficit
    assert pressure / (2 * GAMMA / R) == pytest.approx(1 + 0.36 / R**2, abs=0.1 / R**2)


def test_a_sphere_shrinks_by_its_curvature() -> None:
    # Without a volume constraint d(R²)/dt = -4 γ / τ. Up to t = 10 the profile and the speed
    # settle. Measured from there to t = 30: 0.5 % more.
    engine = make_engine(
        [sphere(CENTER, 8.0, tail=1e-5)],
        dt=0.5, S=2.0, box_tolerance=1e-4, physics={"volume_constraint": "none"},
    )  # fmt: skip
    squares = [radius(advance(engine, steps)) ** 2 for steps in (20, 40)]
    assert squares[0] - squares[1] == pytest.approx(4 * GAMMA / TAU * 20, rel=0.01)


# --- orders --------------------------------------------------------------------------------------


def end_state(steps: int, **numerics: Any) -> NDArray:
    """A small cell at t = 1.6 that started 10 % below its volume, on a common grid."""
    # Any κ makes the kernel that other tests use; this one is too weak to act.
    kappa = 1e-30 if numerics["scheme"] == "imex1" else 0.0
    engine = make_engine(
        [sphere(CENTER, 2.0, tail=1e-7)],
        dt=1.6 / steps, box_tolerance=1e-6, physics={"kappa": kappa}, **numerics,
    )  # fmt: skip
    advance(engine, steps, 1.1 * engine.volumes)
    return on_grid(engine, (-25,) * 3, (50,) * 3)


@pytest.mark.parametrize(
    ("numerics", "order"),
    [
        ({"scheme": "imex1", "S": 2.0}, 1),
        ({"scheme": "imex1", "S": 0.0}, 1),
        ({"scheme": "bdf2", "S": 2.0}, 2),
        ({"scheme": "bdf2", "S": 2.0, "start_S": 0.0}, 2),
    ],
)
def test_order_in_time(numerics: dict, order: int) -> None:
    # The first step of "bdf2" is by Eq. 8: an error of O(δt²) in one step only, so the whole is of
    # second order with a stabilised start or without. S acts as an inertia S δt² ∂²φ/∂t², which
    # is of second order too. Both need S δt < τ; here S δt is 0.1 at most.
    ends = [end_state(steps, **numerics) for steps in (32, 64, 128)]
    coarse, fine = (np.linalg.norm(d) for d in np.diff(ends, axis=0))
    assert np.log2(coarse / fine) == pytest.approx(order, abs=0.1)


def blob(h: float) -> tuple[NDArray, NDArray]:
    """A Gaussian: no kink, and gone at the faces of its box."""
    origin, points = lattice((-15,) * 3, (15,) * 3, h)
    return origin, 0.9 * np.exp(-(distance(points, CENTER) ** 2) / 8)


def space_error(h: float, order: int) -> float:
    """L² distance from the Fourier solution on the same lattice after two noisy steps."""
    engine = make_engine(
        [blob(h)], scheme="imex1", S=0.0, dt=0.1, order=order, laplacian="stencil",
        box_tolerance=1e-11, spacing=h, physics={"volume_constraint": "none", "kappa": 2.0},
    )  # fmt: skip
    low, shape = grid_around(engine, margin=2)
    model = fg.Model(h=h, kappa=2.0, volume_constraint=None)
    exact = fg.run(
        on_grid(engine, low, shape), model, 0.1, 0.0, "imex1",
        n_steps=2, noise=lambda step: drawn(engine, step),
    )  # fmt: skip
    return float(np.linalg.norm(on_grid(advance(engine, 2), low, shape) - exact) * h**1.5)


@pytest.mark.parametrize("order", [2, 4, 6])
def test_order_in_space(order: int) -> None:
    # Volume pressure is left out: |∇φ| has a kink at the centre of a cell, and so no order.
    coarse, fine = (space_error(h, order) for h in (0.5, 0.3125))
    observed = np.log(coarse / fine) / np.log(0.5 / 0.3125)
    assert observed == pytest.approx(order, abs=0.25)


# --- noise ---------------------------------------------------------------------------------------


def drawn(engine: Engine, step: int) -> NDArray:
    """The normal vectors of a step."""
    u = np.zeros((len(engine), 3))
    normal_vectors(np.uint64(engine.numerics.seed), np.uint64(step), engine.cells["id"], u)
    return u


def displacements(forces: Sequence[NDArray], rate: float, inertia: float, scheme: str) -> NDArray:
    """What a scheme makes of τ dx/dt = f; `rate` is τ/δt, `inertia` what stabilises it.

    "imex1": (rate + inertia) v = f with v the way of one step. "bdf2":
    (3/2 rate + inertia) v = (rate/2 + inertia) v_old + 2 f - f_old.
    """
    x = v = old = np.zeros_like(forces[0])
    for step, f in enumerate(forces):
        if scheme == "imex1" or step == 0:
            v = f / (rate + inertia)
        else:
            v = ((rate / 2 + inertia) * v + 2 * f - old) / (1.5 * rate + inertia)
        x, old = x + v, f
    return x


@pytest.mark.parametrize("scheme", ["imex1", "bdf2"])
def test_noise_makes_free_cells_diffuse(scheme: str) -> None:
    """By Eq. S3 the force is κ √δt u, so a step moves a cell by κ δt^(3/2) u / τ.

    Then <x²> = (κ δt / τ)² t per axis: it grows with δt². S is an inertia. In "imex1" it divides
    each way by 1 + S δt/τ for good; in "bdf2" it only delays. The implicit Laplacian with the
    explicit double well adds γ <k²> to S: <k²> = ∫φ''² / ∫φ'² = 0.8 c/2 for the tanh profile.
    """
    dt, S, kappa, steps, n = 0.5, 2.0, 0.5, 48, 64
    engine = make_engine(
        [sphere((30.0 * i, 0.1, -0.2), 2.5, tail=1e-4) for i in range(n)],
        scheme=scheme, dt=dt, S=S, physics={"kappa": kappa, "g": 0},
    )  # fmt: skip
    begin = centroids(engine)
    moved = centroids(advance(engine, steps)) - begin
    inertia = S + 0.8 * GAMMA
    forces = [kappa * np.sqrt(dt) * drawn(engine, step) for step in range(steps)]
    expected = displacements(forces, TAU / dt, inertia, scheme)
    ratio = (moved * expected).sum() / (expected**2).sum()
    np.testing.assert_allclose(moved, expected, atol=0.03 * moved.std())
    assert ratio == pytest.approx(1, abs=0.015)
    lasting = inertia if scheme == "imex1" else 0.0
    limit = (kappa * dt / (TAU + lasting * dt)) ** 2 * steps * dt
    assert (moved**2).mean() == pytest.approx(limit, rel=3 * np.sqrt(2 / moved.size))


@pytest.mark.parametrize(("start_S", "inertia"), [(None, 6.0), (1.5, 1.5), (0.0, 0.0)])
def test_the_first_step_has_an_inertia_of_its_own(start_S: float | None, inertia: float) -> None:
    dt, kappa = 0.25, 0.5
    engine = make_engine(
        [sphere(CENTER, 3.0, tail=1e-5)],
        dt=dt, S=6.0, start_S=start_S, box_tolerance=1e-4, physics={"kappa": kappa},
    )  # fmt: skip
    begin = centroids(engine)
    moved = centroids(advance(engine, 1)) - begin
    expected = kappa * np.sqrt(dt) * drawn(engine, 0) / (TAU / dt + inertia + 0.8 * GAMMA)
    np.testing.assert_allclose(moved, expected, atol=0.05 * np.abs(expected).max())


# --- symmetries ----------------------------------------------------------------------------------

MIXED = Attraction(types={("A", "B"): 0.8, ("B", "B"): 0.3}, pairs={("0", "1"): 0.5})
BALLS = [((0.0, 0.0, 0.0), 2.5), ((4.25, 0.5, 0.25), 2.5), ((1.75, 3.75, -0.5), 2.25)]


def cluster(shift: Sequence[float] = (0, 0, 0), steps: int = 20, **numerics: Any) -> Engine:
    """Three cells with all terms, moved by `shift` lattice steps."""
    whole = np.floor(shift).astype(int)
    rest = (np.asarray(shift) - whole) * H
    fields = [sphere(np.asarray(c) + rest, r, tail=3e-6) for c, r in BALLS]
    shell = EllipsoidShell(
        center=np.array([2, 1.5, 0]) + np.asarray(shift) * H, semi_axes=(6, 5, 4), width=1.0
    )
    engine = make_engine(
        [(origin + whole, phi) for origin, phi in fields],
        shell=shell, types=["A", "B", "B"], dt=1.0, S=16.0,
        physics={"sigma": MIXED, "kappa": 0.2}, **({"box_tolerance": 1e-4} | numerics),
    )  # fmt: skip
    return advance(engine, steps, [80.0, 80.0, 60.0])


two_threads = pytest.mark.skipif(
    numba.config.NUMBA_NUM_THREADS < 2, reason="Numba has one thread (NUMBA_NUM_THREADS)"
)


def assert_same(one: Engine, other: Engine, shift: Sequence[int] = (0, 0, 0)) -> None:
    """The same bits, `shift` lattice steps apart."""
    assert not len(one.diverged())
    np.testing.assert_array_equal(other.pool.origin, one.pool.origin + shift)
    for i in range(len(one)):
        np.testing.assert_array_equal(one.pool.box(i), other.pool.box(i))


@two_threads
def test_the_number_of_threads_does_not_matter() -> None:
    assert_same(cluster(threads=1), cluster(threads=2))


@two_threads
@pytest.mark.parametrize("transform", ["scipy", "pyfftw"])
def test_the_number_of_threads_does_not_matter_to_libraries(transform: str) -> None:
    # Boxes of one shape and many steps, so that threads get into each other's way if they can.
    fields = [sphere((20.0 * i, 0.1, 0.2), 2.5, tail=1e-4) for i in range(16)]
    runs = [make_engine(fields, transform=transform, threads=n, physics={"g": 0}) for n in (1, 2)]
    for engine in runs:
        advance(engine, 40, [70.0] * 16)
    assert_same(*runs)


@pytest.mark.parametrize("shift", [(5, -3, 13), (100_000, -70_000, 1)])
def test_whole_lattice_steps_do_not_matter(shift: tuple) -> None:
    assert_same(cluster(), cluster(shift), shift)


@pytest.mark.parametrize("shift", [(0.5, 0, 0), (0.5, 0.5, 0.5)])
def test_half_a_lattice_step_hardly_matters(shift: tuple) -> None:
    # Measured: 0.1 nm while the cells move by 0.5 µm.
    begin, one, other = cluster(steps=0), cluster(), cluster(shift)
    apart = centroids(other) - centroids(one) - np.asarray(shift) * H
    assert np.abs(centroids(one) - centroids(begin)).max() > 0.3
    assert np.abs(apart).max() < 4e-4
    np.testing.assert_allclose(other.volumes, one.volumes, rtol=4e-5)


# --- what is absent costs nothing ----------------------------------------------------------------


def fail(*_: object) -> None:
    raise AssertionError("work for a term that is absent")


def test_a_cell_in_open_space_needs_no_sums(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("accumulate", "accumulate_pairs"):
        monkeypatch.setattr(morphosim.engine.coupling, name, fail)
    monkeypatch.setattr(morphosim.physics.motility, "normal_vectors", fail)
    monkeypatch.setattr(ColumnCover, "update", fail)
    engine = make_engine([sphere(CENTER, 2.5)], physics={"sigma": 0.5})
    volume = engine.volumes[0]
    advance(engine, 2, [1.1 * volume])
    assert engine.volumes[0] > volume
    with pytest.raises(AssertionError, match="absent"):
        make_engine([sphere(CENTER, 2.5)] * 2)


def memory(gap: float) -> tuple[int, int]:
    """Bytes of two cells so far apart: by the engine's account, and by Python's."""
    fields = [sphere((x, 0.1, 0.2), 2.5, tail=1e-4) for x in (0.0, gap)]

    def run() -> Engine:
        return advance(make_engine(fields, precision="single", physics={"sigma": 0.5}), 3)

    run()  # compiles
    tracemalloc.start()
    engine = run()
    traced = tracemalloc.get_traced_memory()[0]
    tracemalloc.stop()
    return engine.nbytes, traced


def test_memory_does_not_follow_the_distance() -> None:
    # Cells that touch need some more: the columns where their boxes meet.
    near, far = memory(4.5), memory(10_000.0)
    assert far[0] < 1.1 * near[0]
    assert far[1] < 1.1 * near[1]


# --- certificates --------------------------------------------------------------------------------


def test_boxes_follow_a_cell_that_is_driven() -> None:
    # B is drawn to A, A is not drawn to B: B pushes A along for good.
    tolerance = 1e-3
    one_sided = Attraction(types={("A", "B"): 1.0, ("B", "A"): 0.0})
    engine = make_engine(
        [sphere((0, 0, 0), 2.5, tail=1e-4), sphere((5.3, 0.4, 0.2), 2.5, tail=1e-4)],
        types=["B", "A"], dt=1.0, S=6.0, box_tolerance=tolerance, precision="single",
        physics={"sigma": one_sided},
    )  # fmt: skip
    begin, targets = centroids(engine), engine.volumes.copy()
    advance(engine, 400, targets)
    assert (centroids(engine) - begin)[:, 0].min() > 12 * H
    assert 0 < np.abs(engine.lost_volume).max() < 6e-3 * targets.min()
    assert (engine.face_peak < 1.5 * tolerance).all()
    assert (engine.face_peak > tolerance).all(), "boxes only move when a face is reached"
    np.testing.assert_allclose(engine.volumes, targets, rtol=0.05)


# --- cells that go -------------------------------------------------------------------------------


def test_a_cell_without_volume_constraint_vanishes() -> None:
    # R² = R0² - 4 γ t / τ is zero after 5.9.
    engine = make_engine(
        [sphere((30.0 * i, 0.1, 0.2), R, tail=1e-4) for i, R in enumerate((1.5, 4.0))],
        dt=0.2, S=2.0, physics={"volume_constraint": "none", "g": 0},
    )  # fmt: skip
    assert not len(advance(engine, 10).vanished())
    assert advance(engine, 25).vanished().tolist() == [0]
    assert not len(engine.diverged())


def test_a_cell_that_diverges_is_told_and_keeps_its_field() -> None:
    fields = [sphere((30.0 * i, 0.1, 0.2), 2.5, tail=1e-4) for i in range(2)]
    engine = advance(make_engine(fields, S=2.0, dt=0.5, physics={"g": 0}), 2)
    engine.pool.box(1, engine.pool.history)[8, 8, 8] = np.nan
    before, volumes = engine.pool.box(1).copy(), engine.volumes
    assert advance(engine, 1, 1.1 * volumes).diverged().tolist() == [1]
    np.testing.assert_array_equal(engine.pool.box(1), before)
    assert engine.volumes[1] == volumes[1]
    assert engine.volumes[0] > 1.001 * volumes[0]
