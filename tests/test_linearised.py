"""The scheme "linearised": against the full grid, its order, its steps of varying length."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from morphosim import Attraction, Column, Simulation, Term, built_in_scene
from morphosim.cell_field import CellField
from morphosim.cell_table import CellTable
from morphosim.engine.engine import Engine
from morphosim.engine.solvers.linearised import LinearisedSolver
from morphosim.engine.step_control import FIRST
from morphosim.geometry.confinement import Confinement, EllipsoidShell
from morphosim.physics.term import Environment, Forces, Step
from morphosim.physics.volume_constraint import VolumeConstraint

from .helpers import (
    H,
    advance,
    assert_band_alone,
    centroids,
    grid_around,
    index_of,
    make_engine,
    normals,
    on_grid,
    sphere,
)
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


def adhering(
    balls: Sequence[tuple] = BALLS, shell: Confinement = WIDE_SHELL, **numerics: Any
) -> Engine:
    """Balls that touch and adhere, in double precision."""
    chosen = {"box_tolerance": BOX_TOLERANCE, "scheme": "linearised", "S": 1.0} | numerics
    engine = make_engine(
        [sphere(*ball, tail=BOX_TOLERANCE / 3) for ball in balls],
        types=[TYPES[k % len(TYPES)] for k in range(len(balls))], shell=shell,
        physics={"sigma": ADHESION, "g_e": NONE, "terms": [NoDrift()]}, **chosen,
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
    engine = adhering(dt=1 / 16)
    exact = centroids(advance(engine, int(16 * END), engine.volumes))
    errors, steps = [], []
    for tolerance in (100.0, 6.0, 0.4):
        engine = adhering(dt=2.0, tolerance=tolerance)
        *_, engine = run(engine, int(32 * END))
        error = 1e3 * np.linalg.norm(centroids(engine) - exact, axis=1)
        assert tolerance / 40 < error.max() < 1.5 * tolerance, "most of what 100 units may make"
        errors.append(error.max())
        steps.append(engine.steps)
    assert errors[0] > 2 * errors[1] > 4 * errors[2]
    assert steps == sorted(steps)


# --- steps that are tried again ------------------------------------------------------------------


def twins(count: int, **numerics: Any) -> list[Engine]:
    """Engines in the same state, on their way."""
    engine = adhering(**numerics)
    *_, engine = run(engine, 100)
    others = [adhering(**numerics) for _ in range(count - 1)]
    for other in others:
        other.restore(engine.contents(), engine.physics, engine.steps, engine.ticks)
    return [engine, *others]


def arrays(engine: Engine) -> dict[str, np.ndarray]:
    return engine.contents() | {
        "lost": engine.pool.lost.copy(),
        "totals": engine.pool.totals.copy(),
    }


def test_a_step_that_is_tried_again_loses_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    tried_again, at_once = twins(2, dt=2.0, tolerance=1.0)
    control, solver = tried_again.solver._control, tried_again.solver
    lengths, advance = [], solver.advance

    def watched(state: Any, most_of_all: Any) -> int | None:
        before = arrays(tried_again)
        lengths.append(state.ticks)
        shorter = advance(state, most_of_all)
        if shorter is not None:
            assert shorter < state.ticks
            after = arrays(tried_again)
            after["stepping"][2] = before["stepping"][2]  # the length that is planned
            for name, values in before.items():
                np.testing.assert_array_equal(after[name], values, err_msg=name)
        return shorter

    monkeypatch.setattr(solver, "advance", watched)
    tick, control.planned = tried_again.ticks, 400
    with tried_again.limited_threads():
        tried_again.step()
    assert len(lengths) > 1, "the first was too long"
    assert tried_again.ticks == tick + lengths[-1]
    take(at_once, lengths[-1])
    found, expected = arrays(tried_again), arrays(at_once)
    for name, values in expected.items():
        if values.dtype.kind == "f":
            np.testing.assert_allclose(found[name], values, rtol=1e-9, atol=1e-12, err_msg=name)
        else:
            np.testing.assert_array_equal(found[name], values, err_msg=name)


def apart(**numerics: Any) -> Engine:
    """Two balls that do not feel each other."""
    return adhering([((0.0, 0.0, 0.0), 2.5), ((15.0, 0.0, 0.0), 2.5)], **numerics)


@pytest.mark.parametrize("order", [6, "fitted"])
def test_the_finest_waves_do_not_grow(order: int | str) -> None:
    """Where S is 0: the iterations see less of Δ than the forces have."""
    *_, engine = run(apart(order=order, dt=2.0, S=0.0, spacing=0.35), 40)
    assert not engine.diverged().size
    fields = engine.pool.phi
    assert fields.min() > -0.1
    assert fields.max() < 1.2


def test_what_walls_do_implicitly_does_not_grow() -> None:
    """Where iterations leave 0.6 of it, the embryo diverges at t = 156."""
    chosen = {"scheme": "linearised", "dt": 4.0, "threads": 1}
    simulation = Simulation(built_in_scene("celegans-8").with_numerics(**chosen))
    simulation.step(45)
    assert max(field.phi.max() for field in simulation.fields) < 1.1


@pytest.mark.parametrize("tolerance", [None, 20.0])
def test_a_cell_that_diverges_keeps_its_field_and_stands_still(tolerance: float | None) -> None:
    engine = apart(tolerance=tolerance)
    pool = engine.pool
    *_, engine = run(engine, 10)
    pool.acting[index_of(pool, 0, (10, 10, 10))] = np.nan
    before = pool.phi.copy()
    with engine.limited_threads():
        engine.step()
    assert engine.diverged().tolist() == [0]
    np.testing.assert_array_equal(pool.box(0), pool.box(0, before))
    np.testing.assert_array_equal(pool.box(0, pool.acting), pool.box(0))
    assert pool.totals[0] == pytest.approx(pool.box(0).sum())
    assert np.isfinite(pool.box(1, pool.acting)).all()
    with engine.limited_threads():
        engine.step()
    assert not engine.diverged().size


def test_a_step_that_diverges_is_tried_again_shorter() -> None:
    """Also where there is noise, whose steps are else all of one length."""
    engine = apart(tolerance=20.0)
    engine.set_physics(replace(engine.physics, kappa=NONE))
    *_, engine = run(engine, 128)
    assert engine.steps == 2
    pool = engine.pool
    pool.acting[index_of(pool, 0, (10, 10, 10))] += 100
    with engine.limited_threads():
        engine.step()
    assert not engine.diverged().size
    assert engine.ticks < 128 + 64


# --- cells that move, come and go ----------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class Wind(Term):
    """All cells drift along x with the velocity v."""

    v: float
    tau: float = 2.62

    def update(self, cells: Any, step: Any, forces: Any) -> None:
        """Blow."""
        forces.drift[:, 0] -= self.tau * self.v


def assert_sound(engine: Engine) -> None:
    """Bands are as they should be, and sums are those of the fields."""
    pool = engine.pool
    for i in range(len(engine)):
        assert_band_alone(pool, i)
    sums = [[pool.box(i, p).sum() for i in range(len(engine))] for p in (pool.phi, pool.acting)]
    np.testing.assert_allclose(pool.surveys[:, 0], sums[0], rtol=1e-12)
    np.testing.assert_allclose(pool.totals, sums[1], rtol=1e-12)


def test_boxes_move_with_cells_whose_steps_differ() -> None:
    v, end, results = 0.2, 24, []
    for threads in (1, 2):
        engine = adhering(dt=1.0, tolerance=5.0, threads=threads, box_tolerance=1e-3)
        engine.set_physics(replace(engine.physics, terms=[Wind(v=v)]))
        begin, moved = centroids(engine).mean(axis=0), 0
        for now in run(engine, end * 64):
            moved += len(now.moved)
            assert_sound(now)
        assert moved > 2 * len(engine)
        way = centroids(engine).mean(axis=0) - begin
        assert way[0] == pytest.approx(v * end, rel=0.005), "5 per mille are allowed"
        assert np.abs(way[1:]).max() < 0.01 * v * end
        assert np.abs(engine.lost_volume).max() < 2e-3 * engine.volumes.min()
        results.append(arrays(engine))
    for name, values in results[0].items():
        np.testing.assert_array_equal(results[1][name], values, err_msg=name)


@dataclass(frozen=True, kw_only=True)
class Plate(Term):
    """A wall whose term does not say how strong it is."""

    strength: float
    behind: float

    def surround(self, environment: Environment) -> None:
        """Add it."""
        environment.add_wall(self, lambda x, y, z: self.strength * (x < self.behind) + 0 * (y + z))


@pytest.mark.parametrize("terms", [[], [Plate(strength=5e3, behind=-6.0)]])
def test_steps_are_the_same_whether_or_not_the_process_has_seen_a_wall(terms: list[Term]) -> None:
    """Iterations depend on the repulsion that there is or may be, not on what has been met."""
    walls = EllipsoidShell(center=(90, 0, 0), semi_axes=(93, 99, 99), width=1.0)
    engine = adhering(BALLS[:2], shell=walls, dt=4.0, tolerance=100.0, box_tolerance=1e-3)
    engine.set_physics(replace(engine.physics, g_e=16.0, terms=[Wind(v=0.2), *terms]))
    *_, engine = run(engine, 50 * 16)
    assert centroids(engine)[:, 0].min() > 8
    other = Engine(engine.physics, engine.numerics, walls)
    other.restore(engine.contents(), engine.physics, engine.steps, engine.ticks)
    for both in (engine, other):
        *_, both = run(both, 52 * 16)
    for name, values in arrays(engine).items():
        np.testing.assert_array_equal(arrays(other)[name], values, err_msg=name)


def test_iterations_know_how_many_cells_overlap() -> None:
    """A cell of a pile feels all others at one point, and is gone; none diverges."""
    engine = adhering(BALLS[:1] * 12, dt=2.0, tolerance=10.0, box_tolerance=1e-3)
    engine.set_physics(replace(engine.physics, g=100.0))
    *_, engine = run(engine, 64)
    assert len(engine.diverged()) == 0
    assert len(engine.vanished()) == 12
    saved = engine.contents()
    older = {key: values for key, values in saved.items() if key != "crowding"}
    older["stepping"] = saved["stepping"][:4]  # as before it was known
    others = [Engine(engine.physics, engine.numerics, engine.confinement) for _ in range(2)]
    for other, contents in zip(others, (saved, older), strict=True):
        other.restore(contents, engine.physics, engine.steps, engine.ticks)
    for each in (engine, *others):
        *_, each = run(each, 96)
    assert not others[1].diverged().size
    for name, values in arrays(engine).items():
        np.testing.assert_array_equal(arrays(others[0])[name], values, err_msg=name)


def test_cells_may_stop_go_on_and_go() -> None:
    engine = adhering(dt=2.0, tolerance=10.0)
    *_, engine = run(engine, 200)
    assert_sound(engine)
    pool = engine.pool
    engine.cells["frozen"][0] = True
    engine.restart([0])
    field = pool.box(0).copy()
    for now in run(engine, 400):
        np.testing.assert_array_equal(pool.box(0), field)
        np.testing.assert_array_equal(pool.box(0, pool.acting), field)
        assert_sound(now)
    engine.cells["frozen"][0] = False
    engine.restart([0])
    for now in run(engine, 600):
        assert_sound(now)
    assert np.abs(pool.box(0) - field).max() > 1e-3
    phi, origin, x = pool.box(0), pool.origin[0].copy(), np.arange(pool.shape[0, 0])
    sides = [(x < x.mean())[:, None, None] * phi, (x > x.mean())[:, None, None] * phi]
    halves = [CellField(name, origin, side) for name, side in zip("03", sides, strict=True)]
    targets = [side.sum() * H**3 for side in sides]
    engine.divide(0, {"name": ["0", "3"], "target": targets}, ["A", "A"], halves)
    assert_sound(engine)
    ticks, steps = engine.ticks, engine.steps
    for now in run(engine, ticks + 200):
        assert now.steps > steps + 1 or now.ticks - ticks <= FIRST
        assert_sound(now)
    assert engine.cells.names == ["1", "2", "0", "3"]
    engine.remove(1)
    history = pool.box(0, pool.acting).copy()
    engine.settle()
    np.testing.assert_array_equal(pool.box(0, pool.acting), history)
    *_, engine = run(engine, ticks + 300)
    assert_sound(engine)


def test_a_cell_that_shrinks_vanishes_without_end_of_the_run() -> None:
    engine = adhering([*BALLS[:2], ((9.0, 0.0, 0.0), 1.2)], dt=2.0, tolerance=10.0)
    engine.cells["target"][2] = 0.05
    for now in run(engine, 30 * 32):
        assert not now.overdue
        assert not now.diverged().size
        if now.vanished().size:
            assert now.vanished().tolist() == [2]
            now.remove(2)
    assert len(engine) == 2
    assert_sound(engine)


# --- the volume constraint -----------------------------------------------------------------------


def test_volumes_follow_targets_that_grow_without_lag() -> None:
    """The pressure is that of the new volume and the new target, however long the step."""
    rate, end, shares = 0.01, 40.0, []
    for dt in (0.25, 4.0):
        engine = apart(dt=dt)
        begin = engine.cells["target"].copy()

        def grow(time: float, engine: Engine = engine, begin: np.ndarray = begin) -> None:
            engine.cells["target"][:] = begin * (1 + rate * time)

        engine.targets = grow
        *_, engine = run(engine, int(end / dt))
        shares.append(engine.volumes[0] / engine.cells["target"][0])
    assert engine.cells["target"] == pytest.approx(1.4 * begin)
    assert shares[1] == pytest.approx(shares[0], abs=0.02 * rate * dt)


@pytest.mark.parametrize("kind", ["relative", "absolute"])
def test_stiffness_is_how_pressure_falls_with_volume(kind: str) -> None:
    cells = CellTable([Column("target")])
    cells.add({"name": ["a", "b"], "target": [40.0, 90.0]}, ["", ""])
    term = VolumeConstraint(kind=kind, M=0.7)

    def forces(volumes: np.ndarray) -> Forces:
        result = Forces(np.zeros(2), np.zeros((2, 3)), np.zeros(2))
        term.update(cells, Step(0, 0.0, 0.0, 1.0, 1.0, 0, volumes, 2.62), result)
        return result

    volumes, more = np.array([50.0, 60.0]), np.array([0.5, 0.3])
    change = forces(volumes + more).pressure - forces(volumes).pressure
    np.testing.assert_allclose(forces(volumes).stiffness, -change / more, rtol=1e-12)


def test_terms_that_press_add_up_their_stiffness() -> None:
    """Two constraints of half the strength are one."""
    ends = []
    for terms, M in (([], 8.0), ([VolumeConstraint(kind="relative", M=4.0)], 4.0)):
        engine = apart(dt=4.0)
        physics = replace(engine.physics, M=M, terms=[NoDrift(), *terms])
        engine.set_physics(physics)
        engine.cells["target"][:] *= 1.2
        *_, engine = run(engine, 5)
        ends.append(engine.volumes)
    np.testing.assert_allclose(*ends, rtol=1e-10)
