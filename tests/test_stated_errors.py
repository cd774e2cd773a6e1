"""Errors that a run states of itself, against true ones."""

import numpy as np
import pytest

from morphosim import (
    Attraction,
    BoxWalls,
    Cell,
    Ellipsoid,
    Numerics,
    Physics,
    ResolutionWarning,
    RunWriter,
    Scene,
    Simulation,
    Sphere,
    built_in_scene,
    open_run,
)
from morphosim.cli.run_facts import run_facts
from morphosim.engine import accuracy
from morphosim.engine.accuracy import Errors

WITHIN = 3.0
TIMES = (16.0, 48.0, 96.0)


def fast(**changes):
    return Numerics(solver="band", threads=1, **changes)


def pair(**numerics):
    """Two cells that adhere, off the axes of the lattice."""
    places = {"a": (0.0, 0.0, 0.0), "b": (6.1, 1.0, 0.4)}
    cells = [Cell(name=n, shape=Sphere(center=c, radius=3.0)) for n, c in places.items()]
    return Scene(
        cells=cells, numerics=fast(**numerics), physics=Physics(sigma=0.5), duration=1000.0
    )


def course(scene, times=TIMES):
    """Centroids and stated errors of a run at some times."""
    simulation, found = Simulation(scene), []
    for time in times:
        simulation.run(until=time)
        found.append((simulation.centroids, simulation.errors))
    return found


def rms(values):
    return float(np.sqrt(np.mean(values**2)))


def distance(one, other):
    """Root mean square distance of centroids, nm."""
    return 1e3 * rms(np.linalg.norm(one - other, axis=1))


@pytest.fixture(scope="module")
def fine():
    """The pair with short steps."""
    return course(pair(dt=0.25, S=3.0))


def test_a_place_is_the_centroid_and_second_moments_without_their_trace():
    shape = Ellipsoid(center=(0.3, -0.2, 0.1), semi_axes=(4.5, 3.0, 2.6))
    cell = Cell(name="a", shape=shape)
    simulation = Simulation(Scene(cells=[cell], numerics=fast(), duration=1000.0))
    simulation.run(until=4)
    place, h, (field,) = simulation.column("error_place")[0], 0.5, list(simulation.fields)
    points = np.stack(np.meshgrid(*map(np.arange, field.phi.shape), indexing="ij"), -1) * h
    weight = field.phi.astype(float) / field.phi.sum(dtype=float)
    centre = np.tensordot(weight, points, 3)
    moments = np.einsum("xyz,xyzi,xyzj->ij", weight, points - centre, points - centre)
    moments -= np.eye(3) * np.trace(moments) / 3
    radius = (3 * float(simulation.volumes[0]) / (4 * np.pi)) ** (1 / 3)
    np.testing.assert_allclose(place[:3], simulation.centroids[0], atol=1e-6)
    expected = moments[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]] * [1, 1, 1, *[np.sqrt(2)] * 3]
    np.testing.assert_allclose(place[3:], expected * 5 / (2 * np.sqrt(3) * radius), atol=1e-5)


SCHEMES = (
    {},
    {"dt": 4.0},
    {"S": 12.0},
    {"scheme": "imex1", "dt": 0.5, "S": 0.5},
    {"scheme": "imex1", "dt": 0.5, "S": 0.0},
    {"scheme": "linearised", "dt": 4.0},
)


@pytest.mark.parametrize("numerics", SCHEMES, ids=str)
def test_error_in_time_is_that_against_short_steps(fine, numerics):
    for (found, errors), (true, _) in zip(course(pair(**numerics)), fine, strict=True):
        assert 1 / WITHIN < rms(errors.time) / distance(found, true) < WITHIN


def pursuing(**numerics):
    """The embryo with attractions drawn at random, in which cells pull on others that do not."""
    scene = built_in_scene("celegans-8").with_numerics(
        spacing=0.6, order="fitted", box_tolerance=3e-3, solver="band", threads=1, **numerics
    )
    table = np.random.default_rng(0).uniform(0, 0.98, (8, 8))
    np.fill_diagonal(table, 0)
    return scene.with_physics(sigma=Attraction.from_matrix(scene.names, table))


@pytest.mark.parametrize(
    ("make", "times"), [(pair, (50.0, 93.0, 150.0)), (pursuing, (25.0, 49.9, 50.0))]
)
def test_error_in_time_of_steps_that_vary_is_that_against_short_ones(make, times):
    """Whether they end at a save or not, of cells that come to rest and of some that do not."""
    true = course(make(scheme="linearised", dt=0.5), times)
    found = course(make(tolerance=20.0), times)
    ratios = [
        rms(errors.time) / max(distance(here, there), 0.5)
        for (here, errors), (there, _) in zip(found, true, strict=True)
    ]
    assert min(ratios) > 1 / WITHIN, ratios
    assert max(ratios) < WITHIN, ratios


def test_error_of_shape_is_that_against_short_steps():
    shape = Ellipsoid(center=(0.0, 0.0, 0.0), semi_axes=(4.5, 3.0, 2.6))
    axes, stated = [], 0.0
    for dt in (2.0, 0.25):
        cell = Cell(name="a", shape=shape)
        simulation = Simulation(Scene(cells=[cell], numerics=fast(dt=dt), duration=1000.0))
        simulation.run(until=24)
        axes.append(simulation.measured().semi_axes)
        stated = stated or float(simulation.errors.shape[0])
    assert 1 / WITHIN < stated / (1e3 * rms(axes[0] - axes[1])) < WITHIN
    assert float(simulation.errors.time[0]) < 1  # the centroid stays where it is


def test_error_in_space_is_that_against_a_finer_lattice():
    steps = {"dt": 1.0, "S": 12.0}
    (found, errors), (true, less) = (
        course(pair(spacing=h, **steps), (96.0,))[0] for h in (0.75, 0.375)
    )
    assert 1 / WITHIN < rms(errors.space) / distance(found, true) < WITHIN
    assert rms(less.space) < 0.5 * rms(errors.space)


def pressed(**numerics):
    """A cell in a corner of a box."""
    walls = BoxWalls(lower=(-2.6, -2.5, -2.6), upper=(20, 20, 20))
    cell = Cell(name="a", shape=Sphere(center=(0.2, 0.3, 0.2), radius=3.0))
    return Scene(cells=[cell], numerics=fast(**numerics), confinement=walls, duration=1000.0)


def test_walls_count_where_they_press_from_one_side():
    both = BoxWalls(lower=(-2.6, -2.6, -2.6), upper=(2.6, 2.6, 2.6))
    ball = Cell(name="a", shape=Sphere(center=(0, 0, 0), radius=3.0))
    held = Scene(cells=[ball], numerics=fast(), confinement=both, duration=1000.0)
    corner, middle, stepped = (
        float(course(scene, (16.0,))[0][1].space[0])
        for scene in (pressed(), held, pressed(walls="stepped"))
    )
    assert corner > 5 > 1 > middle
    assert stepped > 2 * corner  # a stepped wall is off by up to half a spacing


def test_errors_do_not_depend_on_threads_or_on_saves_between():
    one, two = Simulation(pair()), Simulation(pair().with_numerics(threads=2))
    one.run(until=40)
    for time in range(2, 42, 2):
        two.run(until=time)
    for name in ("time", "shape", "space", "way"):
        assert np.array_equal(getattr(one.errors, name), getattr(two.errors, name))


def test_saves_hold_the_errors_and_a_run_that_goes_on_has_the_same(tmp_path):
    whole = Simulation(pair())
    whole.run(until=64, observers=[RunWriter(tmp_path / "whole", every=32)])
    first = Simulation(pair())
    first.run(until=32, observers=[RunWriter(tmp_path / "part", every=32)])
    again = Simulation.from_run(tmp_path / "part")
    again.run(until=64, observers=[RunWriter(tmp_path / "part", every=32, resume=True)])
    runs = [open_run(tmp_path / name) for name in ("whole", "part")]
    for name in ("time_error", "shape_error", "space_error"):
        assert np.array_equal(runs[0][name], runs[1][name])
        assert runs[0][name].attrs["units"] == "nm"
    assert np.array_equal(runs[0]["time_error"].values[-1], whole.errors.time)
    assert f"error: {whole.errors}" in run_facts(runs[0], tmp_path / "whole").splitlines()


def test_daughters_have_their_mothers_error_and_begin_anew():
    simulation = Simulation(pair(dt=4.0))
    simulation.run(until=40)
    before = simulation.errors
    gone = before.way.copy()
    simulation.divide("a", ("a1", "a2"), axis=(1, 0, 0))
    after = simulation.errors
    assert after.time.tolist() == [before.time[1], before.time[0], before.time[0]]
    assert after.way[1:].tolist() == [0, 0]
    simulation.run(until=44)
    assert np.array_equal(before.way, gone)  # what was told stays
    assert simulation.errors.time[1:].max() > 1.5 * before.time[0]  # new cells move, and lag


def test_a_cell_at_rest_keeps_a_small_error():
    cell = Cell(name="a", shape=Sphere(center=(0.1, 0.2, 0.3), radius=3.0))
    simulation = Simulation(Scene(cells=[cell], numerics=fast(), duration=10000.0))
    simulation.run(until=2000)
    errors = simulation.errors
    assert errors.time[0] < 1
    assert errors.space[0] < 2


def errors_of(space, way):
    none = np.zeros(1)
    return Errors(time=none, shape=none, space=np.array([space]), boxes=none, way=np.array([way]))


@pytest.mark.parametrize(
    ("space", "way", "coarse"),
    [(150.0, 4.0, True), (150.0, 40.0, False), (20.0, 0.1, False), (150.0, 0.0, False)],
)
def test_a_lattice_is_too_coarse_by_its_error_and_the_way_that_cells_have_gone(space, way, coarse):
    text = errors_of(space, way).too_coarse(0.5)
    assert bool(text) == coarse
    if coarse:
        assert "about 150 nm so far, 3.8 % of the way" in text
        assert "Take spacing = 0.36" in text


def test_a_run_warns_once_of_a_lattice_that_is_too_coarse(monkeypatch):
    simulation = Simulation(pair())
    simulation.run(until=16)  # warnings are errors here
    monkeypatch.setattr(accuracy, "COARSE", 1e-4)
    monkeypatch.setattr(accuracy, "OF_THE_WAY", 1e-6)
    with pytest.warns(ResolutionWarning, match="spacing = 0.5 µm does not resolve this scene"):
        simulation.run(until=20)
    simulation.run(until=24)
