"""Checks of the full-grid solution: published trajectories, then exact results on small grids."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.io import loadmat

from . import full_grid as fg

SHARED = Path(__file__).resolve().parents[3] / "shared"
CELLS = ["ABal", "ABar", "ABpl", "ABpr", "MS", "E", "C", "P3"]
# Published attraction table 2: sisters and ABpl-E do not attract, all other pairs do.
WITHOUT_ATTRACTION = [
    ("ABal", "ABar"),
    ("ABpl", "ABpr"),
    ("MS", "E"),
    ("C", "P3"),
    ("ABpl", "E"),
]
H = 0.5

needs_shared = pytest.mark.skipif(
    not SHARED.is_dir(), reason="published example and reference runs (../shared) are absent"
)


# --- published trajectories --------------------------------------------------------------------


def load_cells(path: Path, name: str) -> fg.Array:
    """Read one field per cell, stored as y, x, z, and return them as x, y, z."""
    cells = loadmat(path)[name].ravel()
    return np.array([cell.transpose(1, 0, 2) for cell in cells], dtype=float)


def attraction_table() -> fg.Array:
    """Attraction between the eight cells, table 2."""
    sigma = np.full((8, 8), 0.5)
    for first, second in WITHOUT_ATTRACTION:
        i, j = CELLS.index(first), CELLS.index(second)
        sigma[i, j] = sigma[j, i] = 0
    return sigma


def published_rows(time: int) -> pd.DataFrame:
    """Rows of the published trajectory at one time, in the order of ``CELLS``."""
    table = pd.read_csv(SHARED / "reference" / "trajectory_weak.csv")
    return table[table.time == time].set_index("cell").loc[CELLS]


def assert_matches(phi: fg.Array, rows: pd.DataFrame) -> None:
    """Centroids and volumes above one half equal the rows to their last printed digit."""
    # The values are rounded: they may differ by half a unit of the last digit.
    expected = rows[["x_um", "y_um", "z_um"]]
    np.testing.assert_allclose(fg.centroid(phi, H), expected, rtol=0, atol=0.51e-4)
    above_half = np.count_nonzero(phi > 0.5, axis=(1, 2, 3)) * H**3
    np.testing.assert_array_equal(above_half, rows.volume_above_half_um3)


@needs_shared
def test_five_steps_equal_the_published_trajectory() -> None:
    example = SHARED / "matlab_example"
    masks = load_cells(example / "Example_8Cell.mat", "Mask")
    shell = loadmat(example / "Example_Eggshell.mat")["PhiShell"].transpose(1, 0, 2)
    model = fg.Model(
        h=H, sigma=attraction_table(), phi_e=shell.astype(float), targets=fg.volume(masks, H)
    )
    start = np.array([fg.published_start(mask, H) for mask in masks])
    np.testing.assert_allclose(fg.volume(start, H), model.targets, rtol=1e-10)

    phi = fg.run(start, model, dt=2.0, S=12.0, n_steps=5)

    rows = published_rows(time=10)
    assert_matches(phi, rows)
    np.testing.assert_allclose(fg.volume(phi, H), rows.volume_um3, rtol=0, atol=0.51e-3)


@needs_shared
def test_measures_of_a_published_state() -> None:
    phi = load_cells(SHARED / "reference" / "state_weak_t100.mat", "phi_save")
    # The stored state drops values below 1e-5, so its integral is not compared.
    assert_matches(phi, published_rows(time=100))

    table = pd.read_csv(SHARED / "reference" / "contacts_weak.csv").query("time == 100")
    pairs = zip(table.cell1.map(CELLS.index), table.cell2.map(CELLS.index), strict=True)
    expected = dict(zip(pairs, table.touching_voxels, strict=True))
    assert fg.touching_pairs(phi) == expected


# --- derivatives -------------------------------------------------------------------------------


def wave(n: int) -> tuple[fg.Array, float]:
    """exp(cos x) on n points of one period 2 pi, and the spacing."""
    h = 2 * np.pi / n
    return np.exp(np.cos(np.arange(n) * h)), h


def along(axis: int, profile: fg.Array) -> fg.Array:
    """One cell that varies along one axis and is constant over two points along the others."""
    shape = [1, 2, 2, 2]
    shape[axis + 1] = len(profile)
    return profile.reshape([-1 if a == axis + 1 else 1 for a in range(4)]) * np.ones(shape)


def gradient_error(n: int, kind: int | str, axis: int = 0) -> float:
    """Largest error of the gradient of exp(cos x) on n points."""
    profile, h = wave(n)
    exact = np.zeros((3, *along(axis, profile).shape))
    exact[axis] = along(axis, -np.sin(np.arange(n) * h) * profile)
    return np.abs(fg.gradient(along(axis, profile), fg.Model(h=h, gradient=kind)) - exact).max()


def laplacian_error(n: int, kind: int | str, axis: int = 0) -> float:
    """Largest error of the Laplacian of exp(cos x) on n points."""
    profile, h = wave(n)
    x = np.arange(n) * h
    exact = along(axis, (np.sin(x) ** 2 - np.cos(x)) * profile)
    return np.abs(fg.laplacian(along(axis, profile), fg.Model(h=h, laplacian=kind)) - exact).max()


@pytest.mark.parametrize("error", [gradient_error, laplacian_error])
@pytest.mark.parametrize("order", [2, 4, 6])
def test_difference_order(error: Callable[[int, int], float], order: int) -> None:
    assert np.log2(error(64, order) / error(128, order)) == pytest.approx(order, abs=0.1)


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize(
    ("error", "kind"), [(gradient_error, "fourier"), (laplacian_error, "exact")]
)
def test_fourier_derivatives_are_exact(
    error: Callable[[int, str, int], float], kind: str, axis: int
) -> None:
    assert error(32, kind, axis) < 1e-12
    assert error(33, kind, axis) < 1e-12


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_differences_act_along_each_axis(axis: int) -> None:
    assert gradient_error(64, 6, axis) == pytest.approx(gradient_error(64, 6), rel=1e-6)
    assert laplacian_error(64, 6, axis) == pytest.approx(laplacian_error(64, 6), rel=1e-6)


def test_second_difference_symbol_equals_its_stencil() -> None:
    phi = np.random.default_rng(1).random((1, 5, 6, 7))
    stencil = sum((np.roll(phi, 1, a) - 2 * phi + np.roll(phi, -1, a)) / H**2 for a in fg.GRID_AXES)
    model = fg.Model(h=H, laplacian=2)
    np.testing.assert_allclose(fg.laplacian(phi, model), stencil, atol=1e-12)


def test_highest_wave_has_no_fourier_gradient() -> None:
    phi = along(0, (-1.0) ** np.arange(8))
    np.testing.assert_allclose(fg.gradient(phi, fg.Model(h=H)), 0, atol=1e-14)


# --- forces ------------------------------------------------------------------------------------


def test_double_well_by_hand() -> None:
    phi = np.full((2, 2, 2, 2), 0.25)
    force = fg.double_well(phi, fg.Model(h=H, gamma=[0.25, 0.5], c=2))
    # W'(1/4) = 4/64 - 6/16 + 2/4 = 3/16
    np.testing.assert_allclose(force[:, 0, 0, 0], [-0.25 * 2 * 3 / 16, -0.5 * 2 * 3 / 16])


def test_repulsion_by_hand() -> None:
    phi = np.array([0.5, 0.25, 1.0]).reshape(3, 1, 1, 1)
    shell = np.full((1, 1, 1), 0.5)
    force = fg.repulsion(phi, fg.Model(h=H, g=2, g_e=8, phi_e=shell)).ravel()
    # -phi (8 * 1/4 + 2 * (sum of the others' squares))
    expected = [-0.5 * (2 + 2 * 1.0625), -0.25 * (2 + 2 * 1.25), -1.0 * (2 + 2 * 0.3125)]
    np.testing.assert_allclose(force, expected)


def test_attraction_by_hand() -> None:
    n = 16
    x = np.arange(n) * 2 * np.pi / n
    phi = np.concatenate([along(0, np.sin(x)), along(0, np.cos(x))])
    # Row j, column i: cell 1 pulls cell 0 with 3, cell 0 pulls cell 1 with 5, the 7s are unused.
    model = fg.Model(h=2 * np.pi / n, sigma=np.array([[7, 5], [3, 7]]))
    force = fg.attraction(phi, fg.gradient(phi, model), model)
    product = np.sin(x) * np.cos(x)  # minus the product of the two gradients
    np.testing.assert_allclose(force[:, :, 0, 0], [3 * product, 5 * product], atol=1e-12)


def test_volume_pressure_by_hand() -> None:
    n = 16
    h = 2 * np.pi / n
    x = np.arange(n) * h
    phi = along(0, 1 + np.sin(x))
    held = n * 4 * h**3
    relative = fg.Model(h=h, M=8, targets=np.array([2 * held]))
    absolute = replace(relative, M=0.5, volume_constraint="absolute")
    for model, strength in [(relative, 8 / 2), (absolute, 0.5 * held)]:
        force = fg.volume_pressure(phi, fg.gradient(phi, model), model)
        np.testing.assert_allclose(force[0, :, 0, 0], strength * np.abs(np.cos(x)), atol=1e-12)


def test_motility_by_hand() -> None:
    grad_phi = np.arange(6.0).reshape(3, 2, 1, 1, 1)  # cell 0: (0, 2, 4), cell 1: (1, 3, 5)
    noise = np.array([[1.0, -1.0, 0.5], [2.0, 0.0, 1.0]])
    force = fg.motility(grad_phi, noise, 0.25, fg.Model(h=H, kappa=3))
    np.testing.assert_allclose(force.ravel(), [-3 * 0.5 * 0, -3 * 0.5 * 7])


def test_force_is_the_sum_of_its_terms() -> None:
    rng = np.random.default_rng(2)
    phi, noise = rng.random((2, 4, 6, 5)), rng.standard_normal((2, 3))
    bare = fg.Model(h=H, volume_constraint=None)
    simple = fg.double_well(phi, bare) + fg.repulsion(phi, bare)
    np.testing.assert_allclose(fg.nonlinear_force(phi, bare), simple)

    model = fg.Model(h=H, sigma=np.ones((2, 2)), kappa=0.3, targets=np.array([20.0, 30.0]))
    grad_phi = fg.gradient(phi, model)
    full = simple + fg.attraction(phi, grad_phi, model) + fg.volume_pressure(phi, grad_phi, model)
    full += fg.motility(grad_phi, noise, 2.0, model)
    np.testing.assert_allclose(fg.nonlinear_force(phi, model, noise, 2.0), full)


# --- time steps --------------------------------------------------------------------------------


@pytest.mark.parametrize("c", [1.0, 2.0])
def test_tanh_profile_is_steady(c: float) -> None:
    h, n = 0.25, 240
    depth = 15 - np.abs(np.arange(n) * h - 30)
    phi = along(0, (1 + np.tanh(np.sqrt(c / 2) * depth)) / 2)
    model = fg.Model(h=h, c=c, volume_constraint=None)
    residual = model.gamma * fg.laplacian(phi, model) + fg.nonlinear_force(phi, model)
    assert np.abs(residual).max() < 1e-6
    assert np.abs(fg.run(phi, model, dt=2.0, S=12.0, n_steps=20) - phi).max() < 1e-5


def two_spheres() -> fg.Array:
    """Two soft, overlapping spheres on a small grid."""
    x, y, z = np.meshgrid(np.arange(20) * H, np.arange(12) * H, np.arange(12) * H, indexing="ij")
    distance = [np.sqrt((x - x0) ** 2 + (y - 3) ** 2 + (z - 3) ** 2) for x0 in (3.2, 6.6)]
    return np.array([(1 + np.tanh(2 - r)) / 2 for r in distance])


def small_model() -> fg.Model:
    """Two attracting cells, 10 % below their target volumes."""
    targets = 1.1 * fg.volume(two_spheres(), H)
    return fg.Model(h=H, sigma=np.full((2, 2), 0.5), targets=targets, gamma=[0.25, 0.3])


def test_implicit_steps_solve_their_equations() -> None:
    model, dt, S = small_model(), 0.5, 3.0
    old = two_spheres()
    force_old = fg.nonlinear_force(old, model)
    tension = fg.per_cell(model.gamma)

    phi = fg.step_first_order(old, model, dt, S)
    left = model.tau / dt * (phi - old)
    right = tension * fg.laplacian(phi, model) + force_old - S * (phi - old)
    np.testing.assert_allclose(left, right, atol=1e-11)

    force = fg.nonlinear_force(phi, model)
    new = fg.step_second_order(phi, old, force, force_old, model, dt, S)
    left = model.tau / (2 * dt) * (3 * new - 4 * phi + old)
    right = tension * fg.laplacian(new, model) + 2 * force - force_old - S * (new - 2 * phi + old)
    np.testing.assert_allclose(left, right, atol=1e-11)


@pytest.mark.parametrize("constraint", ["relative", "absolute", None])
def test_a_linearised_step_solves_its_equation(constraint: str | None) -> None:
    """The equation written with the new field, and second differences of steps that differ."""
    model = replace(small_model(), volume_constraint=constraint, M=0.5)
    old, dt, dt_old, S = two_spheres(), 0.8, 0.5, 3.0
    phi = fg.step_linearised(old, None, model, dt_old, S)
    new = fg.step_linearised(phi, old, model, dt, S, dt_old)
    tension, r = fg.per_cell(model.gamma), dt / dt_old
    for ahead, now, after, step, rate in (
        (old, old, phi, dt_old, (phi - old) / dt_old),
        (
            phi + r * (phi - old), phi, new, dt,
            ((1 + 2 * r) / (1 + r) * new - (1 + r) * phi + r**2 / (1 + r) * old) / dt,
        ),
    ):  # fmt: skip
        u = after - ahead
        curvature = (ahead - 0.5) ** 2 * 12 - 1
        others = model.g * ahead[::-1] ** 2
        damped = (tension * model.c * curvature + others) * u
        spread = (tension + S / (2 * model.c)) * fg.laplacian(u, replace(model, laplacian=2))
        ahead_rate = model.tau * (rate - (ahead - now) / step)
        force = fg.nonlinear_force(ahead, model) + tension * fg.laplacian(ahead, model)
        left = ahead_rate + model.tau / step * (ahead - now)
        gap = force + spread - damped - left  # q |grad(phi*)|
        slope = np.sqrt((fg.gradient(ahead, model) ** 2).sum(axis=0))
        q = (gap * slope).sum(axis=fg.GRID_AXES) / (slope**2).sum(axis=fg.GRID_AXES)
        np.testing.assert_allclose(gap, fg.per_cell(q) * slope, atol=2e-8)
        lost = fg.volume_stiffness(model) * fg.volume(u, H)  # about: u is no shift alone
        np.testing.assert_allclose(q, np.broadcast_to(lost, q.shape), rtol=0.15, atol=1e-9)


def observed_order(scheme: str, S: float) -> float:
    """Order in dt from the changes between three successive halvings of dt, up to t = 0.8."""
    ends = [
        fg.run(two_spheres(), small_model(), 0.8 / n, S, scheme, n_steps=n) for n in (16, 32, 64)
    ]
    coarse, fine = np.diff(ends, axis=0)
    return np.log2(np.linalg.norm(coarse) / np.linalg.norm(fine))


@pytest.mark.parametrize(
    ("scheme", "S", "order"),
    [("bdf2", 2, 2), ("imex1", 2, 1), ("imex1", 0, 1), ("euler", 0, 1), ("linearised", 2, 2)],
)
def test_order_in_time(scheme: str, S: float, order: int) -> None:
    assert observed_order(scheme, S) == pytest.approx(order, abs=0.05)


def test_schemes_have_the_same_limit() -> None:
    def end(scheme: str, n_steps: int) -> fg.Array:
        return fg.run(two_spheres(), small_model(), 0.4 / n_steps, 0, scheme, n_steps=n_steps)

    second_order = end("bdf2", 64)
    np.testing.assert_allclose(end("linearised", 64), second_order, atol=1e-5)
    for scheme in ("imex1", "euler"):
        # First order: twice the fine result minus the coarse one is nearly exact.
        extrapolated = 2 * end(scheme, 64) - end(scheme, 32)
        np.testing.assert_allclose(extrapolated, second_order, atol=2e-5)


@pytest.mark.parametrize("scheme", fg.SCHEMES)
def test_noise_moves_a_cell(scheme: str) -> None:
    h, kappa, dt, n_steps = 0.25, 0.4, 0.02, 10
    x = np.arange(96) * h

    def slab(centre: float) -> fg.Array:
        return along(1, (1 + np.tanh(6 - np.abs(x - centre))) / 2)

    asked = []

    def noise(step: int) -> fg.Array:
        asked.append(step)
        return np.array([[0.0, 1.0, 0.0]])

    model = fg.Model(h=h, kappa=kappa, volume_constraint=None)
    end = fg.run(slab(12), model, dt, 0, scheme, n_steps=n_steps, noise=noise)

    assert asked == list(range(n_steps))
    # d(phi)/dt = -v . grad(phi) moves phi by v t, here with v = kappa sqrt(dt) / tau.
    moved = kappa * np.sqrt(dt) / model.tau * n_steps * dt
    assert np.abs(end - slab(12 + moved)).max() < 0.01 * np.abs(end - slab(12)).max()


def test_on_step_sees_each_step() -> None:
    seen = {}
    end = fg.run(two_spheres(), small_model(), 0.1, n_steps=3, on_step=seen.__setitem__)
    assert list(seen) == [1, 2, 3]
    assert seen[3] is end


def test_unknown_scheme_names_the_known_ones() -> None:
    with pytest.raises(ValueError, match="'rk4'; known schemes are bdf2, imex1, euler, linearised"):
        fg.run(two_spheres(), small_model(), 0.1, scheme="rk4", n_steps=1)


# --- start and measures ------------------------------------------------------------------------


def test_published_start_keeps_the_volume() -> None:
    mask = np.zeros((24, 26, 28))
    mask[6:18, 7:19, 8:20] = 1
    phi = fg.published_start(mask, H)
    assert phi.sum() == pytest.approx(mask.sum(), rel=1e-12)
    assert phi[12, 13, 14] > 0.99
    assert phi[0, 0, 0] < 0.01


def test_centroid_weighs_by_phi_and_ignores_the_faint() -> None:
    phi = np.zeros((1, 5, 5, 5))
    phi[0, 1, 2, 3], phi[0, 3, 2, 3], phi[0, 0, 0, 0] = 0.25, 0.75, 0.02
    np.testing.assert_allclose(fg.centroid(phi, H), [[2.5 * H, 2 * H, 3 * H]])


def test_touching_needs_regions_two_points_apart_at_most() -> None:
    phi = np.zeros((3, 9, 5, 5))
    for cell, x in enumerate([1, 3, 6]):
        phi[cell, x, 2, 2] = 0.45
    assert fg.touching_pairs(phi) == {(0, 1): 1}
