"""The engine against the plain full-grid solution: each term alone, and all of them together.

Both start from the same fields. They differ by what a cell loses beyond its box, where |φ| is
below `box_tolerance`. Each case also solves the full grid without its term, or with the term a
little different, and requires a difference far above the tolerance: no case passes without it.

Numba compiles a step anew for each combination of absent terms. To keep these few, some cases
hold a term at a negligible strength instead of leaving it out.
"""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from morphosim.engine.engine import Engine
from morphosim.geometry.confinement import EllipsoidShell
from morphosim.physics.attraction import Attraction

from .helpers import (
    H,
    advance,
    centroids,
    full_centroids,
    grid_around,
    make_engine,
    normals,
    on_grid,
    sphere,
)
from .reference import full_grid as fg

BALLS = [((0.0, 0.0, 0.0), 2.5), ((4.2, 0.6, 0.3), 2.5), ((1.8, 3.8, -0.4), 2.3)]
GROWTH = np.array([1.15, 1.0, 0.9])
"""Target volumes, as multiples of the volumes at the start."""
BOX_TOLERANCE = 1e-5
NONE = 1e-30
"""A strength that is not zero and has no effect."""
SHELL = EllipsoidShell(center=(2, 1.5, 0), semi_axes=(5, 4.6, 3), width=1.0)
WIDE_SHELL = EllipsoidShell(center=(2, 1.5, 0), semi_axes=(99, 99, 99), width=1.0)
NAMES, TYPES = ["0", "1", "2"], ["A", "B", "B"]
BY_TYPE = {("A", "B"): 0.8, ("B", "A"): 0.6, ("B", "B"): 0.3}
# In these matrices row j pulls and column i is pulled.
TYPE_MATRIX = np.array([[0, 0.8, 0.8], [0.6, 0, 0.3], [0.6, 0.3, 0]])
UNEVEN = np.array([[0, 0.5, 0.9], [0.2, 0, 0.1], [0.1, 0.7, 0]])
MIXED = Attraction(types=BY_TYPE, pairs={("0", "1"): 0.5, ("1", "0"): 0.2})
MIXED_MATRIX = np.array([[0, 0.5, 0.8], [0.2, 0, 0.3], [0.6, 0.3, 0]])
EVEN = np.ones((3, 3))


@dataclass(frozen=True, kw_only=True)
class Limits:
    """Allowed deviations, about three times the measured ones."""

    first: float = 5e-6
    """Field after one step."""
    tenth: float = 2.5e-5
    """Field after ten steps."""
    centroid: float = 0.02
    """nm, after ten steps."""
    volume: float = 5e-5
    """Relative, at both times."""


@dataclass(frozen=True, kw_only=True)
class Case:
    """A scene; `sigma` is its attraction for the full grid, each of `without` changes a term."""

    physics: dict = field(default_factory=dict)
    numerics: dict = field(default_factory=dict)
    sigma: NDArray | None = None
    gamma: tuple = (0.25, 0.25, 0.25)
    shell: EllipsoidShell | None = None
    types: list | None = None
    without: tuple = ()
    limits: Limits = Limits()


def alone(**physics: object) -> dict:
    """Surface tension and what is given."""
    return {"volume_constraint": "none", "g": 0, "g_e": 0} | physics


def attracting(sigma: Attraction | float, matrix: NDArray, changed: float, **options: Any) -> Case:
    """Attraction and nothing else; `without` changes one of its values by a little."""
    without = {"sigma": np.where(matrix == changed, changed + 0.01, matrix)}
    return Case(
        physics=alone(sigma=sigma, g_e=options.pop("g_e", 0), kappa=options.pop("kappa", 0)),
        sigma=matrix,
        without=(without,),
        **options,
    )


VOLUME = Limits(first=9e-6, tenth=7e-5)
TERMS = {
    "tension": Case(physics=alone(), without=({"gamma": 0.24},)),
    "tension of each cell": Case(
        physics=alone(), gamma=(0.15, 0.25, 0.4), without=({"gamma": (0.15, 0.25, 0.39)},)
    ),
    "relative volume": Case(
        physics=alone(volume_constraint="relative"), without=({"M": 7.8},), limits=VOLUME
    ),
    "absolute volume": Case(
        physics=alone(volume_constraint="absolute", M=0.05), without=({"M": 0.049},), limits=VOLUME
    ),
    "shell": Case(
        physics=alone(g_e=16),
        shell=SHELL,
        without=({"g_e": 15.5},),
        limits=Limits(first=3e-5, tenth=1.2e-4),
    ),
    "repulsion": Case(physics=alone(g=1.6, g_e=NONE), shell=WIDE_SHELL, without=({"g": 1.58},)),
    "attraction": attracting(0.5, 0.5 * EVEN, 0.5, numerics={"precision": "single"}),
    "attraction by type": attracting(
        Attraction(types=BY_TYPE), TYPE_MATRIX, 0.3, types=TYPES, numerics={"precision": "single"}
    ),
    "attraction by pair": attracting(
        Attraction.from_matrix(NAMES, UNEVEN), UNEVEN, 0.1, shell=WIDE_SHELL, g_e=NONE, kappa=NONE
    ),
}
NOISE = Case(
    physics={"kappa": 0.3, "g": 0},
    numerics={"scheme": "imex1"},
    without=({"kappa": 0.28}, {"M": 7.7}),
    limits=Limits(first=9e-6, tenth=3e-5, centroid=0.2),
)
TOGETHER = Case(
    physics={"sigma": MIXED, "kappa": 0.3},
    numerics={"dt": 1.0, "S": 16.0},
    sigma=MIXED_MATRIX,
    gamma=(0.15, 0.25, 0.4),
    shell=SHELL,
    types=TYPES,
    without=(
        {"gamma": (0.15, 0.25, 0.38)}, {"M": 7.8}, {"g": 1.5}, {"g_e": 15.5}, {"kappa": 0.28},
        {"sigma": MIXED_MATRIX.T},
    ),
    limits=Limits(first=2.5e-5, tenth=4e-4, centroid=0.05),
)  # fmt: skip


def start(case: Case, frozen: tuple = ()) -> Engine:
    """Engine of the cells."""
    return make_engine(
        [sphere(*ball, tail=BOX_TOLERANCE / 3) for ball in BALLS],
        gamma=case.gamma,
        shell=case.shell,
        types=case.types,
        frozen=frozen,
        physics=case.physics,
        **({"box_tolerance": BOX_TOLERANCE} | case.numerics),
    )


def full_grid_model(
    engine: Engine, case: Case, targets: NDArray, low: NDArray, shape: tuple
) -> fg.Model:
    """The same scene on the full grid whose first lattice point is `low`."""
    physics, numerics = engine.physics, engine.numerics
    axes = [np.arange(a, a + n) * H for a, n in zip(low, shape, strict=True)]
    points = np.meshgrid(*axes, indexing="ij", sparse=True)
    form = physics.volume_constraint
    exact = numerics.laplacian == "exact" and numerics.active_solver == "dct"
    return fg.Model(
        h=H, gamma=case.gamma, g=physics.g, g_e=physics.g_e, kappa=physics.kappa,
        M=physics.volume_strength, volume_constraint=None if form == "none" else form,
        sigma=case.sigma, targets=targets,
        phi_e=None if case.shell is None else case.shell.field(*points),
        gradient=numerics.order,
        laplacian="exact" if exact else numerics.order,
    )  # fmt: skip


def full_grid_run(phi: NDArray, model: fg.Model, engine: Engine, steps: int) -> list[NDArray]:
    """Fields of the full grid after 1, 2, … steps."""
    numerics, found = engine.numerics, []
    fg.run(
        phi, model, numerics.dt, numerics.S, numerics.scheme, n_steps=steps,
        noise=normals(engine), on_step=lambda _, new: found.append(new),
    )  # fmt: skip
    return found


def check(case: Case) -> None:
    """Fields, centroids and volumes after one step and after ten."""
    engine = start(case)
    low, shape = grid_around(engine, margin=4)
    targets = GROWTH * engine.volumes
    model = full_grid_model(engine, case, targets, low, shape)
    begin = on_grid(engine, low, shape)
    expected = full_grid_run(begin, model, engine, steps=10)
    for change in case.without:
        other = full_grid_run(begin, replace(model, **change), engine, steps=1)
        assert np.abs(other[0] - expected[0]).max() > 5 * case.limits.first, change
    for steps, limit in ((1, case.limits.first), (10, case.limits.tenth)):
        advance(engine, steps - engine.steps, targets)
        phi, wanted = on_grid(engine, low, shape), expected[steps - 1]
        assert np.abs(phi - wanted).max() < limit
        np.testing.assert_allclose(engine.volumes, fg.volume(wanted, H), rtol=case.limits.volume)
    moved = centroids(engine) - full_centroids(wanted, low)
    assert np.abs(moved).max() < 1e-3 * case.limits.centroid


@pytest.mark.parametrize("name", TERMS)
def test_one_term(name: str) -> None:
    check(TERMS[name])


@pytest.mark.parametrize("laplacian", ["exact", "stencil"])
@pytest.mark.parametrize("order", [2, 4, 6])
def test_noise_and_order(order: int, laplacian: str) -> None:
    numerics = NOISE.numerics | {"order": order, "laplacian": laplacian}
    others = (
        {"gradient": 4 if order == 2 else 2},
        {"laplacian": order if laplacian == "exact" else "exact"},
    )
    check(replace(NOISE, numerics=numerics, without=NOISE.without + others))


@pytest.mark.parametrize("scheme", ["imex1", "euler"])
def test_small_steps_without_stabilisation(scheme: str) -> None:
    limits = Limits(first=3e-6 if scheme == "imex1" else 5e-6, tenth=1.2e-5)
    numerics = {"scheme": scheme, "S": 0.0, "dt": 0.05}
    check(replace(NOISE, numerics=numerics, limits=limits))


def test_all_terms_together() -> None:
    check(TOGETHER)


@pytest.mark.parametrize("transform", ["scipy", "pyfftw"])
def test_transforms_of_libraries(transform: str) -> None:
    check(replace(TERMS["relative volume"], numerics={"transform": transform}))


# --- cells that stand still, and cells that go ---------------------------------------------------

State = tuple[NDArray, NDArray | None, NDArray | None]
"""φⁿ, and φⁿ⁻¹ and Fⁿ⁻¹ if there are any."""
CROWD = Case(physics={"sigma": 0.5}, numerics={"precision": "single"}, sigma=0.5 * EVEN)


def second_order_steps(
    state: State, model: fg.Model, engine: Engine, steps: int, frozen: tuple = ()
) -> State:
    """Steps of the full grid by Eq. 9, in which frozen cells are put back each time."""
    dt, S = engine.numerics.dt, engine.numerics.S
    phi, old, old_force = state
    for _ in range(steps):
        force = fg.nonlinear_force(phi, model)
        if old is None:
            new = fg.solve_first_order(phi, force, model, dt, S)
        else:
            new = fg.step_second_order(phi, old, force, old_force, model, dt, S)
        new[list(frozen)] = phi[list(frozen)]
        phi, old, old_force = new, phi, force
    return phi, old, old_force


def test_a_frozen_cell_acts_and_stays() -> None:
    engine = start(CROWD, frozen=(0,))
    low, shape = grid_around(engine, margin=4)
    targets = GROWTH * engine.volumes
    model = full_grid_model(engine, CROWD, targets, low, shape)
    begin = on_grid(engine, low, shape)
    expected, *_ = second_order_steps((begin, None, None), model, engine, 10, frozen=(0,))
    free, *_ = second_order_steps((begin, None, None), model, engine, 10)
    phi = on_grid(advance(engine, 10, targets), low, shape)
    np.testing.assert_array_equal(phi[0], begin[0])
    assert np.abs(phi - expected).max() < 9e-5
    assert np.abs(free - expected)[1:].max() > 0.01


def test_a_removed_cell_acts_no_more_and_the_others_keep_their_history() -> None:
    keep = [0, 2]
    engine = start(CROWD)
    low, shape = grid_around(engine, margin=4)
    targets = GROWTH * engine.volumes
    model = full_grid_model(engine, CROWD, targets, low, shape)
    state = second_order_steps((on_grid(engine, low, shape), None, None), model, engine, 5)
    advance(engine, 5, targets).remove(1)
    assert engine.cells.names == ["0", "2"]
    left = replace(model, targets=targets[keep], gamma=0.25, sigma=0.5 * EVEN[:2, :2])
    with_history = tuple(part[keep] for part in state)
    expected, *_ = second_order_steps(with_history, left, engine, 5)
    fresh, *_ = second_order_steps((with_history[0], None, None), left, engine, 5)
    phi = on_grid(advance(engine, 5, targets[keep]), low, shape)
    assert np.abs(phi - expected).max() < 9e-5
    assert np.abs(fresh - expected).max() > 0.01
