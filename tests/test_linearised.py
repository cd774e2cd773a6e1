"""The scheme "linearised": against the full grid, its order, its steps of varying length."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from morphosim import Attraction, Term
from morphosim.engine.engine import Engine
from morphosim.engine.solvers.linearised import LinearisedSolver
from morphosim.engine.step_control import FIRST

from .helpers import H, advance, centroids, grid_around, make_engine, normals, on_grid, sphere
from .reference import full_grid as fg
from .test_engine_against_reference import (
    BALLS,
    BOX_TOLERANCE,
    GROWTH,
    NONE,
    TERMS,
    TOGETHER,
    TYPES,
    WIDE_SHELL,
    Case,
    full_grid_model,
    start,
)

# Terms that a scene leaves out act with no effect instead: one step is compiled for all tests.
FAINT = Attraction(types={("A", "B"): NONE}, pairs={("0", "1"): 2 * NONE})
ADHESION = Attraction(
    types={("A", "B"): 0.5, ("B", "A"): 0.5, ("B", "B"): 0.5},
    pairs={("0", "1"): 0.4, ("1", "0"): 0.4},
)


@dataclass(frozen=True, kw_only=True)
class NoDrift(Term):
    """A term that might drift, and does not."""


def adhering(balls: Sequence[tuple] = BALLS, **numerics: Any) -> Engine:
    """Balls that touch and adhere, in double precision."""
    chosen = {"box_tolerance": BOX_TOLERANCE, "scheme": "linearised", "S": 1.0} | numerics
    engine = make_engine(
        [sphere(*ball, tail=BOX_TOLERANCE / 3) for ball in balls], types=TYPES[: len(balls)],
        shell=WIDE_SHELL, physics={"sigma": ADHESION, "g_e": NONE, "terms": [NoDrift()]}, **chosen,
    )  # fmt: skip
    engine.cells["target"][:] = engine.volumes
    return engine


def take(engine: Engine, ticks: int) -> None:
    """A step of just so many ticks."""
    before, solver = engine.ticks, engine.solver
    assert isinstance(solver, LinearisedSolver)
    assert solver._control is not None
    solver._control.planned = ticks
    with engine.limited_threads():
        engine.step(ticks)
    assert engine.ticks == before + ticks


def run(engine: Engine, ticks: int) -> Iterator[Engine]:
    """Steps to a tick."""
    with engine.limited_threads():
        while engine.ticks < ticks:
            engine.step(ticks - engine.ticks)
            yield engine


# --- against the full grid -----------------------------------------------------------------------

LENGTHS = (FIRST, 12, 20)
"""Ticks; the first step is one without history."""
CASES = {
    "tension": replace(TERMS["tension of each cell"], limits=2e-5),
    "absolute volume": replace(TERMS["absolute volume"], limits=2e-5),
    "shell": replace(TERMS["shell"], limits=7e-5),
    "repulsion": replace(TERMS["repulsion"], limits=1e-4),
    "together": replace(TOGETHER, limits=2e-4, without=TOGETHER.without[-2:]),
}
"""`limits` are those of fields, about three times the measured ones, which stem from the band."""


def with_all_terms(case: Case) -> Case:
    faint = {"sigma": FAINT, "kappa": NONE, "g_e": NONE}
    given = {name: value for name, value in case.physics.items() if value or name not in faint}
    return replace(case, physics=faint | given, types=TYPES, shell=case.shell or WIDE_SHELL)


@pytest.mark.parametrize("name", CASES)
def test_steps_of_any_length_are_those_of_the_full_grid(name: str) -> None:
    case, S = with_all_terms(CASES[name]), 4.0
    numerics = {"dt": 4.0, "S": S, "sweeps": 40, "tolerance": 1000.0, "scheme": "linearised"}
    engine = start(replace(case, numerics=numerics))
    low, shape = grid_around(engine, margin=4)
    engine.cells["target"][:] = GROWTH * engine.volumes
    given = full_grid_model(engine, case, engine.cells["target"].copy(), low, shape)
    phi, old, before = on_grid(engine, low, shape), None, None
    for ticks in LENGTHS if name == "together" else LENGTHS[:2]:
        dt, draw = ticks * engine.numerics.tick, normals(engine)
        # Noise is stronger in a shorter step: displacements of all add up to the same.
        model = replace(given, kappa=given.kappa * engine.numerics.dt / dt)
        noise = None if draw is None else draw(engine.ticks)
        new = fg.step_linearised(phi, old, model, dt, S, before, noise)
        if old is None:
            for change in case.without:
                other = fg.step_linearised(phi, old, replace(model, **change), dt, S, before, noise)
                assert np.abs(other - new).max() > 5 * case.limits, change
        take(engine, ticks)
        assert np.abs(on_grid(engine, low, shape) - new).max() < case.limits
        np.testing.assert_allclose(engine.volumes, fg.volume(new, H), rtol=1e-4)
        phi, old, before = new, phi, dt


# --- order, and the tolerance --------------------------------------------------------------------

END = 12.0


def test_errors_fall_as_the_square_of_fixed_steps() -> None:
    """With the iterations that steps have by default, from a start without history."""
    ends = []
    for dt in (0.5, 0.25, 0.125):
        engine = adhering(dt=dt)
        begin = centroids(engine)
        ends.append(centroids(advance(engine, int(END / dt), engine.volumes)))
    assert np.abs(ends[-1] - begin).max() > 0.1
    coarse, fine = np.linalg.norm(np.diff(ends, axis=0), axis=(1, 2))
    assert np.log2(coarse / fine) == pytest.approx(2, abs=0.25)


def test_errors_fall_with_the_tolerance_and_are_near_it() -> None:
    """Nor are they understated."""
    engine = adhering(dt=1 / 16)
    exact = centroids(advance(engine, int(16 * END), engine.volumes))
    errors, steps = [], []
    for tolerance in (100.0, 6.0, 0.4):
        engine = adhering(dt=2.0, tolerance=tolerance)
        *_, engine = run(engine, int(32 * END))
        error = 1e3 * np.linalg.norm(centroids(engine) - exact, axis=1)
        assert (error < 3 * 1e3 * engine.cells["time_error"]).all()
        assert tolerance / 40 < error.max() < 1.5 * tolerance, "most of what 100 units may make"
        errors.append(error.max())
        steps.append(engine.steps)
    assert errors[0] > 2 * errors[1] > 4 * errors[2]
    assert steps == sorted(steps)
