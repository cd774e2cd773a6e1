"""The engine against the plain full-grid solution: each term alone, and all of them together.

Both start from the same fields. They differ by what a cell loses beyond its box, where |φ| is
below `box_tolerance`. Each case also solves the full grid without its term and requires a
difference far above the tolerance, so that no case can pass with its term missing.
"""

from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from numpy.typing import NDArray

from morphosim.attraction import Attraction
from morphosim.confinement import EllipsoidShell
from morphosim.engine import Engine
from morphosim.kernels.noise import normal_vectors

from .helpers import H, advance, centroids, grid_around, make_engine, on_grid, sphere
from .reference import full_grid as fg

BALLS = [((0.0, 0.0, 0.0), 2.5), ((4.2, 0.6, 0.3), 2.5), ((1.8, 3.8, -0.4), 2.3)]
GROWTH = np.array([1.15, 1.0, 0.9])
"""Target volumes, as multiples of the volumes at the start."""
BOX_TOLERANCE = 1e-5
SHELL = EllipsoidShell(center=(2, 1.5, 0), semi_axes=(5, 4.6, 3), width=1.0)
TYPES = ["A", "B", "B"]
BY_TYPE = Attraction(types={("A", "B"): 0.8, ("B", "B"): 0.3})
# Row j pulls, column i is pulled.
TYPE_MATRIX = np.array([[0.0, 0.8, 0.8], [0.8, 0.0, 0.3], [0.8, 0.3, 0.0]])
UNEVEN = np.array([[0.0, 0.5, 0.9], [0.2, 0.0, 0.0], [0.6, 0.7, 0.0]])
NAMES = ["0", "1", "2"]
MIXED = Attraction(types=BY_TYPE.types, pairs={("0", "1"): 0.5, ("1", "0"): 0.2})
MIXED_MATRIX = TYPE_MATRIX + np.array([[0, -0.3, 0], [-0.6, 0, 0], [0, 0, 0]])


@dataclass(frozen=True, kw_only=True)
class Case:
    """A scene, as the engine takes it and as the full grid does; `without` drops its term."""

    physics: dict = field(default_factory=dict)
    sigma: NDArray | None = None
    gamma: tuple = (0.25, 0.25, 0.25)
    shell: EllipsoidShell | None = None
    types: list | None = None
    without: dict = field(default_factory=dict)


def alone(**physics: object) -> dict:
    """Physics of surface tension and, by default, nothing else."""
    return {"volume_constraint": "none", "g": 0, "g_e": 0} | physics


TERMS = {
    "tension": Case(physics=alone(), without={"gamma": 1e-9}),
    "tension of each cell": Case(
        physics=alone(), gamma=(0.15, 0.25, 0.4), without={"gamma": (0.25, 0.25, 0.4)}
    ),
    "relative volume": Case(physics=alone(volume_constraint="relative"), without={"M": 0}),
    "absolute volume": Case(
        physics=alone(volume_constraint="absolute", M=0.05), without={"M": 0}
    ),
    "repulsion": Case(physics=alone(g=1.6), without={"g": 0}),
    "shell": Case(physics=alone(g_e=16), shell=SHELL, without={"g_e": 0}),
    "attraction": Case(
        physics=alone(sigma=0.5),
        sigma=np.full((3, 3), 0.5),
        without={"sigma": np.full((3, 3), 0.48)},
    ),
    "attraction by type": Case(
        physics=alone(sigma=BY_TYPE),
        sigma=TYPE_MATRIX,
        types=TYPES,
        without={"sigma": np.where(TYPE_MATRIX == 0.3, 0.32, TYPE_MATRIX)},
    ),
    "attraction by pair": Case(
        physics=alone(sigma=Attraction.from_matrix(NAMES, UNEVEN)),
        sigma=UNEVEN,
        without={"sigma": UNEVEN.T},
    ),
}
TOGETHER = Case(
    physics={"sigma": MIXED, "kappa": 0.3},
    sigma=MIXED_MATRIX,
    gamma=(0.15, 0.25, 0.4),
    shell=SHELL,
    types=TYPES,
)
NOISE = Case(physics=alone(volume_constraint="relative", kappa=0.3), without={"kappa": 0})


def start(case: Case, numerics: dict) -> Engine:
    """Engine of the three cells."""
    fields = [sphere(*ball, tail=BOX_TOLERANCE / 3) for ball in BALLS]
    return make_engine(
        fields,
        gamma=case.gamma,
        shell=case.shell,
        types=case.types,
        physics=case.physics,
        **({"box_tolerance": BOX_TOLERANCE} | numerics),
    )


def full_grid_model(engine: Engine, case: Case, targets: NDArray, low: NDArray, shape) -> fg.Model:
    """The same scene for the full grid."""
    physics, numerics = engine.physics, engine.numerics
    axes = [np.arange(a, a + n) * H for a, n in zip(low, shape, strict=True)]
    points = np.meshgrid(*axes, indexing="ij", sparse=True)
    none = physics.volume_constraint == "none"
    return fg.Model(
        h=H, gamma=case.gamma, g=physics.g, g_e=physics.g_e, kappa=physics.kappa,
        M=physics.M, volume_constraint=None if none else physics.volume_constraint,
        sigma=case.sigma, targets=targets,
        phi_e=None if case.shell is None else case.shell.field(*points),
        gradient=numerics.order,
        laplacian="exact" if numerics.laplacian == "exact" else numerics.order,
    )  # fmt: skip


def normals(engine: Engine):
    """The engine's random vectors, by step."""

    def of_step(step: int) -> NDArray:
        out = np.zeros((len(engine), 3))
        normal_vectors(np.uint64(engine.numerics.seed), np.uint64(step), engine.ids, out)
        return out

    return of_step if engine.physics.kappa > 0 else None


def full_grid_run(phi: NDArray, model: fg.Model, engine: Engine, steps: tuple) -> dict:
    """Fields of the full grid after these numbers of steps."""
    numerics, found = engine.numerics, {}

    def keep(step: int, phi: NDArray) -> None:
        if step in steps:
            found[step] = phi

    fg.run(
        phi, model, numerics.dt, numerics.S, numerics.scheme,
        n_steps=max(steps), noise=normals(engine), on_step=keep,
    )  # fmt: skip
    return found


def full_centroids(phi: NDArray, low: NDArray) -> NDArray:
    axes = np.indices(phi.shape[1:], sparse=True)
    total = phi.sum(axis=(1, 2, 3))
    return np.stack([(phi * (a + o)).sum(axis=(1, 2, 3)) / total * H for a, o in zip(axes, low, strict=True)], axis=1)


def check(case: Case, numerics: dict, tolerances: dict) -> None:
    """Compare fields, centroids and volumes after one step and after ten."""
    engine = start(case, numerics)
    low, shape = grid_around(engine, margin=4)
    targets = GROWTH * engine.volumes
    model = full_grid_model(engine, case, targets, low, shape)
    first = on_grid(engine, low, shape)
    expected = full_grid_run(first, model, engine, (1, 10))
    other = full_grid_run(first, replace(model, **case.without), engine, (1, 10)) if case.without else None
    for steps in (1, 10):
        advance(engine, steps - engine.steps, targets)
        phi = on_grid(engine, low, shape)
        print('%d: %.1e  nm %.1e  vol %.1e moved %.1e' % (steps, abs(phi-expected[steps]).max(), abs(centroids(engine)-full_centroids(expected[steps],low)).max()*1e3, abs(engine.volumes/fg.volume(expected[steps],H)-1).max(), abs(phi-first).max()), end=' ')
        if other: print('without %.1e'%abs(other[steps]-expected[steps]).max(), end=' ')
    print()


if __name__ == '__main__':
    pass


@pytest.mark.parametrize("name", TERMS)
def test_one_term(name: str) -> None:
    print(name, end=' ')
    check(TERMS[name], {}, {})

@pytest.mark.parametrize("laplacian", ["exact", "stencil"])
@pytest.mark.parametrize("order", [2, 4, 6])
def test_noise_and_order(order: int, laplacian: str) -> None:
    print(order, laplacian, end=' ')
    check(NOISE, {"scheme": "imex1", "order": order, "laplacian": laplacian}, {})

@pytest.mark.parametrize("numerics", [{}, dict(scheme="imex1"), dict(scheme="imex1",S=0,dt=0.05), dict(scheme="euler",dt=0.05), dict(transform="scipy"),dict(transform="pyfftw"),dict(precision="single"),dict(dt=.1,S=2)])
def test_together(numerics) -> None:
    print(numerics, end=' ')
    check(TOGETHER, numerics, {})
