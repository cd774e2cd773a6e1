"""Periodic space: against the full grid, wherever its faces lie, over them, and what is refused.

The full grid of the reference is periodic by itself. Where a step need not be fast it is taken in
plain Python, on a coarse lattice.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from morphosim import (
    Attraction,
    Cell,
    Division,
    Gravity,
    Numerics,
    Physics,
    Polarity,
    RunWriter,
    Scene,
    Simulation,
    Sphere,
    Stage,
    load_scene,
    open_run,
    save_scene,
)
from morphosim.cell_field import CellField
from morphosim.engine.engine import Engine
from morphosim.kernels.layout import Boxes
from morphosim.kernels.rows import whole_rows
from morphosim.measure.label_image import label_image
from morphosim.measure.tissue import periodic_pair_correlation
from morphosim.period import Period, with_images
from morphosim.scene.ends import Duration
from morphosim.scene.fingerprint import settings
from morphosim.simulation import warming
from morphosim.simulation.kernel_calls import recorded

from .helpers import H, advance, make_engine, sphere
from .reference import full_grid as fg

L = 18.0
"""Twice as far as a cell's field reaches: of an image of its own a cell feels what others do."""
BALLS = [((0.4, 3.0, 17.2), 2.5), ((4.6, 3.6, 17.5), 2.5), ((15.8, 17.2, 1.0), 2.3)]
NAMES = ["0", "1", "2"]
SIGMA = np.array([[0, 0.5, 0.9], [0.2, 0, 0.1], [0.1, 0.7, 0]])
COARSE = Numerics(
    threads=1, dt=0.5, S=3.0, spacing=1.0, allow_coarse=True, precision="double",
    box_tolerance=1e-3, solver="band",
)  # fmt: skip
pytestmark = pytest.mark.filterwarnings(
    "ignore::morphosim.scene.stability.StabilityWarning",
    "ignore::morphosim.errors.ResolutionWarning",
)


@contextmanager
def plain_python() -> Iterator[None]:
    with warming.not_ahead(), recorded():
        yield


def folded(engine: Engine, n: int) -> NDArray[np.float64]:
    """Fields (N, n, n, n) on the grid of one period."""
    full = np.zeros((len(engine), n, n, n))
    for i in range(len(engine)):
        box = engine.pool.box(i)
        places = [(engine.pool.origin[i, a] + np.arange(box.shape[a])) % n for a in range(3)]
        np.add.at(full[i], np.ix_(*places), box)
    return full


def test_steps_are_those_of_the_full_periodic_grid() -> None:
    """With pairs that attract; every cell meets others over a face."""
    pull = Attraction.from_matrix(NAMES, SIGMA)
    engine = make_engine(
        [sphere(*ball, tail=3e-6) for ball in BALLS], physics={"sigma": pull, "kappa": 1e-30},
        period=(L, L, L), box_tolerance=1e-5,
    )  # fmt: skip
    n, targets = round(L / H), np.array([1.15, 1.0, 0.9]) * engine.volumes
    begin, physics, numerics = folded(engine, n), engine.physics, engine.numerics
    model = fg.Model(
        h=H, gamma=physics.gamma, g=physics.g, M=physics.volume_strength, targets=targets,
        volume_constraint="relative", sigma=SIGMA, gradient=numerics.order, laplacian="exact",
    )  # fmt: skip
    found: list[NDArray] = []
    for sigma in (SIGMA, SIGMA.T):
        fg.run(
            begin, replace(model, sigma=sigma), numerics.dt, numerics.S, numerics.scheme,
            n_steps=10, on_step=lambda _, new: found.append(new),
        )  # fmt: skip
    expected, other = found[9], found[19]
    phi = folded(advance(engine, 10, targets), n)
    assert np.abs(phi - expected).max() < 2e-4
    assert np.abs(other - expected).max() > 5e-3
    np.testing.assert_allclose(engine.volumes, fg.volume(expected, H), rtol=1e-4)


def packed(shift: Any = (0, 0, 0), **more: Any) -> Scene:
    """Eight cells of two types that fill a period, all of it shifted."""
    side = 10.0
    places = np.array([(i, j, k) for i in range(2) for j in range(2) for k in range(2)])
    centres = (places + 0.5) * side / 2 + np.array([0.3, 0, 0]) * (places[:, :1] % 2) + shift
    cells = [
        Cell(name=f"c{k}", type="ab"[k % 2], shape=Sphere(center=c, radius=2.5 + 0.1 * (k % 3)))
        for k, c in enumerate(centres)
    ]
    physics = Physics(sigma=0.3, terms=[Polarity(alpha=0.05, align={"neighbours": 0.1})])
    said = {"physics": physics, "numerics": COARSE, "period": (side,) * 3} | more
    return Scene(cells=cells, **said)


def test_all_is_the_same_wherever_the_faces_lie() -> None:
    """Places, contacts, and directions that follow from them; to rounding."""
    seen = []
    for shift in ((0, 0, 0), (3, -4, 107)):
        with plain_python():
            simulation = Simulation(packed(shift))
            simulation.step(2)
            measured, polarity = simulation.measured(), simulation.column("polarity")
        assert len(measured.contacts) >= 12
        seen.append(
            [
                simulation.centroids - shift, simulation.volumes, measured.contacts,
                measured.contact_area, measured.touched, measured.surface_area, polarity,
            ]
        )  # fmt: skip
    for a, b in zip(*seen, strict=True):
        np.testing.assert_allclose(a, b, atol=1e-9)


def test_two_cells_touch_on_either_side() -> None:
    """A row of balls along x: as in open space at a face, with twice the area."""
    cells = [
        Cell(name=n, shape=Sphere(center=(x, 0, 0), radius=3))
        for n, x in zip("ab", (1, 6), strict=True)
    ]
    scene = Scene(cells=cells, numerics=replace(COARSE, spacing=0.5))
    open_space = Simulation(scene).measured()
    both = Simulation(replace(scene, period=(10, 0, 0))).measured()
    alone = Simulation(replace(scene, cells=cells[:1], period=(5, 0, 0))).measured()
    assert both.contacts.tolist() == open_space.contacts.tolist() == [[0, 1]]
    np.testing.assert_allclose(both.contact_area, 2 * open_space.contact_area)
    np.testing.assert_allclose(both.touched, 2 * open_space.touched)
    assert len(alone.contacts) == 0  # no pair, but it is touched
    np.testing.assert_allclose(alone.touched, both.touched[:1])


def falling(**more: Any) -> Scene:
    """A ball that falls through the faces x = 0 and z = 0."""
    ball = Cell(name="ball", shape=Sphere(center=(1, 5, 1.5), radius=3))
    gravity = Gravity(weight=1.0, direction=(-1, 0, -2))
    said = {"physics": Physics(terms=[gravity]), "numerics": COARSE, "period": (24, 0, 24)} | more
    return Scene(cells=[ball], duration=10.0, **said)


def test_a_cell_crosses_faces_as_if_there_were_none(tmp_path: Path) -> None:
    with plain_python():
        simulation, free = Simulation(falling()), Simulation(falling(period=(0, 0, 0)))
        simulation.run(observers=[RunWriter(tmp_path / "run", 2.5)])
        free.run()
    np.testing.assert_allclose(simulation.centroids, free.centroids, atol=1e-9)
    assert simulation.centroids[0, 2] < -1
    np.testing.assert_allclose(simulation.errors.time, free.errors.time, rtol=1e-6, atol=1e-3)
    pool = simulation.engine.pool
    middle = pool.origin[0] + pool.shape[0] / 2
    assert (middle[[0, 2]] >= 0).all()
    assert (middle[[0, 2]] <= 24).all()
    with open_run(tmp_path / "run") as run:
        went = run["centroid"].values[:, 0]
        assert (np.diff(went[:, 2]) < -0.5).all()
    with plain_python():
        resumed = Simulation.from_run(tmp_path / "run", time=5.0)
        resumed.run(until=5)
    np.testing.assert_allclose(resumed.centroids % 24, simulation.centroids % 24, atol=0.2)


def test_a_run_goes_on_bit_for_bit(tmp_path: Path) -> None:
    with plain_python():
        whole, part = Simulation(falling()), Simulation(falling())
        whole.run()
        part.run(until=6, observers=[RunWriter(tmp_path / "run", 2.0)])
        resumed = Simulation.from_run(tmp_path / "run")
        resumed.run()
    np.testing.assert_array_equal(resumed.centroids, whole.centroids)
    np.testing.assert_array_equal(resumed.fields[0].phi, whole.fields[0].phi)


def test_daughters_of_a_cell_on_a_face_are_on_either_side() -> None:
    mother = Cell(name="m", shape=Sphere(center=(0, 5, 5), radius=3.5))
    division = Division(cell="m", axis=(1, 0, 0), daughters=("p", "q"))
    stage = Stage(name="s", end=Duration(1.0), events=[division])
    scene = Scene(cells=[mother], numerics=COARSE, period=(14, 14, 14), stages=[stage])
    with plain_python():
        simulation = Simulation(scene)
        simulation.run()
    assert sorted(simulation.names) == ["p", "q"]
    assert abs(np.diff(simulation.centroids[:, 0])) == pytest.approx(2.6, abs=0.4)
    middle = simulation.engine.pool.origin[:, 0] + simulation.engine.pool.shape[:, 0] / 2
    assert sorted(middle.round() > 7) == [False, True]


def test_images_are_those_that_come_near() -> None:
    period, shape = Period(np.array([20, 0, 30])), np.full((2, 3), 8)
    origin = np.array([[1, 50, 4], [9, 50, 15]])
    boxes = Boxes(origin, shape, np.array([0, 512]), *whole_rows(shape))
    owner, places = period.images(boxes, margin=3)
    assert owner.tolist() == [1, 0]
    assert places.tolist() == [[-11, 50, 15], [21, 50, 4]]
    every = with_images(boxes, owner, places)
    assert every.start.tolist() == [0, 512, 512, 0]
    assert every.origin[2:].tolist() == places.tolist()
    found = period.shifts(np.array([[-5, 500, 0], [38, -9, 27], [18, 0, 59]]), np.full((3, 3), 8))
    assert found.tolist() == [[20, 0, 0], [-40, 0, -30], [-20, 0, -60]]
    assert Period.of((0, 0, 0), 0.5) is None
    ways = period.shortest(np.array([[6.0, 40, -14], [-9, 3, 16]]), 0.5)
    assert ways.tolist() == [[-4, 40, 1], [1, 3, 1]]


def test_files_and_states_say_it(tmp_path: Path) -> None:
    scene = packed()
    save_scene(scene, tmp_path / "s.toml")
    assert load_scene(tmp_path / "s.toml").period == (10, 10, 10)
    assert settings(scene) != settings(replace(scene, period=(10, 10, 0)))
    assert "period" not in settings(replace(scene, period=(0, 0, 0)))
    save_scene(replace(scene, period=(0, 0, 0)), tmp_path / "open.toml")
    assert "period" not in (tmp_path / "open.toml").read_text(encoding="utf-8")
    assert "10 x 10 x - µm" in repr(replace(scene, period=(10, 10, 0)))


def test_a_label_image_is_one_period() -> None:
    """Of a cell over a face and one within, and of a whole axis that does not repeat."""
    box = np.ones((4, 3, 2))
    fields = [CellField("a", np.array([8, 0, -1]), box), CellField("b", np.array([3, 1, 2]), box)]
    origin, labels = label_image(fields, period=Period(np.array([10, 0, 6])))
    assert origin.tolist() == [0, 0, 0]
    assert labels.shape == (10, 4, 6)
    first = {(x, y, z) for x in (8, 9, 0, 1) for y in (0, 1, 2) for z in (5, 0)}
    second = {(x, y, z) for x in (3, 4, 5, 6) for y in (1, 2, 3) for z in (2, 3)}
    for number, expected in ((1, first), (2, second)):
        assert set(map(tuple, np.argwhere(labels == number).tolist())) == expected


def test_pairs_over_faces_count() -> None:
    points = np.random.default_rng(2).uniform(-50, 100, (4000, 3))
    edges = np.linspace(0, 12, 7)
    g, pairs = periodic_pair_correlation(points, (20.0, 30.0, 25.0), edges)
    np.testing.assert_allclose(g[:5], 1, atol=4 / np.sqrt(pairs[:5].min()))
    assert np.isnan(g[5])  # beyond 10
    near = np.array([[0.5, 0, 0], [19.5, 0, 0]])
    assert periodic_pair_correlation(near, (20.0,) * 3, edges)[1].tolist() == [1, 0, 0, 0, 0, 0]


@pytest.mark.parametrize("period", [(10.3, 0, 0), (0, -10, 0), (0, 0, 3), (np.nan, 0, 0), (10, 10)])
def test_lengths_that_no_lattice_has_are_refused(period: Any) -> None:
    with pytest.raises(ValueError, match=r"scene\.period"):
        packed(period=period)
