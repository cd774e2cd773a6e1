"""A division restarts the history of the daughters alone: nearer to the full grid than of all."""

import numpy as np
from numpy.typing import NDArray

from morphosim.cell_field import CellField
from morphosim.engine.engine import Engine
from morphosim.simulation.division import divided

from .helpers import (
    H,
    advance,
    centroids,
    full_centroids,
    grid_around,
    make_engine,
    on_grid,
    sphere,
)
from .reference import full_grid as fg

SIGMA, STEPS, FINE = 0.8, 10, 8
"""Attraction; steps of δt = 2 before and after the division; steps of the full grid in each."""
BALLS = [((0, 0, 0), 3.5), ((7.2, 0.5, 0), 3.8), ((3, 6.4, 0.3), 3.5)]
AXIS, NAMES = (0, 1, 0.2), ("x", "y")


def start() -> Engine:
    return make_engine(
        [sphere(*ball, tail=1e-5) for ball in BALLS], physics={"sigma": SIGMA}, dt=2.0, S=6.0,
        walls="resolved", box_tolerance=1e-4,
    )  # fmt: skip


def halves(field: CellField) -> tuple[CellField, CellField]:
    return divided(field, H, AXIS, 0.5, NAMES, 1.0)


def full_grid_end() -> NDArray[np.float64]:
    """Centroids on the full grid with small steps, of cells 0, 2 and the daughters of 1."""
    engine = start()
    low, shape = grid_around(engine, margin=5)
    targets = engine.volumes.copy()

    def run(phi: NDArray, targets: NDArray) -> NDArray:
        n = len(phi)
        model = fg.Model(
            h=H, g=1.6, M=8.0, volume_constraint="relative", sigma=SIGMA * (1 - np.eye(n)),
            targets=targets, gradient=6, laplacian="exact",
        )  # fmt: skip
        return fg.run(phi, model, 2.0 / FINE, 0.0, n_steps=STEPS * FINE)

    phi = run(on_grid(engine, low, shape), targets)
    born = [half.phi for half in halves(CellField("1", np.zeros(3, int), phi[1]))]
    later = np.array([phi[0], phi[2], *born])
    half = targets[1] / 2
    return full_centroids(run(later, np.array([targets[0], targets[2], half, half])), low)


def engine_end(restart_all: bool) -> NDArray[np.float64]:
    """Centroids of the engine, at δt = 2."""
    engine = start()
    targets = engine.volumes.copy()
    advance(engine, STEPS, targets)
    half = targets[1] / 2
    values = {"name": NAMES, "target": [half, half]}
    engine.divide(1, values, ["", ""], halves(engine.field(1)))
    assert engine.cells["fresh"].tolist() == [False, False, True, True]
    if restart_all:
        engine.restart()
    advance(engine, STEPS, [targets[0], targets[2], half, half])
    return centroids(engine)


def test_keeping_the_history_of_others_lessens_the_error() -> None:
    exact = full_grid_end()
    errors = [np.linalg.norm(engine_end(way) - exact, axis=1) for way in (False, True)]
    kept, restarted = (float(np.sqrt(np.mean(error[:2] ** 2))) for error in errors)
    assert kept < 0.8 * restarted, (kept, restarted)
    daughters = [float(np.sqrt(np.mean(error[2:] ** 2))) for error in errors]
    assert daughters[0] < 1.1 * daughters[1], daughters
